"""Settings and sources from YAML and the command line, checked."""

from __future__ import annotations

import json
from collections.abc import Iterable, Mapping
from copy import deepcopy
from dataclasses import dataclass, field
from pathlib import Path
from types import MappingProxyType
from typing import Any

import yaml
from pydantic import ValidationError

from pipeline.errors import UserError, shortened, shown
from pipeline.files.yaml_text import DEEPEST, parse_yaml, read_yaml_text
from pipeline.settings import Settings, is_group, near

NOTHING_RENAMED: Mapping[str, str] = MappingProxyType({})
MOST_FAULTS = 5  # settings of one stage that are named in one message
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
                f"{path}: the section {name!r} is {shown(section)}; expected `name: value` lines below it."
            )
    sources = values.pop("sources", {})
    for name in sources:
        if name not in source_names:
            raise UserError(f"{path}: there is no source {name!r}; {near(str(name), source_names)}")
    places = {"workspace": values.pop("workspace"), **sources} if "workspace" in values else sources
    for name, place in places.items():
        if not isinstance(place, str) or not place or "\0" in place:
            raise UserError(
                f"{path}: {name} is {shown(place)}; expected a path or a name, in quotes where it would pass "
                "for something else. Write one, or leave out the line."
            )
    return Config(path.parent, places.get("workspace"), sources, values)


def _read_yaml(path: Path) -> dict[str, Any]:
    try:
        values = parse_yaml(read_yaml_text(path))
    except yaml.YAMLError as error:
        raise UserError(f"The configuration {path} is not YAML: {_reason(error)}") from error
    values = {} if values is None else values
    if not isinstance(values, dict):
        raise UserError(
            f"The configuration {path} holds {type(values).__name__}; expected sections with settings."
        )
    return {str(name): section for name, section in values.items()}


def _reason(error: yaml.YAMLError) -> str:
    return shortened(" ".join(str(error).split()))


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
        if not (equals and sections and all(sections) and setting_name) or len(sections) > DEEPEST:
            raise UserError(
                f"--set {shortened(assignment)} was not understood; expected STAGE.SETTING=VALUE, as in "
                "mesh.depth=9."
            )
        try:
            value = parse_yaml(text)
        except yaml.YAMLError as error:
            raise UserError(
                f"--set {shortened(assignment)}: the value is not YAML ({_reason(error)})."
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
        faults = error.errors(include_url=False)
        sentences = [_sentence(stage, kind, fault) for fault in faults[:MOST_FAULTS]]
        more = [f"And {len(faults) - MOST_FAULTS} more."] if len(faults) > MOST_FAULTS else []
        raise UserError(" ".join(sentences + more)) from None
    except (TypeError, ValueError) as error:  # sets and bytes have no JSON, nor have numbers of 5,000 digits
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
    return f"{name} is {shown(fault['input'])}; expected {expected}."


def _phase_at(kind: type[Settings], names: Iterable[str | int]) -> type[Settings]:
    """Look up the settings class of a phase by the path of names that leads to it."""
    for name in names:
        kind = {
            field.alias or own: field.annotation
            for own, field in kind.model_fields.items()
            if is_group(field.annotation)
        }[str(name)]
    return kind
