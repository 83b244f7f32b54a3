"""Checks of focal lengths that were found: how certain they are, and whether photos share one."""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping, Sequence

import numpy as np
import pycolmap

from stages.formats.colmap.model import registered
from stages.motion.mapping import adjuster
from stages.scene.wording import listed


def deviations(model: pycolmap.Reconstruction) -> dict[int, float]:
    """Compute the standard deviation of every used camera's focal length, in focal lengths.

    From the covariance at the bundle adjustment's minimum, for observations with a deviation of one pixel. It
    is infinite where the photos do not determine the focal length at all: a rank is missing then.
    """
    used = sorted({image.camera_id for image in registered(model)})
    copy = pycolmap.Reconstruction(model)
    solver = adjuster(copy, ())
    solver.solve()
    options = pycolmap.BACovarianceOptions(params=pycolmap.BACovarianceOptionsParams.ALL)
    covariance = pycolmap.estimate_ba_covariance(options, copy, solver)
    if covariance is None:
        return dict.fromkeys(used, np.inf)
    return {camera_id: _deviation(copy.cameras[camera_id], covariance) for camera_id in used}


def _deviation(camera: pycolmap.Camera, covariance: pycolmap.BACovariance) -> float:
    found = covariance.get_other_params_cov(camera.params)
    if found is None:
        return 0.0  # held
    variance = float(found[0, 0])  # a focal length is the first parameter of every model
    return float(np.sqrt(variance)) / camera.mean_focal_length() if variance >= 0 else np.inf


def uncertain_among(
    model: pycolmap.Reconstruction, deviations: Mapping[int, float], names: Sequence[str], largest: float
) -> str:
    """Name the photos whose focal length deviates by more than `largest`; empty where none does.

    Parameters
    ----------
    model : pycolmap.Reconstruction
    deviations : mapping of int to float
        By camera.
    names : sequence of str
        Of all photos.
    largest : float
        In focal lengths.
    """
    unsure = {i: share for i, share in deviations.items() if share > largest}
    if not unsure:
        return ""
    worst = max(unsure, key=lambda i: unsure[i])
    seen = [names[image.image_id - 1] for image in registered(model) if image.camera_id in unsure]
    return _uncertain(model.cameras[worst], unsure[worst], seen, largest)


def _uncertain(camera: pycolmap.Camera, deviation: float, names: Sequence[str], largest: float) -> str:
    """Say that the photos hardly determine the focal length of a camera, and what would."""
    focal_px = camera.mean_focal_length()
    sides = focal_px / max(camera.width, camera.height)
    by = f"± {deviation:.0%}" if deviation < 1 else "and nothing in the photos determines it"
    return (
        f"The focal length of {listed(names, 3)} is uncertain: {focal_px:.0f} px, {sides:.2f} longest sides, "
        f"{by} (at most ± {largest:.0%} was expected). Poses and relief may be wrong by as much. Give the "
        "lens (sfm.camera_params, sfm.camera_model), or add photos from more sides and distances; with a "
        "long lens, sfm.camera_model: SIMPLE_PINHOLE may do."
    )


def several_focal_lengths(model: pycolmap.Reconstruction, before_px: float, after_px: float) -> str:
    """Say that photos that shared a camera got one each, and what that has gained."""
    focal_px = sorted(model.cameras[image.camera_id].mean_focal_length() for image in registered(model))
    return (
        f"The photos were not taken with one focal length (from {focal_px[0]:.0f} to {focal_px[-1]:.0f} px): "
        f"each has a camera of its own, which lowers the reprojection error from {before_px:.2f} to "
        f"{after_px:.2f} px. Where you know which belong together, a folder for each zoom and "
        "sfm.cameras: per_folder is more accurate."
    )


def spread(model: pycolmap.Reconstruction) -> float:
    """Find how far photos that share a camera would move its focal length, each by itself.

    Every photo's pose and lens are refined at the points where they are; the largest distance from the median
    of its camera's photos, in focal lengths. Cameras of one photo have none.
    """
    images = registered(model)
    count = Counter(image.camera_id for image in images)
    own: dict[int, list[float]] = {}
    for image in images:
        if count[image.camera_id] > 1:
            own.setdefault(image.camera_id, []).append(_own_focal_px(model, image))
    return max((float(np.max(np.abs(np.array(f) / np.median(f) - 1))) for f in own.values()), default=0.0)


def _own_focal_px(model: pycolmap.Reconstruction, image: pycolmap.Image) -> float:
    seen = [point for point in image.points2D if point.has_point3D()]
    camera = pycolmap.Camera(model.cameras[image.camera_id].todict())
    options = pycolmap.AbsolutePoseRefinementOptions(refine_focal_length=True, refine_extra_params=True)
    pycolmap.refine_absolute_pose(
        image.cam_from_world(),
        np.array([point.xy for point in seen]),
        np.array([model.points3D[point.point3D_id].xyz for point in seen]),
        np.ones(len(seen), bool),
        camera,
        options,
    )
    return float(camera.mean_focal_length())
