"""Photos to be placed, their reduced copies and masks, and their features."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np
import pycolmap

from pipeline import Job, UserError
from stages.formats.images.masks import nothing_kept
from stages.formats.images.photo_folder import find_masks, find_photos, unread_photos
from stages.motion.database import copy_name, write_features
from stages.motion.features import detect, read_features
from stages.motion.photo_set import (
    Photo,
    camera_groups,
    copies_among,
    exposure_for_matching,
    initial_cameras,
    survey,
    write_linear_copy,
    write_mask_of_copy,
)
from stages.motion.room import check_room, room_for_copy
from stages.motion.sfm_settings import SfmSettings
from stages.scene.wording import listed


def photos_to_place(job: Job[SfmSettings]) -> list[Photo]:
    """Read the photos and write their reduced copies into `scratch`; what cannot be read is warned of.

    Raises
    ------
    UserError
        Fewer than two are left.
    """
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
    """Choose the photos of which no other, before, is the same pixel by pixel; copies are warned of."""
    copies = copies_among(photos)
    if copies:
        job.warn(
            f"{len(copies)} of {len(photos)} photos are copies of another, pixel by pixel, and left out: "
            f"{listed(list(copies))} (the first of {next(iter(copies.values()))})."
        )
        job.note(copies=copies)
    return [photo for photo in photos if photo.name not in copies]


def find_features(job: Job[SfmSettings], photos: Sequence[Photo], database: Path) -> list[np.ndarray]:
    """Find features and write them to a new database; returns the photos' colours there, (n, 3), uint8, each.

    Raises
    ------
    UserError
        Masks are asked for, and there are none, or they keep nothing.
    OSError
        The disk has no room for the database.
    """
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
    """Write the masks of the photos' copies, and return their folder; photos without one are warned of."""
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
