"""Dense stereo on the CPU: `depth.dense_stereo`, view by view."""

from __future__ import annotations

import time
from functools import partial
from pathlib import Path

import numpy as np

from pipeline import Job, UserError, counted
from stages.formats.artefacts.array_store import ArrayStore
from stages.scene.cameras import Camera
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
        without = ", ".join(workspace.image_names[view] for view in lonely)
        job.warn(f"No other view shares surface with {without}: without depth there.")
    views = [view for view in range(len(workspace.cameras)) if view not in lonely]
    settings, names, maps = job.settings, workspace.image_names, job.outputs["depth_maps"]
    on_all = partial(job.tasks.large, at_a_time=AT_ONCE if loops_may_run_at_once() else 1)
    kept, used = ArrayStore(job.scratch / "kept"), ArrayStore(job.scratch / "used")
    passes = 4 if settings.geometric_iterations else 3
    with job.progress("depth maps", passes * len(views)) as step:
        for _ in on_all(match_view, views, scene, settings):
            step()
        if settings.geometric_iterations:
            after = ArrayStore(job.scratch / "planes_after")
            for _ in on_all(reconcile_view, views, scene, after, settings):
                step()
            scene.planes = after
        shares = list(counted(on_all(confirm_view, views, scene, kept, settings, maps, names), step))
        for view in lonely:
            write_empty_maps(maps, names[view], workspace.cameras[view])
        cloud = stereo.fuse_views(scene, settings, kept, used, step)
    job.note(
        coverage={names[view]: round(share, 4) for view, share in zip(views, shares, strict=True)},
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
    view: int,
    scene: stereo.Scene,
    kept: ArrayStore,
    settings: MvsSettings,
    folder: Path,
    names: list[str],
    threads: int,
) -> float:
    """Keep the pixels of a view that others confirm, and write its maps; returns their share. Picklable."""
    use_threads(threads)
    camera, confirmed = scene.cameras[view], stereo.confirm_view(scene, view, settings)
    kept[view] = confirmed
    depth = np.where(confirmed, depth_from_planes(scene.planes[view]), np.float32(0))
    normals = np.where(confirmed[..., None], stereo.world_normals(scene, view), np.float32(0))
    write_depth_maps(folder, names[view], camera, depth, normals)
    return float(confirmed.mean())


def write_empty_maps(folder: Path, name: str, camera: Camera) -> None:
    """Write the maps of a view without sources: no depth anywhere."""
    write_depth_maps(
        folder, name, camera, np.zeros(camera.shape, np.float32), np.zeros((*camera.shape, 3), np.float32)
    )
