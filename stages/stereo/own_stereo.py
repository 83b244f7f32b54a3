"""Dense stereo on the CPU: `depth.dense_stereo`, view by view."""

from __future__ import annotations

import time
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import partial
from pathlib import Path

import numpy as np

from pipeline import Job, UserError, counted
from stages.formats.artefacts.array_store import ArrayStore
from stages.formats.images.photos import write_mask
from stages.scene.cameras import Camera
from stages.solvers.kernels.threading_layer import loops_may_run_at_once, use_threads
from stages.stereo.depth import dense_stereo as stereo
from stages.stereo.depth.fusion import FusedPoints
from stages.stereo.depth.inverse_depth import depth_from_planes
from stages.stereo.gaps import scales_of, with_gaps_closed, without_surface
from stages.stereo.mvs_settings import MvsSettings
from stages.stereo.view_selection import SparsePoints, depth_range, points_from_poses, select_sources
from stages.stereo.workspace import Workspace, write_depth_maps

AT_ONCE = 2  # views: while one is read and prepared, another keeps the threads busy


@dataclass(frozen=True, eq=False)
class Reconstruction:
    """Stereo of all views at one size.

    Attributes
    ----------
    cloud : FusedPoints
    scene : stereo.Scene
        With the planes of every view that has sources.
    kept, background : ArrayStore
        (h, w), bool, by view: pixels that others confirm, and those of even background, at full size only.
    coverage : dict of str to float
        Share of the pixels that are kept, by image name.
    """

    cloud: FusedPoints
    scene: stereo.Scene
    kept: ArrayStore
    background: ArrayStore
    coverage: dict[str, float]

    def depth(self, view: int) -> np.ndarray:
        """Compute the depth map of a view, (h, w): z, 0 where unknown."""
        if view not in self.kept:
            return np.zeros(self.scene.cameras[view].shape, np.float32)
        return np.where(self.kept[view], depth_from_planes(self.scene.planes[view]), np.float32(0))


def compute(job: Job[MvsSettings], workspace: Workspace) -> FusedPoints:
    """Compute and write depth maps and backgrounds of all views; returns the fused cloud, its gaps closed."""
    use_threads(job.threads)
    began, gaps = time.process_time(), job.settings.gaps
    scales = scales_of(workspace.cameras, gaps)
    passes = 4 if job.settings.geometric_iterations else 3
    with job.progress("depth maps", passes * len(workspace.cameras) * len(scales)) as step:
        finest = reconstruct(job, workspace, job.outputs, step)
        cloud = finest.cloud
        for scale in scales[1:]:
            coarse = reconstruct(job, workspace.reduced(scale), None, step)
            found = coarse.cloud.at_scale(scale)
            cloud = with_gaps_closed(cloud, found, workspace.cameras, finest.depth, gaps, job.threads)
            for view in finest.background.keys() & coarse.kept.keys():
                finest.background[view] = without_surface(
                    finest.background[view], coarse.kept[view], job.settings.patch_radius_px / scale
                )
    for view in finest.background:
        name = workspace.cameras[view].name
        write_mask(job.outputs["background"] / f"{name}.png", finest.background[view])
    job.note(
        coverage=finest.coverage,
        points_of_smaller_sizes=len(cloud.x_in_world) - len(finest.cloud.x_in_world),
        cpu_seconds=round(time.process_time() - began, 1),
    )
    return cloud


def reconstruct(
    job: Job[MvsSettings], workspace: Workspace, folders: Mapping[str, Path] | None, step: Callable[[], None]
) -> Reconstruction:
    """Match, refine, confirm and fuse all views of a workspace.

    Parameters
    ----------
    job : Job
    workspace : Workspace
    folders : mapping of str to Path, or None
        For depth maps, written at full size only; None: they are not written, and nothing is warned of again.
    step : callable
        Called for every view of every pass.

    Raises
    ------
    UserError
        No two views show the same surface from different places.
    """
    scene, lonely = plan_scene(job, workspace)
    if len(lonely) == len(workspace.cameras):
        raise UserError(
            f"No two of the {len(lonely)} posed views show the same surface from different places; stereo "
            "needs at least two that do. Add photos that overlap, taken a few steps apart."
        )
    if lonely and folders is not None:
        without = ", ".join(workspace.image_names[view] for view in lonely)
        job.warn(f"No other view shares surface with {without}: without depth there.")
    views = [view for view in range(len(workspace.cameras)) if view not in lonely]
    settings, names, folder = job.settings, workspace.image_names, scratch_of(job, workspace)
    on_all = partial(job.tasks.large, at_a_time=AT_ONCE if loops_may_run_at_once() else 1)
    kept, background, used = (ArrayStore(folder / name) for name in ("kept", "background", "used"))
    for _ in on_all(match_view, views, scene, settings):
        step()
    if settings.geometric_iterations:
        after = ArrayStore(folder / "planes_after")
        for _ in on_all(reconcile_view, views, scene, after, settings):
            step()
        scene.planes = after
    shares = list(
        counted(on_all(confirm_view, views, scene, kept, background, settings, folders, names), step)
    )
    if folders is not None:
        for view in lonely:
            write_empty_maps(folders["depth_maps"], names[view], workspace.cameras[view])
    cloud = stereo.fuse_views(scene, settings, kept, used, step)
    coverage = {names[view]: round(share, 4) for view, share in zip(views, shares, strict=True)}
    return Reconstruction(cloud, scene, kept, background, coverage)


def scratch_of(job: Job[MvsSettings], workspace: Workspace) -> Path:
    """Name the folder of temporary maps at the workspace's size."""
    return job.scratch / f"size_{max(max(camera.shape) for camera in workspace.cameras)}"


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
        planes=ArrayStore(scratch_of(job, workspace) / "planes"),
        costs=ArrayStore(scratch_of(job, workspace) / "costs"),
        mask_of=workspace.masks(),
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
    background: ArrayStore,
    settings: MvsSettings,
    folders: Mapping[str, Path] | None,
    names: list[str],
    threads: int,
) -> float:
    """Keep the pixels of a view that others confirm; returns their share. Picklable.

    Its maps are written into folders, if there are any, and its background is stored.
    """
    use_threads(threads)
    camera = scene.cameras[view]
    confirmed, even = stereo.confirm_view(scene, view, settings)
    kept[view] = confirmed
    if folders is None:
        return float(confirmed.mean())
    background[view] = even
    depth = np.where(confirmed, depth_from_planes(scene.planes[view]), np.float32(0))
    normals = np.where(confirmed[..., None], stereo.world_normals(scene, view), np.float32(0))
    write_depth_maps(folders["depth_maps"], names[view], camera, depth, normals)
    return float(confirmed.mean())


def write_empty_maps(folder: Path, name: str, camera: Camera) -> None:
    """Write the maps of a view without sources: no depth anywhere."""
    write_depth_maps(
        folder, name, camera, np.zeros(camera.shape, np.float32), np.zeros((*camera.shape, 3), np.float32)
    )
