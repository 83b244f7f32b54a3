"""The energy, the smoothed energy that reweighting descends, and the gauge that fixes their scale."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass

import numpy as np

from stages.photometry.stack import StackedViews
from stages.solvers.least_squares.difference_operators import Pixels
from stages.solvers.least_squares.reweighted_least_squares import smoothed_absolute


@dataclass(frozen=True)
class EnergyWeights:
    """Weights of the terms of Eq. 2.

    Attributes
    ----------
    smoothness : float
        λ.
    consistency : float
        μ.
    """

    smoothness: float
    consistency: float


@dataclass(frozen=True)
class EnergyTerms:
    """The three sums of Eq. 2, not yet weighted by λ and μ."""

    photo: float
    smooth: float
    multi_view: float

    def total(self, weights: EnergyWeights) -> float:
        """Sum the terms with their weights.

        Eq. 2: ``ε = Σ_i ε_Photo(σ^i, ρ^i) + λ Σ_i ε_Smooth(ρ^i) + μ Σ_{i<j} ε_MV(ρ^i, ρ^j)``
        """
        return self.photo + weights.smoothness * self.smooth + weights.consistency * self.multi_view


def photometric_residual(image: np.ndarray, albedo: np.ndarray, shading: np.ndarray) -> np.ndarray:
    """Compute the residual of the image, ``I − ρ σ·ν``, shape (N,)."""
    return image - albedo * shading


def photometric_term(image: np.ndarray, albedo: np.ndarray, shading: np.ndarray) -> float:
    """Sum the photometric misfit over the views.

    Eq. 3: ``ε_Photo(σ^i, ρ^i) = Σ_p |I^i(p) − ρ^i(p) σ^i·ν^i(p)|``
    """
    return float(np.abs(photometric_residual(image, albedo, shading)).sum())


def smoothness_term(views: StackedViews, albedo: np.ndarray) -> float:
    """Sum the anisotropic total variation over the views.

    Eq. 4: ``ε_Smooth(ρ^i) = Σ_p |∂x ρ^i(p)| + |∂y ρ^i(p)|``
    """
    return float(_differences_of(albedo, views.neighbours()))


def consistency_term(views: StackedViews, albedo: np.ndarray) -> float:
    """Sum the differences between corresponding albedos over the pairs of views i < j.

    Eq. 5: ``ε_MV(ρ^i, ρ^j) = Σ_{p^i} Σ_{p^j} C_ij(p^i, p^j) |ρ^i(p^i) − ρ^j(p^j)|``
    """
    return float(_differences_of(albedo, views.linked_pixels()))


def _differences_of(albedo: np.ndarray, pairs: Iterable[Pixels]) -> np.ndarray:
    """Sum ``|ρ_q − ρ_p|`` per channel, float64, view by view: never all pairs at a time."""
    total = np.zeros(albedo.shape[1:])
    for p, q in pairs:
        apart = np.abs(albedo[q].astype(np.float64) - albedo[p])
        total += np.ascontiguousarray(apart.T).sum(axis=-1)  # contiguous per channel: pairwise summation
    return total


def energy_terms(
    views: StackedViews, image: np.ndarray, albedo: np.ndarray, light: np.ndarray
) -> EnergyTerms:
    """Evaluate the three sums of one channel: image and albedo of shape (N,), light of shape (n, 9)."""
    return EnergyTerms(
        photo=photometric_term(image, albedo, views.shading(light)),
        smooth=smoothness_term(views, albedo),
        multi_view=consistency_term(views, albedo),
    )


def channel_terms(
    views: StackedViews, images: Sequence[np.ndarray], albedo: np.ndarray, shading: np.ndarray
) -> tuple[EnergyTerms, ...]:
    """Evaluate the three sums of every channel: images of shape (N,), albedo and shading (N, c)."""
    photo = [photometric_term(image, albedo[:, c], shading[:, c]) for c, image in enumerate(images)]
    smooth = _differences_of(albedo, views.neighbours())
    multi_view = _differences_of(albedo, views.linked_pixels())
    return tuple(EnergyTerms(*map(float, terms)) for terms in zip(photo, smooth, multi_view, strict=True))


def smoothed_energy(
    views: StackedViews,
    image: np.ndarray,
    albedo: np.ndarray,
    light: np.ndarray,
    weights: EnergyWeights,
    delta: float,
) -> float:
    """Evaluate Eq. 2 with h_δ in place of ``|·|``, which no step at fixed δ can raise.

    Missing differences (mask borders, pixels without correspondence) add nothing, not even h_δ(0).
    """
    photo = smoothed_absolute(photometric_residual(image, albedo, views.shading(light)), delta).sum()
    smooth = (
        smoothed_absolute(views.d_x @ albedo, delta).sum()
        + smoothed_absolute(views.d_y @ albedo, delta).sum()
    )
    multi_view = smoothed_absolute(views.c @ albedo, delta).sum()
    return float(photo + weights.smoothness * smooth + weights.consistency * multi_view)


def gauge_scale(image: np.ndarray, albedo: np.ndarray) -> float:
    """Compute the factor s with Σ|s ρ| = Σ|I| over all pixels of a channel; 1 where there is none.

    Notes
    -----
    Deviation 1: the paper fixes no gauge. (ρ, σ) → (s ρ, σ/s) leaves Eq. 3 unchanged and scales Eq. 4 and 5
    by s, so that inf ε = 0 and a long descent drifts to black. Energies are compared in this gauge only.
    """
    current, wanted = float(np.abs(albedo).sum()), float(np.abs(image).sum())
    return wanted / current if current > 0 and wanted > 0 else 1.0
