"""Typed, strict settings: each has a default, a reason, and where it applies a unit and a range."""

from __future__ import annotations

from typing import Any

from pydantic import BaseModel, ConfigDict, Field


class Settings(BaseModel):
    """Settings of one stage: frozen, unknown keys refused. Subclass it beside the stage."""

    model_config = ConfigDict(frozen=True, extra="forbid", strict=True)


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
    extra = {"unit": unit, "changes_result": changes_result}
    return Field(default, description=why, alias=name, json_schema_extra=extra, **bounds)
