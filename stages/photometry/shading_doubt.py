"""How far the shading may be wrong, octave by octave, told from the photos divided by it."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np
from scipy.optimize import nnls

from stages.photometry.octaves import SIGMAS_PX, gaussian_mean, octaves, response_to_noise
from stages.photometry.stack import StackedViews
from stages.scene.view_files import image_of

DARK = 0.01  # of the scaled image, under the logarithms: as dark as that, hardly anything is told
VIEWS = 6  # that it is told from, evenly chosen
CLASSES = 16  # of pixels, by how much the shading changes around them
SHARE = 0.8  # of the error that is told: some of it is paint, as renders of known truth show
MAD = 0.6745  # of a normal deviate: what half of all stay below
FEWEST = 100  # pixels of a class that are worth a word
TEXTURE = (0.6, 1.0, 1.0, 1.0, 1.0)  # of 1/f brightness, a little blurred: deviations of the finest octaves


@dataclass(frozen=True)
class ShadingDoubt:
    """What the logarithm of an observation may be wrong by, besides what it says of the albedo.

    Attributes
    ----------
    of_change : tuple of float
        Per octave, finest first: standard deviation of the error over the shading's own local change.
    noise : float
        Standard deviation of the camera's noise in a working pixel of median brightness.
    """

    of_change: tuple[float, ...]
    noise: float

    def error(self, octave: int, change_squared: np.ndarray) -> np.ndarray:
        """``κ_k² L²``, the variance of the shading's error, where its band has a local mean square L²."""
        return self.of_change[octave] ** 2 * change_squared

    def noise_in(self, octave: int) -> float:
        """Standard deviation of the noise in an octave, at median brightness."""
        return self.noise * response_to_noise()[octave]

    def as_json(self) -> dict[str, Any]:
        """For records."""
        return {
            "of_shading_change": [round(value, 3) for value in self.of_change],
            "noise": round(self.noise, 4),
        }


def log_quotient(image: np.ndarray, explained: np.ndarray) -> np.ndarray:
    """``log((I + d) / (E + d))``, elementwise, float32; of what is dark in both, next to nothing."""
    return np.log((np.maximum(image, 0) + DARK) / (np.maximum(explained, 0) + DARK)).astype(np.float32)


def log_shading(light: np.ndarray) -> np.ndarray:
    """Average the logarithms of the channels of a shading above 0, (N, 3); (N,), float32."""
    return np.log(light).mean(axis=1).astype(np.float32)


@dataclass(frozen=True, eq=False)
class Evidence:
    """What the shading's error and the noise are told from; all of shape (N,), float32 but for `trusted`.

    Attributes
    ----------
    quotient, left, lit : ndarray
        Mean logarithms of I/S, of I/(ρ S) with a smooth albedo ρ, and of S.
    response : ndarray
        How much of a change of the light's logarithm shows in ``log(I + d)``: little where it is dark.
    grain : ndarray
        Standard deviation of noise in ``log(I + d)``, over that of a pixel of median brightness.
    trusted : ndarray, bool
    """

    quotient: np.ndarray
    left: np.ndarray
    lit: np.ndarray
    response: np.ndarray
    grain: np.ndarray
    trusted: np.ndarray


def grain_of(explained: np.ndarray) -> np.ndarray:
    """Noise of ``log(I + d)`` by brightness, (N,), float32: photons' variance grows as their number does.

    ``√(m / (E + d))`` of the mean channel E that is explained, m its median; from a half to four.
    """
    brightness = explained.mean(axis=1) + DARK
    return np.clip(np.sqrt(np.median(brightness) / brightness), 0.5, 4.0).astype(np.float32)


