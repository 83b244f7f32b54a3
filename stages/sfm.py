"""Structure from motion: where the photos were taken from, and with what lens (Eq. 7: K, R, t)."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

from pipeline import Artefact, Job, Stage, UserError
from stages.motion.sfm_settings import SfmSettings
from stages.scene.distributions import PICTURES, PYCOLMAP
from stages.scene.wording import listed

if TYPE_CHECKING:
    import numpy as np
    import pycolmap

    from stages.motion.pairs import Pair
    from stages.motion.photo_set import Photo

EVERY = slice(None)


def run(job: Job[SfmSettings]) -> None:
    """Survey the photos, find and compare features, place, adjust, publish."""
    from stages.motion.mapping import colour_points, quiet_colmap

    database = job.scratch / "working.db"
    with quiet_colmap():
        photos = _survey(job)
        colours = _find_features(job, photos, database)
        features = [len(own) for own in colours]
        _match(job, database, photos, features)
        names = [photo.name for photo in photos]
        pairs = _check_pairs(job, database, names)
        models, database = _map(job, database, features, names, pairs)
        _tell_left_out(job, models, names, pairs)
        model = _adjust(job, models[0])
        _check_focal_lengths(job, model, names)
        colour_points(model, colours)
        _publish(job, model, database, names)


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
        named = [(name, job.scratch / copy_name(index)) for index, name in enumerate(names)]
        bounds = settings.max_size_px, settings.linear_white_samples
        for found in job.tasks.small(survey, named, folder, *bounds):
            if isinstance(found, str):
                job.warn(f"Left out: {found}")
            else:
                photos.append(found)
            step()
    exposure = exposure_for_matching(photos, settings.linear_white_percentile)
    linear = [photo for photo in photos if photo.linear_sample is not None]
    for _ in job.tasks.small(write_linear_copy, linear, folder, settings.max_size_px, exposure):
        pass
    readable = len(photos)
    photos = _without_copies(job, photos)
    if len(photos) < 2:
        raise UserError(
            f"{folder} holds {'one readable photo' if photos else 'no readable photo'}"
            f"{' (and copies of it)' if readable > 1 else ''}, but structure from motion needs at least two "
            "that overlap, taken from different places, better twenty. Add photos."
        )
    return photos


def _without_copies(job: Job[SfmSettings], photos: list[Photo]) -> list[Photo]:
    """The photos of which no other, before, is the same pixel by pixel; copies are named."""
    from stages.motion.photo_set import copies_among

    copies = copies_among(photos)
    if copies:
        job.warn(
            f"{len(copies)} of {len(photos)} photos are copies of another, pixel by pixel, and left out: "
            f"{listed(list(copies))} (the first of {next(iter(copies.values()))})."
        )
        job.note(copies=copies)
    return [photo for photo in photos if photo.name not in copies]


def _find_features(job: Job[SfmSettings], photos: Sequence[Photo], database: Path) -> list[np.ndarray]:
    """Fill the database with features; the photos' colours at the features are returned."""
    import pycolmap

    from stages.motion.database import write_features
    from stages.motion.features import detect, read_features
    from stages.motion.photo_set import camera_groups, initial_cameras
    from stages.motion.room import check_room, room_for_copy

    settings = job.settings
    groups = camera_groups(photos, settings.cameras)
    cameras = initial_cameras(
        photos, groups, settings.camera_model, settings.camera_params, settings.focal_factor
    )
    masks = _write_masks(job, photos) if settings.within_masks else None
    found_in = job.scratch / "features.db"
    batch = 2 * job.threads
    with job.progress("finding features", len(photos)) as step:
        for start in range(0, len(photos), batch):
            copies = [photo.copy for photo in photos[start : start + batch]]
            detect(copies, found_in, settings.max_features, job.threads, masks)
            step(len(copies))
    check_room(database, room_for_copy(found_in))
    with pycolmap.Database.open(found_in) as found:
        features = (read_features(found, photo.copy, photo.width, photo.height) for photo in photos)
        return write_features(database, cameras, groups, features)


