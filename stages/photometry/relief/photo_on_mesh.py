"""What the photos show at the vertices of a mesh, and normals of its vertices at the photos' pixels."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from stages.formats.artefacts.view_files import read_surface_points
from stages.formats.images.exr import read_exr, write_exr
from stages.formats.images.photos import read_mask
from stages.photometry.light_search.light_from_pairs import reliability
from stages.photometry.light_search.settings import PairSettings
from stages.photometry.lighting.opened_views import ViewFiles
from stages.scene.cameras import Camera


@dataclass(frozen=True, eq=False)
class SeenOnMesh:
    """What a view shows at the vertices of the mesh.

    Attributes
    ----------
    vertices : ndarray, shape (n,)
        Indices of those that trusted pixels show.
    logs : ndarray, shape (n,), float32
        Weighted sum, over the pixels around, of the mean of the channels' logarithms: radiance, scaled, gain
        of the view divided out.
    weight : ndarray, shape (n,), float32
        Sum of the weights: barycentric coordinates times reliability.
    """

    vertices: np.ndarray
    logs: np.ndarray
    weight: np.ndarray


@dataclass(frozen=True, eq=False)
class OnMesh:
    """What views are brought to the mesh by. Picklable.

    Attributes
    ----------
    files : ViewFiles
    faces : ndarray, shape (F, 3)
    vertices : int
        V.
    scale : float
        By which images are divided.
    gains : ndarray, shape (n, 3)
        Of all views.
    pairs : PairSettings
        Noise of the image, and its darkest.
    """

    files: ViewFiles
    faces: np.ndarray
    vertices: int
    scale: float
    gains: np.ndarray
    pairs: PairSettings


def seen_on_mesh(view: int, task: OnMesh) -> SeenOnMesh:
    """Sum up what a view shows around every vertex. Picklable."""
    camera = task.files.cameras[view]
    mask = read_mask(task.files.paths["mask"] / f"{camera.name}.png")
    linear, _, trusted = task.files.trusted(camera)
    radiance = linear[trusted] / (task.scale * task.gains[view])
    logs = np.log(np.maximum(radiance, task.pairs.darkest)).mean(axis=1)
    (faces,), (barycentric,) = read_surface_points(task.files.paths, [camera], [mask])
    corners, shares = task.faces[faces[trusted]].ravel(), shares_of(barycentric[trusted])
    shares *= reliability(radiance.min(axis=1), task.pairs)[:, None]
    weight = np.bincount(corners, shares.ravel(), minlength=task.vertices)
    summed = np.bincount(corners, (shares * logs[:, None]).ravel(), minlength=task.vertices)
    vertices = np.flatnonzero(weight)
    return SeenOnMesh(vertices, summed[vertices].astype(np.float32), weight[vertices].astype(np.float32))


def photo_on_mesh(seen: Iterable[SeenOnMesh], vertices: int, fewest: float) -> tuple[np.ndarray, np.ndarray]:
    """Average what all views show: logarithms at the vertices, (V,), and where known, (V,), bool."""
    logs, weight = np.zeros(vertices), np.zeros(vertices)
    for one in seen:
        logs[one.vertices] += one.logs
        weight[one.vertices] += one.weight
    known = weight > fewest
    return np.where(known, logs / np.where(known, weight, 1), 0), known


def shares_of(barycentric: np.ndarray) -> np.ndarray:
    """Compute the shares of the three corners of faces at points (u, v), (n, 2): (n, 3), float32."""
    return np.column_stack([1 - barycentric.sum(axis=1), barycentric]).astype(np.float32)


def normals_at(
    of_vertices: np.ndarray, faces: np.ndarray, barycentric: np.ndarray, mesh_normals: np.ndarray
) -> np.ndarray:
    """Interpolate vertices' normals, (V, 3), at points of faces.

    Parameters
    ----------
    of_vertices : ndarray, shape (V, 3)
        Of any length.
    faces : ndarray, shape (n, 3)
        Corners of the face of each point.
    barycentric : ndarray, shape (n, 2)
        (u, v): the point is (1 − u − v) a + u b + v c.
    mesh_normals : ndarray, shape (n, 3)
        On the side that is seen: the others are turned to it. They are kept where nothing else is known.

    Returns
    -------
    ndarray, shape (n, 3), float32
        Unit.
    """
    found = np.einsum("nc,nck->nk", shares_of(barycentric), of_vertices[faces])
    found *= np.where(np.einsum("nk,nk->n", found, mesh_normals) < 0, -1, 1)[:, None]
    length = np.linalg.norm(found, axis=1, keepdims=True)
    return np.where(length > 0, found / np.where(length > 0, length, 1), mesh_normals).astype(np.float32)


def write_normals(
    camera: Camera, paths: Mapping[str, Path], of_vertices: np.ndarray, faces: np.ndarray, to: Path
) -> float:
    """Write the map of a view, and measure by how many degrees its normals turned, the median. Picklable."""
    before = read_exr(paths["normal"] / f"{camera.name}.exr")
    there = np.any(before != 0, axis=2)
    (seen,), (barycentric,) = read_surface_points(paths, [camera], [there])
    found = np.zeros_like(before)
    found[there] = normals_at(of_vertices, faces[seen], barycentric, before[there])
    write_exr(to / f"{camera.name}.exr", found, is_colour=False)
    if not there.any():
        return 0.0
    cosines = np.einsum("nk,nk->n", found[there], before[there])
    return float(np.degrees(np.arccos(np.clip(np.median(cosines), -1, 1))))
