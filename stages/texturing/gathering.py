"""What views show of texels: weighted means over all that see them, robust against what one alone shows."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass

import cv2
import numpy as np
from numba import njit, prange

import stages.solvers.kernels.threading_layer  # noqa: F401 -- chooses the threads below
from stages.geometry.outlines.border_distances import distances_from_border
from stages.scene.cameras import (
    Camera,
    footprint,
    intrinsics_for_integer_centres,
    smallest_footprints,
)
from stages.texturing.settings import GatheringSettings

SHADING, NORMAL, CONFIDENCE, MAPS = slice(0, 3), slice(3, 6), 6, 7  # besides the albedo


@dataclass(frozen=True, eq=False)
class ViewMaps:
    """A view, opened.

    Attributes
    ----------
    camera : Camera
        At working size.
    depth : ndarray, shape (h, w), float32
        z, 0 where nothing is.
    weight : ndarray, shape (h, w), float32
        0 where the view tells nothing; see `weight_of`.
    maps : ndarray, shape (h, w, 7), float32
        Shading, normal, confidence.
    albedo : ndarray, shape (H, W, 3), float32
        At any size.
    """

    camera: Camera
    depth: np.ndarray
    weight: np.ndarray
    maps: np.ndarray
    albedo: np.ndarray


@dataclass(eq=False)
class Sums:
    """Weighted sums over views.

    Attributes
    ----------
    weight : ndarray, shape (T,), float32
    albedo : ndarray, shape (T, 3), float32
    maps : ndarray, shape (T, 7) or (T, 0), float32
    """

    weight: np.ndarray
    albedo: np.ndarray
    maps: np.ndarray

    @classmethod
    def none(cls, texels: int, maps: int) -> Sums:
        """Begin with nothing; `maps` of 0: of the albedo alone."""
        return cls(
            np.zeros(texels, np.float32),
            np.zeros((texels, 3), np.float32),
            np.zeros((texels, maps), np.float32),
        )

    def add(self, other: Sums) -> None:
        """Add the sums over other views, in place."""
        self.weight += other.weight
        self.albedo += other.albedo
        self.maps += other.maps

    def into_means(self) -> tuple[np.ndarray, np.ndarray]:
        """Turn the sums of albedo and maps into means, in place; 0 where no view shows a texel."""
        weight = np.where(self.weight > 0, self.weight, 1)[:, None]
        self.albedo /= weight
        self.maps /= weight
        return self.albedo, self.maps


@dataclass(frozen=True, eq=False)
class Gathered:
    """What all views show of points of the surface.

    Attributes
    ----------
    weight : ndarray, shape (T,), float32
        0 where no view shows it.
    albedo : ndarray, shape (T, 3), float32
    maps : ndarray, shape (T, 7), float32
        Shading, normal, confidence.
    """

    weight: np.ndarray
    albedo: np.ndarray
    maps: np.ndarray

    @property
    def colours(self) -> np.ndarray:
        """Albedo and shading, (T, 6), float32, linear."""
        return np.concatenate([self.albedo, self.maps[:, SHADING]], axis=1)

    @property
    def normals(self) -> np.ndarray:
        """In world axes, (T, 3), float32; zeros where unseen."""
        return self.maps[:, NORMAL]

    @property
    def confidence(self) -> np.ndarray:
        """Of the albedo, (T, 1), float32; 0 where unseen."""
        return self.maps[:, CONFIDENCE, None]


def gathered(
    points: np.ndarray,
    normals: np.ndarray,
    origin: np.ndarray,
    typical: float,
    views: Callable[[], Iterator[ViewMaps]],
    how: GatheringSettings,
    after_each: Callable[[], None] = lambda: None,
) -> Gathered:
    """Average points over the views in two passes, the second robust.

    Parameters
    ----------
    points, normals : ndarray, shape (T, 3), float32
        World axes, points from `origin`.
    origin : ndarray, shape (3,), float64
    typical : float
        A footprint, model units: that of `typical_footprint`.
    views : callable
        Opens the views, one after another; called once for each pass.
    how : GatheringSettings
    after_each : callable
        Called after every view.
    """
    reference, bright = np.zeros((0, 3), np.float32), 1.0
    for robust in (False, True):
        sums = Sums.none(len(points), MAPS if robust else 0)
        for view in views():
            gather(points, normals, view, reference, (typical, bright), origin, how, sums)
            after_each()
        albedo, maps = sums.into_means()
        if robust:
            lost = sums.weight <= 0  # no two views agree
            albedo[lost] = reference[lost]
        else:
            reference, weight = albedo, sums.weight
            seen = weight > 0
            bright = float(np.quantile(albedo[seen], how.bright_quantile)) if seen.any() else 1.0
            bright = bright or 1.0  # all but black: then any unit will do
    return Gathered(weight, albedo, maps)


def typical_footprint(vertices: np.ndarray, cameras: list[Camera]) -> float:
    """Compute the median of the vertices' smallest footprints, model units.

    Where no vertex is in any image, as of a few large faces: the cameras' own at the middle of the mesh.
    """
    footprints = smallest_footprints(vertices, cameras)
    known = footprints[np.isfinite(footprints)]
    if not len(known):
        middle = vertices.mean(axis=0)
        known = np.array([np.linalg.norm(one.centre_in_world - middle) / one.focal_px for one in cameras])
    return float(np.median(known))


def weight_of(
    camera: Camera, mask: np.ndarray, depth: np.ndarray, confidence: np.ndarray, how: GatheringSettings
) -> np.ndarray:
    """Weigh a view's pixels by confidence and by their distance from borders, (h, w), float32.

    Parameters
    ----------
    camera : Camera
    mask : ndarray, shape (h, w), bool
    depth : ndarray, shape (h, w)
    confidence : ndarray, shape (h, w)
        0 to 1.
    how : GatheringSettings

    Notes
    -----
    Borders are those of the mask, of the image, and of surfaces: where neighbouring depths jump. There, a
    pixel mixes two surfaces.
    """
    around = np.ones((3, 3), np.uint8)
    jump = cv2.dilate(depth, around) - cv2.erode(depth, around)
    whole = mask & (depth > 0) & (jump <= how.jump_footprints * footprint(camera, depth))
    inside = distances_from_border(np.pad(whole, 1))[1:-1, 1:-1]
    faded = np.clip((inside - 1) / how.border_px, 0, 1)
    return (faded * confidence).astype(np.float32)


def gather(
    points: np.ndarray,
    normals: np.ndarray,
    view: ViewMaps,
    reference: np.ndarray,
    scale: tuple[float, float],
    origin: np.ndarray,
    how: GatheringSettings,
    sums: Sums,
) -> None:
    """Add what a view shows of texels to the sums.

    Parameters
    ----------
    points, normals : ndarray, shape (T, 3), float32
        World axes, points from `origin`.
    view : ViewMaps
    reference : ndarray, shape (T, 3), float32
        Means of a first pass, with which the view is compared; of length 0 in that pass.
    scale : tuple of float
        A typical footprint, model units, and a bright albedo: units of weights and offsets.
    origin : ndarray, shape (3,), float64
    how : GatheringSettings
    sums : Sums
        **Updated.**
    """
    camera, (height, width) = view.camera, view.albedo.shape[:2]
    larger = np.diag([width / camera.width, height / camera.height, 1.0])
    shift = camera.rotation @ origin + camera.cam_from_world[:, 3]
    typical, bright = scale
    _gather(
        points,
        normals,
        (camera.rotation.astype(np.float32), shift.astype(np.float32)),
        (camera.centre_in_world - origin).astype(np.float32),
        intrinsics_for_integer_centres(camera.intrinsics).astype(np.float32),
        intrinsics_for_integer_centres(larger @ camera.intrinsics).astype(np.float32),
        (view.depth, view.weight, view.maps, view.albedo),
        reference,
        tuple(
            np.float32(value)
            for value in (
                how.min_cosine,
                how.depth_footprints / camera.focal_px,
                typical * camera.focal_px,
                how.sharpness if len(reference) else 0,  # a reference is what most views say
                how.tolerance,
                how.log_offset * bright,
            )
        ),
        (sums.weight, sums.albedo, sums.maps),
    )


@njit(parallel=True, cache=True, nogil=True)
def _gather(points, normals, pose, centre, small, large, maps, reference, how, sums):
    rotation, shift = pose
    depth, weight, further, albedo = maps
    total, sum_of_albedo, sum_of_maps = sums
    min_cosine, reach, focal, sharpness, tolerance, offset = how
    for t in prange(len(points)):
        x, y, z = _in_camera(points[t], rotation, shift)
        if z <= 0:
            continue
        column, row = small[0, 0] * x / z + small[0, 2], small[1, 1] * y / z + small[1, 2]
        column += small[0, 1] * y / z
        if not (0 <= column <= depth.shape[1] - 1 and 0 <= row <= depth.shape[0] - 1):
            continue
        cosine = _cosine(points[t], normals[t], centre)
        if cosine < min_cosine:
            continue
        known = _mixed(weight, row, column)
        if known <= 0 or not _visible(depth, row, column, z, reach * z / cosine):
            continue
        sharp = cosine * (focal / z) ** 2
        own = known * sharp**sharpness
        across = large[0, 0] * x / z + large[0, 1] * y / z + large[0, 2]
        down = large[1, 1] * y / z + large[1, 2]
        shown = (
            _mixed(albedo[:, :, 0], down, across),
            _mixed(albedo[:, :, 1], down, across),
            _mixed(albedo[:, :, 2], down, across),
        )
        if len(reference):
            own *= _agreement(shown, reference[t], tolerance, offset)
        total[t] += own
        for c in range(3):
            sum_of_albedo[t, c] += own * shown[c]
        for c in range(sum_of_maps.shape[1]):
            sum_of_maps[t, c] += own * _mixed(further[:, :, c], row, column)


@njit(inline="always")
def _in_camera(point, rotation, shift):
    x = rotation[0, 0] * point[0] + rotation[0, 1] * point[1] + rotation[0, 2] * point[2] + shift[0]
    y = rotation[1, 0] * point[0] + rotation[1, 1] * point[1] + rotation[1, 2] * point[2] + shift[1]
    z = rotation[2, 0] * point[0] + rotation[2, 1] * point[1] + rotation[2, 2] * point[2] + shift[2]
    return x, y, z


@njit(inline="always")
def _cosine(point, normal, centre):
    """Compute the cosine between normal and the direction to the camera."""
    x, y, z = centre[0] - point[0], centre[1] - point[1], centre[2] - point[2]
    return (x * normal[0] + y * normal[1] + z * normal[2]) / np.sqrt(x * x + y * y + z * z)


@njit(inline="always")
def _visible(depth, row, column, z, reach):
    """Check whether one of the four depths around is that of the point."""
    top, left = int(row), int(column)
    for dy in range(2):
        for dx in range(2):
            found = depth[min(top + dy, depth.shape[0] - 1), min(left + dx, depth.shape[1] - 1)]
            if found > 0 and abs(found - z) <= reach:
                return True
    return False


@njit(inline="always")
def _mixed(image, row, column):
    """Interpolate an image, (h, w), bilinearly; beyond its border, its border."""
    row = min(max(row, np.float32(0)), np.float32(image.shape[0] - 1))
    column = min(max(column, np.float32(0)), np.float32(image.shape[1] - 1))
    top, left = int(row), int(column)
    bottom, right = min(top + 1, image.shape[0] - 1), min(left + 1, image.shape[1] - 1)
    down, across = row - top, column - left
    upper = image[top, left] + across * (image[top, right] - image[top, left])
    lower = image[bottom, left] + across * (image[bottom, right] - image[bottom, left])
    return upper + down * (lower - upper)


@njit(inline="always")
def _agreement(shown, mean, tolerance, offset):
    """Weigh a view by how near it is to the mean: exp(−(largest log difference / tolerance)²)."""
    largest = np.float32(0)
    for c in range(3):
        difference = abs(
            np.log((max(shown[c], np.float32(0)) + offset) / (max(mean[c], np.float32(0)) + offset))
        )
        largest = max(largest, difference)
    return np.exp(-((largest / tolerance) ** 2))
