"""The albedo under a known light: the convex half of Eq. 2, from coarse to fine."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np

from pipeline.process.free_memory import large_blocks_apart
from stages.photometry.joint.fast_alternation import FastDescent, FastSolver, finish, from_coarse_to_fine
from stages.photometry.joint.problem_assembly import EdgeWeights, finest_level
from stages.photometry.stack import StackedViews


@large_blocks_apart()
def albedo_under_light(
    views: StackedViews,
    images: list[np.ndarray],
    shading: np.ndarray,
    trusted: np.ndarray,
    edges: EdgeWeights,
    solver: FastSolver,
    threads: int,
    step: Callable[[], None],
) -> FastDescent:
    """Minimise ``Σ_p |I − ρ S| + Σ λ_pq |ρ_p − ρ_q| + Σ μ_pq |ρ_p^i − ρ_q^j|`` over ρ.

    Parameters
    ----------
    views : StackedViews
        The basis is not used.
    images : list of 3 ndarray, shape (N,)
        Scaled.
    shading : ndarray, shape (N, 3)
        S.
    trusted : ndarray, shape (N,), bool
        Pixels with a data term. The others are inferred from neighbours and corresponding pixels.
    edges : EdgeWeights
        λ_pq and μ_pq, where they differ from the solver's constants.
    solver : FastSolver
    threads : int
        Never changes the result.
    step : callable
        Called after every round.

    Notes
    -----
    The data term is weighted by S. Over pixels of equal albedo, in all views, its minimum is the weighted
    median of I/S, robust to highlights in a few views and to the noisy quotients of dark pixels. No gauge is
    needed, since the light fixes the scale. This is Eq. 10 under a fixed light.
    """
    kept = trusted[:, None]
    basis = np.where(kept, np.maximum(shading, 0), 0).astype(np.float32)[:, None, :]
    images = [np.where(trusted, image, 0).astype(np.float32) for image in images]
    views = replace(views, basis=basis)
    light = np.ones((views.view_count, 3, 1))
    found = finish(  # a named level or descent would stay in memory
        views,
        images,
        from_coarse_to_fine(finest_level(views, images, solver.weights, edges), solver.how, threads, light),
        solver,
        step,
    )
    return replace(found, shading=shading)
