"""An object as user input: photos, a COLMAP model of ten equal cameras, and a mesh."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pycolmap

from benchmarks.mit_berkeley.objects import LampObject
from stages.formats.colmap.assembly import PosedImage, assemble
from stages.formats.images.exr import write_exr
from stages.formats.images.photos import write_mask
from stages.formats.meshes.triangle_meshes import Surface, write_mesh

DISTANCE = 100.0  # of the cameras, sides of the image: what is orthographic is bent by half a percent


def write_sources(subject: LampObject, to: Path) -> dict[str, Path]:
    """Write photos, masks, cameras and mesh of an object; returns their paths by source name.

    The world's unit is a pixel, its axes are the camera's; the point of the object that is nearest to the
    cameras lies in the plane z = 0.
    """
    height, width = subject.mask.shape
    distance = DISTANCE * max(height, width)
    camera = pycolmap.Camera(
        model="PINHOLE",
        width=width,
        height=height,
        params=[distance, distance, width / 2, height / 2],
    )
    cam_from_world = pycolmap.Rigid3d(pycolmap.Rotation3d(), np.array([0, 0, distance]))
    sources = {"images": to / "images", "colmap": to / "colmap", "masks": to / "masks"}
    for folder in sources.values():
        folder.mkdir(parents=True, exist_ok=True)
    posed = []
    for k, photo in enumerate(subject.photos, start=1):
        write_exr(sources["images"] / f"lamp{k:02d}.exr", photo)
        write_mask(sources["masks"] / f"lamp{k:02d}.png", subject.mask)
        posed.append(PosedImage(k, f"lamp{k:02d}.exr", camera, cam_from_world, np.empty((0, 2))))
    assemble(posed).write(sources["colmap"])
    mesh = to / "mesh.ply"
    write_mesh(mesh, surface_of(subject.height, subject.mask, distance))
    return sources | {"mesh_file": mesh}


def surface_of(height: np.ndarray, mask: np.ndarray, distance: float) -> Surface:
    """Triangulate a height map, with a square of two triangles per pixel.

    Parameters
    ----------
    height : ndarray, shape (h, w)
        Towards the viewer, pixels.
    mask : ndarray, shape (h, w), bool
    distance : float
        From the camera to the highest point, pixels: each corner lies on the ray through its image
        coordinates.

    Returns
    -------
    Surface
        Corners have the mean height of the masked pixels around them. Faces point to the viewer, against z.
    """
    neighbours = _sum_around(mask.astype(float))
    used = neighbours > 0
    corner = _sum_around(np.where(mask, height, 0.0)) / np.maximum(neighbours, 1)
    behind = corner[used].max() - corner
    rows, columns = mask.shape
    y, x = np.mgrid[: rows + 1, : columns + 1]
    widening = 1 + behind / distance
    vertices = np.stack([(x - columns / 2) * widening, (y - rows / 2) * widening, behind], axis=-1)
    number = np.cumsum(used).reshape(used.shape) - 1
    top_left, top_right = number[:-1, :-1][mask], number[:-1, 1:][mask]
    low_left, low_right = number[1:, :-1][mask], number[1:, 1:][mask]
    faces = [[top_left, low_left, top_right], [top_right, low_left, low_right]]
    return Surface(
        vertices=vertices[used],
        faces=np.concatenate([np.stack(face, axis=1) for face in faces]).astype(np.int32),
    )


def _sum_around(pixels: np.ndarray) -> np.ndarray:
    """Sum the four pixels around every corner."""
    padded = np.pad(pixels, 1)
    return padded[:-1, :-1] + padded[1:, :-1] + padded[:-1, 1:] + padded[1:, 1:]
