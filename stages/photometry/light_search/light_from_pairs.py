"""Estimation of light from pairs of pixels of equal albedo, without the albedo itself."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from stages.photometry.light_search.pair_loss_kernel import share_among_channels, sum_losses, sum_slopes
from stages.photometry.light_search.pair_sampling import COLOUR, Pairs
from stages.photometry.light_search.sampled_shading import SampledShading
from stages.photometry.light_search.settings import LightSearchSettings, PairSettings
from stages.photometry.transport.light_priors import colour_contrast, contrast
from stages.solvers.least_squares.non_negative import descend_above_zero

PARTS = 4  # of the pairs: more would have more gradients to add up than threads save


@dataclass(frozen=True, eq=False)
class Sample:
    """Pixels that the light is estimated from.

    Attributes
    ----------
    image : ndarray, shape (n, 3)
        Scaled; gains of the views divided out.
    shares : ndarray, shape (n, M), float32
        Shading of a pixel per unit of radiance from each direction.
    light_of : ndarray, shape (n,)
        Index, of G, of the light of a pixel.
    cells : ndarray, shape (M,)
        Solid angle of each direction as a share of the sphere.
    """

    image: np.ndarray
    shares: np.ndarray
    light_of: np.ndarray
    cells: np.ndarray


def light_from_pairs(
    sample: Sample,
    bounced: np.ndarray,
    pairs: Pairs,
    scale: float,
    start: np.ndarray,
    settings: LightSearchSettings,
) -> np.ndarray:
    """Minimise the loss of pairs of equal albedo over the light.

    Parameters
    ----------
    sample : Sample
    bounced : ndarray, shape (n, 3)
        Current shading by interreflection.
    pairs : Pairs
    scale : float
        Difference of two log albedos from which on a pair is an outlier, of different albedo.
    start : ndarray, shape (G, M, 3)
        Initial light, at least 0.
    settings : LightSearchSettings

    Returns
    -------
    ndarray, shape (G, M, 3)
        At least 0.

    Notes
    -----
    Minimises, over light e ≥ 0 (bounds kept by L-BFGS-B),
    ``Σ_pq w_pq φ(u_pq) + neutrality + evenness`` with ``u = (m² + chroma_weight² v) / scale²``, m and v the
    channels' mean and variance of ``log ρ_p − log ρ_q``, ``ρ = I / (T e + bounced)`` and ``φ(u) = u/(1 + u)``
    (Geman and McClure), which bounds the loss of pairs of different albedo. Neither an albedo nor its
    smoothness enters, so no λ trades it off against the data. Shading is at least 0 since light is.
    """
    objective = PairObjective(sample, bounced, pairs, scale, settings)
    how = settings.search
    tolerance = how.slope_tolerance / len(start)  # the mean loss depends on each of G lights by 1/G
    return descend_above_zero(objective, start, how.max_steps, tolerance)


def disagreement(
    image: np.ndarray, shading: np.ndarray, pairs: Pairs, scale: float, how: PairSettings
) -> float:
    """Compute the mean loss, 0 to 1, of pairs of pixels, (n, 3), under a shading; see `light_from_pairs`."""
    return PairLoss(image, pairs, scale, how).mean(shading)


def weighted_by_reliability(
    image: np.ndarray, shading: np.ndarray, pairs: Pairs, scale: float, how: PairSettings
) -> Pairs:
    """Weigh pairs of each kind by their reliability; arguments as of `disagreement`.

    Notes
    -----
    With d the mean loss of a kind, a near pair has the weight ``min(1, (d_nearest / d)²)``, and pairs of one
    chromaticity together ``chromaticity_share min(1, (d_near / d_colour)²)`` of the whole. Smoothly varying
    grey albedo has one chromaticity and many intensities: there, the nearest pairs distinguish light from
    albedo. In striped albedo near pairs have as large a loss as others, and all keep their weight. The
    nearest are those of the smallest squares that have enough pairs.
    """
    kinds = pairs.kinds
    left = {kind: disagreement(image, shading, pairs.of_kind(kind), scale, how) for kind in kinds}
    near = [kind for kind in kinds if kind != COLOUR]
    if not near:
        return pairs
    nearest = next((kind for kind in near if pairs.count(kind) >= how.fewest), near[-1])
    reliability = {kind: _reliability(left[kind], left[nearest]) for kind in near}
    weighted = pairs.weighted(0.0, reliability)
    of_near = disagreement(image, shading, weighted, scale, how)
    of_colour = how.chromaticity_share * _reliability(left.get(COLOUR, 0.0), of_near)
    return pairs.weighted(of_colour, reliability)


def _reliability(loss: float, least: float) -> float:
    """Compute ``min(1, (least / loss)²)``."""
    return 1.0 if loss <= least else (least / loss) ** 2


def reliability(image: np.ndarray, how: PairSettings) -> np.ndarray:
    """Compute the reliability, 0 to 1, of intensities beside their noise; 0 of what is not above 0."""
    bright = np.maximum(image, 0)
    return (bright / (bright + 2 * how.noise)) ** 2


class PairLoss:
    """Loss of pairs of pixels under a shading, ``Σ w φ(u)`` of `light_from_pairs`, and its gradient.

    Parameters
    ----------
    image : ndarray, shape (n, 3)
        Scaled.
    pairs : Pairs
    scale : float
    how : PairSettings
    """

    def __init__(self, image: np.ndarray, pairs: Pairs, scale: float, how: PairSettings) -> None:
        image, self._darkest = image.astype(np.float64), how.darkest
        self._logs = np.log(np.maximum(image, how.darkest))
        shares = np.empty((len(pairs.first), 3), np.float32)
        share_among_channels(reliability(image, how), pairs.first, pairs.second, shares)
        self._pairs = pairs.first, pairs.second, shares, pairs.weight
        self._scales = scale, how.chroma_weight

    def mean(self, shading: np.ndarray) -> float:
        """Compute the mean loss under a shading, (n, 3)."""
        totals = np.empty(PARTS)
        sum_losses(self._logs - np.log(self._lit(shading)), self._pairs, *self._scales, totals)
        return float(totals.sum())

    def mean_and_slope(self, shading: np.ndarray) -> tuple[float, np.ndarray]:
        """Compute the mean loss, and its gradient by the shading, (n, 3)."""
        lit, totals, slopes = self._lit(shading), np.empty(PARTS), np.zeros((PARTS, *self._logs.shape))
        sum_slopes(self._logs - np.log(lit), self._pairs, *self._scales, totals, slopes)
        return float(totals.sum()), -slopes.sum(axis=0) / lit

    def _lit(self, shading: np.ndarray) -> np.ndarray:
        return np.maximum(shading.astype(np.float64), 0) + self._darkest


class PairObjective:
    """Value and gradient of the objective of `light_from_pairs`."""

    def __init__(
        self,
        sample: Sample,
        bounced: np.ndarray,
        pairs: Pairs,
        scale: float,
        settings: LightSearchSettings,
    ) -> None:
        self._sample, self._bounced, self._settings = sample, bounced, settings
        self._loss = PairLoss(sample.image, pairs, scale, settings.pairs)
        self._direct = SampledShading(sample.shares, sample.light_of)

    def __call__(self, light: np.ndarray) -> tuple[float, np.ndarray]:
        loss, slope = self.disagreement(light)
        priors = (colour_contrast, self._settings.neutrality), (contrast, self._settings.evenness)
        for term, weight in priors:
            price, own = term(light, self._sample.cells)
            loss, slope = loss + weight * price, slope + weight * own
        return loss, slope

    def disagreement(self, light: np.ndarray) -> tuple[float, np.ndarray]:
        """Compute the loss of the pairs, and its gradient by the light."""
        shading = self._direct.beside(self._bounced, light)
        loss, by_shading = self._loss.mean_and_slope(shading)
        return loss, self._direct.slope_by_light(by_shading, len(light))
