"""Evaluation of folders without truth: detail against the photos, one scene under two lights."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import numpy as np

from pipeline import UserError, finite_or_null
from stages.evaluation.agreement import relative_difference
from stages.evaluation.albedo_folder import AlbedoFolder, MapFolder, check_finite, open_albedo_folder
from stages.evaluation.detail import PhotoOctave, PhotoView, photo_octaves
from stages.evaluation.evaluate import common_names
from stages.evaluation.scores import by_channel


@dataclass(frozen=True)
class PhotoDetail:
    """Detail of albedo against the photos.

    Attributes
    ----------
    views, pixels : int
        Number of views and of pixels compared, before the masks are eroded.
    octaves : tuple of PhotoOctave
    """

    views: int
    pixels: int
    octaves: tuple[PhotoOctave, ...]

    def as_json(self) -> dict[str, Any]:
        """Convert to plain JSON values, null for NaN and infinities."""
        return finite_or_null(asdict(self))


@dataclass(frozen=True)
class Stability:
    """Albedo of one scene under two lights; triples are red, green, blue.

    Attributes
    ----------
    views, pixels : int
        Number of views and of pixels compared.
    albedo : tuple of 3 floats
        `relative_difference` of the two sets of albedo maps.
    photos : tuple of 3 floats, or None
        That of the photos on the same pixels; None where they were not given.
    left_out : tuple of str
        Views that only one of the two folders has.
    """

    views: int
    pixels: int
    albedo: tuple[float, ...]
    photos: tuple[float, ...] | None
    left_out: tuple[str, ...]

    @property
    def ratio(self) -> tuple[float, ...] | None:
        """Share of the photos' difference that remains in the albedo; nan where the photos do not differ."""
        if self.photos is None:
            return None
        return tuple(a / p if p > 0 else float("nan") for a, p in zip(self.albedo, self.photos, strict=True))

    def as_json(self) -> dict[str, Any]:
        """Convert to plain JSON values: triples by channel, null for unknown values."""
        triples = {"albedo": self.albedo, "photos": self.photos, "ratio": self.ratio}
        named = {name: None if one is None else by_channel(one) for name, one in triples.items()}
        return finite_or_null(
            {"views": self.views, "pixels": self.pixels, **named, "left_out": self.left_out}
        )


def compare_with_photos(
    prediction_folder: Path,
    photos: Path,
    shading: Path | None = None,
    masks: Path | None = None,
    step: Callable[[], None] = lambda: None,
) -> PhotoDetail:
    """Measure how much of the photos' detail the albedo maps retain.

    Parameters
    ----------
    prediction_folder : Path
        As `open_albedo_folder` takes it.
    photos : Path
        Folder of photos of the same names, the same size or larger.
    shading : Path, optional
        Folder of shading maps; by default ``shading/`` beside the albedo.
    masks : Path, optional
        Where to compare, instead of the prediction's own masks.
    step : callable
        Called after each view.

    Raises
    ------
    UserError
        The folders have an error that the user can correct.
    """
    prediction = open_albedo_folder(prediction_folder, masks)
    shading = prediction.shading if shading is None else shading
    if shading is None:
        raise UserError(
            f"There is no shading/ beside the albedo in {prediction_folder}, and detail is compared with the "
            "photos only where the shading has little of it. Give its folder with --shading."
        )
    photo_maps, shading_maps = MapFolder.open("photo", photos), MapFolder.open("shading", shading)
    views = []
    for name in prediction.files:
        albedo = prediction.albedo(name)
        mask = mask_or_all(prediction, name, albedo)
        check_finite(name, "albedo", albedo[mask])
        views.append(
            PhotoView(name, photo_maps.read(name, mask), albedo, shading_maps.read(name, mask), mask)
        )
        step()
    pixels = sum(int(view.mask.sum()) for view in views)
    check_any(pixels)
    return PhotoDetail(len(views), pixels, photo_octaves(views))


def compare_two_lights(
    prediction_folder: Path,
    other_folder: Path,
    photos: tuple[Path, Path] | None = None,
    masks: Path | None = None,
    step: Callable[[], None] = lambda: None,
) -> Stability:
    """Measure the difference between the albedo maps of the same views under two lights.

    Parameters
    ----------
    prediction_folder, other_folder : Path
        As `open_albedo_folder` takes them: one scene, the same cameras, two lights.
    photos : (Path, Path), optional
        Folders of the photos under either light, of the same names, the same size or larger.
    masks : Path, optional
        Where to compare, instead of the prediction's own masks; the other's masks always apply.
    step : callable
        Called after each view.

    Raises
    ------
    UserError
        The folders have an error that the user can correct.
    """
    one, other = open_albedo_folder(prediction_folder, masks), open_albedo_folder(other_folder)
    names = common_names(one, other)
    maps = [] if photos is None else [MapFolder.open("photo", folder) for folder in photos]
    rows: list[list[np.ndarray]] = []  # of every view: two albedos, two photos; (pixels, 3) each
    for name in names:
        albedos = [one.albedo(name), other.albedo(name)]
        check_same_size(name, "albedo under the other light", albedos[1], albedos[0])
        mask = mask_or_all(one, name, albedos[0]) & mask_or_all(other, name, albedos[1])
        for albedo in albedos:
            check_finite(name, "albedo", albedo[mask])
        rows.append([image[mask] for image in (*albedos, *(folder.read(name, mask) for folder in maps))])
        step()
    values = [np.concatenate(column) for column in zip(*rows, strict=True)]
    check_any(len(values[0]))
    return Stability(
        views=len(names),
        pixels=len(values[0]),
        albedo=relative_difference(*values[:2]),
        photos=None if photos is None else relative_difference(*values[2:]),
        left_out=tuple(sorted(one.files.keys() ^ other.files.keys())),
    )


def mask_or_all(folder: AlbedoFolder, name: str, albedo: np.ndarray) -> np.ndarray:
    """Read the mask of a view, shape (h, w), bool; white without one.

    Raises
    ------
    UserError
        Its size is not that of the albedo, shape (h, w, 3).
    """
    mask = folder.mask(name)
    mask = np.ones(albedo.shape[:2], bool) if mask is None else mask
    check_same_size(name, "mask", mask, albedo)
    return mask


def check_same_size(name: str, what: str, image: np.ndarray, albedo: np.ndarray) -> None:
    """Refuse a map of a view whose size is not that of its albedo."""
    (height, width), (rows, columns) = image.shape[:2], albedo.shape[:2]
    if (height, width) != (rows, columns):
        raise UserError(
            f"View {name}: the {what} has {width} × {height} pixels, the albedo {columns} × {rows}; expected "
            "the same size."
        )


def check_any(pixels: int) -> None:
    """Refuse masks that leave no pixel."""
    if not pixels:
        raise UserError(
            "No pixel is compared: the masks have none in common. Check that they are white where the object "
            "is."
        )
