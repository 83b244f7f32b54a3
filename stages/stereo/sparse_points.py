"""The sparse points, with normals, in place of dense stereo's cloud."""

from __future__ import annotations

import numpy as np

from pipeline import Job, UserError
from stages.stereo.depth.fusion import FusedPoints
from stages.stereo.mvs_settings import MvsSettings
from stages.stereo.sparse_surface import oriented_normals
from stages.stereo.workspace import Workspace, write_depth_maps


def compute(job: Job[MvsSettings], workspace: Workspace) -> FusedPoints:
    """Write empty depth maps and return the sparse points as a cloud, with a warning.

    Raises
    ------
    UserError
        The model has fewer than three points.
    """
    points = workspace.points
    if len(points.x_in_world) < 3:
        raise UserError(
            f"The sparse model has {len(points.x_in_world)} 3-D points; the sparse engine needs at least 3. "
            "Give a mesh with --mesh, or photos that overlap more."
        )
    job.warn(
        f"The surface comes from {len(points.x_in_world)} sparse points alone: it is coarse, and fine "
        "relief, normals and shading will be wrong where it departs from the object."
    )
    for name, camera in zip(workspace.image_names, workspace.cameras, strict=True):
        nothing = np.zeros((*camera.shape, 3), np.float32)
        write_depth_maps(job.outputs["depth_maps"], name, camera, nothing[..., 0], nothing)
    normals = oriented_normals(workspace.cameras, points, job.settings.sparse_neighbours)
    return FusedPoints(points.x_in_world, normals, workspace.colours)
