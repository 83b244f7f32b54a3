"""Solutions for light and albedo together, and their solvers: `mode: paper`, and `light: harmonics`."""

from __future__ import annotations

from collections.abc import Callable
from concurrent.futures import Executor
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np

from stages.photometry.albedo.confidence import confidence
from stages.photometry.albedo.settings import ConfidenceSettings
from stages.photometry.energy_history import descent_as_json, rounds_as_json
from stages.photometry.joint.fast_alternation import FastDescent, FastSolver, solve
from stages.photometry.joint.settings import HarmonicsSettings
from stages.photometry.joint.transfer_alternation import solve_with_transfer
from stages.photometry.paper.alternation import Outcome, decompose_channels
from stages.photometry.paper.energy import EnergyWeights
from stages.photometry.paper.harmonics import real_harmonics
from stages.photometry.paper.settings import PaperSettings
from stages.photometry.stack import StackedViews
from stages.photometry.transport.directional_transport import even_directions
from stages.photometry.transport.pixel_transfer import Bounces, PixelTransfer


@dataclass(frozen=True, eq=False)
class Solved:
    """Solution of a solver.

    Attributes
    ----------
    views : StackedViews
        With the basis of the light.
    albedo : ndarray, shape (N, 3)
        In the unit of the scaled images.
    shading : ndarray, shape (N, 3)
    histories : list of dict
        Per channel, for `energy.json`.
    outcomes : list of Outcome
        Per channel.
    albedo_tv : ndarray, shape (N, 3), or None
        The minimiser of Eq. 2, where `albedo` is another.
    confidence : ndarray, shape (N,), or None
        In `mode: transfer`.
    """

    views: StackedViews
    albedo: np.ndarray
    shading: np.ndarray
    histories: list[dict[str, Any]]
    outcomes: list[Outcome]
    albedo_tv: np.ndarray | None = None
    confidence: np.ndarray | None = None


@dataclass(frozen=True, eq=False)
class SolvedWithLight(Solved):
    """Solution for albedo and light together.

    Attributes
    ----------
    light : ndarray, shape (n, 3, K)
        Coefficients of the basis.
    """

    light: np.ndarray = field(kw_only=True)

    def judged(
        self,
        views: StackedViews,
        image: np.ndarray,
        incidence: np.ndarray,
        trusted: np.ndarray,
        how: ConfidenceSettings,
    ) -> SolvedWithLight:
        """Add the confidence of every pixel, from visibility, incidence, shading and residual."""
        known = confidence(views, image, self.shading, self.albedo, incidence, trusted, how)
        return replace(self, confidence=known)

    def sampled_light(self, count: int) -> tuple[np.ndarray, np.ndarray]:
        """Sample the harmonic light; returns M = `count` directions, (M, 3), and the light, (n, M, 3)."""
        directions = even_directions(count)
        degree = int(self.light.shape[2] ** 0.5) - 1
        return directions, np.einsum("mk,nck->nmc", real_harmonics(directions, degree), self.light)


def solve_by_alternation(
    views: StackedViews,
    images: list[np.ndarray],
    weights: EnergyWeights,
    how: PaperSettings,
    executor: Executor,
    step: Callable[[], None],
) -> SolvedWithLight:
    """Solve `mode: paper` by `solver: paper`, channels apart."""
    exact = [image.astype(np.float64) for image in images]
    descents = decompose_channels(views, exact, weights, how, executor, step)
    light = np.stack([descent.state.light for descent in descents], axis=1)
    return SolvedWithLight(
        views=views,
        albedo=np.stack([descent.state.albedo for descent in descents], axis=-1),
        shading=views.shadings(light),
        light=light,
        histories=[descent_as_json(descent) for descent in descents],
        outcomes=[descent.ended for descent in descents],
    )


def solve_jointly(
    views: StackedViews,
    images: list[np.ndarray],
    solver: FastSolver,
    threads: int,
    step: Callable[[], None],
) -> SolvedWithLight:
    """Solve `mode: paper` by `solver: fast`."""
    return solution_of(solve(views, images, solver, threads, step), views, solver.weights)


def solution_of(descent: FastDescent, views: StackedViews, weights: EnergyWeights) -> SolvedWithLight:
    """Convert the solution of the fast solver, all channels together."""
    histories = rounds_as_json(descent, weights)
    outcomes = [descent.outcome] * len(histories)
    return SolvedWithLight(views, descent.albedo, descent.shading, histories, outcomes, light=descent.light)


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
