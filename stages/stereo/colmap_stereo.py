"""Dense stereo by COLMAP's own PatchMatch, where pycolmap has CUDA."""

from __future__ import annotations

import shutil
from pathlib import Path

import numpy as np
import pycolmap

from pipeline import Job, UserError
from stages.formats.colmap.depth_maps import read_map
from stages.formats.images.photos import write_mask
from stages.formats.meshes.point_clouds import read_cloud
from stages.scene.cameras import normals_in_world
from stages.stereo.depth.fusion import FusedPoints
from stages.stereo.mvs_settings import MvsSettings
from stages.stereo.workspace import Workspace, write_depth_maps


def compute(job: Job[MvsSettings], workspace: Workspace) -> FusedPoints:
    """Run PatchMatch and fusion on a copy of the workspace; writes the maps and returns the fused cloud.

    Raises
    ------
    UserError
        This pycolmap has no CUDA.
    """
    if not pycolmap.has_cuda:
        raise UserError(
            "mvs.engine is cuda, but this pycolmap was built without CUDA; install pycolmap-cuda12 in its "
            "place, or set mvs.engine=cpu."
        )
    folder = shutil.copytree(workspace.folder, job.scratch / "workspace")
    for name in ("depth_maps", "normal_maps", "consistency_graphs"):
        for image_name in workspace.image_names:
            (folder / "stereo" / name / image_name).parent.mkdir(parents=True, exist_ok=True)
    with job.progress("COLMAP PatchMatch"):
        pycolmap.patch_match_stereo(folder, options=patch_match_options(job.settings))
    options = fusion_options(job.settings, write_fusion_masks(workspace, job.scratch / "masks"))
    with job.progress("COLMAP fusion"):
        pycolmap.stereo_fusion(job.scratch / "fused.ply", folder, options=options, output_type="PLY")
    job.note(coverage=_hand_over(job, workspace, folder / "stereo"))
    return FusedPoints(*read_cloud(job.scratch / "fused.ply"))


def patch_match_options(settings: MvsSettings) -> pycolmap.PatchMatchOptions:
    """Set up PatchMatch with a geometric pass and its filter, and our threshold of consistency."""
    options = pycolmap.PatchMatchOptions()
    options.geom_consistency = True
    options.filter = True
    options.filter_min_num_consistent = settings.consistent_views
    options.filter_geom_consistency_max_cost = settings.consistent_px
    return options


def write_fusion_masks(workspace: Workspace, folder: Path) -> Path | None:
    """Write the masks of the views as COLMAP's fusion seeks them: an image's name with ``.png``."""
    masks = workspace.masks()
    if masks is None:
        return None
    for view, name in enumerate(workspace.image_names):
        write_mask(folder / f"{name}.png", masks(view))
    return folder


def fusion_options(settings: MvsSettings, masks: Path | None = None) -> pycolmap.StereoFusionOptions:
    """Set up fusion with our thresholds of agreement, and the folder of masks to keep within."""
    options = pycolmap.StereoFusionOptions()
    if masks is not None:
        options.mask_path = masks
    options.min_num_pixels = settings.fusion_views
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
        coverage[name] = round(float((depth > 0).mean()), 4)
        write_depth_maps(job.outputs["depth_maps"], name, camera, depth, normals_in_world(camera, normals))
    return coverage
