"""Photo-consistency of views through a surface: differences of contrast, and their derivatives by height."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from math import floor, sqrt

import cv2
import numba
import numpy as np

import stages.solvers.kernels.threading_layer  # noqa: F401  # before the first parallel loop
from stages.geometry.rays import Hits
from stages.scene.cameras import Camera
from stages.stereo.refinement.settings import PhotoErrorSettings, RefineSettings


@dataclass(frozen=True, eq=False)
class Photo:
    """A photo, and what its camera sees of the surface.

    Attributes
    ----------
    camera : Camera
    radiance : ndarray, shape (h, w), float32
        Mean of the channels over white; NaN where the photo is not kept.
    hits : Hits
        Of its rays with the surface.
    """

    camera: Camera
    radiance: np.ndarray
    hits: Hits

    @classmethod
    def unmixed(cls, camera: Camera, radiance: np.ndarray, hits: Hits, occlusion: float) -> Photo:
        """Leave out pixels at edges of the depth, which show two surfaces, or one and what is behind.

        `occlusion`: how far apart the depths of neighbours of one surface may be, pixel footprints.
        """
        return cls(camera, _unmixed(radiance, hits.depth, occlusion / camera.focal_px), hits)


@dataclass(frozen=True, eq=False)
class PixelTerms:
    """Sum the squared residuals of a photo to others, as a quadratic of the height at each of its pixels.

    The negative logarithm of the likelihood of a change by x, model units, is, but for a constant,
    ``½ curvature x² + slope x``: its exact slope, and the curvature for relief finer than the window.

    Attributes
    ----------
    curvature, slope : ndarray, shape (h, w), float64
        0 where no other photo shows the point.
    misfits : ndarray, shape (n,), float32
        Squared residuals over their variance, of all comparisons.
    """

    curvature: np.ndarray
    slope: np.ndarray
    misfits: np.ndarray


def radiance(image: np.ndarray, kept: np.ndarray, settings: PhotoErrorSettings) -> np.ndarray:
    """Compute a photo's grey over white, (h, w), float32, from linear values, (h, w, 3)."""
    grey = image.mean(axis=2)
    kept = kept & np.isfinite(grey)
    white = float(np.quantile(grey[kept], settings.white)) if kept.any() else 0.0
    bright = np.maximum(grey / (white if white > 0 else 1.0), settings.darkest)
    return np.where(kept, bright, np.nan).astype(np.float32)


def compare(
    photo: Photo,
    normals: np.ndarray,
    others: list[Photo],
    noise: float,
    settings: RefineSettings,
) -> PixelTerms:
    """Compute the photo-consistency of a photo with others, each seen through the surface.

    Parameters
    ----------
    photo : Photo
    normals : ndarray, shape (h, w, 3), float64
        Unit normals of the faces that its pixels see, world axes.
    others : list of Photo
    noise : float
        Variance of the differences over that which the settings give.
    settings : RefineSettings

    Notes
    -----
    With i seen at a pixel, j at the projection of its point, and ī, j̄ their averages around, a difference is
    ``i / ī − j / j̄``: exposures cancel. (Of logarithms, edges that are blurred in one photo more than in the
    other would move to their dark side: blur is linear in radiance.) A pixel shows an average over an area;
    where i's is another one on the surface than j's, as at a slant, j is blurred or sharpened by what they
    differ: ``½ σ² tr((J Jᵀ - 1) H)`` with J how j's image moves from pixel to pixel of i along the surface,
    and H its second derivatives; else shadows' edges would bend what is plain. The surface moves along its
    normal n by h: the point moves along the pixel's ray r by h / (n·r), and j by its gradient times the
    projection of that. A photo's own noise is in all its comparisons, so K of them, in both directions,
    count as often over as there are photos: K + 1. The average j̄ changes with the surface as well; of wide
    relief on paint that changes slowly the curvature is therefore too large, and its moves are short.
    """
    shape = photo.camera.shape
    curvature, slope, compared = np.zeros(shape), np.zeros(shape), np.zeros(shape)
    misfits = []
    errors = settings.errors
    own = *_rays(photo.camera), np.where(np.isfinite(photo.radiance), photo.hits.depth, 0), normals
    limits = settings.occlusion, settings.grazing, errors.spread_px**2
    for other in others:
        theirs = *_projection(other.camera), other.hits.depth, other.radiance
        there, rate = _seen_by_other(*own, *theirs, *limits)
        average = _local_average(np.isfinite(there), settings.window_px)
        mean_here, mean_there = (np.maximum(average(v), errors.darkest) for v in (photo.radiance, there))
        contrast_there, change = there / mean_there, -rate / mean_there
        variance = errors.shot_noise**2 * (1 / mean_here + 1 / mean_there) + 2 * errors.mismatch**2
        misfit, weighted = np.full((2, *shape), np.nan, np.float32)
        _add_terms(
            *(photo.radiance / mean_here - contrast_there, change, noise * variance, errors.outlier),
            *(curvature, compared, misfit, weighted),
        )
        around = average(weighted * contrast_there)
        slope += np.where(np.isfinite(weighted), change * (weighted - around), 0)
        misfits.append(misfit[np.isfinite(misfit)])
    share = 1 / ((compared + 1) * errors.alike)
    return PixelTerms(curvature * share, slope * share, np.concatenate([np.zeros(0, np.float32), *misfits]))


