"""Small views with holes and links, the graph of their energy, and its exact optimum at fixed light."""

from __future__ import annotations

from itertools import combinations

import numpy as np
import scipy.sparse as sp
from scipy.optimize import linprog

from stages.photometry.stack import StackedViews, stack_views
from stages.solvers.primal_dual.half_edges import HalfEdges


def random_views(rng: np.random.Generator, view_count: int = 3, side: int = 7) -> StackedViews:
    """Views with holes, odd sizes and random links; never empty, not always linked."""
    masks, normals, correspondences = [], [], {}
    for _ in range(view_count):
        mask = rng.random(tuple(rng.integers(1, side + 1, 2))) < 0.75
        mask[rng.integers(mask.shape[0]), rng.integers(mask.shape[1])] = True
        normal = rng.standard_normal((*mask.shape, 3))
        masks.append(mask)
        normals.append(normal / np.linalg.norm(normal, axis=-1, keepdims=True))
    for i, j in combinations(range(view_count), 2):
        shape = int(masks[i].sum()), int(masks[j].sum())
        linked = np.flatnonzero(rng.random(shape[0]) < 0.4)
        partner = rng.integers(shape[1], size=linked.size)
        correspondences[i, j] = sp.csr_array((np.ones(linked.size, np.uint8), (linked, partner)), shape=shape)
    return stack_views(masks, normals, correspondences)


def variation(graph: HalfEdges, albedo: np.ndarray) -> float:
    """Σ w |ρ_p − ρ_q| over the edges: half of it at either end."""
    owner = np.repeat(np.arange(graph.size), np.diff(graph.first))
    return float(np.sum(graph.weight * np.abs(albedo[owner] - albedo[graph.neighbour])) / 2)


def exact_energy(graph: HalfEdges, image: np.ndarray, shading: np.ndarray, in_gauge: bool = False) -> float:
    """Least Σ|I − S ρ| + Σ w |ρ_p − ρ_q| of one channel: a linear program in (ρ, |I − S ρ|, |Dρ|).

    In the gauge, Σ ρ = Σ I and ρ ≥ 0.
    """
    count = graph.size
    owner = np.repeat(np.arange(count), np.diff(graph.first))
    once = owner < graph.neighbour
    tail, head, weight = owner[once], graph.neighbour[once], graph.weight[once].astype(float)
    edges = np.arange(tail.size)
    d = sp.csr_array((np.ones(tail.size), (edges, head)), shape=(tail.size, count))
    d = d - sp.csr_array((np.ones(tail.size), (edges, tail)), shape=(tail.size, count))
    s, each, between = sp.diags_array(shading), sp.eye_array(count), sp.eye_array(tail.size)
    above = sp.block_array(
        [[s, -each, None], [-s, -each, None], [d, None, -between], [-d, None, -between]], format="csc"
    )
    total = sp.csr_array(np.concatenate([np.ones(count), np.zeros(count + tail.size)])[None])
    bounds = [(0 if in_gauge else None, None)] * count + [(0, None)] * (count + tail.size)
    found = linprog(
        np.concatenate([np.zeros(count), np.ones(count), weight]),
        A_ub=above,
        b_ub=np.concatenate([image, -image, np.zeros(2 * tail.size)]),
        A_eq=total if in_gauge else None,
        b_eq=[image.sum()] if in_gauge else None,
        bounds=bounds,
        method="highs",
    )
    assert found.status == 0
    return float(found.fun)
