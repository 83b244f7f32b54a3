"""Settings and sources from YAML and the command line, checked."""

from __future__ import annotations

import json
import re
from collections.abc import Iterable, Mapping
from copy import deepcopy
from dataclasses import dataclass, field
from pathlib import Path
from types import MappingProxyType
from typing import Any

import yaml
from pydantic import ValidationError
from yaml.error import MarkedYAMLError

from pipeline.errors import UserError
from pipeline.settings import Settings, is_group, near


class _Loader(yaml.SafeLoader):
    """Safe YAML in which 1e-6 is a number, none is null, and duplicate names are refused.

    PyYAML accepts only 1.0e-6 and null, reads the others as text, and drops the first of two equal names.
    """

    def compose_mapping_node(self, anchor: object) -> yaml.MappingNode:
        """Compose a mapping as PyYAML does; refuse duplicate names."""
        node = super().compose_mapping_node(anchor)  # type: ignore[arg-type]  # types-PyYAML has it a dict
        names = [name.value for name, _ in node.value]
        for place, (name, _) in enumerate(node.value):
            if name.value in names[:place]:
                raise MarkedYAMLError(
                    problem=f"a second {name.value!r}, but each was expected once (join them or remove one)",
                    problem_mark=name.start_mark,
                )
        return node


_Loader.add_implicit_resolver("tag:yaml.org,2002:null", re.compile("[nN]one$"), ["n", "N"])
_Loader.add_implicit_resolver(
    "tag:yaml.org,2002:float", re.compile(r"[-+]?(\d+\.?\d*|\.\d+)[eE][-+]?\d+$"), list("-+.0123456789")
)


NOTHING_RENAMED: Mapping[str, str] = MappingProxyType({})
A_LIST = 'a list, as in [1.5, 2] or ["001", "b"]'
AS_ONE_WRITES_IT = {  # by pydantic's type of fault, where YAML may have read another type than was meant
    "list_type": A_LIST,
    "tuple_type": A_LIST,
    "string_type": 'text, in quotes where it would pass for something else, as in "001"',
}


@dataclass
class Config:
    """A configuration before its settings are checked.

    Attributes
    ----------
    folder : Path
        Base of its relative paths.
    workspace : str or None
    sources : dict of str to str
    settings : dict of str to dict
        Per stage.
    """

    folder: Path = Path()
    workspace: str | None = None
    sources: dict[str, str] = field(default_factory=dict)
    settings: dict[str, dict[str, Any]] = field(default_factory=dict)


def read_config(
    path: Path,
    source_names: Iterable[str],
    stage_names: Iterable[str],
    renamed: Mapping[str, str] = NOTHING_RENAMED,
) -> Config:
    """Read a YAML configuration: `workspace`, `sources`, and a section per stage. Paths are relative to it.

    Raises
    ------
    UserError
        The file cannot be read, is not YAML, has an unknown section or source, or a path that is no text.
    """
    values = {
        name: {} if section is None and name != "workspace" else section
        for name, section in _read_yaml(path).items()
    }
    source_names = list(source_names)
    sections = ["workspace", "sources", *stage_names]
    for name, section in values.items():
        if name not in sections:
            raise UserError(f"{path} has an unknown section {name!r}; {near(name, sections, renamed)}")
        if name != "workspace" and not isinstance(section, dict):
            raise UserError(
                f"{path}: the section {name!r} is {section!r}; expected `name: value` lines below it."
            )
    sources = values.pop("sources", {})
    for name in sources:
        if name not in source_names:
            raise UserError(f"{path}: there is no source {name!r}; {near(str(name), source_names)}")
    places = {"workspace": values.pop("workspace"), **sources} if "workspace" in values else sources
    for name, place in places.items():
        if not isinstance(place, str) or not place:
            raise UserError(
                f"{path}: {name} is {place!r}; expected a path or a name, in quotes where it would pass for "
                "something else. Write one, or leave out the line."
            )
    return Config(path.parent, places.get("workspace"), sources, values)


