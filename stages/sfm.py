"""Structure from motion: where the photos were taken from, and with what lens (Eq. 7: K, R, t)."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

from pipeline import Artefact, Job, Stage
from stages.motion.sfm_settings import SfmSettings
from stages.scene.distributions import PICTURES, PYCOLMAP

if TYPE_CHECKING:
    import pycolmap


def run(job: Job[SfmSettings]) -> None:
    """Survey the photos, find and compare features, place, adjust, publish."""
    from stages.motion.mapping import colour_points, quiet_colmap
    from stages.motion.unknown_poses.comparison import checked_pairs, match_photos
    from stages.motion.unknown_poses.placement import (
        adjusted,
        check_focal_lengths,
        place_photos,
        tell_left_out,
    )
    from stages.motion.unknown_poses.survey import find_features, photos_to_place

    database = job.scratch / "working.db"
    with quiet_colmap():
        photos = photos_to_place(job)
        colours = find_features(job, photos, database)
        features = [len(own) for own in colours]
        match_photos(job, database, photos, features)
        names = [photo.name for photo in photos]
        pairs = checked_pairs(job, database, names)
        models, database = place_photos(job, database, features, names, pairs)
        tell_left_out(job, models, names, pairs)
        model = adjusted(job, models[0])
        check_focal_lengths(job, model, names)
        colour_points(model, colours)
        _publish(job, model, database, names)


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
