"""A surface moved along its normals until the photos of neighbouring views agree on it."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from functools import lru_cache

import numpy as np

from stages.formats.meshes.triangle_meshes import Surface, joined
from stages.geometry.rays import face_normals, vertex_normals
from stages.geometry.short_edges import with_short_edges
from stages.scene.cameras import Camera, smallest_footprints
from stages.solvers.kernels.unit_vectors import as_unit
from stages.stereo.refinement.compared_views import Comparison, ViewsOfSurface
from stages.stereo.refinement.displacement import HeightModel, Roughness
from stages.stereo.refinement.folds import without_folds
from stages.stereo.refinement.settings import RefineSettings
from stages.stereo.refinement.slivers import without_slivers
from stages.stereo.refinement.vertex_order import ordered_by_neighbours
from stages.stereo.refinement.vertex_rings import VertexRings


@dataclass(frozen=True, eq=False)
class Round:
    """The surface after a round of refinement, and what was measured in it.

    Attributes
    ----------
    surface : Surface
    noise : float
        Variance of differences of the photos, before its move, over that which the settings give.
    moved : float
        Root mean square of all moves so far, of the vertices that are known, pixel footprints of the working
        size.
    stiffness : float
        Measured after it, as that of the settings.
    known : float
        Share of the vertices whose height the photos tell better than `settings.hold`.
    """

    surface: Surface
    noise: float
    moved: float
    stiffness: float
    known: float


def refine(
    surface: Surface,
    widest: float,
    cameras: Sequence[Camera],
    sources: Sequence[Sequence[int]],
    radiance_at: Callable[[Camera], np.ndarray],
    settings: RefineSettings,
    threads: int,
) -> Iterator[Round]:
    """Refine a surface, round by round.

    Parameters
    ----------
    surface : Surface
    widest : float
        As `widest_relief` says of it, pixel footprints.
    cameras : sequence of Camera
        At the working size.
    sources : sequence of sequence of int
        Of each view, those that it is compared with.
    radiance_at : callable
        Reads the photo of a camera at its size: as `Photo.radiance`.
    settings : RefineSettings
    threads : int

    Notes
    -----
    Heights are along the normals of the given surface, in pixel footprints. Each round compares the photos
    through the surface as it is, and solves for the heights that are most probable given the differences,
    their variance as measured, and a roughness that is measured too, on the finest scale. (Vu et al. 2012
    descend a correlation by steps of a given length under a given stiffness.) Heights that are wider than
    what the mesh lacks are not expected: else an edge that is sharpened would bend the plain surface beside.
    """
    whole, number_in_whole = joined(surface)  # at creases and seams, or it would open there
    lengths, normals = _footprints(whole, list(cameras)), vertex_normals(whole.vertices, whole.faces)
    facing = as_unit(face_normals(whole.vertices, whole.faces))
    directions = normals.astype(np.float64) * lengths[:, None]
    rings = VertexRings.of(whole.faces, len(whole.vertices))
    heights, noise = np.zeros(len(whole.vertices)), 1.0
    edge = _typical_edge(whole, lengths)
    roughness = Roughness(
        settings.roughness.stiffness / edge**2, np.ones(len(heights)), widest / (np.pi * edge)
    )
    now = whole
    for scale in settings.scales:
        scaled = [camera.reduced(1 / scale) for camera in cameras]
        held = max(settings.most_pixels // max(c.width * c.height for c in scaled), settings.neighbours + 1)
        radiance_of = lru_cache(held)(radiance_at)
        for number in range(settings.rounds):
            views = ViewsOfSurface.of(scaled, radiance_of, now, held, settings.occlusion, threads)
            comparison = Comparison(views, sources, rings, directions, noise, number, settings)
            equations, measured = comparison.summed(threads)
            noise = max(noise * measured, settings.errors.least)
            model = HeightModel(rings, equations, roughness, settings)
            found, known = model.most_probable(heights), equations.diagonal > settings.hold
            heights = without_folds(whole, facing, directions, found, settings.folds)
            if scale == settings.scales[-1] and known.any():
                left_open = model.sample(np.random.default_rng([number, len(cameras)]))
                roughness = roughness.measured(rings, heights, left_open, known, settings.roughness)
            now = Surface(whole.vertices + heights[:, None] * directions, whole.faces)
            del views, comparison, equations, model  # the rays' tree, before that of the next round is made
            moved = float(np.sqrt(np.mean(heights[known] ** 2))) if known.any() else 0.0
            refined = Surface(now.vertices[number_in_whole], surface.faces)
            yield Round(refined, noise, moved, roughness.stiffness * edge**2, float(known.mean()))


def remeshed(surface: Surface, cameras: Sequence[Camera], settings: RefineSettings) -> Surface:
    """Even out slivers, and divide faces until edges are as short as relief needs them."""
    surface = without_slivers(surface, settings.slivers)
    sizes = smallest_footprints(surface.vertices, list(cameras))
    sizes = sizes[np.isfinite(sizes)]
    if not len(sizes):
        return surface
    longest = settings.edge_px * float(np.median(sizes))
    return ordered_by_neighbours(with_short_edges(surface, longest, settings.most_vertices).surface)


def widest_relief(surface: Surface, cameras: Sequence[Camera], settings: RefineSettings) -> float:
    """Estimate how wide relief may be that a mesh lacks: a wavelength, pixel footprints."""
    edge = _typical_edge(surface, _footprints(surface, list(cameras)))
    return max(settings.roughness.widest_px, settings.roughness.widest_edges * edge)


def _footprints(surface: Surface, cameras: list[Camera]) -> np.ndarray:
    """Compute each vertex's smallest pixel footprint, model units; the usual one where no image holds it."""
    sizes = smallest_footprints(surface.vertices, cameras)
    finite = np.isfinite(sizes)
    return np.where(finite, sizes, np.median(sizes[finite]) if finite.any() else 1.0)


def _typical_edge(surface: Surface, lengths: np.ndarray) -> float:
    """Measure the mean edge, in footprints."""
    edges = np.diff(surface.vertices[surface.faces[:, [0, 1, 2, 0]]], axis=1)
    return float(np.mean(np.linalg.norm(edges, axis=2) / lengths[surface.faces]))