def _rays(camera: Camera) -> tuple[np.ndarray, np.ndarray]:
    """Matrix from homogeneous image coordinates to rays of z = 1, world axes, and the centre."""
    return camera.rotation.T @ np.linalg.inv(camera.intrinsics), camera.centre_in_world


def _projection(camera: Camera) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """K, R and t of a camera, contiguous."""
    return camera.intrinsics, np.ascontiguousarray(camera.rotation), camera.cam_from_world[:, 3].copy()


def _local_average(shown: np.ndarray, sigma: float) -> Callable[[np.ndarray], np.ndarray]:
    """Prepare the average of values, (h, w), over a Gaussian around each pixel, of those shown, (h, w)."""
    weight = np.maximum(cv2.GaussianBlur(shown.astype(np.float32), (0, 0), sigma), np.finfo(np.float32).eps)
    return lambda values: cv2.GaussianBlur(np.where(shown, values, 0), (0, 0), sigma) / weight


@numba.njit(inline="always")
def _cubic(t):
    """Weights of four neighbours for a value t past the second: Catmull-Rom."""
    return (
        ((-0.5 * t + 1.0) * t - 0.5) * t,
        (1.5 * t - 2.5) * t * t + 1.0,
        ((-1.5 * t + 2.0) * t + 0.5) * t,
        (0.5 * t - 0.5) * t * t,
    )


@numba.njit(inline="always")
def _cubic_slope(t):
    """Derivatives of these weights."""
    return ((-1.5 * t + 2.0) * t - 0.5, (4.5 * t - 5.0) * t, (-4.5 * t + 4.0) * t + 0.5, (1.5 * t - 1.0) * t)


@numba.njit(inline="always")
def _cubic_bend(t):
    """Second derivatives of these weights."""
    return (-3.0 * t + 2.0, 9.0 * t - 5.0, -9.0 * t + 4.0, 3.0 * t - 1.0)


@numba.njit(nogil=True)
def _interpolated(image, u, v):
    """Interpolate value, gradient, and second derivatives (uu, uv, vv) at array coordinates (u, v).

    From the 4 × 4 pixels around; NaN if one of them is.
    """
    left, top = floor(u) - 1, floor(v) - 1
    across, down = _cubic(u - left - 1), _cubic(v - top - 1)
    slope_across, slope_down = _cubic_slope(u - left - 1), _cubic_slope(v - top - 1)
    bend_across, bend_down = _cubic_bend(u - left - 1), _cubic_bend(v - top - 1)
    value, gradient_u, gradient_v = 0.0, 0.0, 0.0
    bend_uu, bend_uv, bend_vv = 0.0, 0.0, 0.0
    for i in range(4):
        for j in range(4):
            one = image[top + i, left + j]
            value += down[i] * across[j] * one
            gradient_u += down[i] * slope_across[j] * one
            gradient_v += slope_down[i] * across[j] * one
            bend_uu += down[i] * bend_across[j] * one
            bend_uv += slope_down[i] * slope_across[j] * one
            bend_vv += bend_down[i] * across[j] * one
    return value, (gradient_u, gradient_v), (bend_uu, bend_uv, bend_vv)


@numba.njit(inline="always")
def _image_motion(intrinsics, rotation, seen, by):
    """Compute how far the image of a point moves, (u, v) in pixels, that moves by a world vector."""
    across, down, away = 0.0, 0.0, 0.0
    for axis in range(3):
        across += rotation[0, axis] * by[axis]
        down += rotation[1, axis] * by[axis]
        away += rotation[2, axis] * by[axis]
    return (
        intrinsics[0, 0] * (across - seen[0] / seen[2] * away) / seen[2],
        intrinsics[1, 1] * (down - seen[1] / seen[2] * away) / seen[2],
    )


@numba.njit(inline="always")
def _blur(x, y, bend):
    """Compute the trace of (J Jᵀ - 1) H: x and y are J's columns, `bend` the second derivatives H."""
    uu, uv, vv = x[0] * x[0] + y[0] * y[0] - 1, x[0] * x[1] + y[0] * y[1], x[1] * x[1] + y[1] * y[1] - 1
    return uu * bend[0] + 2 * uv * bend[1] + vv * bend[2]


