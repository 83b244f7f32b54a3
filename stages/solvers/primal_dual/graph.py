"""Primal-dual scheme for albedo on a graph of pixels and light of every view, three channels at once."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from pipeline.process.free_memory import give_back_free_memory
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
    """Joint primal-dual minimisation over albedo and light.

    Parameters
    ----------
    problem : Problem
    albedo : ndarray, shape (S, 3, 8), float32
        Initial value; updated in place.
    light : ndarray, shape (n, 3, K), float64
        Initial value; copied.
    steps : Steps
    free_light : bool
        Whether the light is optimised; if not, no gauge is needed or kept.
    duals : tuple of ndarray, shapes (3 · R · 8,), int16, and (S, 3, 8), float32, or None
        Initial values of edges and data, updated in place; None: 0.

    Notes
    -----
    Chambolle and Pock 2011, algorithm 1, for a saddle that is linear in the albedo and in the light, each
    (Valkonen 2014), with diagonal steps (Pock and Chambolle 2011).
    With duals ``y_pq = w_pq z_pq`` of the edges and ``x_p`` of the data, all within ±1, an iteration is

    | ``z ← z + (ρ̄_p − ρ̄_q) / (2 r)``, clipped to ±1;
    | ``x ← x + κ/(2 r) · (ρ̄ S + ρ S̄ − ρ S − I)``, clipped to ±1, with ``S = σ·ν``;
    | ``ρ ← ρ − τ (Kᵀy + S x − m)``, with ``τ_p = r / (Σ_q w_pq + κ S_p²)``;
    | ``σ ← σ − r/κ · (Σ_p ρ² ν νᵀ)⁻¹ Σ_p x ρ ν``, view by view;
    | ``ρ̄``, ``σ̄``: extrapolated by the last step once more.

    m is the multiplier of a gauge, ``Σ_{pq} w |ρ_p − ρ_q| / wanted``: the gain, per unit of albedo, of the
    scale-free energy whose second sum is divided by Σ|ρ|. Where S is smaller, S replaces it; otherwise the
    darkest pixels, which cost nothing, would take all the albedo. Light and albedo are updated together. In
    an alternation, pixels that fit already would hold the light back.

    Epochs of two kinds alternate. Reflected Halpern iterations step up to twice as far, and average the k-th
    iterate with the start of the epoch, which weighs 1/(k + 2) (Halpern 1967; Lu and Yang 2024, "Restarted
    Halpern PDHG for linear programming"). Over-relaxed iterations step θ times as far (Condat 2013). The
    first damp oscillations around the solution, the second are faster where there are none.

    Both ends of an edge store their own copy of its dual; the copies are negatives of each other to the last
    bit, since rounding is symmetric. A pixel writes only its own values: one pass per iteration, without
    races between threads, and the result does not depend on their number. z is stored in 16 bits: a step
    below 3e-5 of its range is lost, which is a difference of albedo of 3e-6 at r = 0.05.
    """

    def __init__(
        self,
        problem: Problem,
        albedo: np.ndarray,
        light: np.ndarray,
        steps: Steps,
        free_light: bool = True,
        duals: tuple[np.ndarray, np.ndarray] | None = None,
    ):
        self.problem, self.steps, self.free_light, self.iterations = problem, steps, free_light, 0
        self.albedo, self.light = albedo, light.astype(np.float64)
        self._ahead = np.zeros((COUNT * problem.slices.count, 4), np.float32)  # one load per neighbour
        interleave(self.albedo.ravel(), self._ahead.ravel())
        self._ahead_next = np.zeros(self._ahead.shape, np.float32)  # no memory yet, unlike `zeros_like`
        self._light_ahead = self.light.copy()
        self.edge_dual, self._data_dual = duals or (_no_edge_duals(problem), np.zeros_like(self.albedo))
        self._multiplier = np.zeros_like(problem.wanted)
        self._mobility = np.zeros((*light.shape, light.shape[2]))

    @classmethod
    def from_coarse(cls, coarse: CoarseState, problem: Problem, group: np.ndarray) -> PrimalDual:
        """Initialise a level from the coarser one: albedo, light and duals; see also `fill_in`.

        Parameters
        ----------
        coarse : CoarseState
        problem : Problem
            That of the finer level.
        group : ndarray, shape (N,), int32
            Group of every pixel: a pixel of the coarser level.
        """
        own, other = problem.graph, coarse.graph
        edge_dual = _no_edge_duals(problem)
        places = problem.slices.spread_numbers(coarse.slices.places[group])
        prolong_edges(
            places,
            (other.first, other.neighbour, other.weight, coarse.edge_dual),
            (own.first, own.neighbour, own.weight, edge_dual),
        )
        give_back_free_memory()  # of coarse edges, before what pixels need
        albedo, data_dual = np.zeros_like(problem.image), np.zeros_like(problem.image)
        prolong_pixels(places, coarse.albedo.ravel(), albedo.ravel())
        prolong_pixels(places, coarse.data_dual.ravel(), data_dual.ravel())
        duals = edge_dual, data_dual
        finer = cls(problem, albedo, coarse.light, coarse.steps, coarse.free_light, duals)
        finer._multiplier = coarse.multiplier
        return finer

    def fill_in(self, group: np.ndarray) -> None:
        """Set the duals within groups, (N,); called after `from_coarse`, once the coarse state is freed."""
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

    def coarse_state(self) -> CoarseState:
        """Return the state that a finer level is initialised from; the rest can be freed."""
        return CoarseState(
            slices=self.problem.slices,
            graph=self.problem.graph,
            albedo=self.albedo,
            light=self.light,
            edge_dual=self.edge_dual,
            data_dual=self._data_dual,
            multiplier=self._multiplier,
            steps=self.steps,
            free_light=self.free_light,
        )

    def replace_basis(self, basis: np.ndarray) -> None:
        """Replace the basis, (N, K) or (N, K, 3), as after an update of the interreflection."""
        self.problem = replace(self.problem, basis=self.problem.slices.spread_basis(basis))

    def set_scale(self, scale: float) -> None:
        """Set r, the scale of the primal steps, for what follows; the state does not depend on it."""
        self.steps = replace(self.steps, scale=scale)

    def iterate(self, count: int) -> None:
        """Perform `count` iterations, in epochs."""
        goal, epoch = self.iterations + count, self.steps.epoch
        while self.iterations < goal:
            if self.free_light:
                self._restore_gauge()
                self._update_mobility()
            length = min(epoch - self.iterations % epoch, goal - self.iterations)
            if self.iterations // epoch % 2 == 0:
                self._iterate_halpern(length)
            else:
                self._iterate_relaxed(length)
            self.iterations += length
        if self.free_light:
            self._restore_gauge()

    def bounds(self, widths: tuple[float, ...]) -> Bounds:
        """Compute the energy of the albedo under the current light, and a lower bound of the least.

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
        """Interleave the albedo, four numbers per pixel; uses the buffer of the next extrapolated albedo."""
        interleave(self.albedo.ravel(), self._ahead_next.ravel())
        return self._ahead_next

    def _iterate_halpern(self, count: int) -> None:
        anchor = Anchor.at(self.edge_dual, self._data_dual, self.albedo, self.light)
        for k in range(count):
            self._iterate_once(anchor, self.steps.reflection, (k + 1) / (k + 2))

    def _iterate_relaxed(self, count: int) -> None:
        for _ in range(count):
            self._iterate_once(NOWHERE, self.steps.relaxation, 1.0)

    def _iterate_once(self, anchor: Anchor, relaxation: float, counted: float) -> None:
        problem, blocks, steps = self.problem, self.problem.slices.blocks, self.steps
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
        if self.free_light:
            self._move_light(blocks.by_view(slopes), anchor.light, relaxation, counted)
            pulled = problem.by_gauge(blocks.by_view(pulls))
            self._multiplier = np.maximum(pulled, 0) / np.maximum(problem.wanted, NOTHING)

    def _move_light(self, slope: np.ndarray, anchor: np.ndarray, relaxation: float, counted: float) -> None:
        now = self.light - np.einsum("vckl,vcl->vck", self._mobility, slope)
        self._light_ahead = 2 * now - self.light
        self.light = counted * (self.light + relaxation * (now - self.light)) + (1 - counted) * anchor

    def _update_mobility(self) -> None:
        gram = gram_matrices(self.problem.slices.blocks, self.problem.basis, self.albedo)
        inverse = np.linalg.pinv(gram, rcond=self.steps.rank_tolerance, hermitian=True)
        self._mobility = self.steps.scale / self.steps.data_step_ratio * inverse

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


def _no_edge_duals(problem: Problem) -> np.ndarray:
    return np.zeros(3 * problem.graph.weight.size, np.int16)
