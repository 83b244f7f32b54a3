"""Numba's cache of compiled loops, in a folder named by a digest of their sources.

Numba checks the file of a loop only, not those of the functions it calls: after an edit there it would use an
outdated kernel.
"""

from __future__ import annotations

import hashlib
import os
from pathlib import Path

VARIABLE = "NUMBA_CACHE_DIR"  # numba reads it when it is imported
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
    """Set numba's cache folder for the loops under `root`: in its ``__pycache__``, else in the user's cache.

    A value in the environment takes precedence. If neither folder is writable, nothing is set: numba then
    uses its own default, or compiles again.
    """
    if VARIABLE in os.environ:
        return
    name = f"loops-{digest_of_loops(root)}"
    for place in (root / "__pycache__", Path(os.environ.get("XDG_CACHE_HOME") or "~/.cache", "unshade")):
        try:
            folder = place.expanduser() / name
            folder.mkdir(parents=True, exist_ok=True)
        except (OSError, RuntimeError):  # not ours to write; or there is no home
            continue
        if os.access(folder, os.W_OK):
            os.environ[VARIABLE] = str(folder)
            return
