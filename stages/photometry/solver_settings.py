"""What the settings of `lighting` and `decomposition` mean to the solvers, at the size of the views."""

from __future__ import annotations

from typing import TYPE_CHECKING

from stages.photometry.decomposition_settings import DecompositionSettings, given_or
from stages.photometry.lighting.settings import LightingSettings

if TYPE_CHECKING:
    from stages.photometry.albedo.albedo_given_light import AlbedoSettings
    from stages.photometry.joint.fast_alternation import FastSettings
    from stages.photometry.joint.transfer_alternation import TransferAlternation
    from stages.photometry.lighting.illumination import IlluminationSettings
    from stages.photometry.paper.alternation import AlternationSettings
    from stages.photometry.paper.energy import EnergyWeights

BEST_ON_FIG_3 = {"paper": (40.0, 1.0), "fast": (12.0, 0.2)}  # λ, μ by solver (docs/paper)
PAPER_SIDE = 720.0  # px: of 540 × 960, were it a square
OWN_SIDE = 180.0  # px: of the views that λ of `mode: transfer` is stated for
OWN_LAMBDA, OWN_MU = 3.0, 1.0  # of `mode: transfer`


def weights_at(settings: DecompositionSettings, side: float, links_per_pixel: float) -> EnergyWeights:
    """λ and μ of Eq. 2 for views of a side, px, were they squares.

    The data count pixels and the smoothness lengths, so the same balance takes a λ in proportion to the side.
    """
    from stages.photometry.paper.energy import EnergyWeights

    if settings.mode == "transfer":
        smoothness, consistency = given_or(settings.lambda_, OWN_LAMBDA), given_or(settings.mu, OWN_MU)
        consistency = consistency / links_per_pixel if links_per_pixel else 0.0
        return EnergyWeights(smoothness * side / OWN_SIDE, consistency, settings.delta)
    smoothness, consistency = BEST_ON_FIG_3[settings.solver or "paper"]
    return EnergyWeights(
        given_or(settings.lambda_, smoothness * side / PAPER_SIDE),
        given_or(settings.mu, consistency),
        settings.delta,
    )


def as_alternation(settings: DecompositionSettings, weights: EnergyWeights) -> AlternationSettings:
    """For `solver: paper`."""
    from stages.photometry.paper.alternation import AlternationSettings

    return AlternationSettings(
        weights=weights,
        max_alternations=settings.max_alternations,
        energy_tolerance=settings.energy_tolerance,
        cg_tolerance=settings.cg_tolerance,
        cg_max_steps=settings.cg_max_steps,
    )


def as_fast(settings: DecompositionSettings, weights: EnergyWeights) -> FastSettings:
    """For `solver: fast`."""
    from stages.photometry.joint.fast_alternation import FastSettings

    stopping = settings.stopping
    return FastSettings(
        weights=weights,
        tolerance=stopping.tolerance,
        gap_tolerance=stopping.gap,
        max_rounds=stopping.rounds,
    )


def as_transfer(settings: DecompositionSettings, weights: EnergyWeights) -> TransferAlternation:
    """For `light: harmonics`."""
    from stages.photometry.joint.transfer_alternation import TransferAlternation
    from stages.photometry.transport.pixel_transfer import Bounces

    scale = settings.reflectance_scale
    bounces = Bounces(
        int(given_or(settings.bounces, LightingSettings().bounces)),
        given_or(settings.brightest, scale.usual_brightest),
        scale.brightest_quantile,
    )
    return TransferAlternation(as_fast(settings, weights), bounces)


def as_illumination(settings: LightingSettings) -> IlluminationSettings:
    """For the light of `light: directions`."""
    from stages.photometry.light_search.light_estimate import LightSearchSettings
    from stages.photometry.light_search.light_from_pairs import PairWeights
    from stages.photometry.lighting.illumination import IlluminationSettings
    from stages.photometry.lighting.shared_or_own_lights import LightSharing

    return IlluminationSettings(
        light=LightSearchSettings(
            samples=settings.samples,
            bounces=settings.bounces,
            brightest=settings.brightest,
            weights=PairWeights(settings.neutrality, settings.evenness),
        ),
        lighting=LightSharing(settings.lights, settings.still_up_to, settings.moving_light),
        stage=settings,
    )


def as_sky(settings: DecompositionSettings, weights: EnergyWeights, side: float) -> AlbedoSettings:
    """For the albedo under that light."""
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
        descent=as_fast(settings, weights),
    )
