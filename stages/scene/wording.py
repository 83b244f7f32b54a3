"""Lists of photos in messages, and messages that several stages share."""

from __future__ import annotations

from collections.abc import Sequence

from pipeline import Job, Settings


def listed(names: Sequence[str], at_most: int = 12) -> str:
    """List names as ``a, b, c``, and how many more there are beyond `at_most`.

    >>> listed(["a", "b", "c"], at_most=2)
    'a, b and 1 more'
    """
    more = len(names) - at_most
    return ", ".join(names[:at_most]) + (f" and {more} more" if more > 0 else "")


def sizes_in_words(sizes: Sequence[str]) -> str:
    """Say the sizes of views in a few words.

    >>> sizes_in_words(["480x360"]), sizes_in_words(["360x480", "480x360", "90x90"])
    ('480x360', '3 sizes from 360x480 to 90x90')
    """
    return sizes[0] if len(sizes) == 1 else f"{len(sizes)} sizes from {sizes[0]} to {sizes[-1]}"


def tell_seen_from_behind(job: Job[Settings], opposed: int, pixels: int) -> None:
    """Record how many of all pixels see the back of the mesh, and warn where most do."""
    job.note(opposed_pixels=opposed)
    if 2 * opposed > pixels:
        job.warn(
            f"{opposed} of {pixels} pixels see the back of the mesh; they count as seeing the whole sky. "
            "Turn the mesh's faces outwards if it is inside out; if the cameras are inside it, its scale or "
            "frame is not theirs."
        )
