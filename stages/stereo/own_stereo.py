"""Dense stereo on the CPU: `depth.dense_stereo`, view by view."""

from __future__ import annotations

import time
from typing import Any

import numpy as np

from pipeline import Job, UserError
from stages.formats.artefacts.array_store import ArrayStore
from stages.solvers.kernels.threading_layer import use_threads
from stages.stereo.depth import dense_stereo as stereo
from stages.stereo.depth.fusion import FusedPoints
from stages.stereo.depth.inverse_depth import depth_from_planes
from stages.stereo.mvs_settings import MvsSettings
from stages.stereo.view_selection import SparsePoints, depth_range, points_from_poses, select_sources
from stages.stereo.workspace import Workspace, write_depth_maps


def compute(job: Job[MvsSettings], workspace: Workspace) -> FusedPoints:
    """Compute and write the depth maps of all views; returns the fused cloud."""
    use_threads(job.threads)
    began = time.process_time()
    scene, lonely = plan_scene(job, workspace)
    if len(lonely) == len(workspace.cameras):
        raise UserError(
            f"No two of the {len(lonely)} posed views show the same surface from different places; stereo "
            "needs at least two that do. Add photos that overlap, taken a few steps apart."
        )
    if lonely:
        names = ", ".join(workspace.image_names[view] for view in lonely)
        job.warn(f"No other view shares surface with {names}: without depth there.")
    views = [view for view in range(len(workspace.cameras)) if view not in lonely]
    passes = 5 if job.settings.geometric_iterations else 4
    with job.progress("depth maps", passes * len(views)) as step:
        find_planes(job, scene, views, step)
        if job.settings.geometric_iterations:
            reconcile(job, scene, views, step)
        kept = confirm(job, scene, workspace, views, step)
        cloud = stereo.fuse_views(scene, job.settings, kept, step)
    job.note(
        coverage={workspace.image_names[view]: round(float(kept[view].mean()), 4) for view in views},
        cpu_seconds=round(time.process_time() - began, 1),
    )
    return cloud


def plan_scene(job: Job[MvsSettings], workspace: Workspace) -> tuple[stereo.Scene, list[int]]:
    """Choose sources and depth ranges; returns the scene and the views that have no sources."""
    settings, cameras, points = job.settings, workspace.cameras, workspace.points
    if not len(points.x_in_world):
        points = points_from_poses(cameras, settings.pose_points)
        job.note(depth_ranges="from the poses: the model has no 3-D points")
    plans = []
    for view in range(len(cameras)):
        sources = select_sources(cameras, points, view, settings)
        # A view without sources may have no point in front of it, and gets no depth.
        near, far = _range_of(workspace, points, view, settings) if sources else (0.0, 0.0)
        plans.append(stereo.ViewPlan(sources, near, far))
    scene = stereo.Scene(
        cameras,
        workspace.image_reader(),
        plans,
        planes=ArrayStore(job.scratch / "planes"),
        costs=ArrayStore(job.scratch / "costs"),
    )
    return scene, [view for view, plan in enumerate(plans) if not plan.sources]


def _range_of(
    workspace: Workspace, points: SparsePoints, view: int, settings: MvsSettings
) -> tuple[float, float]:
    camera = workspace.cameras[view]
    seen = points.x_in_world[points.seen[view]]
    x_in_world = seen if len(seen) >= settings.views.range_fewest_points else points.x_in_world
    return depth_range(camera, x_in_world, settings.range_outliers, settings.range_margin)


def find_planes(job: Job[MvsSettings], scene: stereo.Scene, views: list[int], step: Any) -> None:
    """Sweep, then refine by matching alone; leaves planes and costs in the scene."""
    settings = job.settings
    for view in views:
        scene.planes[view] = stereo.sweep_view(scene, view, settings)
        step()
        scene.planes[view], scene.costs[view] = stereo.refine_view(scene, view, settings, geometric=False)
        step()


def reconcile(job: Job[MvsSettings], scene: stereo.Scene, views: list[int], step: Any) -> None:
    """Refine with the others' maps; puts new planes and costs into the scene."""
    after = ArrayStore(job.scratch / "planes_after")
    for view in views:  # by the maps of the round before, so that the order does not matter
        after[view], scene.costs[view] = stereo.refine_view(scene, view, job.settings, geometric=True)
        step()
    scene.planes = after


def confirm(
    job: Job[MvsSettings], scene: stereo.Scene, workspace: Workspace, views: list[int], step: Any
) -> dict[int, np.ndarray]:
    """Keep what other views confirm and write it; views without sources get empty maps."""
    settings, kept = job.settings, {}
    folder = job.outputs["depth_maps"]
    for view, camera in enumerate(workspace.cameras):
        depth, normals = np.zeros(camera.shape, np.float32), np.zeros((*camera.shape, 3), np.float32)
        if view in views:
            kept[view] = stereo.confirm_view(scene, view, settings)
            depth = np.where(kept[view], depth_from_planes(scene.planes[view]), depth)
            normals = np.where(kept[view][..., None], stereo.world_normals(scene, view), normals)
            step()
        write_depth_maps(folder, workspace.image_names[view], camera, depth, normals)
    return kept
