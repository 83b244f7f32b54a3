"""Selection of pairs of photos, and their matching by COLMAP."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import pycolmap

from pipeline.process.own_process import in_own_processes
from stages.motion.database import take_matches, working_name, write_part
from stages.motion.mapping import quiet_colmap
from stages.motion.room import check_room, room_for_features, room_for_matches

BATCH, BLOCK = 128, 16  # pairs per thread and call, and photos along a block of pairs: change speed only
# Features of both photos of all pairs, about a second: fewer are not worth a process. Changes speed only.
FEWEST_FEATURES = 100_000


def sequential_pairs(count: int, overlap: int) -> list[tuple[int, int]]:
    """List pairs of a sequence of photos: up to `overlap` apart, and at powers of two up to 2^overlap.

    The powers of two tie a long sequence together, where neighbours alone would let it drift.
    """
    steps = sorted({*range(1, overlap + 1), *(2**k for k in range(overlap + 1))})
    return [(i, i + step) for i in range(count) for step in steps if i + step < count]


def in_batches(pairs: Sequence[tuple[int, int]], threads: int) -> list[list[tuple[int, int]]]:
    """Batch pairs so that each thread's share touches few photos, whose descriptors it has to index."""
    ordered = sorted(pairs, key=lambda pair: (pair[0] // BLOCK, pair[1] // BLOCK, pair))
    batch = BATCH * threads
    return [ordered[start : start + batch] for start in range(0, len(ordered), batch)]


def match_pairs(
    database: Path,
    pairs: Sequence[tuple[int, int]],
    features: Sequence[int],
    seed: int,
    threads: int,
    guided: bool = False,
) -> None:
    """Match and verify pairs of photos (indices) without matches yet, given how many features each has.

    `guided`: once more then, along the epipolar lines of the motion that the matches agree with, where a
    feature has fewer rivals: more matches, for some times the cost. Raises what `check_room` does.

    Notes
    -----
    The result does not depend on `threads`: every pair draws from its own generator, started at `seed`, and
    each thread's share of the pairs is matched in a process of its own. (The indices of descriptors that
    COLMAP builds at the same time in one process are now and then others than those it builds one by one.)
    """
    shares = _shares(pairs, features, threads)
    if len(shares) == 1:
        check_room(database, room_for_matches(pairs, features))
        _match(database, pairs, seed, guided)
        return
    photos = [sorted({photo for pair in share for photo in pair}) for share in shares]
    copied = sum(room_for_features(features[photo] for photo in each) for each in photos)
    check_room(database, 2 * room_for_matches(pairs, features) + copied)
    parts = [database.with_suffix(f".{number}.part") for number in range(len(shares))]
    for part, each in zip(parts, photos, strict=True):
        write_part(database, part, each)
    work = [(part, share, seed, guided) for part, share in zip(parts, shares, strict=True)]
    in_own_processes("that compares photos", _match, work)
    for part, share in zip(parts, shares, strict=True):
        take_matches(database, part, share)
        part.unlink()


def _shares(
    pairs: Sequence[tuple[int, int]], features: Sequence[int], threads: int
) -> list[Sequence[tuple[int, int]]]:
    """Divide pairs among threads in runs of about the same size, each worth a process of its own."""
    compared = sum(features[i] + features[j] for i, j in pairs)
    count = max(1, min(threads, len(pairs), compared // FEWEST_FEATURES))
    ends = [len(pairs) * number // count for number in range(count + 1)]
    return [pairs[start:end] for start, end in zip(ends, ends[1:], strict=False)]


def _match(database: Path, pairs: Sequence[tuple[int, int]], seed: int, guided: bool) -> None:
    """Match and verify pairs on one thread, as `match_pairs`."""
    pairs_file = database.with_suffix(".pairs.txt")
    pairs_file.write_text(
        "".join(f"{working_name(i)} {working_name(j)}\n" for i, j in pairs), encoding="ascii"
    )
    verification = pycolmap.TwoViewGeometryOptions()
    verification.ransac.random_seed = seed
    verification.ransac.num_threads = 1
    with quiet_colmap():  # for a process of its own
        pycolmap.match_image_pairs(
            database,
            pycolmap.FeatureMatchingOptions(num_threads=1, use_gpu=False, guided_matching=guided),
            pycolmap.ImportedPairingOptions(match_list_path=pairs_file),
            verification,
            pycolmap.Device.cpu,
        )
