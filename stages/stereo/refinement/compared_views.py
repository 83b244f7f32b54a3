"""Photo-consistency of all views through a surface: normal equations for the heights of its vertices."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import lru_cache, partial

import numpy as np

from stages.formats.meshes.triangle_meshes import Surface
from stages.geometry.rays import RayCaster, face_normals
from stages.scene.cameras import Camera
from stages.solvers.kernels.pixelwise import on_threads
from stages.solvers.kernels.threading_layer import loops_may_run_at_once, use_threads
from stages.solvers.kernels.unit_vectors import as_unit
from stages.stereo.refinement.compared_photos import Photo, PixelTerms, compare
from stages.stereo.refinement.displacement import NormalEquations, PixelEquations
from stages.stereo.refinement.settings import RefineSettings
from stages.stereo.refinement.vertex_rings import VertexRings

MEDIAN_SQUARE = 0.455  # of a standard normal variable
MISFITS_OF_VIEW = 20_000  # residuals of a view, about, that the noise is measured from


@dataclass(frozen=True, eq=False)
class ViewsOfSurface:
    """Views of a surface: photos by number, some of them held; and unit normals of its faces, (F, 3)."""

    cameras: list[Camera]
    photo: Callable[[int], Photo]
    surface: Surface
    normals: np.ndarray

    @classmethod
    def of(
        cls,
        cameras: list[Camera],
        radiance_of: Callable[[Camera], np.ndarray],
        surface: Surface,
        held: int,
        occlusion: float,
        threads: int,
    ) -> ViewsOfSurface:
        """Prepare the rays onto a surface; photos are read and cast when they are asked for."""
        caster = RayCaster(surface)

        def photo(view: int) -> Photo:
            camera = cameras[view]
            return Photo.unmixed(camera, radiance_of(camera), caster.hits(camera, threads), occlusion)

        normals = as_unit(face_normals(surface.vertices, surface.faces))
        return cls(cameras, lru_cache(held)(photo), surface, normals)

    def normals_in(self, photo: Photo) -> np.ndarray:
        """Find the normals of the faces that a photo's rays meet, towards its camera, (h, w, 3)."""
        hits = photo.hits
        normals = self.normals[np.where(hits.mask, hits.triangles, 0)]
        normals[hits.behind] *= -1
        return normals


@dataclass(frozen=True, eq=False)
class Comparison:
    """All photos, each to be compared with its sources through a surface.

    Attributes
    ----------
    views : ViewsOfSurface
    sources : sequence of sequence of int
        Of each view, those that it is compared with.
    rings : VertexRings
    directions : ndarray, shape (V, 3), float64
        Of the heights, as long as one of them, model units.
    noise : float
        Variance of the differences over that which the settings give.
    seed : int
    settings : RefineSettings
    """

    views: ViewsOfSurface
    sources: Sequence[Sequence[int]]
    rings: VertexRings
    directions: np.ndarray
    noise: float
    seed: int
    settings: RefineSettings

    def summed(self, threads: int) -> tuple[NormalEquations, float]:
        """Sum the normal equations of all photos, and measure the residuals' variance over the assumed one.

        NumPy and OpenCV use one thread for most of a comparison, so several photos are compared at once,
        where the threading layer allows it. They are added up in their order, on any number of threads.
        """
        equations, misfits = NormalEquations.none(self.rings), [np.zeros(0, np.float32)]
        sizes = [camera.width * camera.height for camera in self.views.cameras]
        at_once = self.settings.photos_at_once(sizes, threads if loops_may_run_at_once() else 1)
        for first in range(0, len(sizes), at_once):
            for pixels, left in self._several(range(first, min(first + at_once, len(sizes))), threads):
                equations.add(pixels)
                misfits.append(left)
        everything = np.concatenate(misfits)
        return equations, float(np.median(everything)) / MEDIAN_SQUARE if len(everything) else 1.0

    def _several(self, numbers: range, threads: int) -> list[tuple[PixelEquations, np.ndarray]]:
        """Compare some photos at once; see `_one`."""
        photos = [[self.views.photo(view) for view in (number, *self.sources[number])] for number in numbers]
        compared = partial(self._one, threads=max(1, threads // len(numbers)))
        return on_threads(lambda given: compared(*given), list(zip(numbers, photos, strict=True)))

    def _one(self, number: int, photos: list[Photo], threads: int) -> tuple[PixelEquations, np.ndarray]:
        """Compare the first of some photos with the others; also returns some of its residuals."""
        use_threads(threads)  # of this thread's loops
        normals = self.views.normals_in(photos[0])
        terms = compare(photos[0], normals, photos[1:], self.noise, self.settings)
        some = terms.misfits[:: max(len(terms.misfits) // MISFITS_OF_VIEW, 1)].copy()
        rng = np.random.default_rng([self.seed, number])
        return self._at_corners(photos[0], normals, terms, rng), some

    def _at_corners(
        self, photo: Photo, normals: np.ndarray, terms: PixelTerms, rng: np.random.Generator
    ) -> PixelEquations:
        """Refer the terms of a photo's pixels to the corners of the faces that they see."""
        seen, hits = terms.curvature > 0, photo.hits
        triangles, (u, v) = hits.triangles[seen], hits.barycentric[seen].T.astype(np.float64)
        corners, edges = self.views.surface.faces[triangles], self.rings.edges_of_faces[triangles]
        rise = np.einsum("nck,nk->nc", self.directions[corners], normals[seen])
        shares, noise = np.stack([1 - u - v, u, v], axis=1) * rise, rng.standard_normal(len(corners))
        return PixelEquations(corners, edges, shares, terms.curvature[seen], terms.slope[seen], noise)
