"""Poses and points from matches: COLMAP's mappers and bundle adjustment, reproducible to the bit."""

from __future__ import annotations

import signal
import threading
from collections import Counter
from collections.abc import Callable, Iterable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import TypeVar

import numpy as np
import pycolmap

from stages.formats.colmap.model import registered
from stages.motion.room import SLACK, check_room
from stages.motion.sfm_settings import MappingSettings

N = TypeVar("N", int, float, bool)
FEWEST_PHOTOS = 2  # of a model: with one there is no depth


@contextmanager
def quiet_colmap() -> Iterator[None]:
    """Keep COLMAP's log off the terminal; what matters of it is checked and reported here.

    Its handler of crashes prints a page of addresses: the system's own takes its place, for good.
    """
    if threading.current_thread() is threading.main_thread():
        for crash in (signal.SIGSEGV, signal.SIGABRT, signal.SIGBUS, signal.SIGFPE, signal.SIGILL):
            signal.signal(crash, signal.SIG_DFL)
    level = pycolmap.logging.minloglevel
    pycolmap.logging.minloglevel = pycolmap.logging.FATAL.value
    try:
        yield
    finally:
        pycolmap.logging.minloglevel = level


@dataclass(frozen=True)
class Attempt:
    """Thresholds of one run of the incremental mapper.

    Attributes
    ----------
    seed : int
    init_inliers : int
        Matches that the first pair must share.
    init_angle_deg : float
        Median angle between the first pair's rays.
    pose_inliers : int
        Points that a further photo must see.
    two_view_points : bool
        Whether points that only two photos see take part.
    """

    seed: int
    init_inliers: int
    init_angle_deg: float
    pose_inliers: int
    two_view_points: bool


def attempts(count: int, seed: int, settings: MappingSettings) -> list[Attempt]:
    """List attempts: COLMAP's own thresholds first, then other seeds and looser thresholds."""
    return [
        Attempt(
            seed + number,
            init_inliers=_of_attempt(settings.init_inliers, number),
            init_angle_deg=_of_attempt(settings.init_angle_deg, number),
            pose_inliers=_of_attempt(settings.pose_inliers, number),
            two_view_points=_of_attempt(settings.two_view_points, number),
        )
        for number in range(count)
    ]


def _of_attempt(values: Sequence[N], number: int) -> N:
    """The value of an attempt, counted from 0; the last holds for those that follow."""
    return values[min(number, len(values) - 1)]


def reproducible_options(seed: int) -> pycolmap.IncrementalPipelineOptions:
    """Set up COLMAP's incremental pipeline so that a seed gives the same bits, and start its generator at it.

    One thread: with more, sums in the bundle adjustment change their order and the model its last bits. Their
    gain is small, the mapper is nearly sequential. Colours come from the photos as decoded by us.
    """
    options = pycolmap.IncrementalPipelineOptions(num_threads=1, random_seed=seed, extract_colors=False)
    options.mapper.num_threads = 1
    options.mapper.random_seed = options.triangulation.random_seed = seed
    pycolmap.set_random_seed(seed)
    return options


def map_incrementally(
    database: Path,
    scratch: Path,
    attempt: Attempt,
    settings: MappingSettings,
    hold_cameras: bool,
    step: Callable[[], None],
) -> list[pycolmap.Reconstruction]:
    """Run COLMAP's incremental mapper; `step` is called for every photo that gets a pose.

    Raises what `check_room` does.
    """
    check_room(database, SLACK)
    options = reproducible_options(attempt.seed)
    options.min_model_size = FEWEST_PHOTOS
    options.ba_refine_focal_length = options.ba_refine_extra_params = not hold_cameras
    options.ba_local_function_tolerance = settings.local_tolerance
    options.ba_global_function_tolerance = settings.global_tolerance
    options.mapper.init_min_num_inliers = attempt.init_inliers
    options.mapper.init_min_tri_angle = attempt.init_angle_deg
    options.mapper.abs_pose_min_num_inliers = attempt.pose_inliers
    options.mapper.abs_pose_refine_focal_length = not hold_cameras
    options.mapper.abs_pose_refine_extra_params = not hold_cameras
    options.triangulation.ignore_two_view_tracks = not attempt.two_view_points

    def step_for_both() -> None:
        step()
        step()

    models = pycolmap.incremental_mapping(
        database,
        scratch,
        scratch,
        options,
        initial_image_pair_callback=step_for_both,
        next_image_callback=step,
    )
    return by_size(models.values())


