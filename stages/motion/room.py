"""Room on the disk for COLMAP's database, checked beforehand: COLMAP ends the process where there is none."""

from __future__ import annotations

import os
from collections.abc import Iterable, Sequence
from pathlib import Path

BYTES_PER_FEATURE = 6 * 4 + 128  # keypoint, six floats, and SIFT descriptor
BYTES_PER_MATCH = 2 * 2 * 4  # two indices, as matched and once more as verified
COPIES = 2  # SQLite writes to a journal first, which can become as long as what is written
SLACK = 2**21  # bytes; tables, indices, shared memory, and rows of cameras and images


def room_for_features(counts: Iterable[int]) -> int:
    """Compute an upper bound of the bytes that so many features per photo take in a database."""
    return SLACK + COPIES * BYTES_PER_FEATURE * sum(counts)


def room_for_copy(database: Path) -> int:
    """Compute an upper bound of the bytes that the rows of another database take."""
    return SLACK + COPIES * database.stat().st_size


def room_for_matches(pairs: Iterable[tuple[int, int]], counts: Sequence[int]) -> int:
    """Compute an upper bound of the bytes that matches of pairs take, given the photos' feature counts.

    A feature has at most one match in another photo.
    """
    return SLACK + COPIES * BYTES_PER_MATCH * sum(min(counts[i], counts[j]) for i, j in pairs)


def check_room(database: Path, size: int) -> None:
    """Check that a database, which need not exist yet, can grow by `size` bytes: reserve as many beside it.

    Raises
    ------
    OSError
        There is no room on the disk, in a quota, or below the limit of a file's size.
    """
    begin = database.stat().st_size if database.exists() else 0
    ballast = database.with_name(f"{database.name}.room")
    try:
        with ballast.open("wb") as file:
            if hasattr(os, "posix_fallocate"):
                os.posix_fallocate(file.fileno(), begin, size)
            else:
                file.write(bytes(size))
                file.flush()
    except OSError as error:
        raise OSError(error.errno, error.strerror, str(database)) from error
    finally:
        ballast.unlink(missing_ok=True)
