"""A scene whose albedo is to have its detail: photos with their model, and which part of it they are."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from pathlib import Path

import numpy as np

from stages.photometry.albedo_data import typical_light_of
from stages.photometry.detail.noise_estimation import relative_noise, relative_noise_variance
from stages.photometry.detail.octaves import KnownPixels
from stages.photometry.detail.other_views import OtherViews
from stages.photometry.detail.settings import DetailSettings
from stages.photometry.detail.shading_uncertainty import log_quotient, log_shading
from stages.photometry.stack import StackedViews
from stages.solvers.kernels.arrays_in_files import in_file
from stages.solvers.kernels.pixelwise import pixelwise

AXES, QUOTIENT, LIT = slice(0, 3), 3, 4  # columns of `DetailScene.maps`


@dataclass(frozen=True, eq=False)
class TypicalPixel:
    """What is typical of a scene.

    Attributes
    ----------
    light : float
        Median brightness of the shading.
    noise : ndarray, shape (3,)
        Median of `relative_noise_variance` of the photos.
    """

    light: float
    noise: np.ndarray

    @classmethod
    def of(cls, shading: np.ndarray, image: np.ndarray, log_offset: float) -> TypicalPixel:
        """Take the medians of pixels, (n, 3) each, scaled."""
        if not len(shading):
            return cls(0.0, np.ones(3))
        return cls(typical_light_of(shading), np.median(relative_noise_variance(image, log_offset), axis=0))

    def least_light(self, share: float) -> float:
        """Compute the least shading to divide photos by, a share of the typical one; above 0."""
        return share * max(self.light, 1e-6)


@dataclass(frozen=True, eq=False)
class PartOfScene:
    """Pixels that are part of a scene.

    Attributes
    ----------
    places : ndarray, shape (N,), int64
        Of each among all masked pixels of the scene, view after view, row by row.
    own : ndarray, shape (N,), bool
        Those that stand for the scene; the others are neighbours that help, and stand in other parts.
    of_scene : int
        Masked pixels of the scene.
    typical : TypicalPixel
        Of the scene.
    """

    places: np.ndarray
    own: np.ndarray
    of_scene: int
    typical: TypicalPixel

    def sampled(self, most: int) -> np.ndarray:
        """Select own pixels evenly, (N,), bool: the same of any division, of all parts about `most`."""
        return self.own & (self.places % stride(self.of_scene, most) == 0)


def whole_scene(shading: np.ndarray, image: np.ndarray, log_offset: float, most: int) -> PartOfScene:
    """Take pixels, (N, 3), for all of a scene, what is typical of it from `most` of them."""
    every = stride(len(shading), most)
    typical = TypicalPixel.of(shading[::every], image[::every], log_offset)
    return PartOfScene(np.arange(len(shading)), np.ones(len(shading), bool), len(shading), typical)


def stride(pixels: int, most: int) -> int:
    """Find every how manieth pixel is sampled so that there are no more than `most`."""
    return max(1, -(-pixels // most))


@dataclass(frozen=True, eq=False)
class DetailScene:
    """Photos with their model.

    Attributes
    ----------
    views : StackedViews
    image : ndarray, shape (N, 3)
        Scaled, without specular reflection.
    smooth, light, explained : ndarray, shape (N, 3), float32
        The smooth albedo ρ, the shading S, above 0, and ρ S.
    trusted : ndarray, shape (N,), bool
        Pixels with valid data.
    how : DetailSettings
    part : PartOfScene
    """

    views: StackedViews
    image: np.ndarray
    smooth: np.ndarray
    light: np.ndarray
    explained: np.ndarray
    trusted: np.ndarray
    how: DetailSettings
    part: PartOfScene

    @classmethod
    def of(
        cls,
        views: StackedViews,
        albedo: np.ndarray,
        image: np.ndarray,
        shading: np.ndarray,
        trusted: np.ndarray,
        how: DetailSettings,
        part: PartOfScene | None = None,
        folder: Path | None = None,
        gains: np.ndarray | None = None,
    ) -> DetailScene:
        """Bound smooth albedo and shading from below.

        Parameters
        ----------
        views : StackedViews
        albedo : ndarray, shape (N, 3)
            The smooth albedo, inferred from all views.
        image, shading : ndarray, shape (N, 3)
            Scaled, without specular reflection.
        trusted : ndarray, shape (N,), bool
            Pixels with valid data.
        how : DetailSettings
        part : PartOfScene or None
            What part of a scene these pixels are; None: they are all of it.
        folder : Path or None
            Where the model waits until its octaves are filtered; None: in memory.
        gains : ndarray, shape (n,), or None
            Brightness of the views, which image and shading include; None: 1.
        """
        part = part or whole_scene(shading, image, how.log_offset, how.sample_pixels)
        least = np.float32(part.typical.least_light(how.least_light))
        of_view = np.full(views.view_count, least) if gains is None else least * gains
        of_pixel = np.repeat(of_view, np.diff(views.starts))
        light, smooth, explained = in_file(pixelwise(_model, albedo, shading, of_pixel), folder)
        return cls(views, image, smooth, light, explained, trusted, how, part)

    @cached_property
    def pixels(self) -> KnownPixels:
        """The trusted pixels."""
        return KnownPixels.of(self.views, self.trusted)

    @cached_property
    def others(self) -> OtherViews:
        """The correspondences of the trusted pixels."""
        return OtherViews.of(self.views, self.trusted)

    @cached_property
    def seen_by_others(self) -> KnownPixels:
        """Trusted pixels with correspondences in other views."""
        return KnownPixels.of(self.views, self.others.count > 0)

    @cached_property
    def noise_scale(self) -> np.ndarray:
        """Noise relative to that at median brightness, (N, 3)."""
        offset, typical, how = self.how.log_offset, self.part.typical.noise, self.how.noise

        def relative(explained: np.ndarray) -> np.ndarray:
            return relative_noise(relative_noise_variance(explained, offset), typical, how)

        return pixelwise(relative, self.explained)

    @cached_property
    def response(self) -> np.ndarray:
        """Derivative of ``log(I + d)`` by log shading, (N,): small in dark pixels."""
        offset = self.how.log_offset
        return pixelwise(lambda explained: (explained / (explained + offset)).mean(axis=1), self.explained)

    @cached_property
    def sample(self) -> np.ndarray:
        """Indices of the pixels that uncertainty and noise are estimated from."""
        return np.flatnonzero(self.trusted & self.part.sampled(self.how.sample_pixels))

    @property
    def measured_and_linked(self) -> tuple[int, int]:
        """Number of trusted pixels that are measured, and of those of them with correspondences."""
        measured = self.trusted & self.part.own
        return int(np.count_nonzero(measured)), int(np.count_nonzero(self.others.count[measured]))

    def maps(self) -> np.ndarray:
        """Compute axes of the residual, mean logarithm of I/S, mean logarithm of S: (N, 5)."""
        offset, most = self.how.log_offset, self.how.largest_residual

        def columns(image: np.ndarray, explained: np.ndarray, light: np.ndarray) -> np.ndarray:
            left = axes_of(np.clip(log_quotient(image, explained, offset), -most, most))
            quotient = log_quotient(image, light, offset).mean(axis=1)
            return np.column_stack([left, quotient, log_shading(light)]).astype(np.float32)

        return pixelwise(columns, self.image, self.explained, self.light)


def _model(
    albedo: np.ndarray, shading: np.ndarray, least: np.ndarray
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Bound the shading and the smooth albedo from below; returns both and their product."""
    light = np.maximum(shading, least[:, None])
    smooth = np.maximum(albedo, 0).astype(np.float32)
    return light, smooth, smooth * light


def axes_of(logs: np.ndarray) -> np.ndarray:
    """Convert logarithms of channels, (N, 3), to mean logarithm, log R/G and log B/G, (N, 3)."""
    red, green, blue = logs.T
    return np.stack([logs.mean(axis=1), red - green, blue - green], axis=1)


def channels_of(axes: np.ndarray) -> np.ndarray:
    """Invert `axes_of`."""
    mean, red, blue = axes.T
    green = mean - (red + blue) / 3
    return np.stack([green + red, green, green + blue], axis=1)