def _read_yaml(path: Path) -> dict[str, Any]:
    try:
        values = yaml.load(path.read_text(encoding="utf-8"), _Loader)
    except OSError as error:
        raise UserError(
            f"The configuration {path} cannot be read ({error.strerror}); check its path."
        ) from error
    except (yaml.YAMLError, UnicodeDecodeError) as error:
        raise UserError(f"The configuration {path} is not YAML: {' '.join(str(error).split())}") from error
    values = {} if values is None else values
    if not isinstance(values, dict):
        raise UserError(
            f"The configuration {path} holds {type(values).__name__}; expected sections with settings."
        )
    return {str(name): section for name, section in values.items()}


def override(settings: dict[str, dict[str, Any]], assignments: Iterable[str]) -> dict[str, dict[str, Any]]:
    """Apply ``stage.name=value`` and ``stage.phase.name=value``; values are read as YAML: 2, true, [a, b].

    Raises
    ------
    UserError
        An assignment does not have that form.
    """
    changed = deepcopy(settings)
    for assignment in assignments:
        name, equals, text = assignment.partition("=")
        *sections, setting_name = name.strip().split(".")
        if not (equals and sections and all(sections) and setting_name):
            raise UserError(
                f"--set {assignment} was not understood; expected STAGE.SETTING=VALUE, as in mesh.depth=9."
            )
        try:
            value = yaml.load(text, _Loader)
        except yaml.YAMLError as error:
            raise UserError(
                f"--set {assignment}: the value is not YAML ({' '.join(str(error).split())})."
            ) from error
        section: dict[str, Any] = changed
        for one in sections:
            if not isinstance(section.setdefault(one, {}), dict):
                section[one] = {}
            section = section[one]
        section[setting_name] = value
    return changed


def check_settings(
    declared: Mapping[str, type[Settings]],
    given: Mapping[str, Mapping[str, Any]],
    renamed: Mapping[str, str] = NOTHING_RENAMED,
) -> dict[str, Settings]:
    """Check the settings of every stage, and fill in the defaults. `renamed`: see `former_names`.

    Raises
    ------
    UserError
        An unknown stage or setting (the nearest name is suggested), or a value of the wrong type or range.
    """
    for stage in given:
        if stage not in declared:
            raise UserError(f"There is no stage {stage!r} to set; {near(stage, declared, renamed)}")
    return {stage: _validated(stage, kind, given.get(stage, {})) for stage, kind in declared.items()}


def _validated(stage: str, kind: type[Settings], values: Mapping[str, Any]) -> Settings:
    try:
        return kind.model_validate_json(json.dumps(dict(values)))
    except ValidationError as error:
        faults = [_sentence(stage, kind, fault) for fault in error.errors(include_url=False)]
        raise UserError(" ".join(faults)) from None
    except TypeError as error:  # YAML dates and the like have no JSON
        raise UserError(f"{stage}: {error}; expected numbers, words, true, false, none or lists.") from None


def _sentence(stage: str, kind: type[Settings], fault: Mapping[str, Any]) -> str:
    """Describe one of pydantic's errors in a sentence."""
    *phases, own = [str(part) for part in fault["loc"]]
    name = ".".join([stage, *phases, own])
    if fault["type"] == "extra_forbidden":
        phase = _phase_at(kind, phases)
        if own in phase.moved:
            return f"{name} has moved to {phase.moved[own]}; set it there."
        known = [field.alias or name for name, field in phase.model_fields.items()]
        return f"There is no setting {name}; {near(own, known)}"
    said = fault["msg"].removeprefix("Input should be ").removeprefix("Value error, ")
    if fault["type"] == "model_type":
        said = f"settings of its own, as in {name}.{next(iter(_phase_at(kind, fault['loc']).model_fields))}"
    expected = AS_ONE_WRITES_IT.get(fault["type"], said)
    return f"{name} is {fault['input']!r}; expected {expected}."


def _phase_at(kind: type[Settings], names: Iterable[str | int]) -> type[Settings]:
    """Look up the settings class of a phase by the path of names that leads to it."""
    for name in names:
        kind = {
            field.alias or own: field.annotation
            for own, field in kind.model_fields.items()
            if is_group(field.annotation)
        }[str(name)]
    return kind
