"""The dense stereo of one set of views, step by step: sweep, refine, refine again, confirm, fuse.

Every function here treats one view with its sources and takes its arrays through a `Scene`, whose maps may
lie on disk: what must be held at once is one view's cost volume and the arrays of a view and its sources.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, MutableMapping
from dataclasses import dataclass, field

import cv2
import numpy as np

from stages.scene.cameras import Camera, intrinsics_for_integer_centres, normals_in_world
from stages.stereo.depth.depth_edges import up_to_edges
from stages.stereo.depth.fusion import DepthViews, FusedPoints, fuse_view
from stages.stereo.depth.geometric_consistency import confirmed, consistent_views
from stages.stereo.depth.inverse_depth import fit_planes, j_from_i, normals_from_planes, resample_planes
from stages.stereo.depth.patch_match import UNMATCHABLE, Sources, refine
from stages.stereo.depth.plane_sweep import disparity_speed, inverse_depth_planes, matching_costs
from stages.stereo.depth.semi_global import aggregate, winner
from stages.stereo.mvs_settings import MvsSettings, PlaneSweepSettings

NO_MAPS = np.zeros((0, 1, 1), np.float32)
GREY = np.array([0.299, 0.587, 0.114], np.float32)  # luma of Rec. 601


@dataclass(frozen=True)
class ViewPlan:
    """Source views of a view, best first, and the range of its depth, model units."""

    sources: list[int]
    near: float
    far: float


@dataclass
class Scene:
    """The views, with their planes and costs so far.

    Attributes
    ----------
    cameras : list of Camera
    colour_of : callable
        From a view's index to its image, (h, w, 3), uint8.
    plans : list of ViewPlan
    planes : mutable mapping of int to ndarray
        (h, w, 3), float32: inverse depth and slopes.
    costs : mutable mapping of int to ndarray
        (h, w), float32: what the planes cost.
    mask_of : callable or None
        From a view's index to the pixels that may become points, (h, w), bool; None: all.
    """

    cameras: list[Camera]
    colour_of: Callable[[int], np.ndarray]
    plans: list[ViewPlan]
    planes: MutableMapping[int, np.ndarray] = field(default_factory=dict)
    costs: MutableMapping[int, np.ndarray] = field(default_factory=dict)
    mask_of: Callable[[int], np.ndarray] | None = None

    def grey(self, view: int) -> np.ndarray:
        """Compute a view's grey values in [0, 1], (h, w), float32."""
        return (self.colour_of(view) @ GREY / np.float32(255)).astype(np.float32)

    def projections(self, view: int) -> np.ndarray:
        """Stack `j_from_i` of the view's sources, shape (S, 3, 4)."""
        return np.stack([j_from_i(self.cameras[view], self.cameras[j]) for j in self.plans[view].sources])

    def step(self, view: int, how: PlaneSweepSettings) -> float:
        """Compute the inverse depth per pixel of `disparity_speed` at the middle of the view's range."""
        plan = self.plans[view]
        middle = (1 / plan.near + 1 / plan.far) / 2
        return 1 / disparity_speed(self.projections(view), self.cameras[view].shape, middle, how)


def padded(arrays: list[np.ndarray]) -> np.ndarray:
    """Stack arrays of different heights and widths, zeros beyond their borders, shape (S, H, W, …)."""
    height, width = (max(array.shape[axis] for array in arrays) for axis in (0, 1))
    stack = np.zeros((len(arrays), height, width, *arrays[0].shape[2:]), arrays[0].dtype)
    for slot, array in zip(stack, arrays, strict=True):
        slot[: array.shape[0], : array.shape[1]] = array
    return stack


def sizes_of(arrays: list[np.ndarray]) -> np.ndarray:
    """List (height, width) of each, shape (S, 2), int32."""
    return np.array([array.shape[:2] for array in arrays], np.int32)


def sweep_view(scene: Scene, view: int, settings: MvsSettings) -> np.ndarray:
    """Sweep a view at reduced size: its first planes, full size, (h, w, 3), float32, by winner and fit."""
    plan, sweep = scene.plans[view], settings.sweep
    scale = min(settings.sweep_scale, settings.sweep_longest_px / max(scene.cameras[view].shape))
    small = {j: scene.cameras[j].reduced(scale) for j in (view, *plan.sources)}
    grey = {j: _shrunk(scene.grey(j), camera) for j, camera in small.items()}
    projections = np.stack([j_from_i(small[view], small[j]) for j in plan.sources])
    images = [grey[j] for j in plan.sources]
    inverse_depths = inverse_depth_planes(projections, small[view].shape, plan.near, plan.far, settings)
    costs = matching_costs(
        grey[view],
        padded(images),
        sizes_of(images),
        projections,
        inverse_depths,
        radius=settings.sweep_radius_px,
        best=settings.counted_sources,
        noise=settings.noise,
    )
    index = winner(aggregate(costs, grey[view], settings))
    spacing = (inverse_depths[-1] - inverse_depths[0]) / np.float32(len(inverse_depths) - 1)
    inverse = inverse_depths[0] + index * spacing
    planes = fit_planes(inverse, float(spacing), sweep.fit_radius_px, sweep.fit_tolerance)
    return resample_planes(planes, scene.cameras[view].shape)


