"""A surface moved along its normals until the photos of neighbouring views agree on it."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass

import numpy as np

from stages.formats.meshes.triangle_meshes import Surface, joined
from stages.geometry.rays import RayCaster, face_normals, vertex_normals
from stages.scene.cameras import Camera, smallest_footprints
from stages.stereo.refinement.compared_photos import Photo, compare
from stages.stereo.refinement.displacement import Evidence, HeightModel, Roughness
from stages.stereo.refinement.settings import RefineSettings
from stages.stereo.refinement.vertex_rings import VertexRings

MEDIAN_SQUARE = 0.455  # of a standard normal variable
MISFITS_OF_VIEW = 20_000  # differences of a view, at most, that the noise is measured from


@dataclass(frozen=True, eq=False)
class Round:
    """What a round has led to.

    Attributes
    ----------
    surface : Surface
    scale : int
        At which the photos were compared.
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
    scale: int
    noise: float
    moved: float
    stiffness: float
    known: float


def refine(
    surface: Surface,
    cameras: Sequence[Camera],
    sources: Sequence[Sequence[int]],
    log_radiance_at: Callable[[Camera], np.ndarray],
    settings: RefineSettings,
    threads: int,
) -> Iterator[Round]:
    """Refine a surface, round by round.

    Parameters
    ----------
    surface : Surface
    cameras : sequence of Camera
        At the working size.
    sources : sequence of sequence of int
        Of each view, those that it is compared with.
    log_radiance_at : callable
        Reads the photo of a camera at its size: as `Photo.log_radiance`.
    settings : RefineSettings
    threads : int

    Notes
    -----
    Heights are along the normals of the given surface, in pixel footprints. Each round compares the photos
    through the surface as it is, and solves for the heights that are most probable given the differences,
    their variance as measured, and a roughness that is measured too, on the finest scale. (Vu et al. 2012
    descend a correlation by steps of a given length under a given stiffness.)
    """
    whole, number_in_whole = joined(surface)  # at creases and seams, or it would open there
    lengths, normals = _footprints(whole, list(cameras)), vertex_normals(whole.vertices, whole.faces)
    directions = normals.astype(np.float64) * lengths[:, None]
    rings = VertexRings.of(whole.faces, len(whole.vertices))
    heights, noise = np.zeros(len(whole.vertices)), 1.0
    edge = _typical_edge(whole, lengths)
    roughness = Roughness(settings.roughness.stiffness / edge**2, np.ones(len(heights)))
    now = whole
    for scale in settings.scales:
        scaled = [camera.reduced(1 / scale) for camera in cameras]
        logs = [log_radiance_at(camera) for camera in scaled]
        for number in range(settings.rounds):
            views = _View.of_all(scaled, logs, now, settings.occlusion, threads)
            evidence, measured = _evidence(views, sources, rings, directions, noise, number, settings)
            noise = max(noise * measured, settings.errors.least)
            model = HeightModel(rings, evidence, roughness, settings)
            heights, known = model.most_probable(heights), evidence.diagonal > settings.hold
            if scale == settings.scales[-1] and known.any():
                left_open = model.sample(np.random.default_rng([number, len(views)]))
                roughness = roughness.measured(rings, heights, left_open, known, settings.roughness)
            now = Surface(whole.vertices + heights[:, None] * directions, whole.faces)
            del views, evidence, model  # the rays' tree, before that of the next round is made
            moved = float(np.sqrt(np.mean(heights[known] ** 2))) if known.any() else 0.0
            found = Surface(now.vertices[number_in_whole], surface.faces)
            yield Round(found, scale, noise, moved, roughness.stiffness * edge**2, float(known.mean()))
        del logs


@dataclass(frozen=True, eq=False)
class _View:
    """A photo with what it needs of the surface: the caster, and normals of the faces."""

    photo: Photo
    caster: RayCaster
    surface: Surface
    normals: np.ndarray
    threads: int

    @classmethod
    def of_all(
        cls, cameras: list[Camera], logs: list[np.ndarray], surface: Surface, occlusion: float, threads: int
    ) -> list[_View]:
        """Cast the rays of all views onto the surface; of each, only the depth is held."""
        caster = RayCaster(surface)
        normals = face_normals(surface.vertices, surface.faces)
        normals /= np.maximum(np.linalg.norm(normals, axis=1, keepdims=True), np.finfo(np.float64).tiny)
        depths = (caster.hits(camera, threads).depth for camera in cameras)
        return [
            cls(Photo.unmixed(camera, log, depth, occlusion), caster, surface, normals, threads)
            for camera, log, depth in zip(cameras, logs, depths, strict=True)
        ]


def _evidence(
    views: list[_View],
    sources: Sequence[Sequence[int]],
    rings: VertexRings,
    directions: np.ndarray,
    noise: float,
    seed: int,
    settings: RefineSettings,
) -> tuple[Evidence, float]:
    """Gather what all photos say; and the variance of their differences over that which was assumed."""
    evidence, misfits = Evidence.none(rings), []
    for number, view in enumerate(views):
        hits = view.caster.hits(view.photo.camera, view.threads)
        normals = view.normals[np.where(hits.mask, hits.triangles, 0)]
        normals[hits.behind] *= -1
        others = [views[other].photo for other in sources[number]]
        terms = compare(view.photo, normals, others, noise, settings)
        told = terms.curvature > 0
        if not told.any():
            continue
        triangles, (u, v) = hits.triangles[told], hits.barycentric[told].T.astype(np.float64)
        corners = view.surface.faces[triangles]
        rise = np.einsum("nck,nk->nc", directions[corners], normals[told])
        rng = np.random.default_rng([seed, number])
        evidence.add(
            corners,
            np.stack([1 - u - v, u, v], axis=1) * rise,
            rings.edges_of_faces[triangles],
            *(terms.curvature[told], terms.slope[told], rng.standard_normal(len(corners))),
        )
        every = max(len(terms.misfits) // MISFITS_OF_VIEW, 1)
        misfits.append(terms.misfits[::every])
    measured = float(np.median(np.concatenate(misfits))) / MEDIAN_SQUARE if misfits else 1.0
    return evidence, measured


def _footprints(surface: Surface, cameras: list[Camera]) -> np.ndarray:
    """Compute each vertex's smallest pixel footprint, model units; the usual one where no image holds it."""
    sizes = smallest_footprints(surface.vertices, cameras)
    finite = np.isfinite(sizes)
    return np.where(finite, sizes, np.median(sizes[finite]) if finite.any() else 1.0)


def _typical_edge(surface: Surface, lengths: np.ndarray) -> float:
    """Measure the mean edge, in footprints."""
    edges = np.diff(surface.vertices[surface.faces[:, [0, 1, 2, 0]]], axis=1)
    return float(np.mean(np.linalg.norm(edges, axis=2) / lengths[surface.faces]))
