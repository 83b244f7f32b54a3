"""Selection of pairs of photos, and their matching by COLMAP."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import pycolmap

from stages.motion.database import working_name
from stages.motion.room import check_room, room_for_matches

BATCH, BLOCK = 256, 16  # pairs per call, and photos along a side of a block of pairs: change speed only


def sequential_pairs(count: int, overlap: int) -> list[tuple[int, int]]:
    """List pairs of a sequence of photos: up to `overlap` apart, and at powers of two up to 2^overlap.

    The powers of two tie a long sequence together, where neighbours alone would let it drift.
    """
    steps = sorted({*range(1, overlap + 1), *(2**k for k in range(overlap + 1))})
    return [(i, i + step) for i in range(count) for step in steps if i + step < count]


def in_batches(pairs: Sequence[tuple[int, int]], batch: int = BATCH) -> list[list[tuple[int, int]]]:
    """Batch pairs so that each touches few photos: COLMAP indexes a photo's descriptors once per call."""
    ordered = sorted(pairs, key=lambda pair: (pair[0] // BLOCK, pair[1] // BLOCK, pair))
    return [ordered[start : start + batch] for start in range(0, len(ordered), batch)]


def match_pairs(
    database: Path,
    pairs: Sequence[tuple[int, int]],
    features: Sequence[int],
    seed: int,
    threads: int,
    guided: bool = False,
) -> None:
    """Match and verify pairs of photos (indices) in a database, given how many features each photo has.

    Pairs that have matches are passed over. `guided`: once more then, along the epipolar lines of the motion
    that the matches agree with, where a feature has fewer rivals: more matches, for some times the cost.
    The result does not depend on `threads`: every pair draws from its own generator, started at `seed`.
    Raises what `check_room` does.
    """
    check_room(database, room_for_matches(pairs, features))
    pairs_file = database.with_suffix(".pairs.txt")
    pairs_file.write_text(
        "".join(f"{working_name(i)} {working_name(j)}\n" for i, j in pairs), encoding="ascii"
    )
    verification = pycolmap.TwoViewGeometryOptions()
    verification.ransac.random_seed = seed
    verification.ransac.num_threads = 1
    pycolmap.match_image_pairs(
        database,
        pycolmap.FeatureMatchingOptions(num_threads=threads, use_gpu=False, guided_matching=guided),
        pycolmap.ImportedPairingOptions(match_list_path=pairs_file),
        verification,
        pycolmap.Device.cpu,
    )
