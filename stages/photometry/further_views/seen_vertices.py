"""Radiance of the surface as the photos of all views show it, before light is estimated from some of them.

Those views do not show all surface, and what shines on a wall is the paint of its own surroundings: so what
the vertices send to each other is taken from all views, one after another.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable
from dataclasses import dataclass

import numpy as np
import scipy.sparse as sp

from stages.formats.images.photos import read_mask
from stages.photometry.lighting.opened_views import ViewFiles
from stages.photometry.transport.pixel_transfer import without_opposed
from stages.photometry.transport.shown_radiance import ShownRadiance
from stages.photometry.transport.transfer_vectors import Proxy
from stages.solvers.kernels.sparse_rows import product


@dataclass(frozen=True, eq=False)
class SurfaceViews:
    """All views, in one unit, with the surface that they show. Picklable.

    Attributes
    ----------
    files : ViewFiles
    blend : callable
        Interpolates the proxy's vertices at the masked pixels of cameras: (N, P); takes a map over views.
    vertex_normals : ndarray, shape (P, 3)
    gains : ndarray, shape (n, 3)
    scale : float
        By which images are divided.
    """

    files: ViewFiles
    blend: Callable[..., sp.csr_array]
    vertex_normals: np.ndarray
    gains: np.ndarray
    scale: float


@dataclass(frozen=True, eq=False)
class SeenVertices:
    """What trusted pixels of a view show around the proxy's vertices.

    Attributes
    ----------
    vertices : ndarray, shape (n,)
        Indices.
    radiance : ndarray, shape (n, 3), float32
        Sum over the pixels by their blend, scaled, gain of the view divided out.
    weight : ndarray, shape (n,), float32
        Sum of the blend.
    """

    vertices: np.ndarray
    radiance: np.ndarray
    weight: np.ndarray


def seen_vertices(view: int, views: SurfaceViews) -> SeenVertices:
    """Sum up what a view shows around every vertex. Picklable."""
    camera = views.files.cameras[view]
    mask = read_mask(views.files.paths["mask"] / f"{camera.name}.png")
    linear, normals, trusted = views.files.trusted(camera)
    blend, _ = without_opposed(normals, views.blend([camera], [mask]), views.vertex_normals)
    around = blend[trusted].T.tocsr()
    vertices = np.flatnonzero(np.diff(around.indptr))
    radiance = (linear[trusted] / (views.scale * views.gains[view])).astype(np.float32)
    ones = np.ones((len(radiance), 1), np.float32)
    radiance, weight = (product(around, values)[vertices] for values in (radiance, ones))
    return SeenVertices(vertices, radiance, weight[:, 0])


def shown_by_all(proxy: Proxy, seen: Iterable[SeenVertices]) -> ShownRadiance:
    """Average what every view shows."""
    vertices = len(proxy.positions)
    radiance, weight = np.zeros((vertices, 3)), np.zeros(vertices)
    for one in seen:
        radiance[one.vertices] += one.radiance
        weight[one.vertices] += one.weight
    return ShownRadiance.of(proxy, radiance, weight)
