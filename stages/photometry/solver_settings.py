"""What the settings of `decomposition` mean to the solvers, at the size of the views."""

from __future__ import annotations

from typing import TYPE_CHECKING

from stages.photometry.decomposition_settings import DecompositionSettings, given_or

if TYPE_CHECKING:
    from stages.photometry.albedo.albedo_given_light import AlbedoSettings
    from stages.photometry.joint.fast_alternation import FastSolver
    from stages.photometry.paper.energy import EnergyWeights

# Sides of the views that λ is stated for, px, were they squares: units, no choice.
PAPER_SIDE = 720.0  # of 540 × 960, in `mode: paper`, where λ is not set
OWN_SIDE = 180.0  # in `mode: transfer`


def weights_at(settings: DecompositionSettings, side: float, links_per_pixel: float) -> EnergyWeights:
    """Scale λ and μ of Eq. 2 to views of a side, px, were they squares.

    The data count pixels and the smoothness lengths, so the same balance takes a λ in proportion to the side.
    """
    from stages.photometry.paper.energy import EnergyWeights

    usual = settings.usual_weights
    consistency = given_or(settings.mu, usual.consistency)
    if settings.mode == "transfer":
        smoothness = given_or(settings.lambda_, usual.smoothness) * side / OWN_SIDE
        return EnergyWeights(smoothness, consistency / links_per_pixel if links_per_pixel else 0.0)
    return EnergyWeights(given_or(settings.lambda_, usual.smoothness * side / PAPER_SIDE), consistency)


def as_sky(settings: DecompositionSettings, solver: FastSolver, side: float) -> AlbedoSettings:
    """Pass on what the albedo under that light is found by."""
    from stages.photometry.albedo.albedo_given_light import AlbedoSettings
    from stages.photometry.albedo.paint_edges import PaintEdges
    from stages.photometry.detail.detail_octaves import DetailSettings

    return AlbedoSettings(
        edges=PaintEdges(
            coarse=max(settings.fine_lambda, settings.coarse_lambda * side / OWN_SIDE),
            fine=settings.fine_lambda,
            shading_step=settings.shading_step,
            chroma_step=settings.chroma_step,
        ),
        detail=DetailSettings(
            least_doubt=settings.shading_doubt,
            most_doubt=settings.most_shading_doubt,
            chroma=settings.chroma_doubt,
            level=settings.level_doubt,
            window=settings.doubt_window,
        ),
        descent=solver,
    )
