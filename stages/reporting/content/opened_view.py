"""A view as its maps are read: each is sampled for figures, reduced for pictures, and let go."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from stages.formats.artefacts.png_scale import png_whites
from stages.formats.images.exr import read_exr
from stages.formats.images.photos import read_mask
from stages.formats.images.resize import reduce_by_area
from stages.reporting.content.picture_size import encode_webp, reduced_picture, size_within
from stages.reporting.content.pictures import (
    area_mean,
    confidence_picture,
    depth_picture,
    masked_mean,
    normal_picture,
    photo_picture,
    residual_picture,
    srgb_picture,
)
from stages.reporting.content.view_figures import SampledView
from stages.reporting.parts import THUMBNAILS
from stages.reporting.settings import PictureSettings, ReportSettings
from stages.scene.cameras import Camera
from stages.texturing.gathering import ViewMaps, weight_of

LINKED = {"linear": "photo", "albedo": "albedo"}  # compared between views
SHOWN = {"linear": "photo"}  # artefacts whose pictures have other names


@dataclass(frozen=True, eq=False)
class ShownView:
    """A view, reduced: its pictures, figures, and what it tells of the surface.

    Attributes
    ----------
    pictures : dict of str to bytes
        WebP by kind.
    thumbnails : dict of str to bytes
        Small ones of photo and albedo.
    figures : SampledView
    depth_range : tuple of 2 floats, or None
    maps : ViewMaps or None
    """

    pictures: dict[str, bytes]
    thumbnails: dict[str, bytes]
    figures: SampledView
    depth_range: tuple[float, float] | None
    maps: ViewMaps | None


class OpenedView:
    """One view.

    Parameters
    ----------
    camera : Camera
        At working size.
    inputs : mapping of str to Path
        Folders of maps, by artefact.
    settings : ReportSettings
    longest_px : int
        Side of its pictures, at most.
    keep_linked : callable, optional
        Called with `photo` or `albedo`, the values of all pixels, (h w, 3), and which of them the mask has.
    with_surface : bool
        Whether `maps_for_surface` will be asked for.
    """

    def __init__(
        self,
        camera: Camera,
        inputs: Mapping[str, Path],
        settings: ReportSettings,
        longest_px: int,
        keep_linked: Callable[[str, np.ndarray, np.ndarray], None] | None = None,
        with_surface: bool = False,
    ) -> None:
        self._keep_linked, self._with_surface = keep_linked, with_surface
        self._camera, self._inputs, self._settings = camera, inputs, settings
        self._size = size_within(camera.shape, longest_px)
        self._small: dict[str, np.ndarray] = {}
        self._samples: dict[str, np.ndarray] = {}
        self.depth_range: tuple[float, float] | None = None
        self._mask = (
            read_mask(inputs["mask"] / f"{camera.name}.png")
            if "mask" in inputs
            else np.ones(camera.shape, bool)
        )
        self._share = area_mean(self._mask.astype(np.float32), self._size)
        self._surface_size = size_within(self._size, settings.surface.view_px)
        self._inside = np.flatnonzero(self._mask).astype(np.int32)
        self._outside = np.flatnonzero(~self._mask).astype(np.int32)
        self._sampled = self._inside[:: max(1, len(self._inside) // settings.figures.pixels)]

    def read(self, kind: str) -> None:
        """Read a map, keep what figures, pictures and the surface need of it."""
        values = np.ascontiguousarray(read_exr(self._inputs[kind] / f"{self._camera.name}.exr"))
        if kind == "linear":
            values = reduce_by_area(values, self._camera.shape)
        flat = values.reshape(self._mask.size, *values.shape[2:])
        if kind != "linear":
            flat[self._outside] = 0
        self._samples[kind] = flat[self._sampled]
        if kind in LINKED and self._keep_linked is not None:
            self._keep_linked(LINKED[kind], flat, self._inside)
        if kind == "depth" and len(self._sampled):
            outside = self._settings.pictures.depth_quantile
            nearest, farthest = np.quantile(self._samples[kind], [outside, 1 - outside])
            self.depth_range = (float(nearest), float(farthest))
        self._small[kind] = (
            area_mean(values, self._size) if kind == "linear" else masked_mean(values, self._share)
        )
        if kind == "depth" and self._with_surface:
            self._surface_depth = chosen_pixels(values, self._surface_size)

    def shown(self) -> ShownView:
        """Make what the page shows of it, when all its maps have been read."""
        how, pixels = self._settings.pictures, self.pixels()
        return ShownView(
            {kind: encode_webp(*picture, how) for kind, picture in pixels.items()},
            {kind: _thumbnail(*pixels[kind], how) for kind in THUMBNAILS if kind in pixels},
            self.sampled(),
            self.depth_range,
            self.maps_for_surface(),
        )

    def sampled(self) -> SampledView:
        """Collect the sampled values."""
        own = self._samples
        return SampledView(
            len(self._inside) / self._mask.size,
            own["linear"],
            own.get("albedo"),
            own.get("shading"),
            own.get("confidence"),
        )

    def maps_for_surface(self) -> ViewMaps | None:
        """Collect what the surface takes from this view, at its own size; None if it takes nothing."""
        if not self._with_surface:
            return None
        how, (height, width) = self._settings.surface, self._surface_size
        camera = self._camera.scaled(width, height)
        mask = area_mean(self._share, self._surface_size) > 0.5
        depth = self._surface_depth
        weight = weight_of(camera, mask, depth, np.ones_like(depth), how.gathering)
        maps = {kind: area_mean(values, self._surface_size) for kind, values in self._small.items()}
        known = maps.get("confidence", np.ones_like(depth))
        further = np.concatenate([maps["linear"], maps["shading"], known[..., None]], axis=2)
        return ViewMaps(camera, depth, weight, further, maps["albedo"])

    def pixels(self) -> dict[str, tuple[np.ndarray, np.ndarray | None]]:
        """Encode every map that there is as 8-bit picture, with the pixels that are visible, None: all."""
        visible = self._share > 0.5
        return {
            SHOWN.get(kind, kind): (picture, None if kind == "linear" else visible)
            for kind, picture in self._pixels().items()
        }

    def _pixels(self) -> dict[str, np.ndarray]:
        """Encode every map that there is as a picture, uint8."""
        small, how = self._small, self._settings.pictures
        pictures = {"linear": photo_picture(small["linear"], how)}
        whites = _whites(self._inputs)
        for kind in ("albedo", "shading"):
            if kind in small:
                pictures[kind] = srgb_picture(
                    small[kind] / whites.get(kind, _white_of(small[kind], how.white_quantile))
                )
        if "normal" in small:
            pictures["normal"] = normal_picture(small["normal"])
        if "depth" in small and self.depth_range:
            pictures["depth"] = depth_picture(small["depth"], *self.depth_range)
        if "confidence" in small:
            pictures["confidence"] = confidence_picture(small["confidence"])
        if "albedo" in small and "shading" in small:
            three = small["linear"], small["albedo"], small["shading"]
            pictures["residual"] = residual_picture(*three, how.residual_stops)
        if "relit" in small:
            pictures["relit"] = srgb_picture(small["relit"] / _white_of(small["relit"], how.white_quantile))
        return pictures


def _thumbnail(pixels: np.ndarray, visible: np.ndarray | None, how: PictureSettings) -> bytes:
    """Compress a picture at the size of those that choose a view."""
    small = reduced_picture(pixels, how.thumbnail_px)
    if visible is not None:
        visible = area_mean(visible.astype(np.float32), small.shape[:2]) > 0.5
    return encode_webp(small, visible, how)


def chosen_pixels(values: np.ndarray, size: tuple[int, int]) -> np.ndarray:
    """Reduce a map, (h, w), by choosing pixels: a mean of two depths is of neither surface."""
    (height, width), (rows, columns) = values.shape, size
    row = (np.arange(rows) * 2 + 1) * height // (2 * rows)
    column = (np.arange(columns) * 2 + 1) * width // (2 * columns)
    return np.ascontiguousarray(values[row[:, None], column[None, :]])


def _whites(inputs: Mapping[str, Path]) -> dict[str, float]:
    """Read which linear values are white in all views; empty where the export has not chosen them."""
    if "scales" not in inputs:
        return {}
    return png_whites(inputs["scales"])


def _white_of(values: np.ndarray, quantile: float) -> float:
    """Choose what is white in one picture: nearly its brightest value."""
    return max(float(np.quantile(values, quantile)), 1e-12)
