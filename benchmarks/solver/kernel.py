"""Memory bandwidth of the inner loop relative to that of copying."""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import dataclass

import numba
import numpy as np

from benchmarks.solver.problems import RaceProblem
from stages.photometry.joint.coarse_to_fine import start
from stages.photometry.joint.problem_assembly import finest_level
from stages.photometry.joint.settings import FastSettings
from stages.solvers.kernels.threading_layer import use_threads
from stages.solvers.primal_dual.graph import PrimalDual

COPIED_BYTES = 512 * 2**20  # far more than any cache holds
REPEATS = 3


@dataclass(frozen=True)
class KernelSpeed:
    """Time and memory traffic of an iteration on the finest level.

    Attributes
    ----------
    threads : int
    pixels : int
    iteration_s : float
        Including the light's part.
    iteration_bytes : int
        Compulsory: every array that an iteration reads or writes counts once for each, gathers once.
    copied_bytes_per_s : float
        Of a large array, bytes read plus bytes written, with as many threads.
    """

    threads: int
    pixels: int
    iteration_s: float
    iteration_bytes: int
    copied_bytes_per_s: float

    @property
    def bytes_per_s(self) -> float:
        """Bandwidth of the iteration."""
        return self.iteration_bytes / self.iteration_s

    @property
    def share(self) -> float:
        """Bandwidth relative to that of copying."""
        return self.bytes_per_s / self.copied_bytes_per_s


def kernel_speed(problem: RaceProblem, threads: int, seconds: float) -> KernelSpeed:
    """Time iterations, and copying, for about so many seconds each; the best of a few tries."""
    how = FastSettings()
    descent = start(finest_level(problem.views, problem.images, problem.weights), how)
    use_threads(threads)
    return KernelSpeed(
        threads=threads,
        pixels=problem.pixels,
        iteration_s=_iteration_s(descent, 2 * how.schedule(known_light=False).epoch, seconds / REPEATS),
        iteration_bytes=compulsory_bytes(descent),
        copied_bytes_per_s=_copied_bytes_per_s(),
    )


def compulsory_bytes(descent: PrimalDual) -> int:
    """Count bytes of an iteration of `PrimalDual` under perfect caching."""
    problem, graph = descent.problem, descent.problem.graph
    of_edges, of_pixels = descent.edge_dual.nbytes, descent.albedo.nbytes
    ahead = of_pixels * 4 // 3  # four numbers per pixel
    of_graph = graph.first, graph.neighbour, graph.weight, graph.total
    read = *of_graph, problem.image, problem.basis, problem.share
    written_back = of_edges + 2 * of_pixels  # duals of edges, albedo and the data's duals
    anchor = descent.edge_dual.size + descent.albedo.size + of_pixels  # duals in 8 bits, and albedo
    every_other_epoch = anchor // 2
    return 2 * written_back + sum(array.nbytes for array in read) + 2 * ahead + every_other_epoch


def _iteration_s(descent: PrimalDual, at_once: int, seconds: float) -> float:
    """Time per iteration over two epochs, one of either kind."""

    def once() -> None:
        descent.iterate(at_once)

    return _best(once, seconds) / at_once


def _copied_bytes_per_s() -> float:
    source = np.ones(COPIED_BYTES // 4, np.float32)
    target = np.empty_like(source)
    return 2 * COPIED_BYTES / _best(lambda: _copy(source, target), 0.2)


def _best(once: Callable[[], None], seconds: float) -> float:
    """Measure the least time of one call among tries of that length; one call before compiles."""
    once()
    best = np.inf
    for _ in range(REPEATS):
        began, calls = time.perf_counter(), 0
        while calls == 0 or time.perf_counter() - began < seconds:
            once()
            calls += 1
        best = min(best, (time.perf_counter() - began) / calls)
    return best


@numba.njit(parallel=True, cache=True, nogil=True)
def _copy(source, target):
    for i in numba.prange(source.size):
        target[i] = source[i]
