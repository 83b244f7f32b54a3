"""Placement of the photos, attempt after attempt, and the last adjustments."""

from __future__ import annotations

import math
from collections.abc import Sequence
from pathlib import Path

import pycolmap

from pipeline import Job, UserError
from stages.formats.colmap.model import registered
from stages.motion.database import write_own_cameras, write_without_matches
from stages.motion.focal_lengths import deviations, several_focal_lengths, spread, uncertain_among
from stages.motion.mapping import (
    adjust,
    attempts,
    free_principal_point,
    map_globally,
    map_incrementally,
)
from stages.motion.pairs import Pair
from stages.motion.placeable import left_out, no_model
from stages.motion.sfm_settings import SfmSettings
from stages.motion.unknown_poses.comparison import compare_pairs

EVERY = slice(None)


def place_photos(
    job: Job[SfmSettings],
    database: Path,
    features: Sequence[int],
    names: Sequence[str],
    pairs: Sequence[Pair],
) -> tuple[list[pycolmap.Reconstruction], Path]:
    """Place the photos; returns models of the best attempt, the largest first, and their cameras' database.

    Raises
    ------
    UserError
        No attempt placed any.
    """
    models = _map_globally(job, database) if job.settings.mapper == "global" else []
    if not models:
        models, database = _map_compared_again(job, database, features, pairs)
    if not models:
        raise UserError(no_model(pairs, names, str(job.inputs["images"])))
    own = _map_with_own_cameras(job, database, models[0], len(names))
    return own or (models, database)


def _map_globally(job: Job[SfmSettings], database: Path) -> list[pycolmap.Reconstruction]:
    settings = job.settings
    calibrate = settings.camera_params is None
    with job.progress("placing photos"):
        models = map_globally(database, job.scratch, settings.seed, settings.holds_cameras, calibrate)
    if not models:
        job.warn("The global mapper placed no photos; the incremental one is tried instead.")
    return models


def _map_compared_again(
    job: Job[SfmSettings], database: Path, features: Sequence[int], pairs: Sequence[Pair]
) -> tuple[list[pycolmap.Reconstruction], Path]:
    """Find the best models, and their database; photos left out at first are compared again."""
    settings, count = job.settings, len(features)
    first = _map_incrementally(job, database, count, tries=slice(0, 1))
    placed = {image_id - 1 for image_id in first[0].reg_image_ids()} if first else set()
    if len(placed) >= settings.enough * count:
        return first, database
    again = [(pair.one.photo, pair.other.photo) for pair in pairs]
    again = [pair for pair in again if not placed.issuperset(pair)]
    further, tries = database, slice(1, None)
    if again and settings.guided_matching:
        further, tries = _match_again(job, database, again, features), EVERY
    more = _map_incrementally(job, further, count, tries=tries, beyond=len(placed))
    return (more, further) if more else (first, database)


def _match_again(
    job: Job[SfmSettings], database: Path, pairs: Sequence[tuple[int, int]], features: Sequence[int]
) -> Path:
    """Copy the database, with the matches of these pairs found along epipolar lines as well."""
    copy = job.scratch / "compared_again.db"
    write_without_matches(database, copy, pairs)
    job.note(pairs_compared_again=len(pairs))
    compare_pairs(job, copy, pairs, features, again=True)
    return copy


def _map_incrementally(
    job: Job[SfmSettings],
    database: Path,
    count: int,
    *,
    tries: slice = EVERY,
    beyond: int = 0,
    how: str = "",
) -> list[pycolmap.Reconstruction]:
    """Attempt until enough are placed; returns the models of the best that places more than `beyond`."""
    settings = job.settings
    attempted = list(enumerate(attempts(settings.attempts, settings.seed, settings.mapping), 1))
    best: list[pycolmap.Reconstruction] = []
    placed = beyond
    for number, attempt in attempted[tries]:
        label = ", ".join(filter(None, ["placing photos", how, f"attempt {number}" if number > 1 else ""]))
        folder = job.scratch / f"{database.stem}_{number}"
        folder.mkdir()
        with job.progress(label, count) as step:
            models = map_incrementally(
                database, folder, attempt, settings.mapping, settings.holds_cameras, step
            )
        if models and models[0].num_reg_images() > placed:
            best, placed = models, models[0].num_reg_images()
            if not how:  # own cameras may yet be rejected
                job.note(attempt=number)
        if placed >= settings.enough * count:
            break
    return best


def _map_with_own_cameras(
    job: Job[SfmSettings], database: Path, shared: pycolmap.Reconstruction, count: int
) -> tuple[list[pycolmap.Reconstruction], Path] | None:
    """Give each photo a camera, where the photos ask for it and that explains them much better."""
    settings = job.settings
    if settings.cameras == "per_image" or settings.camera_params is not None:
        return None
    apart = spread(shared)
    job.note(focal_spread=round(apart, 4))
    if apart <= settings.focal.spread:
        return None
    own_database = job.scratch / "own_cameras.db"
    write_own_cameras(database, own_database)
    models = _map_incrementally(job, own_database, count, how="a camera each")
    if not models or models[0].num_reg_images() < shared.num_reg_images():
        return None
    before, after = (m.compute_mean_reprojection_error() for m in (shared, models[0]))
    job.note(error_with_shared_and_own_cameras_px=[round(before, 4), round(after, 4)])
    if not after < settings.focal.gain * before:
        return None
    job.warn(several_focal_lengths(models[0], before, after))
    return models, own_database


def tell_left_out(
    job: Job[SfmSettings],
    models: Sequence[pycolmap.Reconstruction],
    names: Sequence[str],
    pairs: Sequence[Pair],
) -> None:
    """Warn of the photos that the largest model lacks, and say what is missing."""
    job.note(models=[model.num_reg_images() for model in models])
    placed = [[image.image_id - 1 for image in registered(model)] for model in models]
    for sentence in left_out(placed, pairs, names, min(job.settings.mapping.pose_inliers)):
        job.warn(sentence)


def adjusted(job: Job[SfmSettings], model: pycolmap.Reconstruction) -> pycolmap.Reconstruction:
    """Adjust everything, then the principal point too; returns the model."""
    settings = job.settings
    with job.progress("adjusting"):
        adjust(model, model.cameras if settings.holds_cameras else ())
        if not settings.free_principal_point or settings.holds_cameras:
            return model
        outcome = free_principal_point(
            model, settings.largest_principal_shift, settings.principal_point_views
        )
    if outcome.refused:
        job.note(principal_point=f"left at the image's centre: {outcome.refused}")
        if outcome.suspicious:
            job.warn(
                "The axis of the lens was taken to meet the middle of the photos (the principal point: "
                f"{outcome.refused}). Of whole photos that is true, and there is nothing to do; were they "
                "cropped, give them whole, or the camera's own values (sfm.camera_params)."
            )
    job.note(principal_point_shift_px=round(outcome.shift_px, 3))
    return outcome.model


def check_focal_lengths(job: Job[SfmSettings], model: pycolmap.Reconstruction, names: Sequence[str]) -> None:
    """Note how certain the focal lengths are, and warn of those that the photos hardly determine."""
    settings = job.settings
    if settings.holds_cameras:
        return
    found = deviations(model)
    job.note(focal_deviation={i: round(d, 4) if math.isfinite(d) else None for i, d in found.items()})
    if said := uncertain_among(model, found, names, settings.focal.largest_deviation):
        job.warn(said)