def sources_of(scene: Scene, view: int, *, with_depth: bool) -> Sources:
    """Collect a view's sources for refinement, with their present inverse depths or without."""
    chosen = scene.plans[view].sources
    images = [scene.grey(j) for j in chosen]
    back = np.stack([j_from_i(scene.cameras[j], scene.cameras[view]) for j in chosen])
    return Sources(
        images=padded(images),
        sizes=sizes_of(images),
        projections=scene.projections(view).astype(np.float32),
        back=back.astype(np.float32),
        inverse_depths=padded([_inverse_or_nothing(scene, j) for j in chosen]) if with_depth else NO_MAPS,
    )


def refine_view(
    scene: Scene, view: int, settings: MvsSettings, *, geometric: bool
) -> tuple[np.ndarray, np.ndarray]:
    """Refine a view: planes (h, w, 3), costs (h, w); `geometric` takes the sources' depths into account."""
    plan = scene.plans[view]
    sources = sources_of(scene, view, with_depth=geometric)
    limits = (1 / plan.far, 1 / plan.near)
    step = scene.step(view, settings.sweep)
    return refine(scene.grey(view), sources, scene.planes[view], settings, step, limits)


def confirm_view(scene: Scene, view: int, settings: MvsSettings) -> tuple[np.ndarray, np.ndarray]:
    """Choose the pixels of a view to keep, and tell background apart, (h, w), bool each.

    Kept are those that match, that `consistent_views` confirm, or all sources where there are fewer, that no
    edge of the photo parts from the surface, and that the view's mask keeps. Background is even, or outside
    of the mask.
    """
    inverse = np.ascontiguousarray(scene.planes[view][..., 0])
    count = consistent_views(inverse, sources_of(scene, view, with_depth=True), settings.consistent_px)
    needed = min(settings.consistent_views, len(scene.plans[view].sources))
    kept = confirmed(inverse, scene.costs[view], count, highest_cost=settings.highest_cost, fewest=needed)
    even = scene.costs[view] == UNMATCHABLE
    kept, background = up_to_edges(kept, even, scene.colour_of(view), settings.edges)
    if scene.mask_of is None:
        return kept, background
    mask = scene.mask_of(view)
    return kept & mask, background | ~mask


def fuse_views(
    scene: Scene,
    settings: MvsSettings,
    kept: Mapping[int, np.ndarray],
    used: MutableMapping[int, np.ndarray],
    step: Callable[[], None],
) -> FusedPoints:
    """Fuse all views in order; `step` is called per view.

    `fusion_views` must agree, or all where there are fewer. `kept` holds the pixels to use, (h, w), bool;
    `used`, those that are in the cloud already, or are not to be: it is filled here.
    """
    views_with_depth = sorted(kept)
    for view in views_with_depth:
        used[view] = ~kept[view]
    parts = []
    for view in views_with_depth:
        chosen = [view, *(j for j in scene.plans[view].sources if j in kept)]
        views = _depth_views(scene, chosen, kept, used)
        parts.append(fuse_view(views, settings, min(settings.fusion_views, len(chosen))))
        for slot, j in zip(views.used, chosen, strict=True):
            used[j] = slot[: used[j].shape[0], : used[j].shape[1]].copy()
        step()
    return FusedPoints.joined(parts)


def world_normals(scene: Scene, view: int) -> np.ndarray:
    """Compute normals of a view's planes in world axes, shape (h, w, 3), float32."""
    camera = scene.cameras[view]
    return normals_in_world(camera, normals_from_planes(scene.planes[view], camera)).astype(np.float32)


def _depth_views(scene, chosen, kept, used) -> DepthViews:
    cameras = [scene.cameras[j] for j in chosen]
    inverse = [np.where(kept[j], scene.planes[j][..., 0], np.float32(0)) for j in chosen]
    return DepthViews(
        sizes=sizes_of(inverse),
        inverse=padded(inverse),
        normals=padded([world_normals(scene, j) for j in chosen]),
        colours=padded([scene.colour_of(j) for j in chosen]),
        used=padded([used[j] for j in chosen]),
        projections=np.stack([j_from_i(cameras[0], camera) for camera in cameras]),
        back=np.stack([j_from_i(camera, cameras[0]) for camera in cameras]),
        rays=np.stack(
            [c.rotation.T @ np.linalg.inv(intrinsics_for_integer_centres(c.intrinsics)) for c in cameras]
        ),
        centres=np.stack([camera.centre_in_world for camera in cameras]),
    )


def _inverse_or_nothing(scene: Scene, view: int) -> np.ndarray:
    """A view's inverse depth; zeros for one that could not be matched with anything."""
    if view in scene.planes:
        return scene.planes[view][..., 0]
    return np.zeros(scene.cameras[view].shape, np.float32)


def _shrunk(grey: np.ndarray, camera: Camera) -> np.ndarray:
    if grey.shape == camera.shape:
        return grey
    return cv2.resize(grey, (camera.width, camera.height), interpolation=cv2.INTER_AREA)
