"""The albedo step alone: `PrimalDual` with the light held and nothing asked of the albedo's scale."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from stages.photometry.joint.coarse_to_fine import steps_of
from stages.photometry.joint.settings import FastSettings
from stages.solvers.primal_dual.graph import PrimalDual
from stages.solvers.primal_dual.half_edges import HalfEdges
from stages.solvers.primal_dual.problem import Problem, Steps
from stages.solvers.primal_dual.sliced_graph import sliced_graph, slices_of

STEPS = replace(steps_of(FastSettings(), known_light=False), scale=0.1)


def fixed_light(graph: HalfEdges, image: np.ndarray, shading: np.ndarray, steps: Steps = STEPS) -> PrimalDual:
    """Start at ρ = I for a given shading, (N, 3) each: one harmonic, which differs by channel."""
    slices = slices_of(graph, np.array([0, graph.size]))
    problem = Problem(
        slices=slices,
        graph=sliced_graph(graph, slices),
        image=slices.spread(image),
        basis=slices.spread(shading)[:, None],
        share=slices.spread(np.ones((graph.size, 1))),
        gauge_of_view=np.zeros(1, np.int64),
        wanted=np.abs(image).sum(axis=0, dtype=np.float64)[None],
    )
    return PrimalDual(problem, slices.spread(image), np.ones((1, 3, 1)), steps, free_light=False)


def albedo_of(solver: PrimalDual) -> np.ndarray:
    """ρ, (N, 3), float32."""
    return solver.problem.slices.collect(solver.albedo)