def _write_masks(job: Job[SfmSettings], photos: Sequence[Photo]) -> Path:
    """The folder of masks of the photos' copies; photos without one are named aloud."""
    from stages.formats.images.masks import nothing_kept
    from stages.formats.images.photo_folder import find_masks
    from stages.motion.photo_set import write_mask_of_copy

    settings, given, folder = job.settings, job.inputs.get("masks"), job.scratch / "masks"
    folder.mkdir()
    found = find_masks(given, [photo.name for photo in photos]) if given else {}
    masked = [(photo, found.get(photo.name)) for photo in photos]
    fixed = job.inputs["images"], folder, settings.max_size_px, settings.alpha
    shares = list(job.tasks.small(write_mask_of_copy, masked, *fixed))
    if not any(shares):
        raise UserError(nothing_kept(f"No mask of the photos in {job.inputs['images']}"))
    whole = [
        photo.name for (photo, mask), share in zip(masked, shares, strict=True) if share == 1 and not mask
    ]
    if len(whole) == len(photos):
        raise UserError(
            "sfm.within_masks is set, but no photo has a mask; expected --masks DIR, or photos with alpha "
            "channels. Give them, or leave the setting out."
        )
    if whole:
        job.warn(
            f"{len(whole)} of {len(photos)} photos have no mask, and features everywhere: {listed(whole)}. "
            "Give theirs as well, if their background moved."
        )
    job.note(kept_by_masks=round(sum(shares) / len(shares), 4))
    return folder


def _match(job: Job[SfmSettings], database: Path, photos: Sequence[Photo], features: Sequence[int]) -> None:
    """Match the photos, given how many features each has."""
    from stages.motion.matching import sequential_pairs
    from stages.motion.positions import near_pairs, reach_m
    from stages.motion.retrieval import similar_pairs
    from stages.scene.pairs import all_pairs

    settings, count = job.settings, len(features)
    positions = [photo.position for photo in photos if photo.position is not None]
    mode = settings.matching
    if mode == "auto" and count <= settings.exhaustive_up_to:
        mode = "exhaustive"
    elif mode == "auto":
        apart = len(positions) == count and reach_m(positions, settings.near) > settings.position_error_m
        mode = "positions" if apart else "retrieval"
    if mode == "positions" and len(positions) < count:
        without = [photo.name for photo in photos if photo.position is None]
        raise UserError(
            f"sfm.matching is positions, but {len(without)} of {count} photos have none in their EXIF data: "
            f"{listed(without)}. Leave them out, or set sfm.matching=retrieval."
        )
    if mode == "exhaustive":
        pairs = all_pairs(count)
    elif mode == "positions":
        pairs = near_pairs(positions, settings.near)
    elif mode == "retrieval":
        pairs = similar_pairs(database, settings.retrieval, job.scratch, job.threads, settings.seed)
    else:
        pairs = sequential_pairs(count, settings.overlap)
    job.note(compared=mode, pairs_compared=len(pairs))
    _compare(job, database, pairs, features)


def _compare(
    job: Job[SfmSettings],
    database: Path,
    pairs: Sequence[tuple[int, int]],
    features: Sequence[int],
    again: bool = False,
) -> None:
    """Match pairs, batch by batch; again: along epipolar lines as well."""
    from stages.motion.matching import in_batches, match_pairs

    with job.progress("comparing pairs again" if again else "comparing pairs", len(pairs)) as step:
        for batch in in_batches(pairs, job.threads):
            match_pairs(database, batch, features, job.settings.seed, job.threads, guided=again)
            step(len(batch))


def _check_pairs(job: Job[SfmSettings], database: Path, names: Sequence[str]) -> list[Pair]:
    """The verified pairs, after a refusal of photos that cannot be placed."""
    from stages.motion.pairs import verified_pairs
    from stages.motion.placeable import check_placeable

    settings = job.settings
    pairs = verified_pairs(database)
    fewest = min(settings.mapping.init_inliers)
    check_placeable(pairs, names, fewest, settings.pairs, str(job.inputs["images"]))
    return pairs


def _map(
    job: Job[SfmSettings],
    database: Path,
    features: Sequence[int],
    names: Sequence[str],
    pairs: Sequence[Pair],
) -> tuple[list[pycolmap.Reconstruction], Path]:
    """The models of the best attempt, the largest first, and the database with their cameras."""
    from stages.motion.placeable import no_model

    models = _map_globally(job, database) if job.settings.mapper == "global" else []
    if not models:
        models, database = _map_compared_again(job, database, features, pairs)
    if not models:
        raise UserError(no_model(pairs, names, str(job.inputs["images"])))
    own = _map_with_own_cameras(job, database, models[0], len(names))
    return own or (models, database)