def map_globally(
    database: Path, scratch: Path, seed: int, hold_cameras: bool, calibrate: bool
) -> list[pycolmap.Reconstruction]:
    """Run COLMAP's global mapper; `calibrate` where focal lengths are guesses: it needs them at once.

    Raises what `check_room` does.
    """
    check_room(database, SLACK)
    pycolmap.set_random_seed(seed)
    if calibrate:
        pycolmap.calibrate_view_graph(database, pycolmap.ViewGraphCalibrationOptions(random_seed=seed))
    options = pycolmap.GlobalPipelineOptions(num_threads=1, random_seed=seed, min_model_size=FEWEST_PHOTOS)
    mapper = options.mapper
    mapper.num_threads = 1
    for part in (mapper, mapper.rotation_averaging, mapper.global_positioning, mapper.retriangulation):
        part.random_seed = seed
    mapper.global_positioning.use_gpu = False
    adjustment = mapper.bundle_adjustment
    adjustment.ceres.use_gpu = False
    adjustment.ceres.solver_options.num_threads = 1
    adjustment.refine_focal_length = not hold_cameras
    adjustment.refine_extra_params = not hold_cameras
    return by_size(pycolmap.global_mapping(database, scratch, scratch, options).values())


def by_size(models: Iterable[pycolmap.Reconstruction]) -> list[pycolmap.Reconstruction]:
    """Sort models with at least two posed photos, the largest first (photos, then points)."""
    useful = [model for model in models if model.num_reg_images() >= FEWEST_PHOTOS]
    return sorted(useful, key=lambda model: (-model.num_reg_images(), -model.num_points3D()))


def adjust(
    model: pycolmap.Reconstruction, held_cameras: Iterable[int], *, free_principal_point: bool = False
) -> None:
    """Refine poses, points and intrinsics by bundle adjustment, in place.

    Intrinsics of the cameras in `held_cameras` (ids) stay as they are. One thread, for the same bits again.
    """
    adjuster(model, held_cameras, free_principal_point=free_principal_point).solve()
    model.update_point_3d_errors()


def adjuster(
    model: pycolmap.Reconstruction, held_cameras: Iterable[int], *, free_principal_point: bool = False
) -> pycolmap.CeresBundleAdjuster:
    """Set up the bundle adjustment of `adjust`."""
    options = pycolmap.BundleAdjustmentOptions(
        refine_principal_point=free_principal_point, print_summary=False
    )
    options.ceres.use_gpu = False
    options.ceres.solver_options.num_threads = 1
    problem = pycolmap.BundleAdjustmentConfig()
    for image_id in sorted(model.reg_image_ids()):
        problem.add_image(image_id)
    for camera_id in held_cameras:
        problem.set_constant_cam_intrinsics(camera_id)
    problem.fix_gauge(pycolmap.BundleAdjustmentGauge.TWO_CAMS_FROM_WORLD)
    return pycolmap.create_default_ceres_bundle_adjuster(options, problem, model)


@dataclass(frozen=True)
class PrincipalPoint:
    """Outcome of freeing the principal point.

    Attributes
    ----------
    model : pycolmap.Reconstruction
        The model to go on with.
    shift_px : float
        Largest shift of a camera's principal point that was kept.
    refused : str or None
        Why it stayed where it was.
    suspicious : bool
        It wanted to move too far: worth telling, unlike a set too small to ask.
    """

    model: pycolmap.Reconstruction
    shift_px: float
    refused: str | None
    suspicious: bool = False


def free_principal_point(
    model: pycolmap.Reconstruction, largest_share: float, fewest_views: int
) -> PrincipalPoint:
    """Adjust once more with the principal point free, and keep that if the shift is plausible.

    Lenses and stabilisers put it off centre; held at the centre, it is the rotations that give way (on
    fountain-P11, 0.49° against 0.055°). With few or planar views it trades against translation: so the gates.

    Parameters
    ----------
    model : pycolmap.Reconstruction
        Left as it is.
    largest_share : float
        Of the image's width or height; a larger shift is refused.
    fewest_views : int
        Cameras with fewer photos are held.
    """
    views = Counter(image.camera_id for image in registered(model))
    held = [camera_id for camera_id, count in views.items() if count < fewest_views]
    if len(held) == len(views):
        return PrincipalPoint(model, 0.0, f"no camera has {fewest_views} photos")
    freed = pycolmap.Reconstruction(model)
    adjust(freed, held, free_principal_point=True)
    largest_px = 0.0
    for camera_id in views:
        camera = model.cameras[camera_id]
        shift = _principal_point(freed.cameras[camera_id]) - _principal_point(camera)
        share = float(np.max(np.abs(shift) / (camera.width, camera.height)))
        if not share <= largest_share:
            return PrincipalPoint(model, 0.0, f"freed, it moved by {share:.1%} of the image", suspicious=True)
        largest_px = max(largest_px, float(np.hypot(*shift)))
    return PrincipalPoint(freed, largest_px, None)


def _principal_point(camera: pycolmap.Camera) -> np.ndarray:
    return np.array([camera.principal_point_x, camera.principal_point_y])


def colour_points(model: pycolmap.Reconstruction, colours: Sequence[np.ndarray]) -> None:
    """Give every point the mean sRGB colour of its observations; `colours` per photo, shape (features, 3)."""
    for point in model.points3D.values():
        seen = [colours[element.image_id - 1][element.point2D_idx] for element in point.track.elements]
        point.color = np.rint(np.mean(seen, axis=0)).astype(np.uint8)
