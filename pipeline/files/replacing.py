"""Files written beside and renamed: readers see the old content or the new one, and no link is followed."""

from __future__ import annotations

import os
import shutil
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path

FRESH = ".part"  # ending of a file that is being written


@contextmanager
def replacing(path: Path, fresh: Path) -> Iterator[None]:
    """Let a block write the file `fresh`, then rename it to `path`; after a failure nothing of it remains."""
    fresh.unlink(missing_ok=True)  # of a killed run; or a link, through which the block would write
    try:
        yield
        fresh.replace(path)
    except BaseException:
        with suppress(OSError):
            fresh.unlink()
        raise


def replace_text(path: Path, text: str) -> None:
    """Write a small file atomically, flushed to disk; names of files that are not UTF-8 keep their bytes."""
    path.parent.mkdir(parents=True, exist_ok=True)
    fresh = path.with_name(f".{path.name}{FRESH}")
    with replacing(path, fresh), fresh.open("w", encoding="utf-8", errors="surrogateescape") as file:
        file.write(text)
        file.flush()
        os.fsync(file.fileno())


def replace_copy(source: Path, path: Path, fresh: Path) -> None:
    """Copy a file to `path` atomically, by way of `fresh` on the same file system."""
    with replacing(path, fresh):
        shutil.copyfile(source, fresh)
