"""Estimation of light from pairs of pixels of equal albedo, without the albedo itself."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from stages.photometry.light_search.pair_loss_kernel import pair_losses
from stages.photometry.light_search.pair_sampling import COLOUR, Pairs
from stages.photometry.light_search.settings import LightSearchSettings, PairSettings
from stages.photometry.transport.light_priors import colour_contrast, contrast
from stages.solvers.least_squares.non_negative import descend_above_zero


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
    objective = PairObjective(sample, bounced, pairs, scale, settings, len(start))
    how = settings.search
    tolerance = how.slope_tolerance / len(start)  # the mean loss depends on each of G lights by 1/G
    return descend_above_zero(objective, start, how.max_steps, tolerance)


def disagreement(
    image: np.ndarray, shading: np.ndarray, pairs: Pairs, scale: float, how: PairSettings
) -> float:
    """Compute the mean loss, 0 to 1, of pairs of pixels, (n, 3), under a shading; see `light_from_pairs`."""
    return _Losses(image, how).of(shading, pairs, scale)[0]


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


class _Losses:
    """Loss of pairs of pixels under a shading, and its gradient."""

    def __init__(self, image: np.ndarray, how: PairSettings) -> None:
        image, self._how = image.astype(np.float64), how
        self._logs = np.log(np.maximum(image, how.darkest))
        self._trust = reliability(image, how)

    def of(self, shading: np.ndarray, pairs: Pairs, scale: float) -> tuple[float, np.ndarray]:
        """Compute the mean loss, and its gradient by the shading, (n, 3), float32."""
        shading = np.maximum(shading.astype(np.float64), 0) + self._how.darkest
        by_log = np.zeros_like(self._logs)
        logs = self._logs - np.log(shading)
        ends = pairs.first, pairs.second, pairs.weight
        loss = pair_losses(logs, self._trust, *ends, scale, self._how.chroma_weight, by_log)
        return loss, (-by_log / shading).astype(np.float32)


class PairObjective:
    """Value and gradient of the objective of `light_from_pairs`."""

    def __init__(
        self,
        sample: Sample,
        bounced: np.ndarray,
        pairs: Pairs,
        scale: float,
        settings: LightSearchSettings,
        lights: int,
    ) -> None:
        self._sample, self._bounced, self._pairs = sample, bounced, pairs
        self._scale, self._settings = scale, settings
        self._losses = _Losses(sample.image, settings.pairs)
        order = np.argsort(sample.light_of, kind="stable")
        ends = np.searchsorted(sample.light_of[order], np.arange(lights + 1))
        self._rows = [order[a:b] for a, b in zip(ends, ends[1:], strict=False)]
        whole = len(self._rows) == 1
        self._shares = [sample.shares] if whole else [sample.shares[rows] for rows in self._rows]

    def __call__(self, light: np.ndarray) -> tuple[float, np.ndarray]:
        loss, slope = self.disagreement(light)
        priors = (colour_contrast, self._settings.neutrality), (contrast, self._settings.evenness)
        for term, weight in priors:
            price, own = term(light, self._sample.cells)
            loss, slope = loss + weight * price, slope + weight * own
        return loss, slope

    def disagreement(self, light: np.ndarray) -> tuple[float, np.ndarray]:
        """Compute the loss of the pairs, and its gradient by the light."""
        shading = self._bounced.copy()
        for rows, shares, own in zip(self._rows, self._shares, light, strict=True):
            shading[rows] += shares @ own.astype(np.float32)
        loss, by_shading = self._losses.of(shading, self._pairs, self._scale)
        slopes = [shares.T @ by_shading[rows] for rows, shares in zip(self._rows, self._shares, strict=True)]
        return loss, np.stack(slopes).astype(np.float64)
