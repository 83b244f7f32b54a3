"""Dense stereo by COLMAP's own PatchMatch, where pycolmap has CUDA and the machine a card."""

from __future__ import annotations

import shutil
from pathlib import Path

import numpy as np
import pycolmap

from pipeline import Job, UserError
from stages.formats.colmap.assembly import add_points
from stages.formats.colmap.dense_workspace import write_stereo_settings
from stages.formats.colmap.depth_maps import read_map
from stages.formats.colmap.model import centre_on_cameras, count_from_first_centre, read_model
from stages.formats.images.photos import write_mask
from stages.formats.meshes.point_clouds import read_cloud
from stages.scene.cameras import normals_in_world
from stages.stereo.cuda_cards import count_cards
from stages.stereo.depth.fusion import FusedPoints
from stages.stereo.mvs_settings import MvsSettings
from stages.stereo.view_selection import points_from_poses
from stages.stereo.workspace import Workspace, write_depth_maps


def compute(job: Job[MvsSettings], workspace: Workspace) -> FusedPoints:
    """Run PatchMatch and fusion on a copy of the workspace; writes the maps and returns the fused cloud.

    Raises
    ------
    UserError
        This pycolmap has no CUDA, or the machine no card.
    """
    _check_card()
    views = len(workspace.cameras)
    if not len(workspace.points.x_in_world):
        job.note(depth_ranges="from the poses: the model has no 3-D points")
    folder = job.scratch / "workspace"
    origin = write_colmap_workspace(workspace, folder, job.settings)
    with job.progress("COLMAP PatchMatch"):
        pycolmap.patch_match_stereo(folder, options=patch_match_options(job.settings, views))
    options = fusion_options(job.settings, views, write_fusion_masks(workspace, job.scratch / "masks"))
    with job.progress("COLMAP fusion"):
        pycolmap.stereo_fusion(job.scratch / "fused.ply", folder, options=options, output_type="PLY")
    job.note(coverage=_hand_over(job, workspace, folder / "stereo"))
    x_from_origin, normals, colours = read_cloud(job.scratch / "fused.ply")
    return FusedPoints.at_full_size(x_from_origin + origin, normals, colours)


def _check_card() -> None:
    """Refuse to go on without a card: COLMAP would end the whole process."""
    if not pycolmap.has_cuda:
        raise UserError(
            "mvs.engine is cuda, but this pycolmap was built without CUDA; install pycolmap-cuda12 in its "
            "place, or set mvs.engine=cpu."
        )
    if not count_cards():
        raise UserError(
            "mvs.engine is cuda, but pycolmap finds no NVIDIA card on this machine; expected one that "
            "nvidia-smi lists, with a driver for CUDA 12 or newer. Install the driver, or set mvs.engine=cpu."
        )


def write_colmap_workspace(workspace: Workspace, folder: Path, settings: MvsSettings) -> np.ndarray:
    """Write a workspace for COLMAP's stereo: images, lists of what to match, and its own kind of model.

    Returns the origin that the model counts from, (3,), in world axes.
    """
    shutil.copytree(workspace.folder / "images", folder / "images")
    write_stereo_settings(folder, workspace.image_names)
    (folder / "sparse").mkdir()
    model, origin = model_for_stereo(workspace, settings)
    model.write(folder / "sparse")
    return origin


def model_for_stereo(
    workspace: Workspace, settings: MvsSettings
) -> tuple[pycolmap.Reconstruction, np.ndarray]:
    """Convert the workspace's model to what COLMAP's stereo expects; returns its origin, (3,), as well.

    The principal points move (`count_from_first_centre`), and all of it does (`centre_on_cameras`).
    Neighbours and depth ranges are found by 3-D points only: where there are none, points from the poses
    stand in.
    """
    model = read_model(workspace.model_folder)
    count_from_first_centre(model)
    if not len(workspace.points.x_in_world):
        stand_ins = points_from_poses(workspace.cameras, settings.pose_points)
        add_points(model, workspace.image_names, stand_ins.x_in_world, stand_ins.seen)
    return model, centre_on_cameras(model)


def patch_match_options(settings: MvsSettings, views: int) -> pycolmap.PatchMatchOptions:
    """Set up PatchMatch with a geometric pass and its filter, our threshold of consistency, and its memory.

    Of `views` no more need agree than there are. It works on one view at a time on each card: several on one
    card were as slow (pycolmap-cuda12 4.2.1).
    """
    options = pycolmap.PatchMatchOptions()
    options.geom_consistency = True
    options.filter = True
    options.filter_min_num_consistent = min(settings.consistent_views, views - 1)
    options.filter_geom_consistency_max_cost = settings.consistent_px
    options.cache_size = settings.colmap.cache_gb
    return options


def write_fusion_masks(workspace: Workspace, folder: Path) -> Path | None:
    """Write the masks of the views as COLMAP's fusion seeks them: an image's name with ``.png``."""
    masks = workspace.masks()
    if masks is None:
        return None
    for view, name in enumerate(workspace.image_names):
        write_mask(folder / f"{name}.png", masks(view))
    return folder


def fusion_options(
    settings: MvsSettings, views: int, masks: Path | None = None
) -> pycolmap.StereoFusionOptions:
    """Set up fusion of so many views with our thresholds of agreement, and the masks to keep within.

    It holds some maps at a time and works in one thread: several would find other points in every run.
    """
    options = pycolmap.StereoFusionOptions()
    if masks is not None:
        options.mask_path = masks
    options.use_cache, options.cache_size, options.num_threads = True, settings.colmap.cache_gb, 1
    options.min_num_pixels = min(settings.fusion_views, views)
    options.max_reproj_error = settings.consistent_px
    options.max_depth_error = settings.fusion_depth_share
    options.max_normal_error = settings.fusion_normal_deg
    return options


def within(kept: np.ndarray, depth: np.ndarray, normals: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Empty a depth map (h, w) and its normals (h, w, 3) where the mask `kept`, (h, w), is False."""
    return np.where(kept, depth, np.float32(0)), np.where(kept[..., None], normals, np.float32(0))


def _hand_over(job: Job[MvsSettings], workspace: Workspace, stereo: Path) -> dict[str, float]:
    """COLMAP's maps into the artefact; a view that COLMAP skipped gets empty ones. Returns the coverage."""
    coverage, masks = {}, workspace.masks()
    for view, (name, camera) in enumerate(zip(workspace.image_names, workspace.cameras, strict=True)):
        depth, normals = np.zeros(camera.shape, np.float32), np.zeros((*camera.shape, 3), np.float32)
        if (stereo / "depth_maps" / f"{name}.geometric.bin").is_file():
            depth = read_map(stereo / "depth_maps" / f"{name}.geometric.bin")
            normals = read_map(stereo / "normal_maps" / f"{name}.geometric.bin")
        else:
            job.warn(f"COLMAP gave no depth map for {name}.")
        if masks is not None:
            depth, normals = within(masks(view), depth, normals)
            write_mask(job.outputs["background"] / f"{camera.name}.png", ~masks(view))
        coverage[name] = round(float((depth > 0).mean()), 4)
        write_depth_maps(job.outputs["depth_maps"], name, camera, depth, normals_in_world(camera, normals))
    return coverage
