"""The albedo under a light that is known: the convex half of Eq. 2, from coarse to fine."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np

from stages.photometry.joint.fast_alternation import FastDescent, FastSolver, finish, from_coarse_to_fine
from stages.photometry.joint.problem_assembly import EdgeWeights, finest_level
from stages.photometry.stack import StackedViews


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
        Their basis is not looked at.
    images : list of 3 ndarray, shape (N,)
        Scaled.
    shading : ndarray, shape (N, 3)
        S.
    trusted : ndarray, shape (N,), bool
        Pixels whose data count. The others take their albedo from their neighbours, here and in other views.
    edges : EdgeWeights
        λ_pq and μ_pq, where they are not the solver's own for all.
    solver : FastSolver
    threads : int
        Never changes the result.
    step : callable
        Called after every round.

    Notes
    -----
    Weighted by S as it is, the data term asks for the weighted median of I/S over all pixels, in all views,
    that are tied to one another: highlights of a few views, and dark pixels with their noisy quotients,
    have no say. No gauge is needed: the light holds the scale. It is Eq. 10 under a light that stays.
    """
    kept = trusted[:, None]
    basis = np.where(kept, np.maximum(shading, 0), 0).astype(np.float32)[:, None, :]
    images = [np.where(trusted, image, 0).astype(np.float32) for image in images]
    views = replace(views, basis=basis)
    light = np.ones((views.view_count, 3, 1))
    found = finish(  # a level or a descent that has a name takes room
        views,
        images,
        from_coarse_to_fine(finest_level(views, images, solver.weights, edges), solver.how, threads, light),
        solver,
        step,
    )
    return replace(found, shading=shading)
