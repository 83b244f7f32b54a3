"""The light under which pixels of like paint come out alike: found without the albedo."""

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
    """Pixels that the light is found from.

    Attributes
    ----------
    image : ndarray, shape (n, 3)
        Scaled; gains of the views divided out.
    shares : ndarray, shape (n, M), float32
        What each direction adds to a pixel's shading, per unit of light.
    light_of : ndarray, shape (n,)
        Which of the G lights a pixel stands in.
    cells : ndarray, shape (M,)
        Share of all directions that each stands for.
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
    """Descend from a light to a better one.

    Parameters
    ----------
    sample : Sample
    bounced : ndarray, shape (n, 3)
        Shading by light from other surface, as it is now.
    pairs : Pairs
    scale : float
        Difference of two log albedos at which a pair stops being taken for the same paint.
    start : ndarray, shape (G, M, 3)
        Light, at least 0.
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
    (Geman and McClure): pairs of different paint count, at most, as one that is quite wrong. Neither an
    albedo nor its smoothness enters, so no λ weighs against the paint; and since light is at least 0
    everywhere, so is the shading.
    """
    objective = PairObjective(sample, bounced, pairs, scale, settings, len(start))
    how = settings.search
    settled = how.slope_tolerance / len(start)  # each of many lights has as much less to say in the mean loss
    return descend_above_zero(objective, start, how.max_steps, settled)


def disagreement(
    image: np.ndarray, shading: np.ndarray, pairs: Pairs, scale: float, how: PairSettings
) -> float:
    """Mean loss of pairs of pixels, (n, 3) each, under a shading: 0 to 1, as `light_from_pairs` has it."""
    return _Losses(image, how).of(shading, pairs, scale)[0]


def weighted_by_reliability(
    image: np.ndarray, shading: np.ndarray, pairs: Pairs, scale: float, how: PairSettings
) -> Pairs:
    """Weigh pairs of each kind by how far they are to be believed; arguments as of `disagreement`.

    Notes
    -----
    With d what pairs of a kind disagree by, a near pair counts ``min(1, (d_nearest / d)²)``, and those of one
    colour together ``chromaticity_share min(1, (d_near / d_colour)²)`` of the whole. Grey paint that changes
    softly has one colour and many depths: who is nearest tells the light from it. Paint in stripes, where who
    is near disagrees as much as anybody, leaves all of them their say. The nearest are those of the smallest
    squares that have pairs enough.
    """
    kinds = pairs.kinds
    left = {kind: disagreement(image, shading, pairs.of_kind(kind), scale, how) for kind in kinds}
    near = [kind for kind in kinds if kind != COLOUR]
    if not near:
        return pairs
    nearest = next((kind for kind in near if pairs.count(kind) >= how.fewest), near[-1])
    worth = {kind: _credit(left[kind], left[nearest]) for kind in near}
    weighted = pairs.weighted(0.0, worth)
    of_near = disagreement(image, shading, weighted, scale, how)
    return pairs.weighted(how.chromaticity_share * _credit(left.get(COLOUR, 0.0), of_near), worth)


def _credit(left: float, least: float) -> float:
    """1 for what leaves no more than the best witness; the square of the ratio for what leaves more."""
    return 1.0 if left <= least else (least / left) ** 2


class _Losses:
    """What pairs of pixels lose under a shading, and the slope."""

    def __init__(self, image: np.ndarray, how: PairSettings) -> None:
        image, self._how = image.astype(np.float64), how
        self._logs = np.log(np.maximum(image, how.darkest))
        self._trust = (image / (image + 2 * how.noise)) ** 2
        self._trust[image <= 0] = 0

    def of(self, shading: np.ndarray, pairs: Pairs, scale: float) -> tuple[float, np.ndarray]:
        """Mean loss, and its slope by the shading, (n, 3), float32."""
        shading = np.maximum(shading.astype(np.float64), 0) + self._how.darkest
        by_log = np.zeros_like(self._logs)
        logs = self._logs - np.log(shading)
        who = pairs.first, pairs.second, pairs.weight
        loss = pair_losses(logs, self._trust, *who, scale, self._how.chroma_weight, by_log)
        return loss, (-by_log / shading).astype(np.float32)


class PairObjective:
    """Value and slope of what `light_from_pairs` minimises."""

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
        """Loss of the pairs, and its slope by the light."""
        shading = self._bounced.copy()
        for rows, shares, own in zip(self._rows, self._shares, light, strict=True):
            shading[rows] += shares @ own.astype(np.float32)
        loss, by_shading = self._losses.of(shading, self._pairs, self._scale)
        slopes = [shares.T @ by_shading[rows] for rows, shares in zip(self._rows, self._shares, strict=True)]
        return loss, np.stack(slopes).astype(np.float64)