def _map_with_own_cameras(
    job: Job[SfmSettings], database: Path, shared: pycolmap.Reconstruction, count: int
) -> tuple[list[pycolmap.Reconstruction], Path] | None:
    """Models with a camera for each photo, where the photos ask for it and it explains them much better."""
    from stages.motion.database import write_own_cameras
    from stages.motion.focal_lengths import several_focal_lengths, spread

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


def _tell_left_out(
    job: Job[SfmSettings],
    models: Sequence[pycolmap.Reconstruction],
    names: Sequence[str],
    pairs: Sequence[Pair],
) -> None:
    """Name the photos that the largest model lacks, and say what is missing."""
    from stages.formats.colmap.model import registered
    from stages.motion.placeable import left_out

    job.note(models=[model.num_reg_images() for model in models])
    placed = [[image.image_id - 1 for image in registered(model)] for model in models]
    for sentence in left_out(placed, pairs, names, min(job.settings.mapping.pose_inliers)):
        job.warn(sentence)


def _map_globally(job: Job[SfmSettings], database: Path) -> list[pycolmap.Reconstruction]:
    from stages.motion.mapping import map_globally

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
    """The best models, and the database that they are of: photos left out at first are compared again."""
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
    """A copy of the database in which these pairs have the matches along epipolar lines as well."""
    from stages.motion.database import write_without_matches

    copy = job.scratch / "compared_again.db"
    write_without_matches(database, copy, pairs)
    job.note(pairs_compared_again=len(pairs))
    _compare(job, copy, pairs, features, again=True)
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
    """Attempt after attempt until enough are placed; models of the best that places more than `beyond`."""
    from stages.motion.mapping import attempts, map_incrementally

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
            job.warn(
                "The axis of the lens was taken to meet the middle of the photos (the principal point: "
                f"{outcome.refused}). Of whole photos that is true, and there is nothing to do; were they "
                "cropped, give them whole, or the camera's own values (sfm.camera_params)."
            )
    job.note(principal_point_shift_px=round(outcome.shift_px, 3))
    return outcome.model


def _check_focal_lengths(job: Job[SfmSettings], model: pycolmap.Reconstruction, names: Sequence[str]) -> None:
    """Note how certain the focal lengths are, and warn of those that the photos hardly determine."""
    from stages.motion.focal_lengths import deviations, uncertain_among

    settings = job.settings
    if settings.holds_cameras:
        return
    found = deviations(model)
    job.note(focal_deviation={i: round(d, 4) if math.isfinite(d) else None for i, d in found.items()})
    if said := uncertain_among(model, found, names, settings.focal.largest_deviation):
        job.warn(said)


def _publish(
    job: Job[SfmSettings], model: pycolmap.Reconstruction, database: Path, names: Sequence[str]
) -> None:
    """Model and database under the photos' own names."""
    from stages.formats.colmap.model import registered, write_model
    from stages.formats.images.photo_turns import write_as_stored
    from stages.motion.database import publish

    for image in model.images.values():
        image.name = names[image.image_id - 1]
    write_model(model, job.outputs["model"])
    write_as_stored(job.outputs["model"], [])  # they were read upright
    publish(database, job.outputs["database"], names)
    used = {image.camera_id for image in registered(model)}
    job.note(
        photos=len(names),
        registered=model.num_reg_images(),
        points=model.num_points3D(),
        mean_reprojection_error_px=round(model.compute_mean_reprojection_error(), 4),
        mean_track_length=round(model.compute_mean_track_length(), 3),
        focal_px=[round(model.cameras[i].mean_focal_length(), 2) for i in sorted(used)],
    )


def in_words(facts: Mapping[str, Any]) -> str:
    """Tell in a few words what was found."""
    return (
        f"{facts['registered']} of {facts['photos']} photos placed, {facts['points']:,} points, "
        f"{facts['mean_reprojection_error_px']:.2f} px reprojection error"
    )


SFM = Stage(
    name="sfm",
    version=8,
    about="Camera poses, lens and sparse points from photos alone (COLMAP).",
    settings=SfmSettings,
    takes=("images",),
    gives=(
        Artefact("model", "COLMAP sparse model at the photos' own size"),
        Artefact("database", "COLMAP database of features and matches", file="database.db"),
    ),
    run=run,
    tools=("numpy", "scipy", *PYCOLMAP, *PICTURES),
    saves_memory="lower sfm.max_size_px and sfm.max_features, or give --threads 1",
    found=in_words,
)
