"""`light: harmonics`: the energy of Eq. 2 under light with visibility and interreflection."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np

from pipeline.process.free_memory import large_blocks_apart
from stages.photometry.joint.coarse_to_fine import from_coarse_to_fine
from stages.photometry.joint.fast_alternation import FastDescent, FastSolver, descend
from stages.photometry.joint.problem_assembly import finest_level
from stages.photometry.joint.settings import HarmonicsSettings
from stages.photometry.stack import StackedViews
from stages.photometry.transport.pixel_transfer import Bounces, PixelTransfer


@large_blocks_apart()
def solve_with_transfer(
    views: StackedViews,
    images: list[np.ndarray],
    transfer: PixelTransfer,
    solver: FastSolver,
    bounces: Bounces,
    how: HarmonicsSettings,
    threads: int,
    step: Callable[[], None],
) -> tuple[FastDescent, StackedViews]:
    """Minimise Eq. 2 with transfer vectors for ν.

    Parameters
    ----------
    views : StackedViews
        The basis is not used.
    images : list of 3 ndarray, shape (N,)
        Scaled.
    transfer : PixelTransfer
    solver : FastSolver
    bounces : Bounces
    how : HarmonicsSettings
        Updates of the interreflection.
    threads : int
        Never changes the result.
    step : callable
        Called after every round.

    Returns
    -------
    tuple of FastDescent and StackedViews
        The solution, and the views with its basis.

    Notes
    -----
    Coarser levels use direct light only. Interreflection depends weakly on the albedo: every refresh
    recomputes the basis from the current albedo, and the descent continues from its state.
    """
    basis = transfer.direct()
    finest = finest_level(replace(views, basis=basis), images, solver.weights)
    descent = from_coarse_to_fine(finest, solver.how, threads)
    del finest
    for _ in range(how.refreshes if bounces.count else 0):
        albedo = descent.problem.slices.collect(descent.albedo)
        del basis  # before the next takes its place
        basis = transfer.with_bounces(albedo, bounces)
        descent.replace_basis(basis)
        descent.iterate(how.refresh_iterations)
        step()
    views = replace(views, basis=basis)
    return descend(descent, solver, step).evaluated(views, images), views
