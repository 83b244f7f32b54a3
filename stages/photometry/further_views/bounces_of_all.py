"""Interreflection of all surface under a light that was estimated from some views.

Those views do not show all of it, and what shines on a wall is the paint of its own surroundings: so the
albedo of the vertices is computed anew, from all views, one after another.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass, replace

import numpy as np

from stages.formats.images.photos import read_mask
from stages.photometry.further_views.lit_clusters import LightTask
from stages.photometry.light_search.light_estimate import LightEstimate
from stages.photometry.light_search.vertex_albedo import NO_LIGHT, bounced_at_vertices
from stages.photometry.lighting.illumination import Illumination
from stages.photometry.transport.pixel_transfer import WHITEST, nearest_of, without_opposed
from stages.solvers.kernels.sparse_rows import product


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


def seen_vertices(view: int, task: LightTask) -> SeenVertices:
    """Sum up what a view shows around every vertex. Picklable."""
    camera = task.files.cameras[view]
    mask = read_mask(task.files.paths["mask"] / f"{camera.name}.png")
    linear, normals, towards, unclipped, inner = task.files.read(camera)
    trusted = task.files.viewing(unclipped & inner, normals, towards).trusted
    blend, _ = without_opposed(normals, task.blend([camera], [mask]), task.vertex_normals)
    around = blend[trusted].T.tocsr()
    vertices = np.flatnonzero(np.diff(around.indptr))
    radiance = (linear[trusted] / (task.scale * task.gains[view])).astype(np.float32)
    ones = np.ones((len(radiance), 1), np.float32)
    radiance, weight = (product(around, values)[vertices] for values in (radiance, ones))
    return SeenVertices(vertices, radiance, weight[:, 0])


def with_bounces_of_all(found: Illumination, seen: Iterable[SeenVertices]) -> Illumination:
    """Compute the interreflection under the light that was found, from the albedo that all views show.

    Parameters
    ----------
    found : Illumination
        Of one light for all views.
    seen : iterable of SeenVertices
        Of every view.

    Notes
    -----
    The albedo of a vertex is its radiance over its shading, direct and reflected; both are computed
    alternately, as for the views that the light was estimated from. Vertices that no view shows have that
    of the nearest one.
    """
    own, how = found.explained, found.explained.photos.settings
    if not how.bounces:
        return found
    scene, light = own.scene, own.light
    direct = scene.vertices.shading(light.radiance[0])
    radiance, weight = np.zeros(direct.shape), np.zeros((len(direct), 1))
    for one in seen:
        radiance[one.vertices] += one.radiance
        weight[one.vertices, 0] += one.weight
    nearest, bounced = nearest_of(weight[:, 0] > 0, scene.proxy.positions), light.bounced
    for _ in range(how.search.bounce_rounds):
        lit = (weight * (direct + bounced[0])).astype(np.float32)
        albedo = np.where(lit > NO_LIGHT, radiance / np.maximum(lit, NO_LIGHT), 0)
        absolute = np.clip(albedo, 0, WHITEST).astype(np.float32)[nearest]
        bounced = bounced_at_vertices(scene, direct[None], absolute, lit[nearest], how.bounces)
    return replace(found, explained=replace(own, light=LightEstimate(light.radiance, bounced)))
