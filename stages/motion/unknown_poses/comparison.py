"""Which photos are compared, and whether what they share can place them."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from pipeline import Job, UserError
from stages.motion.matching import in_batches, match_pairs, sequential_pairs
from stages.motion.pairs import Pair, verified_pairs
from stages.motion.photo_set import Photo
from stages.motion.placeable import check_placeable
from stages.motion.positions import near_pairs, reach_m
from stages.motion.retrieval import similar_pairs
from stages.motion.sfm_settings import SfmSettings
from stages.scene.pairs import all_pairs
from stages.scene.wording import listed


def match_photos(
    job: Job[SfmSettings], database: Path, photos: Sequence[Photo], features: Sequence[int]
) -> None:
    """Choose pairs of photos and match them, given how many features each has.

    Raises
    ------
    UserError
        Pairs are to be chosen by position, and photos have none.
    """
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
    compare_pairs(job, database, pairs, features)


def compare_pairs(
    job: Job[SfmSettings],
    database: Path,
    pairs: Sequence[tuple[int, int]],
    features: Sequence[int],
    again: bool = False,
) -> None:
    """Match pairs (indices), batch by batch; `again`: along epipolar lines as well."""
    with job.progress("comparing pairs again" if again else "comparing pairs", len(pairs)) as step:
        for batch in in_batches(pairs, job.threads):
            match_pairs(database, batch, features, job.settings.seed, job.threads, guided=again)
            step(len(batch))


def checked_pairs(job: Job[SfmSettings], database: Path, names: Sequence[str]) -> list[Pair]:
    """Read the verified pairs.

    Raises
    ------
    UserError
        They cannot place the photos.
    """
    settings = job.settings
    pairs = verified_pairs(database)
    fewest = min(settings.mapping.init_inliers)
    check_placeable(pairs, names, fewest, settings.pairs, str(job.inputs["images"]))
    return pairs
