"""The sparse points, with normals, in place of dense stereo's cloud."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from pipeline import Job, UserError
from stages.scene.cameras import Camera, pixels_of
from stages.stereo.depth.fusion import FusedPoints
from stages.stereo.mvs_settings import MvsSettings
from stages.stereo.sparse_surface import oriented_normals
from stages.stereo.view_selection import SparsePoints
from stages.stereo.workspace import Workspace, write_depth_maps


def compute(job: Job[MvsSettings], workspace: Workspace) -> FusedPoints:
    """Write empty depth maps and return the sparse points as a cloud, with a warning.

    Raises
    ------
    UserError
        The model has fewer than three points, within the masks if there are some.
    """
    points, colours = workspace.points, workspace.colours
    if (masks := workspace.masks()) is not None:
        kept = mostly_kept(workspace.cameras, points, masks)
        points, colours = SparsePoints(points.x_in_world[kept], points.seen[:, kept]), colours[kept]
    if len(points.x_in_world) < 3:
        where = " within the masks" if masks is not None else ""
        raise UserError(
            f"The sparse model has {len(points.x_in_world)} 3-D points{where}; the sparse engine needs at "
            "least 3. Give a mesh with --mesh, or photos that overlap more."
        )
    job.warn(
        f"The surface comes from {len(points.x_in_world)} sparse points alone: it is coarse, and fine "
        "relief, normals and shading will be wrong where it departs from the object."
    )
    for name, camera in zip(workspace.image_names, workspace.cameras, strict=True):
        nothing = np.zeros((*camera.shape, 3), np.float32)
        write_depth_maps(job.outputs["depth_maps"], name, camera, nothing[..., 0], nothing)
    normals = oriented_normals(workspace.cameras, points, job.settings.sparse_neighbours)
    return FusedPoints.at_full_size(points.x_in_world, normals, colours)


def mostly_kept(
    cameras: list[Camera], points: SparsePoints, mask_of: Callable[[int], np.ndarray]
) -> np.ndarray:
    """Choose the points that the masks keep in most of the views that observe them, shape (n,), bool.

    Parameters
    ----------
    cameras : list of Camera
    points : SparsePoints
    mask_of : callable
        From a view's index to its mask, (h, w), bool, at the size of its camera.
    """
    votes = np.zeros(len(points.x_in_world), int)
    for view, camera in enumerate(cameras):
        observed = np.flatnonzero(points.seen[view])
        inside, pixel, _ = pixels_of(camera, points.x_in_world[observed])
        kept = np.zeros(len(observed), bool)
        kept[inside] = mask_of(view)[pixel]
        votes[observed] += np.where(kept, 1, -1)
    return votes > 0
