"""Names of photos and of a model's images: each becomes a path below the folders of results."""

from __future__ import annotations

import unicodedata
from pathlib import PurePosixPath

from stages.scene.cameras import view_name

HEIF = (".heic", ".heif")
CAMERA_RAW = (
    *(".dng", ".cr2", ".cr3", ".nef", ".nrw", ".arw", ".raf", ".orf", ".rw2", ".pef", ".srw", ".3fr", ".iiq"),
)
ENDINGS = (".exr", ".png", ".npz", ".png.geometric.bin")  # of files of results that are called by a view
LONGEST_PART = 255 - max(map(len, ENDINGS))  # bytes, without the photo's extension; nearly all disks take 255
LONGEST_NAME = 1024  # bytes, folders included; a system takes 4096 with all that is above them
UNSHOWN = ("Cc", "Zl", "Zp")  # Unicode's control characters and line breaks: lists of names have a line each


def view_as_typed(name: str) -> str:
    """Name the view of an image, for comparison: disks of a Mac spell accents as characters of their own."""
    return unicodedata.normalize("NFC", view_name(name))


def spellings(name: str) -> tuple[str, ...]:
    """List a name as it is, and with its accents spelled in the other ways that disks know."""
    return tuple(dict.fromkeys((name, *(unicodedata.normalize(form, name) for form in ("NFC", "NFD")))))


def fault_of_name(name: str) -> str:
    """Describe why a name cannot be one of a result; empty where it can.

    Parameters
    ----------
    name : str
        Relative to the folder of the photos, with ``/``.
    """
    path = PurePosixPath(name)
    if not path.parts or path.is_absolute() or ".." in path.parts:
        return "leads out of the image folder"
    if "\\" in name or (len(name) > 1 and name[1] == ":"):
        return "leads out of the image folder on some systems (a drive, a backslash)"
    if any(part.startswith(".") for part in path.parts):
        return "is hidden (a part begins with a full stop), as photos and results must not be"
    if any(unicodedata.category(one) in UNSHOWN for one in name):
        return "holds characters that cannot be shown, such as a line break"
    longest = max(len(part.encode()) for part in PurePosixPath(view_name(name)).parts)
    if longest > LONGEST_PART or len(name.encode()) > LONGEST_NAME:
        return f"is longer than results have room for ({LONGEST_PART} bytes a part, {LONGEST_NAME} in all)"
    return ""
