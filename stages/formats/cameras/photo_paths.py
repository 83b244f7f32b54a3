"""Photos of a folder by the paths that other programs wrote: these are of other folders, or bare names."""

from __future__ import annotations

import unicodedata
from collections import defaultdict
from collections.abc import Sequence
from pathlib import Path

from pipeline import UserError
from pipeline.errors import shown
from stages.formats.images.photo_folder import PHOTOS


def photo_of_each_path(paths: Sequence[str], photos: Sequence[str], source: Path) -> dict[str, str]:
    """Find the photo of each path: same name but for the extension, and most of the folders before it equal.

    Parameters
    ----------
    paths : sequence of str
        As the file of cameras has them; ``\\`` counts as ``/``.
    photos : sequence of str
        Of the folder, relative to it.
    source : Path
        For messages.

    Returns
    -------
    dict of str to str
        Photo by path; without those that have none.

    Raises
    ------
    UserError
        Several photos are as near to a path, or two paths are of one photo.
    """
    by_stem: dict[str, list[str]] = defaultdict(list)
    for photo in photos:
        by_stem[_parts(photo)[-1]].append(photo)
    found: dict[str, str] = {}
    path_of: dict[str, str] = {}
    for path in paths:
        parts = _parts(path)
        candidates = by_stem.get(parts[-1], []) if parts else []
        if not candidates:
            continue
        alike = [_equal_at_end(_parts(photo), parts) for photo in candidates]
        best = [photo for photo, count in zip(candidates, alike, strict=True) if count == max(alike)]
        if len(best) > 1:
            raise UserError(
                f"{source} has the photo {shown(path)}, which may be {best[0]} or {best[1]}; expected names "
                "that differ. Give the folder above them, or rename them there and in the file."
            )
        if best[0] in path_of:
            raise UserError(
                f"{source} has {shown(path_of[best[0]])} and {shown(path)}, which are both {best[0]}; "
                "expected one pose for each photo. Leave out one."
            )
        found[path], path_of[best[0]] = best[0], path
    return found


def _parts(path: str) -> list[str]:
    """Folders and name of a path, without the extension of a photo; other full stops are of the name.

    Accents are those of one spelling: disks of a Mac have another.
    """
    plain = unicodedata.normalize("NFC", path.replace("\\", "/"))
    if plain.lower().endswith(PHOTOS):
        plain = plain.rsplit(".", 1)[0]
    return [part for part in plain.split("/") if part not in ("", ".", "..")]


def _equal_at_end(one: Sequence[str], other: Sequence[str]) -> int:
    """How many of the last parts are equal."""
    count = 0
    for a, b in zip(reversed(one), reversed(other), strict=False):
        if a != b:
            break
        count += 1
    return count
