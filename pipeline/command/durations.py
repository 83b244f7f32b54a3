"""Durations in words, no more exact than they are known."""

from __future__ import annotations

SHORT_S, MINUTE_S, HOUR_S = 5, 60, 3600


def spent(seconds: float) -> str:
    """Format a time that was measured.

    >>> spent(0.42), spent(50.4), spent(150), spent(7205)
    ('0.4 s', '50.4 s', '2 min 30 s', '2 h 0 min')
    """
    if seconds < 2 * MINUTE_S:
        return f"{seconds:.1f} s"
    if seconds < HOUR_S:
        return f"{round(seconds) // MINUTE_S} min {round(seconds) % MINUTE_S} s"
    minutes = round(seconds / MINUTE_S)
    return f"{minutes // 60} h {minutes % 60} min"


def about(seconds: float, how: str = "about") -> str:
    """Format a time that is expected, to about a tenth of it.

    >>> [about(seconds) for seconds in (-1, 3, 12, 47)]
    ['a few s', 'a few s', 'about 12 s', 'about 45 s']
    >>> [about(seconds, "at most") for seconds in (100, 1000, 9000)]
    ['at most 2 min', 'at most 17 min', 'at most 2 h 30 min']
    """
    return "a few s" if seconds < SHORT_S else f"{how} {_rounded(seconds)}"


def _rounded(seconds: float) -> str:
    if seconds < 1.5 * MINUTE_S:
        return f"{_to_multiple(seconds, 5 if seconds >= 4 * SHORT_S else 2)} s"
    minutes = max(round(seconds / MINUTE_S), 2)
    if minutes < 60:
        return f"{minutes} min"
    minutes = _to_multiple(minutes, 10)
    return f"{minutes // 60} h" + (f" {minutes % 60} min" if minutes % 60 else "")


def on_a_clock(seconds: float) -> str:
    """Format a time as clocks do.

    >>> on_a_clock(21.7), on_a_clock(3725)
    ('0:21', '1:02:05')
    """
    whole = int(seconds)
    hours, minutes, rest = whole // HOUR_S, whole // MINUTE_S % 60, whole % MINUTE_S
    return f"{hours}:{minutes:02}:{rest:02}" if hours else f"{minutes}:{rest:02}"


def _to_multiple(value: float, of: int) -> int:
    return of * round(value / of)
