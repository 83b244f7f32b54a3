"""`mode: transfer`: the albedo under a known light, by constant weights (Eq. 2) and by weights per edge."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from types import MappingProxyType

import numpy as np

from stages.photometry.albedo.albedo_edges import agreement_of_correspondences, smoothness_of_edges
from stages.photometry.albedo.appearance import appearance_of
from stages.photometry.albedo.settings import EdgeSettings
from stages.photometry.albedo.smooth_albedo import albedo_under_light
from stages.photometry.albedo.soft_texture import soft_texture
from stages.photometry.albedo_data import AlbedoData
from stages.photometry.chromaticity import in_white_light
from stages.photometry.joint.begun_level import BegunLevel
from stages.photometry.joint.fast_alternation import FastSolver, Settled
from stages.photometry.joint.problem_assembly import ALIKE, EdgeWeights
from stages.photometry.stack import StackedViews
from stages.solvers.kernels.arrays_in_files import in_file
from stages.solvers.kernels.threading_layer import use_threads

KINDS = ("alike", "by_edge")  # of smooth albedo; as `SmoothAlbedos`
NOTHING_BEGUN: Mapping[str, BegunLevel] = MappingProxyType({})


@dataclass(frozen=True, eq=False)
class SmoothAlbedos:
    """Smooth albedos under a light; pixels as in the stack, images scaled.

    Attributes
    ----------
    alike : Settled
        ρ of Eq. 2 under that light, for `albedo_tv`.
    by_edge : Settled
        ρ with weights per edge, to which detail is added.
    """

    alike: Settled
    by_edge: Settled


def smooth_albedos_under_light(
    views: StackedViews,
    shading: np.ndarray,
    data: AlbedoData,
    by_edge: EdgeWeights,
    descent: FastSolver,
    threads: int,
    step: Callable[[], None],
    folder: Path | None = None,
    begun: Mapping[str, BegunLevel] = NOTHING_BEGUN,
) -> SmoothAlbedos:
    """Estimate the smooth albedo under a known light: ρ of Eq. 2, and ρ with weights per edge.

    Parameters
    ----------
    views : StackedViews
        The basis is not used.
    shading : ndarray, shape (N, 3), float32
        Under the light, gains of the views included.
    data : AlbedoData
    by_edge : EdgeWeights
        See `weights_of_edges`.
    descent : FastSolver
        Its λ and μ are those of `albedo_tv`.
    threads : int
        Never changes the result.
    step : callable
        Called after every round.
    folder : Path or None
        Where coarse levels wait, and the first albedo while the second is solved; None: in memory.
    begun : mapping of str to BegunLevel
        By kind of albedo, `KINDS`: coarse levels of all views, where these are some of their pixels.
    """
    use_threads(threads)

    def solved(kind: str, weights: EdgeWeights) -> Settled:
        given = views, data.diffuse, shading, data.trusted, weights, descent, threads, step, folder
        return albedo_under_light(*given, begun.get(kind))

    alike = solved("alike", ALIKE)
    alike = replace(alike, albedo=in_file([alike.albedo], folder)[0])
    return SmoothAlbedos(alike, solved("by_edge", by_edge))


def weights_of_edges(
    views: StackedViews,
    shading: np.ndarray,
    data: AlbedoData,
    edges: EdgeSettings,
    consistency: float,
    typical_light: float,
) -> EdgeWeights:
    """Compute λ between neighbours and μ between views.

    `consistency`: the least μ of any correspondence; `typical_light`: the median brightness of the shading,
    over the whole scene.
    """
    shown = in_white_light(data.observed, shading)
    surface = appearance_of(views, shown, shading, data.trusted, edges, data.glossy, typical_light)
    del shown
    white = in_white_light(data.diffuse, shading)
    soft = soft_texture(views, white, shading, data.trusted, edges)
    return EdgeWeights(
        smoothness_of_edges(views, white, shading, surface.textured, soft, edges),
        agreement_of_correspondences(views, consistency, surface.inconsistent, edges.inconsistency_gain),
    )
