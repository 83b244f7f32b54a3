"""`mode: transfer`: the albedo under a known light, by constant weights (Eq. 2) and by weights per edge."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from stages.photometry.albedo.albedo_edges import agreement_of_correspondences, smoothness_of_edges
from stages.photometry.albedo.appearance import appearance_of
from stages.photometry.albedo.settings import EdgeSettings
from stages.photometry.albedo.smooth_albedo import albedo_under_light
from stages.photometry.albedo.soft_texture import soft_texture
from stages.photometry.albedo_data import AlbedoData
from stages.photometry.chromaticity import in_white_light
from stages.photometry.joint.fast_alternation import FastSolver, Settled
from stages.photometry.joint.problem_assembly import ALIKE, EdgeWeights
from stages.photometry.stack import StackedViews
from stages.solvers.kernels.arrays_in_files import in_file
from stages.solvers.kernels.threading_layer import use_threads


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
    edges: EdgeSettings,
    descent: FastSolver,
    typical_light: float,
    threads: int,
    step: Callable[[], None],
    folder: Path | None = None,
) -> SmoothAlbedos:
    """Estimate the smooth albedo under a known light: ρ of Eq. 2, and ρ with weights per edge.

    Parameters
    ----------
    views : StackedViews
        The basis is not used.
    shading : ndarray, shape (N, 3), float32
        Under the light, gains of the views included.
    data : AlbedoData
    edges : EdgeSettings
    descent : FastSolver
        Its λ and μ are those of `albedo_tv`; its μ is the least of any correspondence in `albedo`.
    typical_light : float
        Median brightness of the shading, over the whole scene.
    threads : int
        Never changes the result.
    step : callable
        Called after every round.
    folder : Path or None
        Where weights and coarse levels wait, and the first albedo while the second is solved; None: in
        memory.
    """
    use_threads(threads)
    by_edge = _weights_of_edges(views, shading, data, edges, descent.weights.consistency, typical_light)
    by_edge = by_edge.in_file(folder)

    def solved(weights: EdgeWeights) -> Settled:
        return albedo_under_light(
            views, data.diffuse, shading, data.trusted, weights, descent, threads, step, folder
        )

    alike = solved(ALIKE)
    alike = replace(alike, albedo=in_file([alike.albedo], folder)[0])
    return SmoothAlbedos(alike, solved(by_edge))


def _weights_of_edges(
    views: StackedViews,
    shading: np.ndarray,
    data: AlbedoData,
    edges: EdgeSettings,
    consistency: float,
    typical_light: float,
) -> EdgeWeights:
    """Compute λ between neighbours and μ between views."""
    shown = in_white_light(data.observed, shading)
    surface = appearance_of(views, shown, shading, data.trusted, edges, data.glossy, typical_light)
    del shown
    white = in_white_light(data.diffuse, shading)
    soft = soft_texture(views, white, shading, data.trusted, edges)
    return EdgeWeights(
        smoothness_of_edges(views, white, shading, surface.textured, soft, edges),
        agreement_of_correspondences(views, consistency, surface.inconsistent, edges.inconsistency_gain),
    )