@numba.njit(parallel=True, cache=True, nogil=True)
def _unmixed(values, depth, farthest):
    """Copy values, (h, w); NaN where a pixel around is farther away in depth than `farthest` times z."""
    height, width = depth.shape
    found = np.full(values.shape, np.nan, np.float32)
    for row in numba.prange(1, height - 1):
        for column in range(1, width - 1):
            z, alike = depth[row, column], True
            for i in range(row - 1, row + 2):
                for j in range(column - 1, column + 2):
                    alike &= depth[i, j] > 0 and abs(depth[i, j] - z) <= farthest * z
            if alike:
                found[row, column] = values[row, column]
    return found


@numba.njit(parallel=True, cache=True, nogil=True, error_model="numpy")
def _seen_by_other(
    ray_of,
    centre,
    depth,
    normals,
    intrinsics,
    rotation,
    translation,
    other_depth,
    other,
    occlusion,
    grazing,
    spread,
):
    """Interpolate another photo at the pixels' points: values, NaN where unseen, and changes by height."""
    height, width = depth.shape
    other_height, other_width = other_depth.shape
    there = np.full((height, width), np.nan, np.float32)
    change = np.zeros((height, width), np.float32)
    for row in numba.prange(height):
        ray, point, seen = np.empty(3), np.empty(3), np.empty(3)
        lifted, by_column, by_row = np.empty(3), np.empty(3), np.empty(3)
        for column in range(width):
            z = depth[row, column]
            if not z > 0:
                continue
            x, y = column + 0.5, row + 0.5
            facing, length, facing_column, facing_row = 0.0, 0.0, 0.0, 0.0
            for k in range(3):
                normal = normals[row, column, k]
                ray[k] = ray_of[k, 0] * x + ray_of[k, 1] * y + ray_of[k, 2]
                point[k] = centre[k] + z * ray[k]
                length += ray[k] * ray[k]
                facing += ray[k] * normal
                facing_column += ray_of[k, 0] * normal
                facing_row += ray_of[k, 1] * normal
            if -facing < grazing * sqrt(length):
                continue
            for k in range(3):
                seen[k] = translation[k]
                for axis in range(3):
                    seen[k] += rotation[k, axis] * point[axis]
                lifted[k] = ray[k] / facing
                by_column[k] = z * (ray_of[k, 0] - lifted[k] * facing_column)
                by_row[k] = z * (ray_of[k, 1] - lifted[k] * facing_row)
            if not seen[2] > 0:
                continue
            u = intrinsics[0, 0] * seen[0] / seen[2] + intrinsics[0, 2] - 0.5
            v = intrinsics[1, 1] * seen[1] / seen[2] + intrinsics[1, 2] - 0.5
            if not (u >= 1 and v >= 1 and u < other_width - 2 and v < other_height - 2):
                continue
            nearest = other_depth[int(v + 0.5), int(u + 0.5)]
            if not nearest > 0 or seen[2] - nearest > occlusion * seen[2] / intrinsics[0, 0]:
                continue
            away, toward = 0.0, 0.0
            for k in range(3):
                away += seen[k] * seen[k]
                for axis in range(3):
                    toward -= rotation[axis, k] * seen[axis] * normals[row, column, k]
            if toward < grazing * sqrt(away):
                continue
            found, gradient, bend = _interpolated(other, u, v)
            if np.isnan(found):
                continue
            beside = _image_motion(intrinsics, rotation, seen, by_column)
            below = _image_motion(intrinsics, rotation, seen, by_row)
            by_height = _image_motion(intrinsics, rotation, seen, lifted)
            there[row, column] = found + 0.5 * spread * _blur(beside, below, bend)
            change[row, column] = gradient[0] * by_height[0] + gradient[1] * by_height[1]
    return there, change


@numba.njit(parallel=True, cache=True, nogil=True, error_model="numpy")
def _add_terms(difference, change, variance, outlier, curvature, compared, misfit, weighted):
    """Add one comparison's terms to those of the pixels; `misfit`: squared differences over variance."""
    height, width = difference.shape
    for row in numba.prange(height):
        for column in range(width):
            if np.isnan(difference[row, column]):
                continue
            squared = difference[row, column] ** 2 / variance[row, column]
            weight = 1 / (variance[row, column] * (1 + squared / outlier**2))
            curvature[row, column] += weight * change[row, column] ** 2
            weighted[row, column] = weight * difference[row, column]
            compared[row, column] += 1
            misfit[row, column] = squared
