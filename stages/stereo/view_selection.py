"""Selection of source views and depth ranges, from shared sparse points or the poses alone."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from stages.scene.cameras import Camera, in_image, project, rays_in_world
from stages.stereo.mvs_settings import MvsSettings, PosePointsSettings


@dataclass(frozen=True, eq=False)
class SparsePoints:
    """Points and the views that observe them.

    Attributes
    ----------
    x_in_world : ndarray, shape (n, 3), float64
    seen : ndarray, shape (v, n), bool
        Whether view v observes the point.
    """

    x_in_world: np.ndarray
    seen: np.ndarray


def angle_weight(angle_deg: np.ndarray, settings: MvsSettings) -> np.ndarray:
    """Weigh a point for a pair of views by its triangulation angle: exp(−½ ((angle − best) / σ)²).

    The angle of weight 1, `angle_deg`, has enough parallax and little foreshortening; σ is `angle_below` or
    `angle_above` times that.

    Returns
    -------
    ndarray, shape of `angle_deg`
        In (0, 1].
    """
    best, spread = settings.angle_deg, settings.views
    off = angle_deg - best
    sigma = np.where(off < 0, spread.angle_below * best, spread.angle_above * best)
    return np.exp(-0.5 * (off / sigma) ** 2)


def points_from_poses(cameras: list[Camera], settings: PosePointsSettings) -> SparsePoints:
    """Make stand-ins for sparse points where a model has none: every view's rays over plausible depths.

    The middle depth is where the optical axes meet best (least squares); where they do not meet in front of
    most views, `parallel_distance` times the distance to the nearest neighbour. A stand-in is "seen" by every
    view whose image it falls into.
    """
    centres = np.stack([camera.centre_in_world for camera in cameras])
    axes = np.stack([camera.rotation[2] for camera in cameras])
    projectors = np.eye(3) - axes[:, :, None] * axes[:, None, :]
    middle = centres.mean(axis=0)  # parallel axes leave some of it open: then it is beside the cameras
    at = (projectors @ (centres - middle)[:, :, None]).sum(0)[:, 0]
    focus = middle + np.linalg.lstsq(projectors.sum(0), at, rcond=settings.rank_tolerance)[0]
    reach = np.sum((focus - centres) * axes, axis=1)
    gaps = np.linalg.norm(centres[:, None] - centres[None], axis=-1)
    rounding = 1e-12 * np.abs(centres).max()
    nearest = np.where(gaps > rounding, gaps, np.inf).min(axis=1)
    nearest = np.where(np.isfinite(nearest), nearest, 1.0)  # all stand in one place: any length is as good
    if np.mean(reach > nearest) < settings.converging_share:
        reach = settings.parallel_distance * nearest
    side = settings.rays_per_side
    inverse = np.linspace(1 / settings.nearest, 1 / settings.farthest, settings.depths_per_ray)
    points = []
    for camera, halfway in zip(cameras, np.maximum(reach, nearest), strict=True):
        rays = rays_in_world(camera.scaled(side, side)).reshape(-1, 1, 3)
        steps = halfway / inverse[None, :, None]
        points.append((camera.centre_in_world + rays * steps).reshape(-1, 3))
    x_in_world = np.concatenate(points)
    return SparsePoints(
        x_in_world, np.stack([in_image(camera, *project(camera, x_in_world)) for camera in cameras])
    )


def pair_scores(cameras: list[Camera], points: SparsePoints, view: int, settings: MvsSettings) -> np.ndarray:
    """Score every other view as a source of `view`, shape (v,), 0 for itself.

    The sum over shared points of the angle's weight times the smaller over the larger of the two footprints;
    points that both see from one direction do not count.
    """
    scores = np.zeros(len(cameras))
    centre = cameras[view].centre_in_world
    for other, camera in enumerate(cameras):
        shared = points.x_in_world[points.seen[view] & points.seen[other]]
        if other == view or shared.size == 0:
            continue
        a, b = shared - centre, shared - camera.centre_in_world
        length_a, length_b = np.linalg.norm(a, axis=1), np.linalg.norm(b, axis=1)
        cosine = np.clip(np.sum(a * b, axis=1) / (length_a * length_b), -1, 1)
        size_a, size_b = length_a / cameras[view].focal_px, length_b / camera.focal_px
        similar = np.minimum(size_a, size_b) / np.maximum(size_a, size_b)
        angle_deg = np.rad2deg(np.arccos(cosine))
        weights = angle_weight(angle_deg, settings) * similar
        scores[other] = np.sum(weights[angle_deg > settings.views.smallest_angle_deg])
    return scores


def select_sources(
    cameras: list[Camera], points: SparsePoints, view: int, settings: MvsSettings
) -> list[int]:
    """Select up to `sources` views for `view`, best first; views sharing nothing with it are left out."""
    scores = pair_scores(cameras, points, view, settings)
    order = np.argsort(-scores, kind="stable")[: settings.sources]
    return [int(other) for other in order if scores[other] > 0]


def depth_range(
    camera: Camera, x_in_world: np.ndarray, outliers: float, margin: float
) -> tuple[float, float]:
    """Find near and far z-depth that hold the view's points, widened.

    Parameters
    ----------
    camera : Camera
    x_in_world : ndarray, shape (n, 3)
        The points that the view sees; at least one in front of it.
    outliers : float
        Share of points left out at either end.
    margin : float
        Widening at either end, as a share of the depth there.
    """
    _, depth = project(camera, x_in_world)
    near, far = np.quantile(depth[depth > 0], [outliers, 1 - outliers])
    return float(near / (1 + margin)), float(far * (1 + margin))
