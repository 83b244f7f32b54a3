"""`mode: transfer`: the albedo under a known light, by constant weights (Eq. 2) and by weights per edge."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from stages.photometry.albedo.albedo_edges import agreement_of_correspondences, smoothness_of_edges
from stages.photometry.albedo.appearance import appearance_of
from stages.photometry.albedo.settings import EdgeSettings
from stages.photometry.albedo.smooth_albedo import albedo_under_light
from stages.photometry.albedo.soft_texture import soft_texture
from stages.photometry.albedo_data import AlbedoData
from stages.photometry.chromaticity import in_white_light
from stages.photometry.detail.albedo_detail import Detail, with_detail
from stages.photometry.detail.detail_octaves import DetailSettings
from stages.photometry.joint.fast_alternation import FastDescent, FastSolver
from stages.photometry.joint.problem_assembly import ALIKE, EdgeWeights
from stages.photometry.stack import StackedViews
from stages.solvers.kernels.threading_layer import use_threads


@dataclass(frozen=True, eq=False)
class AlbedoSolution:
    """The albedo under a light; pixels as in the stack, images scaled.

    Attributes
    ----------
    smooth : FastDescent
        ρ of Eq. 2 under that light, for `albedo_tv`.
    detailed : FastDescent
        ρ with weights per edge, before the detail is added.
    detail : Detail
        ρ with the photos' detail, and its uncertainty.
    """

    smooth: FastDescent
    detailed: FastDescent
    detail: Detail


def decompose_under_light(
    views: StackedViews,
    shading: np.ndarray,
    data: AlbedoData,
    edges: EdgeSettings,
    how_detailed: DetailSettings,
    descent: FastSolver,
    threads: int,
    step: Callable[[], None],
) -> AlbedoSolution:
    """Estimate the albedo under a known light: ρ of Eq. 2, and ρ with weights per edge and added detail.

    Parameters
    ----------
    views : StackedViews
        The basis is not used.
    shading : ndarray, shape (N, 3), float32
        Under the light, gains of the views included.
    data : AlbedoData
    edges : EdgeSettings
        Weights of the smooth albedo that `albedo` begins with.
    how_detailed : DetailSettings
    descent : FastSolver
        Its λ and μ are those of `albedo_tv`; its μ is the least of any correspondence in `albedo`.
    threads : int
        Never changes the result.
    step : callable
        Called after every round.
    """
    use_threads(threads)
    trusted, diffuse = data.trusted, data.diffuse
    shown, white = (in_white_light(one, shading) for one in (data.observed, diffuse))
    surface = appearance_of(views, shown, shading, trusted, edges, data.glossy)
    soft = soft_texture(views, white, shading, trusted, edges)
    by_edge = EdgeWeights(
        smoothness_of_edges(views, white, shading, surface.textured, soft, edges),
        agreement_of_correspondences(
            views, descent.weights.consistency, surface.inconsistent, edges.inconsistency_gain
        ),
    )
    channels = list(np.ascontiguousarray(diffuse.T))
    smooth, detailed = (
        albedo_under_light(views, channels, shading, trusted, each, descent, threads, step)
        for each in (ALIKE, by_edge)
    )
    detail = with_detail(views, detailed.albedo, diffuse, shading, trusted, how_detailed)
    return AlbedoSolution(smooth, detailed, detail)
