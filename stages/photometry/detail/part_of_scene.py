"""Pixels as part of a scene: which of it they are, and what is typical of it, however it is divided."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from stages.photometry.albedo_data import typical_light_of
from stages.photometry.detail.noise_estimation import relative_noise_variance


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
