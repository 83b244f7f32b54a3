"""Folders of albedo maps, and of photos beside them; maps are matched by name, never by order."""

from __future__ import annotations

import os
from collections import Counter
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from pipeline import UserError
from pipeline.files.file_kinds import expect_file
from stages.formats.artefacts.part_maps import read_part_map, read_part_names
from stages.formats.images.photo_folder import ENCODED, LINEAR, find_mask
from stages.formats.images.photos import read_mask, read_photo
from stages.formats.images.resize import reduce_by_area
from stages.scene.cameras import view_name
from stages.scene.wording import listed


@dataclass(frozen=True)
class AlbedoFolder:
    """Albedo maps, with optional masks, true shading and parts.

    Attributes
    ----------
    maps : Path
        Folder of the maps.
    files : dict of str to str
        Map of every view, relative to `maps`, by view name.
    masks, shading, parts : Path or None
        Folders of masks, of true shading, of numbered parts.
    part_names : tuple of str
        Names of the numbers in `parts`.
    """

    maps: Path
    files: dict[str, str]
    masks: Path | None
    shading: Path | None
    parts: Path | None
    part_names: tuple[str, ...]

    def albedo(self, name: str) -> np.ndarray:
        """Read the linear albedo, shape (h, w, 3), float32."""
        return read_photo(self.maps / self.files[name])

    def mask(self, name: str) -> np.ndarray | None:
        """Read the mask of valid pixels, shape (h, w), bool; None where there are no masks at all.

        Raises
        ------
        UserError
            There are masks, but none of this view.
        """
        if self.masks is None:
            return None
        file = find_mask(self.masks, self.files[name])
        if file is None:
            raise UserError(f"There is no mask for view {name} in {self.masks}; expected {name}.png.")
        return read_mask(file)

    def part_map(self, name: str) -> np.ndarray | None:
        """Read the number of the part per pixel, shape (h, w), uint8; None where the parts are unknown."""
        if self.parts is None:
            return None
        return read_part_map(existing_map(self.parts, f"{name}.png"), len(self.part_names))

    def true_shading(self, name: str) -> np.ndarray | None:
        """Read the linear shading, shape (h, w, 3), float32, 0 = unknown; None where there is none."""
        return None if self.shading is None else read_photo(existing_map(self.shading, f"{name}.exr"))

    def colour_space(self, names: list[str]) -> str:
        """Describe how the maps of these views were read."""
        kinds = Counter(Path(self.files[name]).suffix.lower() for name in names)
        return ", ".join(
            f"{count} {suffix[1:].upper()} {'taken as linear' if suffix in LINEAR else 'decoded from sRGB'}"
            for suffix, count in sorted(kinds.items())
        )


def open_albedo_folder(folder: Path, masks: Path | None = None) -> AlbedoFolder:
    """Open a flat folder of maps, or one with ``albedo/`` and optional ``mask/``, ``shading/``, ``parts/``.

    Parameters
    ----------
    masks : Path, optional
        Used instead of ``mask/``.

    Raises
    ------
    UserError
        The folder does not exist, holds no maps, or two for one name.
    """
    for place in (folder, masks):
        if place is not None and not place.is_dir():
            raise UserError(f"{place} is not a folder; expected one. Check the path.")
    structured = (folder / "albedo").is_dir()
    maps = folder / "albedo" if structured else folder
    files = find_maps(maps)
    if not files:
        raise UserError(f"{maps} holds no albedo maps; expected EXR (linear), or PNG, TIFF, JPEG (sRGB).")

    def beside(name: str) -> Path | None:
        return folder / name if structured and (folder / name).is_dir() else None

    parts = beside("parts")
    return AlbedoFolder(
        maps=maps,
        files=files,
        masks=beside("mask") if masks is None else masks,
        shading=beside("shading"),
        parts=parts,
        part_names=() if parts is None else read_part_names(folder / "parts.json"),
    )


