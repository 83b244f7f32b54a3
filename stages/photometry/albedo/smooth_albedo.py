"""The albedo under a known light: the convex half of Eq. 2, from coarse to fine."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np

from pipeline.process.free_memory import give_back_free_memory, large_blocks_apart
from stages.photometry.joint.begun_level import BegunLevel
from stages.photometry.joint.coarse_to_fine import from_coarse_to_fine
from stages.photometry.joint.fast_alternation import FastSolver, Settled, descend
from stages.photometry.joint.problem_assembly import EdgeWeights, finest_level
from stages.photometry.joint.pyramid import Level
from stages.photometry.stack import StackedViews


@large_blocks_apart()
def albedo_under_light(
    views: StackedViews,
    image: np.ndarray,
    shading: np.ndarray,
    trusted: np.ndarray,
    edges: EdgeWeights,
    solver: FastSolver,
    threads: int,
    step: Callable[[], None],
    folder: Path | None = None,
    begun: BegunLevel | None = None,
) -> Settled:
    """Minimise ``Σ_p |I − ρ S| + Σ λ_pq |ρ_p − ρ_q| + Σ μ_pq |ρ_p^i − ρ_q^j|`` over ρ.

    Parameters
    ----------
    views : StackedViews
        The basis is not used.
    image : ndarray, shape (N, 3)
        I, scaled.
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
    folder : Path or None
        Where states of coarse levels wait; None: in memory.
    begun : BegunLevel or None
        Where these are some of all pixels: a coarse level of all, to begin from, and to hold the rim at.

    Notes
    -----
    The data term is weighted by S. Over pixels of equal albedo, in all views, its minimum is the weighted
    median of I/S, robust to highlights in a few views and to the noisy quotients of dark pixels. No gauge is
    needed, since the light fixes the scale. This is Eq. 10 under a fixed light.
    """
    light = np.ones((views.view_count, 3, 1))

    def level() -> Level:
        """Prepare the finest level; without a name, since the solver frees it."""
        finest = level_under_light(views, image, shading, trusted, solver, edges)
        return finest if begun is None else begun.pinned(finest)

    give_back_free_memory()  # what the weights of the edges were found from
    return descend(from_coarse_to_fine(level(), solver.how, threads, light, folder, begun), solver, step)


def level_under_light(
    views: StackedViews,
    image: np.ndarray,
    shading: np.ndarray,
    trusted: np.ndarray,
    solver: FastSolver,
    edges: EdgeWeights,
    own: np.ndarray | None = None,
) -> Level:
    """Prepare data term and graph of `albedo_under_light`, or what `own` pixels contribute to them."""
    known = trusted if own is None else trusted & own
    basis = np.where(known[:, None], np.maximum(shading, 0), 0).astype(np.float32)[:, None, :]
    images = [np.where(known, channel, 0).astype(np.float32) for channel in image.T]
    return finest_level(replace(views, basis=basis), images, solver.weights, edges, own)
