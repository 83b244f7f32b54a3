"""What a variant of the decomposition ignores it neither reads nor depends on: it may stay out of the key."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import pytest
from pydantic.fields import FieldInfo

import stages
from benchmarks.paper.laboratory import results_of
from pipeline import Settings
from pipeline.command.terminal import Terminal
from pipeline.settings import is_group, settings_that_matter
from stages.decomposition import DECOMPOSITION, DECOMPOSITION_BY_TRANSFER, DecompositionSettings
from stages.decomposition_under_light import DECOMPOSITION_UNDER_LIGHT
from tests.rendered_scene import TINY

VARIANTS = {
    "paper": DECOMPOSITION,
    "harmonics": DECOMPOSITION_BY_TRANSFER,
    "directions": DECOMPOSITION_UNDER_LIGHT,
}
ASKED: dict[str, dict[str, Any]] = {
    "paper": {"mode": "paper", "paper": {"max_alternations": 3}},
    "paper, solver: fast": {"mode": "paper", "solver": "fast", "fast": {"max_rounds": 2}},
    "harmonics": {"light": "harmonics", "fast": {"max_rounds": 2}, "harmonics": {"refreshes": 1}},
    "directions": {"fast": {"max_rounds": 2}},
}
OTHERS = {  # another value where that of `another` would not do
    "light": "harmonics",
    "solver": "fast",
    "shading_doubt": (0.3,) * 7,
}


def guarded(settings: Settings, ignored: set[str]) -> Settings:
    """The same settings, but that reading one of the ignored, by its public name, fails."""
    kind = type(settings)
    values = {name: getattr(settings, name) for name in kind.model_fields}
    public = {name: field.alias or name for name, field in kind.model_fields.items()}
    for name, value in values.items():
        if isinstance(value, Settings):
            inside = {
                one.removeprefix(f"{public[name]}.") for one in ignored if one.startswith(f"{public[name]}.")
            }
            everything = {field.alias or own for own, field in type(value).model_fields.items()}
            values[name] = guarded(value, everything if public[name] in ignored else inside)

    def read(self: Settings, name: str) -> Any:
        assert public.get(name) not in ignored or isinstance(values[name], Settings), f"{name} was read"
        return kind.__getattribute__(self, name)

    watched = type(f"Guarded{kind.__name__}", (kind,), {"__getattribute__": read, "__module__": __name__})
    return watched.model_construct(**values)


def another(name: str, value: Any, field: FieldInfo) -> Any:
    """A value that is not this one and is allowed."""
    if name in OTHERS:
        return OTHERS[name]
    if value is None:
        return 1 if "int" in str(field.annotation) else 0.5
    if isinstance(value, int):
        return value + 1
    return tuple(1.25 * one for one in value) if isinstance(value, tuple) else 0.75 * value


def changed(settings: Settings, ignored: set[str], everything: bool = False) -> Settings:
    """The same settings with another value of each that is ignored."""
    changes: dict[str, Any] = {}
    for name, field in type(settings).model_fields.items():
        public, value = field.alias or name, getattr(settings, name)
        if is_group(field.annotation):
            inside = {one.removeprefix(f"{public}.") for one in ignored if one.startswith(f"{public}.")}
            changes[public] = changed(value, inside, everything or public in ignored)
        else:
            changed_here = everything or public in ignored
            changes[public] = another(public, value, field) if changed_here else value
    return type(settings)(**changes)


@pytest.fixture(scope="module")
def inputs(tmp_path_factory) -> dict[str, Path]:
    """Every artefact that some variant takes, of a tiny rendered scene, by name."""
    workspace = tmp_path_factory.mktemp("ignored") / "w"
    given = {
        "render": TINY | {"views": 2, "arc_deg": 20.0, "width_px": 32, "height_px": 40},
        "transfer": {"max_vertices": 2000},
        "lighting": {"samples": 1000, "bounces": 0, "specular": {"remove": False}},
    }
    flow = stages.experiment({})
    return dict(results_of(flow, {}, given, workspace, "lighting", 2, Terminal()).paths)


@pytest.mark.parametrize("asked", ASKED)
def test_what_is_ignored_is_neither_read_nor_does_it_change_a_byte(asked, inputs, make_job, tmp_path):
    settings = DecompositionSettings(**ASKED[asked])
    stage = VARIANTS[settings.kind_of_light]
    ignored = set(stage.ignores)
    other = changed(settings, ignored)
    assert settings_that_matter(other, ignored) == settings_that_matter(settings, ignored)
    before, after = settings_that_matter(settings), settings_that_matter(other)
    assert {name for name in before if before[name] != after[name]} == {
        name for name in before if name in ignored or any(name.startswith(f"{one}.") for one in ignored)
    }
    written = []
    for number, how in enumerate([settings, guarded(other, ignored)]):
        takes = {name: inputs[name] for name in stage.takes}
        job = make_job(tmp_path / str(number), stage, how, **takes)
        stage.run(job)
        written.append(contents(tmp_path / str(number)))
    assert written[0].keys() == written[1].keys()
    assert [name for name in written[0] if written[0][name] != written[1][name]] == []


def test_a_guarded_setting_fails_when_it_is_read():
    settings = guarded(DecompositionSettings(), {"degree", "paper", "fast.gap", "lambda"})
    assert (settings.mode, settings.mu, settings.fast.tolerance) == ("transfer", None, None)
    for read in (
        lambda: settings.degree,
        lambda: settings.lambda_,
        lambda: settings.paper.delta,
        lambda: settings.fast.gap,
    ):
        with pytest.raises(AssertionError, match="was read"):
            read()


def contents(folder: Path) -> dict[str, bytes]:
    """All files below a folder, by relative path."""
    return {
        path.relative_to(folder).as_posix(): path.read_bytes()
        for path in sorted(folder.rglob("*"))
        if path.is_file()
    }
