"""One run at a time in a workspace, and what the file system refuses there as sentences."""

from __future__ import annotations

import errno
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from filelock import FileLock, Timeout

from pipeline.errors import UserError
from pipeline.files.boundary import check_workspace

AT_ONCE_S = 2.0  # a killed run holds the lock until the system has taken its memory back
NO_ROOM = {errno.ENOSPC, errno.EDQUOT, errno.EROFS, errno.EFBIG}  # errors of writing only
IF_WITHIN = {errno.EACCES, errno.EPERM, errno.EIO}  # errors of reading as well


@contextmanager
def locked(workspace: Path, patience_s: float = AT_ONCE_S) -> Iterator[None]:
    """Hold the workspace for this run.

    Raises
    ------
    UserError
        It cannot be written, now or later on, would be written elsewhere, or another run holds it.
    """
    check_workspace(workspace)
    try:
        workspace.mkdir(parents=True, exist_ok=True)
        (workspace / "cache").mkdir(exist_ok=True)
        lock = FileLock(workspace / ".lock")
        lock.acquire(timeout=patience_s)
    except Timeout:
        raise UserError(
            f"Another run is using the workspace {workspace}; wait for it to end, "
            "or choose another folder with --workspace."
        ) from None
    except OSError as error:
        raise UserError(
            f"The workspace {workspace} cannot be written ({error.strerror or error}); "
            "choose another folder with --workspace."
        ) from error
    try:
        with refusals_explained(workspace):
            yield
    finally:
        lock.release()


@contextmanager
def refusals_explained(workspace: Path) -> Iterator[None]:
    """Turn what the file system refuses in the workspace into a sentence.

    Raises
    ------
    UserError
        There is no room, or a place within the workspace may not be used.
    """
    try:
        yield
    except OSError as error:
        if error.errno in NO_ROOM or (error.errno in IF_WITHIN and _is_below(error.filename, workspace)):
            raise UserError(
                f"{error.filename or workspace} cannot be used ({error.strerror}); expected a place to "
                "write. Make room there, or allow it, or choose another folder with --workspace; earlier "
                "results are kept."
            ) from error
        raise


def _is_below(place: str | None, workspace: Path) -> bool:
    return place is not None and Path(place).resolve().is_relative_to(workspace.resolve())
