"""The paper's alternation with a compiled inner solver on our graph and threads."""

from __future__ import annotations

from concurrent.futures import Executor, ThreadPoolExecutor

import numpy as np

from benchmarks.solver.clock import Clock, Look, OutOfTime, Trace
from benchmarks.solver.compiled_pcg import reweighted_descent
from benchmarks.solver.problems import RaceProblem
from stages.photometry.joint.coarse_to_fine import threads_for
from stages.photometry.joint.problem_assembly import graph_of
from stages.photometry.paper.energy import channel_terms, gauge_scale
from stages.photometry.paper.light_step import light_step
from stages.photometry.paper.settings import PaperSettings
from stages.solvers.kernels.threading_layer import use_threads

NAME = "compiled PCG"
STEPS = 20
PAPER = PaperSettings()  # δ


def race(problem: RaceProblem, budget_s: float, threads: int) -> Trace:
    """Alternate until the time is up."""
    use_threads(threads_for(problem.pixels, threads))
    clock, views, weights = Clock(budget_s), problem.views, problem.weights
    graph = graph_of(views, weights)
    image = np.stack(problem.images, axis=1).astype(np.float32)
    albedo, light = image.copy(), np.ones((views.view_count, 3, views.basis.shape[1]))
    looks = []
    with ThreadPoolExecutor(threads) as executor:
        while True:
            looks.append(Look(clock.seconds, _energy(problem, albedo, light, clock)))
            try:
                clock.check()
            except OutOfTime:
                return Trace(NAME, tuple(looks))
            light = _light(problem, albedo, light, executor)
            shading = views.shadings(light).astype(np.float32)
            albedo = reweighted_descent(graph, image, shading, albedo, PAPER.delta, STEPS)
            scales = np.array([gauge_scale(image[:, c], albedo[:, c]) for c in range(3)])
            albedo, light = albedo * scales.astype(np.float32), light / scales[:, None]


def _light(problem: RaceProblem, albedo: np.ndarray, light: np.ndarray, executor: Executor) -> np.ndarray:
    def of_channel(c: int) -> np.ndarray:
        now = np.ascontiguousarray(light[:, c])
        own = albedo[:, c].astype(np.float64)
        return light_step(problem.views, problem.images[c], own, now, PAPER)

    return np.stack(list(executor.map(of_channel, range(3))), axis=1)


def _energy(problem: RaceProblem, albedo: np.ndarray, light: np.ndarray, clock: Clock) -> float:
    with clock.held():
        terms = channel_terms(problem.views, problem.images, albedo, problem.views.shadings(light))
        return sum(channel.total(problem.weights) for channel in terms)
