"""Structure from motion: where the photos were taken from, and with what lens (Eq. 7: K, R, t)."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any, TypeVar

from pipeline import Artefact, Job, Stage, UserError
from stages.motion.sfm_settings import SfmSettings
from stages.scene.distributions import PICTURES, PYCOLMAP
from stages.scene.wording import listed

if TYPE_CHECKING:
    import numpy as np
    import pycolmap

    from stages.motion.photo_set import Photo

T = TypeVar("T")


def run(job: Job[SfmSettings]) -> None:
    """Survey the photos, find and compare features, place, adjust, publish."""
    from stages.motion.mapping import colour_points, quiet_colmap

    database = job.scratch / "working.db"
    with quiet_colmap():
        photos = _survey(job)
        colours = _find_features(job, photos, database)
        _match(job, database, [len(own) for own in colours])
        model = _adjust(job, _map(job, database, photos))
        colour_points(model, colours)
        _publish(job, model, database, photos)


def _survey(job: Job[SfmSettings]) -> list[Photo]:
    """The readable photos, with their reduced copies in `scratch`; the others are named aloud."""
    from stages.formats.images.photo_folder import find_photos, unread_photos
    from stages.motion.database import copy_name
    from stages.motion.photo_set import exposure_for_matching, survey, write_linear_copy

    settings = job.settings
    folder = job.inputs["images"]
    names = find_photos(folder)
    unread = unread_photos(folder, names)
    if not names:
        raise UserError(
            f"There are no photos in {folder}: expected JPEG, PNG, TIFF, EXR or HDR files. "
            + (unread or "Give the folder that holds them.")
        )
    if unread:
        job.warn(unread)
    photos: list[Photo] = []
    with job.progress("reading photos", len(names)) as step:
        copies = [job.scratch / copy_name(index) for index in range(len(names))]
        bounds = settings.max_size_px, settings.linear_white_samples
        for found in _each(job, survey, [folder] * len(names), names, copies, *bounds):
            if isinstance(found, str):
                job.warn(f"Left out: {found}")
            else:
                photos.append(found)
            step()
    if len(photos) < 2:
        raise UserError(
            f"{folder} holds {'one readable photo' if photos else 'no readable photo'}, but structure from "
            "motion needs at least two that overlap, better twenty. Add photos."
        )
    exposure = exposure_for_matching(photos, settings.linear_white_percentile)
    linear = [photo for photo in photos if photo.linear_sample is not None]
    paths = [folder / photo.name for photo in linear]
    list(_each(job, write_linear_copy, paths, [p.copy for p in linear], settings.max_size_px, exposure))
    return photos


def _find_features(job: Job[SfmSettings], photos: Sequence[Photo], database: Path) -> list[np.ndarray]:
    """Fill the database with features; the photos' colours at the features are returned."""
    import pycolmap

    from stages.motion.database import write_features
    from stages.motion.features import detect, read_features
    from stages.motion.photo_set import camera_groups, initial_cameras
    from stages.motion.room import check_room, room_for_copy, room_for_features

    settings = job.settings
    groups = camera_groups(photos, settings.cameras)
    cameras = initial_cameras(
        photos, groups, settings.camera_model, settings.camera_params, settings.focal_factor
    )
    found_in = job.scratch / "features.db"
    batch = 2 * job.threads
    with job.progress("finding features", len(photos)) as step:
        for start in range(0, len(photos), batch):
            copies = [photo.copy for photo in photos[start : start + batch]]
            check_room(found_in, room_for_features([settings.max_features] * len(copies)))
            detect(copies, found_in, settings.max_features, job.threads)
            step(len(copies))
    check_room(database, room_for_copy(found_in))
    with pycolmap.Database.open(found_in) as found:
        features = (read_features(found, photo.copy, photo.width, photo.height) for photo in photos)
        return write_features(database, cameras, groups, features)


def _match(job: Job[SfmSettings], database: Path, features: Sequence[int]) -> None:
    """Match the photos, given how many features each has."""
    from stages.motion import matching
    from stages.motion.room import check_room, room_for_matches

    settings, count = job.settings, len(features)
    mode = settings.matching
    if mode == "auto":
        mode = "exhaustive" if count <= settings.exhaustive_up_to else "sequential"
        if mode == "sequential":
            job.warn(
                f"{count} photos are too many to compare all pairs, so only neighbours in name order were "
                "compared; set sfm.matching: exhaustive if the photos were not taken in this order."
            )
    exhaustive = mode == "exhaustive"
    pairs = matching.all_pairs(count) if exhaustive else matching.sequential_pairs(count, settings.overlap)
    with job.progress("comparing pairs", len(pairs)) as step:
        for batch in matching.in_batches(pairs):
            check_room(database, room_for_matches(batch, features))
            matching.match_pairs(database, batch, settings.seed, job.threads)
            step(len(batch))


