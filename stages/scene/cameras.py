"""Pinhole cameras: projection, back-projection and conversions between pixel conventions."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import PurePosixPath

import numpy as np

FARTHEST = 1e15  # model units, of vertices and poses: squares and their sums stay within single precision


@dataclass(frozen=True, eq=False)
class Camera:
    """One view's pinhole camera (Eq. 7: K, R, t).

    Attributes
    ----------
    name : str
        View name: the photo's path below the image folder, without extension.
    width, height : int
        Image size, pixels.
    intrinsics : ndarray, shape (3, 3), float64
        K, with the centre of the first pixel at (0.5, 0.5).
    cam_from_world : ndarray, shape (3, 4), float64
        [R t]: ``x_in_cam = R @ x_in_world + t``.
    """

    name: str
    width: int
    height: int
    intrinsics: np.ndarray
    cam_from_world: np.ndarray

    @property
    def shape(self) -> tuple[int, int]:
        """Shape of the view's arrays, (height, width)."""
        return self.height, self.width

    @property
    def rotation(self) -> np.ndarray:
        """R of Eq. 7: world axes to camera axes, shape (3, 3)."""
        return self.cam_from_world[:, :3]

    @cached_property
    def centre_in_world(self) -> np.ndarray:
        """Centre of projection, −Rᵀt, shape (3,)."""
        return -self.rotation.T @ self.cam_from_world[:, 3]

    @property
    def focal_px(self) -> float:
        """Mean focal length, pixels."""
        return float(self.intrinsics[0, 0] + self.intrinsics[1, 1]) / 2

    def scaled(self, width: int, height: int) -> Camera:
        """Scale the camera to another image size (pixels); COLMAP's half-pixel makes this a plain product."""
        scale = np.diag([width / self.width, height / self.height, 1.0])
        return replace(self, width=width, height=height, intrinsics=scale @ self.intrinsics)

    def reduced(self, scale: float) -> Camera:
        """Scale the camera by a factor, to whole pixels, two at least."""
        return self.scaled(max(2, round(self.width * scale)), max(2, round(self.height * scale)))


def view_name(image_name: str) -> str:
    """Derive the view name of a COLMAP image name: its extension dropped, its sub-folders kept."""
    return str(PurePosixPath(image_name).with_suffix(""))


def pixel_centres(width: int, height: int) -> np.ndarray:
    """List image coordinates of all pixel centres, shape (height, width, 2): (x + 0.5, y + 0.5)."""
    return np.stack(np.meshgrid(centres_along(width), centres_along(height)), axis=-1)


def centres_along(count: int) -> np.ndarray:
    """List image coordinates of the pixel centres along one side of an image, shape (count,): 0.5, 1.5, …"""
    return np.arange(count) + 0.5


def xy_for_integer_centres(xy: np.ndarray) -> np.ndarray:
    """Shift image coordinates to put the first pixel's centre at (0, 0), as for OpenCV and array indices."""
    return xy - 0.5


def intrinsics_for_integer_centres(intrinsics: np.ndarray) -> np.ndarray:
    """Shift K to put the first pixel's centre at (0, 0), as for OpenCV and array indices in kernels."""
    shifted = intrinsics.copy()
    shifted[:2, 2] -= 0.5
    return shifted


def intrinsics_from_first_pixel(intrinsics: np.ndarray, first_pixel_px: float) -> np.ndarray:
    """Shift K, whose first pixel's centre is at `first_pixel_px` on both axes, to put it at (0.5, 0.5)."""
    shifted = intrinsics.copy()
    shifted[:2, 2] += 0.5 - first_pixel_px
    return shifted


def rays_in_world(camera: Camera) -> np.ndarray:
    """Compute the direction of every pixel's ray, (height, width, 3), world axes, **z = 1 in the camera**.

    A point at z-depth d on the ray is ``centre + d * ray``: ray lengths need no conversion.
    """
    xy = pixel_centres(camera.width, camera.height)
    homogeneous = np.concatenate([xy, np.ones((*xy.shape[:2], 1))], axis=-1)
    return homogeneous @ (camera.rotation.T @ np.linalg.inv(camera.intrinsics)).T


def back_project(camera: Camera, depth: np.ndarray) -> np.ndarray:
    """Apply π⁻¹ of Eq. 8 to all pixels: world points, (height, width, 3); `depth` is z, (height, width)."""
    return camera.centre_in_world + rays_in_world(camera) * depth[..., None]


def project(camera: Camera, x_in_world: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Project by π of Eq. 7: ``[p, 1] ~ K (R X + t)``.

    Parameters
    ----------
    camera : Camera
    x_in_world : ndarray, shape (..., 3)

    Returns
    -------
    xy : ndarray, shape (..., 2)
        Image coordinates, pixels; meaningless where `depth` is not positive.
    depth : ndarray, shape (...)
        z in the camera, model units.
    """
    x_in_cam = x_in_world @ camera.rotation.T + camera.cam_from_world[:, 3]
    depth = x_in_cam[..., 2]
    safe = np.where(depth > 0, depth, 1.0)
    xy = (x_in_cam @ camera.intrinsics.T)[..., :2] / safe[..., None]
    return xy, depth


def footprint(camera: Camera, depth: np.ndarray | float) -> np.ndarray | float:
    """Compute the length on a fronto-parallel surface that one pixel covers, z/f, model units."""
    return depth / camera.focal_px


def in_image(camera: Camera, xy: np.ndarray, depth: np.ndarray) -> np.ndarray:
    """Test whether points, projected by `project`, fall into the image, (...), bool; not whether hidden."""
    return (depth > 0) & ((xy >= 0) & (xy < (camera.width, camera.height))).all(axis=-1)


def pixels_of(
    camera: Camera, x_in_world: np.ndarray
) -> tuple[np.ndarray, tuple[np.ndarray, np.ndarray], np.ndarray]:
    """Find the pixels of a view that points, (n, 3), fall into; not whether hidden.

    Returns
    -------
    inside : ndarray, shape (m,), int64
        Indices of the points in the image.
    pixel : tuple of two ndarray, shape (m,), int64
        Their rows and columns: indexes a map of the view.
    depth : ndarray, shape (m,)
        Their z.
    """
    xy, depth = project(camera, x_in_world)
    inside = np.flatnonzero(in_image(camera, xy, depth))
    column, row = xy[inside].astype(np.int64).T
    return inside, (row, column), depth[inside]


def smallest_footprints(x_in_world: np.ndarray, cameras: list[Camera]) -> np.ndarray:
    """Compute points' smallest z/f over the views whose image holds them, (n,); infinite where none does."""
    smallest = np.full(len(x_in_world), np.inf)
    for camera in cameras:
        xy, depth = project(camera, x_in_world)
        inside = in_image(camera, xy, depth)
        smallest[inside] = np.minimum(smallest[inside], footprint(camera, depth[inside]))
    return smallest


def normals_in_world(camera: Camera, normals_in_cam: np.ndarray) -> np.ndarray:
    """Rotate normals, shape (..., 3), from camera axes (COLMAP's normal maps) into world axes."""
    return normals_in_cam @ camera.rotation


def normals_in_cam(camera: Camera, normals_in_world: np.ndarray) -> np.ndarray:
    """Rotate normals, shape (..., 3), from world axes into camera axes."""
    return normals_in_world @ camera.rotation.T
