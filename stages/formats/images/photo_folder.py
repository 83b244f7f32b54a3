"""Photos and masks of a folder."""

from __future__ import annotations

from collections import Counter
from collections.abc import Collection, Iterable, Sequence
from importlib.util import find_spec
from pathlib import Path, PurePosixPath

from pipeline import UserError
from pipeline.cache.digest import files_below
from pipeline.errors import shown
from pipeline.process.installation import install_extra
from stages.scene.cameras import view_name
from stages.scene.image_names import CAMERA_RAW, ENDINGS, HEIF, fault_of_name, spellings, view_as_typed
from stages.scene.wording import listed

ENCODED = (".jpg", ".jpeg", ".png", ".tif", ".tiff", ".webp", ".avif")
LINEAR = (".exr", ".hdr")
AS_TAKEN = HEIF + CAMERA_RAW  # as cameras and telephones write them, often beside a JPEG
PHOTOS = ENCODED + LINEAR + AS_TAKEN
NEEDED = {"heic": ("pi_heif", HEIF), "raw": ("rawpy", CAMERA_RAW)}  # extras, their modules and kinds


def find_photos(folder: Path) -> list[str]:
    """Find photos below `folder`: relative paths with ``/``, sorted; hidden files and folders skipped.

    Linked folders are followed. Camera raw and HEIF that lie beside the same photo in another kind are left
    to it; those whose extra is not installed are missing (`unread_photos`).

    Raises
    ------
    UserError
        There is no such folder; a photo's name is not UTF-8 or has a fault (`fault_of_name`); a link leads
        nowhere or to no file; or results of two photos would have one name: ``a.jpg`` and ``a.png``, or
        those of `check_view_names`.
    """
    if not folder.is_dir():
        raise UserError(f"There is no folder of photos at {folder}; give the folder that holds them.")
    seen: dict[str, str] = {}
    for name in _readable(files_below(folder, PHOTOS)):
        if fault := fault_of_name(name):
            raise UserError(f"A photo in {folder} is called {shown(name)}, which {fault}. Rename it.")
        other = seen.setdefault(view_as_typed(name), name)
        if other != name:
            raise UserError(
                f"{other} and {name} in {folder} differ only in their extension, or in how their accents are "
                "spelled, so their results would have the same name; rename or remove one of them."
            )
    check_view_names([view_name(name) for name in seen.values()], folder)
    return list(seen.values())


def check_view_names(views: Collection[str], source: Path) -> None:
    """Refuse a view whose result would have the name of a folder of other views.

    Raises
    ------
    UserError
        A view, with one of `ENDINGS`, is such a folder.
    """
    folders = {str(folder) for view in views for folder in PurePosixPath(view).parents}
    for view in views:
        for ending in ENDINGS:
            if view + ending in folders:
                raise UserError(
                    f"{source} holds a photo {view!r} and a folder {view + ending!r}, the name of a result "
                    "of that photo; expected names that differ. Rename one of them."
                )


def unread_photos(folder: Path, read: Sequence[str]) -> str:
    """Report the photos below `folder` whose extra is not installed, in a sentence; empty without any.

    Those that lie there in a kind that is `read` as well, as cameras write them, are not missed.
    """
    known = {view_name(name) for name in read}
    sentences = []
    for extra, (_, kinds) in NEEDED.items():
        missed = [name for name in files_below(folder, kinds) if view_name(name) not in known]
        if missed:
            counts = Counter(Path(name).suffix.lower() for name in missed)
            counted = listed([f"{count} {suffix}" for suffix, count in sorted(counts.items())])
            sentences.append(
                f"{folder} holds {counted}, which takes the extra `{extra}`: {install_extra(extra)}. "
                "Or export them as JPEG, TIFF or EXR."
            )
    return " ".join(sentences)


def _readable(names: Iterable[str]) -> list[str]:
    """Choose the photos to read: of kinds whose extra is installed, one of each that was written twice."""
    missing = [kinds for module, kinds in NEEDED.values() if find_spec(module) is None]
    unread = tuple(suffix for kinds in missing for suffix in kinds)
    developed = {view_name(name) for name in names if not name.lower().endswith(AS_TAKEN)}
    return [
        name
        for name in names
        if not name.lower().endswith(AS_TAKEN)
        or (not name.lower().endswith(unread) and view_name(name) not in developed)
    ]


def find_masks(folder: Path, names: Sequence[str]) -> dict[str, Path]:
    """Find the mask of every photo that has one, by the photo's name.

    Raises
    ------
    UserError
        None belongs to a photo.
    """
    found = {name: mask for name in names if (mask := find_mask(folder, name)) is not None}
    if not found:
        raise UserError(
            f"No mask in {folder} belongs to a photo: expected names like {names[0]}, its stem with "
            f".png, or {names[0]}.png. Rename the masks."
        )
    return found


def find_mask(folder: Path, image_name: str) -> Path | None:
    """Find a photo's mask: its name, its stem with ``.png``, or COLMAP's ``name.ext.png``; else None.

    Extensions in capitals are the same, and accents however they are spelled.
    """
    stem = view_name(image_name)
    suffix = PurePosixPath(image_name).suffix
    endings = [*_written(suffix), *_written(".png"), *(suffix + one for one in _written(".png"))]
    names = [written + ending for written in spellings(stem) for ending in endings]
    return next((folder / name for name in names if (folder / name).is_file()), None)


def _written(ending: str) -> tuple[str, ...]:
    """Ways to write an extension."""
    return ending, ending.lower(), ending.upper()