def shading_doubt(
    views: StackedViews, evidence: Evidence, least: tuple[float, ...], most: float
) -> ShadingDoubt:
    """Estimate the shading's error and the camera's noise from the scene itself.

    Parameters
    ----------
    views : StackedViews
    evidence : Evidence
    least : tuple of float
        Per octave, what `of_change` is at least: where smooth surface lies beside texture, or texture hides
        what the shading is wrong by, little can be told.
    most : float
        What it is at most.

    Notes
    -----
    In each octave, pixels are put into classes of equal number by the local mean square L² of the band of
    log S; of each, e² is the variance of the band of log I/S, by the median so that borders of paint do not
    count. ``e² ≈ τ² + κ² L²``, by non-negative least squares over relative errors: κ is the shading's error,
    τ texture and noise; of κ², what is sure: less its standard error. The same of log I/(ρ S), by mean
    squares, as borders are in ρ. Either is too large where paint is in it, the one by bold borders, the other
    by what ρ has lost, so the lesser counts, and of that `SHARE`. Where the shading is most even, what is
    left is told by its octaves: noise is white and halves from one to the next, texture is as strong in all.
    """
    by_median, by_square, noises = [], [], []
    for change, quotient, left, grain in _octaves_of(views, evidence):
        by_median.append(_slope(change, quotient, lambda own: (np.median(np.abs(own)) / MAD) ** 2))
        by_square.append(_slope(change, left, lambda own: np.mean(np.square(own), dtype=np.float64)))
        noises.append(_least_deviation(change, quotient / grain))
    slopes = [SHARE * min(one, other) for one, other in zip(by_median, by_square, strict=True)]
    return ShadingDoubt(
        of_change=tuple(float(np.clip(*each, most)) for each in zip(slopes, least, strict=True)),
        noise=_noise_in(noises),
    )


def _octaves_of(views: StackedViews, evidence: Evidence) -> list[tuple[np.ndarray, ...]]:
    """Of each octave: L², the bands of both quotients, and the grain, over trusted pixels of some views."""
    pooled: list[list[tuple[np.ndarray, ...]]] = [[] for _ in SIGMAS_PX]
    for view in np.unique(np.linspace(0, views.view_count - 1, VIEWS).round().astype(int)):
        mask, own = views.masks[view], views.view(view)
        weight = image_of(mask, evidence.trusted[own].astype(np.float32))
        inside, shown = weight[mask] > 0, image_of(mask, evidence.response[own])
        maps = (
            octaves(image_of(mask, each[own]) * weight, weight)
            for each in (evidence.lit, evidence.quotient, evidence.left)
        )
        for octave, ((change, sigma_px), (quotient, _), (left, _)) in enumerate(zip(*maps, strict=True)):
            if np.isfinite(sigma_px):
                local = gaussian_mean((change * shown) ** 2, weight, max(sigma_px, 1.0))
                found = [each[mask][inside] for each in (local, quotient, left)]
                pooled[octave].append((*found, evidence.grain[own][inside]))
    return [tuple(map(np.concatenate, zip(*each, strict=True))) for each in pooled]


def _noise_in(deviations: list[float]) -> float:
    """White noise, per pixel, in deviations of the octaves that are of noise and texture: least squares."""
    count = len(TEXTURE)
    variances = np.square(deviations[:count])
    relative = 1 / (variances + 1e-8)
    design = np.square([TEXTURE, response_to_noise()[:count]]).T * relative[:, None]
    (_, noise), _ = nnls(design, variances * relative)
    return float(np.sqrt(noise))


def _classes(change_squared: np.ndarray) -> list[np.ndarray]:
    """Numbers of pixels in classes of equal size, by how much the shading changes around them."""
    count = min(CLASSES, len(change_squared) // FEWEST)
    return np.array_split(np.argsort(change_squared, kind="stable"), count) if count else []


def _slope(change_squared: np.ndarray, band: np.ndarray, variance_of: Callable[[np.ndarray], float]) -> float:
    """κ, as far as it is sure."""
    order = _classes(change_squared)
    if len(order) < 3:
        return 0.0
    change = np.array([change_squared[own].mean() for own in order], np.float64)
    variance = np.array([variance_of(band[own]) for own in order], np.float64)
    relative = 1 / (variance + 1e-6)
    design = np.stack([np.ones(len(order)), change], axis=1) * relative[:, None]
    (_, slope), left = nnls(design, variance * relative)
    return float(np.sqrt(max(slope - _standard_error(design, left), 0.0)))


def _least_deviation(change_squared: np.ndarray, band: np.ndarray) -> float:
    """Of the class that varies least among those in which the shading is most even."""
    order = _classes(change_squared)
    deviations = [np.median(np.abs(band[own])) / MAD for own in order[: max(1, len(order) // 8)]]
    return float(min(deviations, default=0.0))


def _standard_error(design: np.ndarray, left: float) -> float:
    """Of the second coefficient of a least squares fit that leaves a residual of this norm."""
    scatter = left**2 / max(len(design) - 2, 1)
    return float(np.sqrt(np.linalg.pinv(design.T @ design)[1, 1] * scatter))
