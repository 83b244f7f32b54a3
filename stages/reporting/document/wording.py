"""Figures in words and units."""

from __future__ import annotations

from typing import Any

NOTHING = "–"


def percent(share: float | None, digits: int = 0) -> str:
    """Format a share: '71 %'; small ones with a digit more."""
    if share is None:
        return NOTHING
    return f"{100 * share:.{digits or (1 if abs(share) < 0.1 else 0)}f} %"


def short(value: Any) -> str:
    """Format a value of a record: four significant digits; lists and pairs in one line."""
    if value is None:
        return NOTHING
    if isinstance(value, bool):
        return "yes" if value else "no"
    if isinstance(value, float):
        return f"{value:.4g}"
    if isinstance(value, dict):
        return "; ".join(f"{_key(name)}: {short(own)}" for name, own in value.items()) or NOTHING
    if isinstance(value, list | tuple):
        return ", ".join(map(short, value)) or NOTHING
    return str(value)


def megabytes(size: float) -> str:
    """Format bytes in MB."""
    return f"{size / 1e6:,.0f} MB".replace(",", " ")


def seconds(time: float) -> str:
    """Format a time: '12.3 s', '4 min 5 s'."""
    if time < 100:
        return f"{time:.1f} s"
    return f"{int(time) // 60} min {int(time) % 60} s"


def counted(number: int, one: str, several: str) -> str:
    """Put a number before the right word: '1 view', '3 views'."""
    return f"{number} {one if number == 1 else several}"


def _key(name: str) -> str:
    """Format a key: a number that was tried is rounded, other keys are words."""
    if name == "inf":
        return "infinitely far"
    try:
        return f"{float(name):.4g}"
    except ValueError:
        return name.replace("_", " ")
