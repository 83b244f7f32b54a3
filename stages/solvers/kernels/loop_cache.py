"""Numba's cache of compiled loops, in a folder named by a digest of their sources.

Numba checks the file of a loop only, not those of the functions it calls: after an edit there it would use an
outdated kernel.
"""

from __future__ import annotations

import hashlib
import os
import stat
import tempfile
from contextlib import suppress
from pathlib import Path

VARIABLE = "NUMBA_CACHE_DIR"  # numba reads it when it is imported
FOR_OTHERS = stat.S_IRWXG | stat.S_IRWXO
COMPILED = b"numba"  # occurs in every file with compiled functions


def digest_of_loops(root: Path) -> str:
    """Digest names and contents of all Python files under a folder that mention numba."""
    digest = hashlib.sha256()
    for path in sorted(root.rglob("*.py")):
        content = path.read_bytes()
        if COMPILED in content:
            digest.update(path.relative_to(root).as_posix().encode() + b"\0" + content + b"\0")
    return digest.hexdigest()[:16]


def name_loop_cache(root: Path) -> None:
    """Set numba's cache folder for the loops under `root`: the first that can be written of three.

    In its ``__pycache__``; in the user's cache; in a folder of the user's alone among the temporary files,
    for numba refuses to compile where it can keep nothing. A value in the environment takes precedence.
    """
    if VARIABLE in os.environ:
        return
    name = f"loops-{digest_of_loops(root)}"
    for place in (lambda: root / "__pycache__", _users_cache, _private_temporary_folder):
        try:
            folder = place() / name
            folder.mkdir(parents=True, exist_ok=True)
        except (OSError, RuntimeError):  # not ours to write; or there is no home
            continue
        if os.access(folder, os.W_OK):
            os.environ[VARIABLE] = str(folder)
            return


def _users_cache() -> Path:
    return Path(os.environ.get("XDG_CACHE_HOME") or "~/.cache", "unshade").expanduser()


def _private_temporary_folder() -> Path:
    """Make or find a folder that nobody else can write: whoever writes compiled loops has them executed.

    Raises
    ------
    OSError
        There is no place for one, or another user made it first.
    """
    folder = Path(tempfile.gettempdir(), f"unshade-{os.geteuid()}")
    with suppress(FileExistsError):
        folder.mkdir(mode=stat.S_IRWXU)
    found = folder.lstat()
    if not stat.S_ISDIR(found.st_mode) or found.st_uid != os.geteuid() or found.st_mode & FOR_OTHERS:
        raise PermissionError(f"{folder} is not this user's alone")
    return folder
