"""Octaves of maps: differences of Gaussian means over the known pixels."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from functools import cache, cached_property
from itertools import pairwise

import cv2
import numpy as np

from stages.photometry.stack import StackedViews
from stages.solvers.kernels.pixelwise import on_threads, pixelwise

COARSE = 4.0  # px: above, Gaussians use a smaller image, accurate to 3 %; a fifth of the time at σ = 32
TINY = 1e-6  # against division by 0


def gaussian_mean(values: np.ndarray, weight: np.ndarray, sigma_px: float) -> np.ndarray:
    """Average known values under a Gaussian (normalised convolution).

    Parameters
    ----------
    values : ndarray, shape (h, w) or (h, w, c), float32
        0 where the weight is 0.
    weight : ndarray, shape (h, w), float32
        1 where the value is known, else 0.
    sigma_px : float

    Returns
    -------
    ndarray, shape as `values`, float32
        ``(G * (w v)) / (G * w)``; 0 far from all known pixels.
    """
    mean, known = _smoothed(values, sigma_px), np.maximum(_smoothed(weight, sigma_px), TINY)
    mean /= known if values.ndim == 2 else known[..., None]
    return mean


@dataclass(frozen=True, eq=False)
class PixelIndices:
    """Indices from the n listed pixels of a view to its image, (h, w), and back.

    `ndarray.take` moves pixels by them several times as fast as an index by the mask does.

    Attributes
    ----------
    pixel : ndarray, shape (h, w), int32
        Number of the known pixel of every place; n where there is none.
    place : ndarray, shape (n,), int32
        Place of every listed pixel, row by row.
    """

    pixel: np.ndarray
    place: np.ndarray

    @classmethod
    def of(cls, mask: np.ndarray, known: np.ndarray) -> PixelIndices:
        """Number the pixels of a mask, (h, w), those of them that are known, (n,)."""
        place = np.flatnonzero(mask).astype(np.int32)
        pixel = np.full(mask.size, len(place), np.int32)
        pixel[place[known]] = np.flatnonzero(known)
        return cls(pixel.reshape(mask.shape), place)

    @property
    def weight(self) -> np.ndarray:
        """1 where a pixel is known, else 0: (h, w), float32."""
        return (self.pixel < len(self.place)).astype(np.float32)

    def image_of(self, values: np.ndarray) -> np.ndarray:
        """Spread the known values of (n,) or (n, c) over an image, 0 elsewhere."""
        nothing = np.zeros((1, *values.shape[1:]), values.dtype)
        return np.concatenate([values, nothing]).take(self.pixel, axis=0, mode="clip")

    def collect(self, image: np.ndarray, out: np.ndarray) -> None:
        """List the values of an image, (h, w) or (h, w, c), at all pixels."""
        image.reshape(self.pixel.size, *image.shape[2:]).take(self.place, axis=0, out=out, mode="clip")


@dataclass(frozen=True, eq=False)
class KnownPixels:
    """The known pixels of stacked views.

    Attributes
    ----------
    masks : sequence of ndarray, shape (h_i, w_i), bool
    starts : ndarray, shape (n + 1,)
        View i owns the places ``starts[i]:starts[i + 1]`` of the stack.
    known : ndarray, shape (N,), bool
    """

    masks: Sequence[np.ndarray]
    starts: np.ndarray
    known: np.ndarray

    @classmethod
    def of(cls, views: StackedViews, known: np.ndarray) -> KnownPixels:
        """Take the masks from the views."""
        return cls(views.masks, views.starts, known)

    def mean(self, values: np.ndarray, sigma_px: float) -> np.ndarray:
        """Average stacked values, (N,) or (N, c), under a Gaussian in each view; float32."""
        return self.mean_of(lambda own: own, values, sigma_px=sigma_px)

    def mean_of(
        self, function: Callable[..., np.ndarray], *values: np.ndarray, sigma_px: float
    ) -> np.ndarray:
        """Average a function of stacked values under a Gaussian in each view; float32.

        Parameters
        ----------
        function : callable
            Takes some of each of the values, (n,) or (n, c), also none, and returns (n,) or (n, k).
        values : ndarray, shape (N,) or (N, c)
        sigma_px : float
        """
        empty = function(*(each[:0] for each in values))
        out = np.empty((len(self.known), *empty.shape[1:]), np.float32)
        indices = self.indices  # found before the threads begin, not in each

        def average_view(number: int) -> None:
            view, own = slice(self.starts[number], self.starts[number + 1]), indices[number]
            image = own.image_of(function(*(each[view] for each in values)).astype(np.float32, copy=False))
            own.collect(gaussian_mean(image, own.weight, sigma_px), out[view])

        on_threads(average_view, range(len(self.masks)))
        return out

    @cached_property
    def indices(self) -> list[PixelIndices]:
        """Indices of the pixels of each view."""
        known = [self.known[slice(*view)] for view in pairwise(self.starts)]
        return on_threads(
            lambda number: PixelIndices.of(self.masks[number], known[number]), range(len(known))
        )

    def octaves(self, values: np.ndarray, sigmas_px: tuple[float, ...]) -> Iterator[tuple[np.ndarray, float]]:
        """Divide stacked values, (N,) or (N, c), into octaves, finest first, then the low-pass remainder.

        Parameters
        ----------
        values : ndarray
        sigmas_px : tuple of float
            Ascending: an octave lies between one and the next, the first below the first.

        Yields
        ------
        tuple of ndarray, shape as `values`, float32, and float
            ``G(σ_{k−1}) − G(σ_k)``, 0 outside the known pixels, and σ_k in pixels; then ``G(σ_last)`` and
            infinity. They sum up to the values at the known pixels.
        """
        known = self.known if values.ndim == 1 else self.known[:, None]
        finer = values.astype(np.float32, copy=False)
        for sigma_px in sigmas_px:
            coarser = self.mean(values, sigma_px)
            band = pixelwise(_difference_where, known, finer, coarser)
            finer = coarser  # before others compute with the band: the one before takes memory
            yield band, sigma_px
        yield np.where(known, finer, 0), np.inf


def _difference_where(known: np.ndarray, finer: np.ndarray, coarser: np.ndarray) -> np.ndarray:
    return np.where(known, finer - coarser, 0)


@cache
def response_to_noise(sigmas_px: tuple[float, ...]) -> tuple[float, ...]:
    """Compute the standard deviation of each octave of unit white noise."""
    side = 2 * int(4 * sigmas_px[-1]) + 1
    everywhere = np.ones((side, side), bool)
    impulse = np.zeros(side**2, np.float32)
    impulse[side**2 // 2] = 1
    pixels = KnownPixels((everywhere,), np.array([0, side**2]), everywhere.ravel())
    bands = pixels.octaves(impulse, sigmas_px)
    return tuple(float(np.sqrt((band**2).sum())) for band, sigma_px in bands if sigma_px < np.inf)


def _smoothed(image: np.ndarray, sigma_px: float) -> np.ndarray:
    """Blur an image by a Gaussian, with zeros beyond its border."""
    if sigma_px < COARSE:
        return cv2.GaussianBlur(image, (0, 0), sigma_px, borderType=cv2.BORDER_CONSTANT)
    height, width = image.shape[:2]
    factor = 2 ** int(np.log2(sigma_px / 2))
    padded = cv2.copyMakeBorder(image, 0, -height % factor, 0, -width % factor, cv2.BORDER_CONSTANT)
    size = padded.shape[1] // factor, padded.shape[0] // factor
    small = cv2.resize(padded, size, interpolation=cv2.INTER_AREA)
    small = cv2.GaussianBlur(small, (0, 0), sigma_px / factor, borderType=cv2.BORDER_CONSTANT)
    large = cv2.resize(small, padded.shape[1::-1], interpolation=cv2.INTER_LINEAR)
    return large[:height, :width]
