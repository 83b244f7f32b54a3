"""Interreflection of all surface under a light that was estimated from some views.

Those views do not show all of it, and what shines on a wall is the paint of its own surroundings: so what
the vertices reflect is taken from all views, one after another.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass, replace

import numpy as np

from stages.formats.images.photos import read_mask
from stages.photometry.further_views.lit_clusters import LightTask
from stages.photometry.light_search.light_estimate import LightEstimate
from stages.photometry.light_search.vertex_albedo import NO_LIGHT
from stages.photometry.lighting.illumination import Illumination
from stages.photometry.transport.lit_scenes import LitScene
from stages.photometry.transport.pixel_transfer import nearest_of, without_opposed
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
    linear, normals, trusted = task.files.trusted(camera)
    blend, _ = without_opposed(normals, task.blend([camera], [mask]), task.vertex_normals)
    around = blend[trusted].T.tocsr()
    vertices = np.flatnonzero(np.diff(around.indptr))
    radiance = (linear[trusted] / (task.scale * task.gains[view])).astype(np.float32)
    ones = np.ones((len(radiance), 1), np.float32)
    radiance, weight = (product(around, values)[vertices] for values in (radiance, ones))
    return SeenVertices(vertices, radiance, weight[:, 0])


def with_bounces_of_all(found: Illumination, seen: Iterable[SeenVertices]) -> Illumination:
    """Replace the interreflection of an illumination, of one light for all views, by `bounced_of_all`."""
    own = found.explained
    if not own.photos.settings.bounces:
        return found
    return replace(found, explained=replace(own, light=bounced_of_all(own.scene, own.light, seen)))


def bounced_of_all(scene: LitScene, light: LightEstimate, seen: Iterable[SeenVertices]) -> LightEstimate:
    """Compute the interreflection from the radiance that all views show.

    Parameters
    ----------
    scene : LitScene
        Its pixels are not used.
    light : LightEstimate
        One light.
    seen : iterable of SeenVertices
        Of every view.

    Notes
    -----
    What a diffuse vertex sends to others is what the photos show of it, with all its bounces. Vertices that
    no view shows send what the nearest one does; the backs of faces, as before, their front's light times
    the median albedo.
    """
    shading = scene.vertices.shading(light.radiance[0]) + light.bounced[0]
    radiance, weight = np.zeros(shading.shape), np.zeros(len(shading))
    for one in seen:
        radiance[one.vertices] += one.radiance
        weight[one.vertices] += one.weight
    shown = weight > 0
    radiance /= np.where(shown, weight, 1)[:, None]
    lit = shown & (shading.min(axis=1) > NO_LIGHT)
    of_backs = np.median(radiance[lit] / shading[lit], axis=0) if lit.any() else np.zeros(3)
    sent = radiance[nearest_of(shown, scene.proxy.positions)].astype(np.float32)
    occlusion = scene.proxy.occlusion
    bounced = product(occlusion.form_factors, sent)
    bounced += of_backs.astype(np.float32) * product(occlusion.behind, shading.astype(np.float32))
    return LightEstimate(light.radiance, bounced[None])
