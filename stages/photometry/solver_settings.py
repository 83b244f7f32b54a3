"""Weights of the solvers, from the settings of `decomposition` and the size of the views."""

from __future__ import annotations

from typing import TYPE_CHECKING

from stages.photometry.albedo.settings import REFERENCE_SIDE_PX
from stages.photometry.decomposition_settings import DecompositionSettings
from stages.photometry.joint.settings import given_or

if TYPE_CHECKING:
    from stages.photometry.paper.energy import EnergyWeights

PAPER_SIDE = 720.0  # px: side of a square of the paper's 540 × 960, for which λ of `mode: paper` is stated


def weights_at(
    settings: DecompositionSettings, side: float, correspondences_per_pixel: float
) -> EnergyWeights:
    """Scale λ and μ of Eq. 2 to views of a side, px, taken as squares.

    The data term grows with the area and the smoothness with the side, so λ is proportional to the side.
    """
    from stages.photometry.paper.energy import EnergyWeights

    usual = settings.usual_weights
    consistency = given_or(settings.mu, usual.consistency)
    if settings.mode == "transfer":
        smoothness = given_or(settings.lambda_, usual.smoothness) * side / REFERENCE_SIDE_PX
        return EnergyWeights(
            smoothness, consistency / correspondences_per_pixel if correspondences_per_pixel else 0.0
        )
    return EnergyWeights(given_or(settings.lambda_, usual.smoothness * side / PAPER_SIDE), consistency)
