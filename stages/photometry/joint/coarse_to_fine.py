"""The levels of a descent of the fast solver, from coarse to fine."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from pipeline.process.free_memory import give_back_free_memory
from stages.photometry.joint.begun_level import BegunLevel
from stages.photometry.joint.problem_assembly import problem_of
from stages.photometry.joint.pyramid import Level, pyramid
from stages.photometry.joint.settings import FastSettings
from stages.solvers.kernels.threading_layer import use_threads
from stages.solvers.primal_dual.graph import PrimalDual
from stages.solvers.primal_dual.problem import Steps
from stages.solvers.primal_dual.prolongation import CoarseState

PIXELS_PER_THREAD = 20_000  # with fewer, barriers cost more than threads gain; changes speed, no result
UNIFORM = 1 / np.sqrt(4 * np.pi)  # ν of the first harmonic, the same for every normal


def from_coarse_to_fine(
    finest: Level,
    how: FastSettings,
    threads: int,
    light: np.ndarray | None = None,
    folder: Path | None = None,
    begun: BegunLevel | None = None,
) -> PrimalDual:
    """Descend on every coarser level, coarsest first; returns the finest, initialised from them.

    A given light, (n, 3, K), is held fixed. In a folder, if there is one, the state of a level waits until
    the next is arranged. Where a coarse level is `begun`, only those finer than it are descended on.
    """
    levels = pyramid(finest, how.coarsest_pixels, None if begun is None else begun.depth - 1)
    del finest  # frees each level once it is arranged
    give_back_free_memory()
    groups = [level.group for level in levels if level.group is not None]  # the finest has none
    use_threads(threads_for(levels[0].pixels, threads))
    if begun is not None:
        group = begun.groups(levels[0])
        descent = begun.descent(problem_of(levels.pop(0)), group)  # the level, without a name, is freed
    else:
        descent = start(levels.pop(0), how) if light is None else under(light, levels.pop(0), how)
    while levels:
        settle(descent, how, len(levels))
        coarse = descent.coarse_state().in_file(folder)
        del descent  # before the finer level takes its place
        use_threads(threads_for(levels[0].pixels, threads))
        give_back_free_memory()
        problem = problem_of(levels.pop(0))
        give_back_free_memory()
        descent = PrimalDual.from_coarse(coarse, problem, groups[0])
        del coarse  # frees memory for the next step
        descent.fill_in(groups.pop(0))
        give_back_free_memory()
    descent.set_scale(how.steps.scale)
    return descent


def settle(descent: PrimalDual, how: FastSettings, depth: int) -> None:
    """Iterate on a coarse level, so many above the finest: twice as often as on the next finer one."""
    scales = how.schedule(known_light=not descent.free_light).coarse_scales
    for scale in scales:
        descent.set_scale(how.steps.scale * scale)
        descent.iterate(how.coarse_iterations * 2 ** (depth - 1) // len(scales))


def start(level: Level, how: FastSettings) -> PrimalDual:
    """Initialise as the paper does: albedo equal to the image, shading as near to 1 as the basis allows."""
    problem = problem_of(level)
    albedo = level.image / level.share[:, None]
    light = np.zeros((level.starts.size - 1, 3, level.basis.shape[1]))
    light[:, :, 0] = 1 / UNIFORM
    return PrimalDual(problem, problem.slices.spread(albedo), light, steps_of(how, known_light=False))


def under(light: np.ndarray, level: Level, how: FastSettings) -> PrimalDual:
    """Initialise with ρ = I/S where S is large enough, else 0; the light is held fixed."""
    view = level.view_of_pixel
    shading = np.stack(
        [np.einsum("pk,pk->p", level.basis[:, :, c], light[view, c]) for c in range(3)], axis=1
    )
    lit = shading > how.start_shading * max(float(shading.mean()), 1e-12)
    albedo = np.where(lit, level.image / np.where(lit, shading, 1), 0).astype(np.float32)
    problem = problem_of(level)
    steps = steps_of(how, known_light=True)
    return PrimalDual(problem, problem.slices.spread(albedo), light, steps, free_light=False)


def threads_for(pixels: int, threads: int) -> int:
    """Limit the threads to those with enough pixels between two barriers."""
    return min(threads, 1 + pixels // PIXELS_PER_THREAD)


def steps_of(how: FastSettings, known_light: bool) -> Steps:
    """Convert the settings of an iteration to the solver's."""
    steps = how.steps
    return Steps(
        scale=steps.scale,
        data_step_ratio=steps.data_step_ratio,
        relaxation=steps.relaxation,
        reflection=steps.reflection,
        epoch=how.schedule(known_light).epoch,
        rank_tolerance=steps.rank_tolerance,
    )


def coarse_solution(
    level: Level,
    depth: int,
    how: FastSettings,
    threads: int,
    light: np.ndarray,
    folder: Path | None = None,
) -> CoarseState:
    """Solve a level so many above the finest, and those above it, as `from_coarse_to_fine` does on its way.

    The light, (n, 3, K), is held fixed.
    """
    above = how.model_copy(update={"coarse_iterations": how.coarse_iterations * 2**depth})
    descent = from_coarse_to_fine(level, above, threads, light, folder)
    settle(descent, how, depth)
    return descent.coarse_state()