def find_maps(folder: Path) -> dict[str, str]:
    """Find maps below `folder`: relative paths by view name, sorted; a linear file precedes an encoded one.

    Raises
    ------
    UserError
        Two files of one name are both linear or both encoded; one is a pipe, a socket or a device.
    """
    found: dict[str, str] = {}
    for parent, folders, files in os.walk(folder):
        folders[:] = [name for name in folders if not name.startswith(".")]
        for file in sorted(files):
            if file.startswith(".") or not file.lower().endswith(ENCODED + LINEAR):
                continue
            expect_file(Path(parent) / file)
            path = (Path(parent) / file).relative_to(folder).as_posix()
            other = found.get(view_name(path))
            if other is not None and _is_linear(other) == _is_linear(path):
                raise UserError(f"{other} and {path} in {folder} are one view; remove one of them.")
            if other is None or _is_linear(path):
                found[view_name(path)] = path
    return dict(sorted(found.items()))


def _is_linear(file: str) -> bool:
    return file.lower().endswith(LINEAR)


def existing_map(folder: Path, file: str) -> Path:
    """Check that the file exists, and return its path.

    Raises
    ------
    UserError
        It does not.
    """
    path = folder / file
    if not path.is_file():
        raise UserError(f"{path} is missing; expected it beside the albedo map of that name.")
    return path


@dataclass(frozen=True)
class MapFolder:
    """Photos or shading maps by view name.

    Attributes
    ----------
    what : str
        Name of one of them in messages.
    folder : Path
    files : dict of str to str
        Relative to `folder`, by view name.
    """

    what: str
    folder: Path
    files: dict[str, str]

    @classmethod
    def open(cls, what: str, folder: Path) -> MapFolder:
        """Find the maps below a folder.

        Raises
        ------
        UserError
            The folder does not exist, or two of its files for one name are both linear or both encoded.
        """
        if not folder.is_dir():
            raise UserError(f"{folder} is not a folder; expected one. Check the path.")
        return cls(what, folder, find_maps(folder))

    def read(self, name: str, mask: np.ndarray) -> np.ndarray:
        """Read a view's map at the size of its mask, shape (h, w, 3), linear; a larger map is averaged.

        Raises
        ------
        UserError
            There is none, it is smaller or of another shape, or a masked value is not a finite number.
        """
        if name not in self.files:
            raise UserError(
                f"There is no {self.what} of view {name} in {self.folder} "
                f"({listed(list(self.files), 3) or 'no map at all'}); expected the names of the albedo maps, "
                "whatever the extension."
            )
        image = read_photo(self.folder / self.files[name])
        check_shape(name, self.what, image, mask)
        reduced = reduce_by_area(image, mask.shape)
        check_finite(name, self.what, reduced[mask])
        return reduced


def check_shape(name: str, what: str, image: np.ndarray, mask: np.ndarray) -> None:
    """Refuse an image that is smaller than the mask, or of another aspect ratio.

    The factors of the sides may differ by one pixel of the smaller image: `raycast.reduce` drops incomplete
    rows and columns.
    """
    (height, width), (rows, columns) = image.shape[:2], mask.shape
    factors = height / rows, width / columns
    if min(factors) < 1 or abs(factors[0] - factors[1]) > min(factors) / min(rows, columns):
        raise UserError(
            f"View {name}: the {what} has {width} × {height} pixels, the albedo {columns} × {rows}; expected "
            "the same picture, as large or larger. The photos of a workspace are in "
            "cache/undistort/KEY/linear."
        )


def check_finite(name: str, what: str, values: np.ndarray) -> None:
    """Refuse masked values of a view that are not finite."""
    bad = int(np.count_nonzero(~np.isfinite(values)))
    if bad:
        raise UserError(
            f"View {name}: {bad} masked values of the {what} are not finite numbers; repair them, or mask "
            "these pixels out."
        )
