"""Photos and masks of a folder."""

from __future__ import annotations

import os
from collections import Counter
from collections.abc import Collection, Sequence
from pathlib import Path, PurePosixPath

from pipeline import UserError
from pipeline.digest import files_below
from stages.scene.cameras import view_name
from stages.scene.wording import listed

ENCODED = (".jpg", ".jpeg", ".png", ".tif", ".tiff")
LINEAR = (".exr", ".hdr")
ENDINGS = (".exr", ".png", ".npz", ".png.geometric.bin")  # of the files of results that are called by a view
LONGEST_NAME = 255  # bytes of a file's name, on nearly all file systems

# Cameras and telephones write these too, and no decoder here knows them.
UNREAD = (".heic", ".heif", ".cr2", ".cr3", ".nef", ".arw", ".dng", ".raf", ".orf", ".rw2")


def find_photos(folder: Path) -> list[str]:
    """Find photos below `folder`: relative paths with ``/``, sorted; hidden files and folders skipped.

    They are the files that the key of a result knows: linked folders are followed.

    Raises
    ------
    UserError
        There is no such folder, a photo's name is not UTF-8, a link leads nowhere, two photos would share
        a view name (``a.jpg`` and ``a.png``), or results could not be called by them (`check_view_names`).
    """
    if not folder.is_dir():
        raise UserError(f"There is no folder of photos at {folder}; give the folder that holds them.")
    seen: dict[str, str] = {}
    for name in files_below(folder, ENCODED + LINEAR):
        _check_name(name, folder)
        other = seen.setdefault(view_name(name), name)
        if other != name:
            raise UserError(
                f"{other} and {name} in {folder} differ only in their extension, so their results would have "
                "the same name; rename or remove one of them."
            )
    check_view_names(seen, folder)
    return list(seen.values())


def check_view_names(views: Collection[str], source: Path) -> None:
    """Refuse views whose results would have names that no disk holds, or one where another has a folder.

    Raises
    ------
    UserError
        A name is too long for the longest of `ENDINGS`, or is, with one of them, a folder of other views.
    """
    folders = {str(folder) for view in views for folder in PurePosixPath(view).parents}
    longest = LONGEST_NAME - max(map(len, ENDINGS))
    for view in views:
        if (size := len(os.fsencode(PurePosixPath(view).name))) > longest:
            raise UserError(
                f"A photo of {source} has a name of {size} bytes without its extension ({view[:40]}…); "
                f"expected {longest} at most, since results are called by it. Give it a shorter one."
            )
        for ending in ENDINGS:
            if view + ending in folders:
                raise UserError(
                    f"{source} holds a photo {view!r} and a folder {view + ending!r}, the name of a result "
                    "of that photo; expected names that differ. Rename one of them."
                )


def unread_photos(folder: Path, read: Sequence[str]) -> str:
    """Report the photos below `folder` of kinds that are not read, in a sentence; empty without any.

    Those that lie there in a kind that is `read` as well, as cameras write them, are not missed.
    """
    known = {view_name(name) for name in read}
    missed = [name for name in files_below(folder, UNREAD) if view_name(name) not in known]
    if not missed:
        return ""
    kinds = Counter(Path(name).suffix.lower() for name in missed)
    counted = listed([f"{count} {suffix}" for suffix, count in sorted(kinds.items())])
    return f"{folder} holds photos of kinds that are not read: {counted}. Export them as JPEG, TIFF or EXR."


def _check_name(name: str, folder: Path) -> None:
    """Refuse a name that no record could hold."""
    try:
        name.encode()
    except UnicodeEncodeError as error:
        raise UserError(
            f"A photo in {folder} is called {os.fsencode(name)!r}; names must be UTF-8. Rename it."
        ) from error


def find_mask(folder: Path, image_name: str) -> Path | None:
    """Find a photo's mask: its name, its stem with ``.png``, or COLMAP's ``name.ext.png``; else None."""
    for name in (image_name, view_name(image_name) + ".png", image_name + ".png"):
        if (folder / name).is_file():
            return folder / name
    return None
