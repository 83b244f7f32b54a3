"""Solver of `mode: transfer` with `light: harmonics`."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np

from stages.photometry.joint.fast_alternation import FastSolver
from stages.photometry.joint.settings import HarmonicsSettings
from stages.photometry.joint.transfer_alternation import solve_with_transfer
from stages.photometry.solutions import SolvedWithLight, solution_of
from stages.photometry.stack import StackedViews
from stages.photometry.transport.pixel_transfer import Bounces, PixelTransfer


def solve_by_transfer(
    views: StackedViews,
    images: list[np.ndarray],
    transfer: PixelTransfer,
    solver: FastSolver,
    bounces: Bounces,
    how: HarmonicsSettings,
    threads: int,
    step: Callable[[], None],
) -> SolvedWithLight:
    """Estimate light and albedo together, with `light: harmonics`."""
    descent, views = solve_with_transfer(views, images, transfer, solver, bounces, how, threads, step)
    solved = solution_of(descent, views, solver.weights)
    return replace(solved, albedo_tv=solved.albedo)
