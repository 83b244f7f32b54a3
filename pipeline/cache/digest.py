"""Digests of content: of values, files and folders; a memo keeps unchanged files from being read twice."""

from __future__ import annotations

import errno
import json
import os
import time
from collections.abc import Callable, Iterable, Iterator, Mapping
from pathlib import Path
from stat import S_ISREG
from typing import Any, NoReturn

from blake3 import blake3

from pipeline.cache.sealed_json import read_sealed, sealed
from pipeline.errors import UserError
from pipeline.files.file_kinds import expect_file, is_file
from pipeline.files.replacing import replace_text

DIGEST_HEX_DIGITS = 32  # 128 bits: accidental collisions are negligible
COARSEST_CLOCK_NS = 2_000_000_000  # FAT counts times in two seconds; other file systems in less

Stamp = tuple[int, int, int, int]  # size, modification and change time, inode


def digest_value(value: Any) -> str:
    """Compute the digest of a JSON-like value and its types: ``1``, ``1.0``, ``True``, ``"1"`` all differ."""
    return blake3(_canonical(value).encode()).hexdigest()[:DIGEST_HEX_DIGITS]


def _canonical(value: Any) -> str:
    """Encode a value as text; two texts are equal only if the values and their types are."""
    if isinstance(value, Mapping):
        pairs = sorted((_canonical(key), _canonical(item)) for key, item in value.items())
        return "{" + ",".join(f"{key}:{item}" for key, item in pairs) + "}"
    if isinstance(value, list | tuple):
        return "[" + ",".join(map(_canonical, value)) + "]"
    if value is None or isinstance(value, bool | int | float | str):
        return f"{type(value).__name__} {json.dumps(value)}"
    raise TypeError(f"{value!r} has no canonical text; keys hold JSON values only")


def digest_file(path: Path) -> str:
    """Compute the digest of a file's bytes.

    On one thread: the library's threads, once begun, would be missed for ever by the forks of stages.
    """
    hasher = blake3()
    with path.open("rb"):  # its error names the file; blake3's does not
        hasher.update_mmap(path)
    return hasher.hexdigest()[:DIGEST_HEX_DIGITS]


def files_below(root: Path, suffixes: Iterable[str] = ()) -> dict[str, Path]:
    """List files at or below `root` by relative posix path, sorted; hidden files and other suffixes excluded.

    Links are followed, as photo collections are often made of them.

    Raises
    ------
    UserError
        A link leads nowhere; a name is not UTF-8, or that of a pipe, a socket or a device.
    """
    if root.is_file():
        return {root.name: root}
    wanted = tuple(suffix.lower() for suffix in suffixes)
    found = {}
    for path in _entries_below(root):
        if path.is_symlink() and not path.exists():
            raise UserError(
                f"{path} is a link to {path.readlink()}, which is not there; mend it or remove it."
            )
        if not wanted or path.name.lower().endswith(wanted):
            name = path.relative_to(root).as_posix()
            _expect_utf8(path, name)
            expect_file(path)
            found[name] = path
    return dict(sorted(found.items()))


def _expect_utf8(path: Path, name: str) -> None:
    """Refuse a name, folders included, that no record could hold."""
    try:
        name.encode()
    except UnicodeEncodeError as error:
        raise UserError(
            f"{os.fsencode(path)!r} is not called by a name in UTF-8; names must be. Rename it."
        ) from error


def _entries_below(root: Path) -> Iterator[Path]:
    """List the files of a folder and its subfolders, hidden ones excluded; each folder is entered once.

    A link to a parent folder is not followed; of two paths to a folder the first in order of names counts.
    """
    entered = set()
    for folder, subfolders, names in os.walk(root, onerror=_raise, followlinks=True):
        stat = Path(folder).stat()
        if (stat.st_dev, stat.st_ino) in entered:
            subfolders.clear()
            continue
        entered.add((stat.st_dev, stat.st_ino))
        subfolders[:] = sorted(name for name in subfolders if not name.startswith("."))
        yield from (Path(folder, name) for name in names if not name.startswith("."))


def _raise(error: OSError) -> NoReturn:
    """Raise the error of a folder that cannot be read, which `os.walk` would skip."""
    raise error


def digest_files(digests: Mapping[str, str]) -> str:
    """Compute the digest of a folder from the digests of its files by relative path."""
    return digest_value(dict(digests))


class DigestMemo:
    """Cache of file digests by size, times and inode; a file that changed since is read again.

    The change time is compared too, so that a change behind a restored modification time is detected. Files
    changed within the last ticks of the coarsest clock are read again next time, since another change would
    not show in their times. What a disk corrupts without a write keeps its times, and goes unnoticed. Keys
    contain digests of content only.
    """

    def __init__(self, path: Path) -> None:
        self._path = path
        self._known: dict[str, tuple[Stamp, str]] = _read_memo(path)
        self._changed = False

    def file(self, path: Path) -> str:
        """Compute the digest of a file, or take it from the memo if the file is unchanged.

        Raises
        ------
        OSError
            It cannot be read, or is a pipe, a socket or a device.
        """
        stat = path.stat()
        if not S_ISREG(stat.st_mode):
            raise OSError(errno.EINVAL, "a pipe, a socket or a device, not a file", str(path))
        stamp = stat.st_size, stat.st_mtime_ns, stat.st_ctime_ns, stat.st_ino
        name = str(path.resolve())
        known = self._known.get(name)
        if known is not None and known[0] == stamp:
            return known[1]
        digest = digest_file(path)
        if time.time_ns() - max(stat.st_mtime_ns, stat.st_ctime_ns) > COARSEST_CLOCK_NS:
            self._known[name] = stamp, digest
            self._changed = True
        return digest

    def tree(
        self, root: Path, suffixes: Iterable[str] = (), seen: Callable[[str], None] | None = None
    ) -> dict[str, str]:
        """Compute digests of all files at or below `root` by relative path; calls `seen` with each name."""
        digests = {}
        for name, path in files_below(root, suffixes).items():
            digests[name] = self.file(path)
            if seen is not None:
                seen(name)
        return digests

    def renamed(self, before: Path, after: Path) -> None:
        """Update the memo after the folder `before` was renamed to `after`."""
        old, new = f"{before.resolve()}{os.sep}", f"{after.resolve()}{os.sep}"
        moved = {new + name[len(old) :]: stamp for name, stamp in self._known.items() if name.startswith(old)}
        self._known |= moved
        self._changed |= bool(moved)

    def save(self) -> None:
        """Write the memo without files that no longer exist; failure to write it is ignored."""
        if not self._changed:
            return
        kept = {
            name: [*stamp, digest] for name, (stamp, digest) in self._known.items() if is_file(Path(name))
        }
        try:
            replace_text(self._path, sealed(kept))
        except OSError:
            return
        self._changed = False


def _read_memo(path: Path) -> dict[str, tuple[Stamp, str]]:
    """Read the memo from disk; an empty one where it is missing or damaged, since it only saves time."""
    try:
        return {name: _remembered(entry) for name, entry in read_sealed(path).items()}
    except (OSError, ValueError):
        return {}


def _remembered(entry: Any) -> tuple[Stamp, str]:
    """Check one entry of the memo: four numbers and a digest."""
    match entry:
        case [int(size), int(modified), int(changed), int(inode), str(digest)]:
            return (size, modified, changed, inode), digest
    raise ValueError(f"{entry!r} is no entry of a memo")
