"""Dense stereo on the CPU: `depth.dense_stereo`, view by view."""

from __future__ import annotations

import time
from pathlib import Path

import numpy as np

from pipeline import Job, UserError
from stages.formats.artefacts.array_store import ArrayStore
from stages.solvers.kernels.threading_layer import loops_may_run_at_once, use_threads
from stages.stereo.depth import dense_stereo as stereo
from stages.stereo.depth.fusion import FusedPoints
from stages.stereo.depth.inverse_depth import depth_from_planes
from stages.stereo.mvs_settings import MvsSettings
from stages.stereo.view_selection import SparsePoints, depth_range, points_from_poses, select_sources
from stages.stereo.workspace import Workspace, write_depth_maps

AT_ONCE = 2  # views: while one is read and prepared, another keeps the threads busy


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
    settings, tasks = job.settings, job.tasks
    at_once = min(AT_ONCE, tasks.threads) if loops_may_run_at_once() else 1
    each = max(1, tasks.threads // at_once)
    kept, used = ArrayStore(job.scratch / "kept"), ArrayStore(job.scratch / "used")
    passes = 4 if settings.geometric_iterations else 3
    with job.progress("depth maps", passes * len(views)) as step:
        for _ in tasks.large(match_view, views, scene, settings, each, at_a_time=at_once):
            step()
        if settings.geometric_iterations:
            after = ArrayStore(job.scratch / "planes_after")
            reconciled = tasks.large(reconcile_view, views, scene, after, settings, each, at_a_time=at_once)
            for _ in reconciled:
                step()
            scene.planes = after
        coverage = {}
        confirmed = tasks.large(confirm_view, views, scene, kept, settings, each, at_a_time=at_once)
        for view, share in zip(views, confirmed, strict=True):
            coverage[workspace.image_names[view]] = round(share, 4)
            step()
        for view, name in enumerate(workspace.image_names):
            write_view(scene, kept, view, job.outputs["depth_maps"], name)
        cloud = stereo.fuse_views(scene, settings, kept, used, step)
    job.note(
        coverage=coverage,
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
        workspace.images(),
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


def match_view(view: int, scene: stereo.Scene, settings: MvsSettings, threads: int) -> None:
    """Sweep a view, then refine it by matching alone; planes and costs go to the scene's files. Picklable."""
    use_threads(threads)
    scene.planes[view] = stereo.sweep_view(scene, view, settings)
    scene.planes[view], scene.costs[view] = stereo.refine_view(scene, view, settings, geometric=False)


def reconcile_view(
    view: int, scene: stereo.Scene, after: ArrayStore, settings: MvsSettings, threads: int
) -> None:
    """Refine a view with the others' maps of the round before: the order does not matter. Picklable."""
    use_threads(threads)
    after[view], scene.costs[view] = stereo.refine_view(scene, view, settings, geometric=True)


def confirm_view(
    view: int, scene: stereo.Scene, kept: ArrayStore, settings: MvsSettings, threads: int
) -> float:
    """Keep the pixels of a view that others confirm; returns their share. Picklable."""
    use_threads(threads)
    confirmed = stereo.confirm_view(scene, view, settings)
    kept[view] = confirmed
    return float(confirmed.mean())


def write_view(scene: stereo.Scene, kept: ArrayStore, view: int, folder: Path, name: str) -> None:
    """Write the depth and normals that are kept; empty maps of a view without sources."""
    camera = scene.cameras[view]
    depth, normals = np.zeros(camera.shape, np.float32), np.zeros((*camera.shape, 3), np.float32)
    if view in kept:
        inside = kept[view]
        depth = np.where(inside, depth_from_planes(scene.planes[view]), depth)
        normals = np.where(inside[..., None], stereo.world_normals(scene, view), normals)
    write_depth_maps(folder, name, camera, depth, normals)
