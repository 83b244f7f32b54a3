"""Typed, strict settings: each has a default, a reason, and where it applies a unit and a range."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping
from difflib import get_close_matches
from types import MappingProxyType
from typing import Any, ClassVar, TypeGuard

from pydantic import BaseModel, ConfigDict, Field


class Settings(BaseModel):
    """Settings of a stage or of one phase in it: frozen; unknown keys, NaN and infinity refused.

    Subclass it beside the stage, or beside the phase, and make that a field of the stage's with `group`.

    Attributes
    ----------
    moved : mapping of str to str
        Former names of settings here, and their present names, as in ``{"light": "lighting.light"}``.
    """

    moved: ClassVar[Mapping[str, str]] = MappingProxyType({})

    model_config = ConfigDict(frozen=True, extra="forbid", strict=True, allow_inf_nan=False)


def setting(
    default: Any,
    why: str,
    *,
    unit: str | None = None,
    name: str | None = None,
    changes_result: bool = True,
    **bounds: Any,
) -> Any:
    """Declare a setting.

    Parameters
    ----------
    default
        Its default value.
    why
        Its effect and the reason for its default, one sentence or two; shown by the documentation.
    unit
        Unit of the value, such as ``"px"``.
    name
        Its public name where that is a Python keyword (``lambda``).
    changes_result
        False for settings that change only speed or messages: they stay out of the cache key.
    **bounds
        pydantic's ``ge``, ``gt``, ``le``, ``lt``, ``min_length``.
    """
    return Field(
        default,
        description=why,
        alias=name,
        json_schema_extra={"unit": unit, "changes_result": changes_result},
        **bounds,
    )


def group(kind: type[Settings], why: str) -> Any:
    """Declare the settings of one phase as a field of its stage's: ``stage.phase.name`` to the user.

    Parameters
    ----------
    kind
        Its settings, all of which have defaults.
    why
        The purpose of the phase, one sentence; shown by the documentation above its settings.
    """
    return Field(default_factory=kind, description=why)


def is_group(annotation: object) -> TypeGuard[type[Settings]]:
    """Check by its type whether a field holds the settings of a phase rather than a single setting."""
    return isinstance(annotation, type) and issubclass(annotation, Settings)


def settings_that_matter(settings: Settings, ignored: Iterable[str] = ()) -> dict[str, Any]:
    """List the settings that change the result, as JSON values by public name: ``phase.name`` in a phase.

    Parameters
    ----------
    settings
        Of a stage.
    ignored
        Public names of settings, or of whole phases, that this variant of the stage does not use.
    """
    ignored = set(ignored)
    return {
        name: value
        for name, value in _values(settings)
        if name not in ignored and not any(name.startswith(f"{phase}.") for phase in ignored)
    }


def _values(settings: Settings) -> Iterator[tuple[str, Any]]:
    """List public names and JSON values of the settings that change the result; in a phase ``phase.name``."""
    values = settings.model_dump(mode="json", by_alias=True)
    for name, field in type(settings).model_fields.items():
        public = field.alias or name
        if is_group(field.annotation):
            yield from ((f"{public}.{own}", value) for own, value in _values(getattr(settings, name)))
        elif not isinstance(field.json_schema_extra, dict) or field.json_schema_extra["changes_result"]:
            yield public, values[public]


def near(wrong: str, known: Iterable[str], renamed: Mapping[str, str] = MappingProxyType({})) -> str:
    """Complete a sentence about a name that does not exist: its present name, or the nearest names."""
    if wrong in renamed:
        return f"it is called {renamed[wrong]!r} now."
    known = sorted(known)
    close = get_close_matches(wrong, known, n=1, cutoff=0.5)
    return f"did you mean {close[0]!r}?" if close else f"expected one of: {', '.join(known)}."
