"""Files of cameras, whatever program wrote them: told apart by their content."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from pipeline import UserError
from pipeline.cache.digest import files_below
from pipeline.errors import shown
from stages.formats.cameras.bundler import HEADER, photos_of_list, posed_photos_of_bundle
from stages.formats.cameras.documents import begins_with, json_object, read_text, xml_root
from stages.formats.cameras.meshroom import posed_photos_of_meshroom
from stages.formats.cameras.metashape import posed_photos_of_metashape
from stages.formats.cameras.plain_matrices import posed_photos_of_files, posed_photos_of_lines
from stages.formats.cameras.posed_photos import PosedPhoto
from stages.formats.cameras.transforms_json import posed_photos_of_transforms

FORMATS = (
    "transforms.json, Bundler's bundle.out, Meshroom's cameras.sfm, Metashape's XML, or a line of numbers "
    "for each photo"
)


def read_posed_photos(
    path: Path, photos: Sequence[str], photo_list: Path | None, first_pixel_px: float
) -> list[PosedPhoto]:
    """Read the poses and lenses in a file, or in a folder of a file of numbers for each photo.

    Parameters
    ----------
    path : Path
    photos : sequence of str
        All that there are, in order of their names: those of a bundle without a list.
    photo_list : Path, optional
        Of a bundle.
    first_pixel_px : float
        Coordinates of the first pixel's centre, of plain matrices.

    Raises
    ------
    UserError
        It is in none of the formats, is damaged, or holds no pose.
    """
    posed = _read(path, photos, photo_list, first_pixel_px)
    if not posed:
        raise UserError(f"{path} holds no photo with a pose; expected {FORMATS}. Align the photos first.")
    return posed


def _read(
    path: Path, photos: Sequence[str], photo_list: Path | None, first_pixel_px: float
) -> list[PosedPhoto]:
    """Tell the formats apart by the beginning of their content."""
    if path.is_dir():
        texts = {
            name.rsplit(".", 1)[0]: read_text(file) for name, file in files_below(path, [".txt"]).items()
        }
        return posed_photos_of_files(texts, first_pixel_px, path)
    if begins_with(path, HEADER):
        listed = photos if photo_list is None else photos_of_list(read_text(photo_list))
        return posed_photos_of_bundle(read_text(path, cut=True), listed, path)
    text = read_text(path)
    match text.lstrip()[:1]:
        case "<":
            return posed_photos_of_metashape(xml_root(text, path), path)
        case "{":
            return _read_json(json_object(text, path), path)
    return posed_photos_of_lines(text, first_pixel_px, path)


def _read_json(document: Mapping[str, Any], path: Path) -> list[PosedPhoto]:
    if "frames" in document:
        return posed_photos_of_transforms(document, path)
    if {"views", "intrinsics"} <= document.keys():
        return posed_photos_of_meshroom(document, path)
    raise UserError(f"{path} is JSON of {shown(list(document)[:8])}; expected {FORMATS}.")
