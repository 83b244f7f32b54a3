"""Solvers of `mode: transfer`, for either kind of light."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np

from stages.photometry.albedo.albedo_given_light import decompose_under_light
from stages.photometry.albedo_data import AlbedoData
from stages.photometry.decomposition_settings import DecompositionSettings
from stages.photometry.energy_history import rounds_under_light_as_json
from stages.photometry.joint.fast_alternation import FastSolver
from stages.photometry.joint.settings import HarmonicsSettings
from stages.photometry.joint.transfer_alternation import solve_with_transfer
from stages.photometry.paper.alternation import Outcome
from stages.photometry.solutions import SolvedUnderLight, SolvedWithLight, solution_of
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


def solve_under_light(
    views: StackedViews,
    shading: np.ndarray,
    data: AlbedoData,
    settings: DecompositionSettings,
    solver: FastSolver,
    threads: int,
    step: Callable[[], None],
) -> SolvedUnderLight:
    """Estimate the albedo under the known light of `light: directions`."""
    solution = decompose_under_light(
        views, shading, data, settings.edges, settings.detail, solver, threads, step
    )
    outcome = worse(solution.smooth.outcome, solution.detailed.outcome)
    return SolvedUnderLight(
        views=views,
        albedo=solution.detail.albedo,
        shading=shading,
        histories=rounds_under_light_as_json(solution.smooth, outcome),
        outcomes=[outcome] * 3,
        albedo_tv=np.maximum(solution.smooth.albedo, 0),
        detail=solution.detail,
    )


def worse(one: Outcome, other: Outcome) -> Outcome:
    """Choose the outcome that did not converge, if there is one."""
    return other if one is Outcome.CONVERGED else one
