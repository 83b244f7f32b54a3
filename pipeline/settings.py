"""Typed, strict settings: each has a default, a reason, and where it applies a unit and a range."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from difflib import get_close_matches
from types import MappingProxyType
from typing import Any, ClassVar

from pydantic import BaseModel, ConfigDict, Field


class Settings(BaseModel):
    """Settings of one stage: frozen; unknown keys, NaN and infinity refused. Subclass it beside the stage.

    Attributes
    ----------
    moved : mapping of str to str
        Names that settings had here once, and where they are now, as in ``{"light": "lighting.light"}``.
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
        What it does and why the default is what it is, one sentence or two; shown by the documentation.
    unit
        Unit of the value, such as ``"px"``.
    name
        Its public name where that is a Python keyword (``lambda``).
    changes_result
        False for settings that change speed or talk only: they stay out of the cache key.
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


def settings_that_matter(settings: Settings) -> dict[str, Any]:
    """The settings that change the result, as JSON values by public name."""
    silent = {
        field.alias or name
        for name, field in type(settings).model_fields.items()
        if isinstance(field.json_schema_extra, dict) and not field.json_schema_extra["changes_result"]
    }
    values = settings.model_dump(mode="json", by_alias=True)
    return {name: value for name, value in values.items() if name not in silent}


def near(wrong: str, known: Iterable[str]) -> str:
    """The sentence that helps after a name that does not exist."""
    known = sorted(known)
    close = get_close_matches(wrong, known, n=1, cutoff=0.5)
    return f"did you mean {close[0]!r}?" if close else f"expected one of: {', '.join(known)}."
