"""The light under which pixels of like paint come out alike: found without the albedo."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from stages.photometry.light_search.pair_loss_kernel import pair_losses
from stages.photometry.light_search.pair_sampling import COLOUR, Pairs
from stages.photometry.transport.light_priors import colour_contrast, contrast
from stages.solvers.least_squares.non_negative import SETTLED, descend_above_zero

DARKEST = 1e-4  # of the scaled image, or of the shading: what logarithms do not go below
ENOUGH = 200  # pairs that tell how far paint of that distance differs
OF_ONE_COLOUR = 0.2  # of the weight, at most: there is darker paint of the same colour, grey above all


@dataclass(frozen=True)
class PairWeights:
    """What else is asked of the light, beside what the pairs say.

    Attributes
    ----------
    neutrality : float
        Price of channels that disagree about where the light comes from.
    evenness : float
        Price of light that differs from direction to direction.
    noise : float
        Of the scaled image: pixels darker than twice that say little.
    colour : float
        How many times as much as one of brightness a difference of colour tells of other paint: shadows are
        deep, but hardly of another colour.
    max_steps : int
        Of the descent.
    """

    neutrality: float = 0.005
    evenness: float = 1e-3
    noise: float = 0.01
    colour: float = 2.0
    max_steps: int = 200


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
    weights: PairWeights,
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
    weights : PairWeights

    Returns
    -------
    ndarray, shape (G, M, 3)
        At least 0.

    Notes
    -----
    Minimises, over light e ≥ 0 (bounds kept by L-BFGS-B),
    ``Σ_pq w_pq φ(u_pq) + neutrality + evenness`` with ``u = (m² + colour² v) / scale²``, m and v the
    channels' mean and variance of ``log ρ_p − log ρ_q``, ``ρ = I / (T e + bounced)`` and ``φ(u) = u/(1 + u)``
    (Geman and McClure): pairs of different paint count, at most, as one that is quite wrong. Neither an
    albedo nor its smoothness enters, so no λ weighs against the paint; and since light is at least 0
    everywhere, so is the shading.
    """
    objective = PairObjective(sample, bounced, pairs, scale, weights, len(start))
    settled = SETTLED / len(start)  # each of many lights has as much less to say in the mean of all pairs
    return descend_above_zero(objective, start, weights.max_steps, settled)


def disagreement(
    image: np.ndarray, shading: np.ndarray, pairs: Pairs, scale: float, weights: PairWeights
) -> float:
    """Mean loss of pairs of pixels, (n, 3) each, under a shading: 0 to 1, as `light_from_pairs` has it."""
    return _Losses(image, weights).of(shading, pairs, scale)[0]


def weighted_by_reliability(
    image: np.ndarray, shading: np.ndarray, pairs: Pairs, scale: float, weights: PairWeights
) -> Pairs:
    """Weigh pairs of each kind by how far they are to be believed; arguments as of `disagreement`.

    Notes
    -----
    With d what pairs of a kind disagree by, a near pair counts ``min(1, (d_nearest / d)²)``, and those of one
    colour together ``0.2 min(1, (d_near / d_colour)²)`` of the whole. Grey paint that changes softly has one
    colour and many depths: who is nearest tells the light from it. Paint in stripes, where who is near
    disagrees as much as anybody, leaves all of them their say. The nearest are those of the smallest squares
    that have pairs enough.
    """
    kinds = pairs.kinds
    left = {kind: disagreement(image, shading, pairs.of_kind(kind), scale, weights) for kind in kinds}
    near = [kind for kind in kinds if kind != COLOUR]
    if not near:
        return pairs
    nearest = next((kind for kind in near if pairs.count(kind) >= ENOUGH), near[-1])
    worth = {kind: _credit(left[kind], left[nearest]) for kind in near}
    weighted = pairs.weighted(0.0, worth)
    of_near = disagreement(image, shading, weighted, scale, weights)
    return pairs.weighted(OF_ONE_COLOUR * _credit(left.get(COLOUR, 0.0), of_near), worth)


def _credit(left: float, least: float) -> float:
    """1 for what leaves no more than the best witness; the square of the ratio for what leaves more."""
    return 1.0 if left <= least else (least / left) ** 2


class _Losses:
    """What pairs of pixels lose under a shading, and the slope."""

    def __init__(self, image: np.ndarray, weights: PairWeights) -> None:
        image, self._colour = image.astype(np.float64), weights.colour
        self._logs = np.log(np.maximum(image, DARKEST))
        self._trust = (image / (image + 2 * weights.noise)) ** 2
        self._trust[image <= 0] = 0

    def of(self, shading: np.ndarray, pairs: Pairs, scale: float) -> tuple[float, np.ndarray]:
        """Mean loss, and its slope by the shading, (n, 3), float32."""
        shading = np.maximum(shading.astype(np.float64), 0) + DARKEST
        by_log = np.zeros_like(self._logs)
        logs = self._logs - np.log(shading)
        who = pairs.first, pairs.second, pairs.weight
        loss = pair_losses(logs, self._trust, *who, scale, self._colour, by_log)
        return loss, (-by_log / shading).astype(np.float32)


class PairObjective:
    """Value and slope of what `light_from_pairs` minimises."""

    def __init__(
        self,
        sample: Sample,
        bounced: np.ndarray,
        pairs: Pairs,
        scale: float,
        weights: PairWeights,
        lights: int,
    ) -> None:
        self._sample, self._bounced, self._pairs = sample, bounced, pairs
        self._scale, self._weights = scale, weights
        self._losses = _Losses(sample.image, weights)
        order = np.argsort(sample.light_of, kind="stable")
        ends = np.searchsorted(sample.light_of[order], np.arange(lights + 1))
        self._rows = [order[a:b] for a, b in zip(ends, ends[1:], strict=False)]
        whole = len(self._rows) == 1
        self._shares = [sample.shares] if whole else [sample.shares[rows] for rows in self._rows]

    def __call__(self, light: np.ndarray) -> tuple[float, np.ndarray]:
        loss, slope = self.disagreement(light)
        for term, weight in ((colour_contrast, self._weights.neutrality), (contrast, self._weights.evenness)):
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