def _map(job: Job[SfmSettings], database: Path, photos: Sequence[Photo]) -> pycolmap.Reconstruction:
    """The largest model of the best attempt; what it lacks is said."""
    from stages.formats.colmap.model import registered
    from stages.motion.room import check_room, room_for_features

    check_room(database, room_for_features([]))
    models = _map_globally(job, database) if job.settings.mapper == "global" else []
    if not models:
        models = _map_incrementally(job, database, len(photos))
    if not models:
        raise UserError(
            f"The {len(photos)} photos of {job.inputs['images']} could not be placed: they share too few "
            "features. They need to show the same textured, unmoving surface, about two thirds of it again "
            "from one to the next; add photos in between."
        )
    best = models[0]
    placed = {image.image_id for image in registered(best)}
    left_out = [photo.name for index, photo in enumerate(photos) if index + 1 not in placed]
    if left_out:
        share = f"{len(left_out)} of {len(photos)} photos"
        job.warn(f"{share} could not be placed and are left out: {listed(left_out)}.")
    if len(models) > 1:
        sizes = ", ".join(str(model.num_reg_images()) for model in models[1:])
        job.warn(
            f"The photos fell into {len(models)} parts that do not connect; the largest is kept, "
            f"parts of {sizes} photos are not. Photos in between would join them."
        )
    job.note(models=[model.num_reg_images() for model in models])
    return best


def _map_globally(job: Job[SfmSettings], database: Path) -> list[pycolmap.Reconstruction]:
    from stages.motion.mapping import map_globally

    settings = job.settings
    calibrate = settings.camera_params is None
    with job.progress("placing photos"):
        models = map_globally(database, job.scratch, settings.seed, settings.holds_cameras, calibrate)
    if not models:
        job.warn("The global mapper placed no photos; the incremental one is tried instead.")
    return models


def _map_incrementally(job: Job[SfmSettings], database: Path, count: int) -> list[pycolmap.Reconstruction]:
    """Attempt after attempt until enough photos are placed; the models of the best one."""
    from stages.motion.mapping import attempts, map_incrementally

    settings = job.settings
    tries = attempts(settings.attempts, settings.seed, settings.mapping)
    best: list[pycolmap.Reconstruction] = []
    placed = 0
    for number, attempt in enumerate(tries, 1):
        label = "placing photos" if number == 1 else f"placing photos, attempt {number}"
        folder = job.scratch / f"attempt_{number}"
        folder.mkdir()
        with job.progress(label, count) as step:
            models = map_incrementally(
                database, folder, attempt, settings.mapping, settings.holds_cameras, step
            )
        if models and models[0].num_reg_images() > placed:
            best, placed = models, models[0].num_reg_images()
            job.note(attempt=number)
        if placed >= settings.enough * count:
            break
    return best


def _adjust(job: Job[SfmSettings], model: pycolmap.Reconstruction) -> pycolmap.Reconstruction:
    """Last bundle adjustments: everything, then the principal point too."""
    from stages.motion.mapping import adjust, free_principal_point

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
            job.warn(f"The principal point was left at the image's centre: {outcome.refused}.")
    job.note(principal_point_shift_px=round(outcome.shift_px, 3))
    return outcome.model


def _publish(
    job: Job[SfmSettings], model: pycolmap.Reconstruction, database: Path, photos: Sequence[Photo]
) -> None:
    """Model and database under the photos' own names."""
    from stages.formats.colmap.model import registered, write_model
    from stages.formats.images.photo_turns import write_as_stored
    from stages.motion.database import publish

    for image in model.images.values():
        image.name = photos[image.image_id - 1].name
    write_model(model, job.outputs["model"])
    write_as_stored(job.outputs["model"], [])  # they were read upright
    publish(database, job.outputs["database"], [photo.name for photo in photos])
    used = {image.camera_id for image in registered(model)}
    job.note(
        photos=len(photos),
        registered=model.num_reg_images(),
        points=model.num_points3D(),
        mean_reprojection_error_px=round(model.compute_mean_reprojection_error(), 4),
        mean_track_length=round(model.compute_mean_track_length(), 3),
        focal_px=[round(model.cameras[i].mean_focal_length(), 2) for i in sorted(used)],
    )


def _each(job: Job[SfmSettings], work: Callable[..., T], *columns: Any) -> Iterator[T]:
    """`work` on every row of the columns, in order, by the job's executor; single values are repeated."""
    rows = max(len(column) for column in columns if isinstance(column, list))
    filled = [column if isinstance(column, list) else [column] * rows for column in columns]
    return job.executor.map(work, *filled)


SFM = Stage(
    name="sfm",
    version=3,
    about="Camera poses, lens and sparse points from photos alone (COLMAP).",
    settings=SfmSettings,
    takes=("images",),
    gives=(
        Artefact("model", "COLMAP sparse model at the photos' own size"),
        Artefact("database", "COLMAP database of features and matches", file="database.db"),
    ),
    run=run,
    tools=("numpy", *PYCOLMAP, *PICTURES),
    saves_memory="lower sfm.max_size_px and sfm.max_features, or give --threads 1",
)
