"""Albedo on a graph of pixels and light of every view by one primal-dual scheme, three channels at once."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from stages.solvers.kernels.simd import COUNT
from stages.solvers.primal_dual.anchor import NOWHERE, Anchor
from stages.solvers.primal_dual.duality_gap import Bounds, bounds
from stages.solvers.primal_dual.filling import fill_in
from stages.solvers.primal_dual.gram_matrices import gram_matrices
from stages.solvers.primal_dual.iteration_kernels import (
    interleave,
    rescale,
    shade,
    sweep,
    weigh,
)
from stages.solvers.primal_dual.problem import Problem, Steps
from stages.solvers.primal_dual.prolongation import CoarseState, prolong_edges, prolong_pixels

NOTHING = 1e-30  # instead of a division by 0


class PrimalDual:
    """Albedo and light on their way to the least energy.

    Parameters
    ----------
    problem : Problem
    albedo : ndarray, shape (S, 3, 8), float32
        Where to start; it is what moves.
    light : ndarray, shape (n, 3, K), float64
        Where to start; not changed.
    steps : Steps
    free_light : bool
        Whether the light moves; if not, no gauge is needed, and none is kept.

    Notes
    -----
    Chambolle and Pock 2011, algorithm 1, for a saddle that is linear in the albedo and in the light, each
    (Valkonen 2014), with diagonal steps (Pock and Chambolle 2011).
    With duals ``y_pq = w_pq z_pq`` of the edges and ``x_p`` of the data, all within ±1, an iteration is

    | ``z ← z + (ρ̄_p − ρ̄_q) / (2 r)``, clipped to ±1;
    | ``x ← x + κ/(2 r) · (ρ̄ S + ρ S̄ − ρ S − I)``, clipped to ±1, with ``S = σ·ν``;
    | ``ρ ← ρ − τ (Kᵀy + S x − m)``, with ``τ_p = r / (Σ_q w_pq + κ S_p²)``;
    | ``σ ← σ − r/κ · (Σ_p ρ² ν νᵀ)⁻¹ Σ_p x ρ ν``, view by view;
    | ``ρ̄``, ``σ̄``: what was extrapolated by as much again.

    m is the multiplier of a gauge, ``Σ_{pq} w |ρ_p − ρ_q| / wanted``: what the scale-free energy, whose
    second sum is divided by Σ|ρ|, gains per unit of albedo; where S is smaller, S takes its place, lest the
    darkest pixels, which cost nothing, bear all the albedo. Light and albedo move together, so that no pixel
    that fits already holds the light where it is, as it does where the two alternate.

    Every step is taken in two ways by turns, an epoch each: reflected, up to twice as far, but drawn back to
    where the epoch began, the k-th time by 1/(k + 2) (Halpern 1967; Lu and Yang 2024, "Restarted Halpern PDHG
    for linear programming"), and θ times as far (Condat 2013). The first averages away what circles around
    the goal, the second gets along where nothing circles.

    Both ends of an edge keep their own copy of its dual; the two are negatives of one another to the last
    bit, since rounding is symmetric. So a pixel writes only what is its own: one pass per iteration, no two
    threads meet, and the result does not depend on how many there are. z is kept in 16 bits: a step below
    3e-5 of its range is lost, which is a difference of albedo of 3e-6 at r = 0.05.
    """

    def __init__(
        self, problem: Problem, albedo: np.ndarray, light: np.ndarray, steps: Steps, free_light: bool = True
    ):
        self.problem, self._steps, self._free, self.iterations = problem, steps, free_light, 0
        self.albedo, self.light = albedo, light.astype(np.float64)
        self._ahead = np.zeros((COUNT * problem.slices.count, 4), np.float32)  # a load per neighbour
        interleave(self.albedo.ravel(), self._ahead.ravel())
        self._ahead_next = np.zeros_like(self._ahead)
        self._light_ahead = self.light.copy()
        self.edge_dual = np.zeros(3 * problem.graph.weight.size, np.int16)
        self._data_dual = np.zeros_like(self.albedo)
        self._multiplier = np.zeros_like(problem.wanted)
        self._mobility = np.zeros((*light.shape, light.shape[2]))

    @classmethod
    def inheriting(cls, legacy: CoarseState, problem: Problem, group: np.ndarray) -> PrimalDual:
        """Start a level where the one above it stands: albedo, light and duals; see also `fill_in`.

        Parameters
        ----------
        legacy : CoarseState
        problem : Problem
            The finer one.
        group : ndarray, shape (N,), int32
            Every pixel's group: what was a pixel to the coarser one.
        """
        finer = cls(problem, np.zeros_like(problem.image), legacy.light, legacy.steps, legacy.free_light)
        own, other = problem.graph, legacy.graph
        places = problem.slices.spread_numbers(legacy.slices.places[group])
        prolong_pixels(places, legacy.albedo.ravel(), finer.albedo.ravel())
        prolong_pixels(places, legacy.data_dual.ravel(), finer._data_dual.ravel())
        prolong_edges(
            places,
            (other.first, other.neighbour, other.weight, legacy.edge_dual),
            (own.first, own.neighbour, own.weight, finer.edge_dual),
        )
        interleave(finer.albedo.ravel(), finer._ahead.ravel())
        finer._multiplier = legacy.multiplier
        return finer

    def fill_in(self, group: np.ndarray) -> None:
        """Give edges within groups, (N,) as before, duals: after `inheriting`, once the legacy is let go."""
        problem = self.problem
        fill_in(
            problem.slices.blocks,
            problem.slices.spread_numbers(group),
            problem.graph,
            (self.edge_dual, self._data_dual),
            problem.share,
            self._multiplier[problem.gauge_of_view].astype(np.float32),
            self.shading(),
        )

    def legacy(self) -> CoarseState:
        """Give what a finer level takes over; whoever does not keep the rest makes room for it."""
        return CoarseState(
            slices=self.problem.slices,
            graph=self.problem.graph,
            albedo=self.albedo,
            light=self.light,
            edge_dual=self.edge_dual,
            data_dual=self._data_dual,
            multiplier=self._multiplier,
            steps=self._steps,
            free_light=self._free,
        )

    def stand_on(self, basis: np.ndarray) -> None:
        """Go on with another basis, (N, K) or (N, K, 3): one that has come to know more."""
        self.problem = replace(self.problem, basis=self.problem.slices.spread_basis(basis))

    def iterate(self, count: int) -> None:
        """Do `count` iterations, in epochs."""
        goal, epoch = self.iterations + count, self._steps.epoch
        while self.iterations < goal:
            if self._free:
                self._restore_gauge()
                self._look_at_the_light()
            length = min(epoch - self.iterations % epoch, goal - self.iterations)
            if self.iterations // epoch % 2 == 0:
                self._go_drawn_back(length)
            else:
                self._go_plainly(length)
            self.iterations += length
        if self._free:
            self._restore_gauge()

    def bounds(self, widths: tuple[float, ...]) -> Bounds:
        """Bound the energy under the light as it is: of the albedo, and what none of its range goes below.

        `widths`: the ranges to try, in units of the range of the albedo.
        """
        return bounds(
            self.problem.slices.blocks,
            self.problem.graph,
            self.edge_dual,
            self._interleaved(),
            self.problem.image,
            self.shading(),
            self.problem.share,
            self._multiplier[self.problem.gauge_of_view],
            (self._multiplier * self.problem.wanted).sum(axis=0),
            widths,
        )

    def shading(self) -> np.ndarray:
        """Compute S, (S, 3, 8), float32."""
        blocks, basis = self.problem.slices.blocks, self.problem.basis
        shading = np.empty_like(self.albedo)
        light = self.light.astype(np.float32)
        shade(blocks.view, blocks.begin, blocks.end, basis.ravel(), light, shading.ravel())
        return shading

    def _interleaved(self) -> np.ndarray:
        """Interleave the albedo, four numbers per pixel; lies where the next albedo ahead will."""
        interleave(self.albedo.ravel(), self._ahead_next.ravel())
        return self._ahead_next

    def _go_drawn_back(self, count: int) -> None:
        anchor = Anchor.at(self.edge_dual, self._data_dual, self.albedo, self.light)
        for k in range(count):
            self._iterate_once(anchor, self._steps.reflection, (k + 1) / (k + 2))

    def _go_plainly(self, count: int) -> None:
        for _ in range(count):
            self._iterate_once(NOWHERE, self._steps.relaxation, 1.0)

    def _iterate_once(self, anchor: Anchor, relaxation: float, counted: float) -> None:
        problem, blocks, steps = self.problem, self.problem.slices.blocks, self._steps
        both = np.concatenate([self.light, self._light_ahead], axis=1)
        lights = np.ascontiguousarray(both.swapaxes(1, 2), np.float32)
        slopes, pulls = np.empty((blocks.view.size, 3, self.light.shape[2])), np.empty((blocks.view.size, 3))
        sweep(
            (blocks.view, blocks.begin, blocks.end),
            (problem.graph.first, problem.graph.neighbour, problem.graph.weight, problem.graph.total),
            (self.edge_dual, self._data_dual.ravel()),
            (self.albedo.ravel(), self._ahead.ravel(), self._ahead_next.ravel()),
            (anchor.edge_dual, anchor.data_dual, anchor.albedo),
            (problem.image.ravel(), problem.basis.ravel(), problem.share.ravel()),
            lights,
            self._multiplier[problem.gauge_of_view].astype(np.float32),
            tuple(map(np.float32, (steps.scale, steps.data_step_ratio, relaxation, counted))),
            slopes,
            pulls,
        )
        self._ahead, self._ahead_next = self._ahead_next, self._ahead
        if self._free:
            self._move_light(blocks.by_view(slopes), anchor.light, relaxation, counted)
            pulled = problem.by_gauge(blocks.by_view(pulls))
            self._multiplier = np.maximum(pulled, 0) / np.maximum(problem.wanted, NOTHING)

    def _move_light(self, slope: np.ndarray, anchor: np.ndarray, relaxation: float, counted: float) -> None:
        now = self.light - np.einsum("vckl,vcl->vck", self._mobility, slope)
        self._light_ahead = 2 * now - self.light
        self.light = counted * (self.light + relaxation * (now - self.light)) + (1 - counted) * anchor

    def _look_at_the_light(self) -> None:
        gram = gram_matrices(self.problem.slices.blocks, self.problem.basis, self.albedo)
        inverse = np.linalg.pinv(gram, rcond=self._steps.rank_tolerance, hermitian=True)
        self._mobility = self._steps.scale / self._steps.data_step_ratio * inverse

    def _restore_gauge(self) -> None:
        problem, blocks = self.problem, self.problem.slices.blocks
        weighed = np.empty((blocks.view.size, 3))
        weigh(blocks.begin, blocks.end, self.albedo.ravel(), problem.share.ravel(), weighed)
        current = problem.by_gauge(blocks.by_view(weighed))
        known = (current > 0) & (problem.wanted > 0)
        factors = np.where(known, problem.wanted / np.maximum(current, NOTHING), 1.0)[problem.gauge_of_view]
        both = self.albedo.ravel(), self._ahead.ravel()
        rescale(blocks.view, blocks.begin, blocks.end, factors.astype(np.float32), *both)
        self.light = self.light / factors[:, :, None]
        self._light_ahead = self._light_ahead / factors[:, :, None]
