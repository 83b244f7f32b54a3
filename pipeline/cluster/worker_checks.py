"""What workers must have in common with this process: code, libraries, folders."""

from __future__ import annotations

import os
import platform
import tempfile
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

from pipeline.cache.digest import digest_file, digest_files, files_below
from pipeline.cache.key import tool_version
from pipeline.errors import UserError

if TYPE_CHECKING:
    from distributed import Client

PACKAGES = ("pipeline", "stages")
SHOWN = 12  # characters of the digest: a sentence quotes it
ROOT = Path(__file__).resolve().parents[2]
SUMMED_ON = "OPENBLAS_NUM_THREADS"  # threads of its own sums: another number adds in another order


def digest_of_sources(root: Path) -> str:
    """Compute the digest of the program's Python files."""
    files = {package: files_below(root / package, (".py",)) for package in PACKAGES}
    return digest_files(
        {f"{package}/{name}": digest_file(path) for package in files for name, path in files[package].items()}
    )[:SHOWN]


# At import: a process goes on with the code that it began with, whatever the files contain later.
LOADED = digest_of_sources(ROOT)


def check_workers(client: Client, tools: Sequence[str], workspace: Path, sources: Sequence[Path]) -> None:
    """Refuse workers that would give other results, or do not see what they are to read.

    Raises
    ------
    UserError
        A worker has not the program, or another version of it, of Python or of the tools; or something that
        is here is not there.
    """
    _check_versions(client, tools)
    _check_folders(client, workspace, sources)


def _check_versions(client: Client, tools: Sequence[str]) -> None:
    own = _versions(tools)
    try:
        client.run_on_scheduler(_versions, [])  # it reads what the tasks are made of
        of_workers = client.run(_versions, list(tools))
    except Exception as error:  # Dask says in an exception of no type of its own what could not be loaded
        raise UserError(
            f"The scheduler or a worker cannot load the program ({error}); expected Unshade there as here. "
            "Install the same checkout and lock file there, and start them again."
        ) from error
    for address, versions in of_workers.items():
        other = [
            f"{name} {versions.get(name)} (here {own[name]})"
            for name in own
            if versions.get(name) != own[name]
        ]
        if other:
            raise UserError(
                f"The worker {address} has {', '.join(other)}; expected the same as here, for results depend "
                "on it. Install the same checkout and lock file there, and start the workers again."
            )


def _check_folders(client: Client, workspace: Path, sources: Sequence[Path]) -> None:
    handle, token = tempfile.mkstemp(prefix=".seen-by-workers-", dir=workspace)
    os.close(handle)
    try:
        _check_seen(client, token, workspace, "Choose one with --workspace DIR.")
        for source in sources:
            if source.exists():
                _check_seen(client, str(source), source, "Move it to one.")
    finally:
        Path(token).unlink(missing_ok=True)


def _check_seen(client: Client, path: str, shown: Path, cure: str) -> None:
    blind = [address for address, there in client.run(os.path.exists, path).items() if not there]
    if blind:
        raise UserError(
            f"The worker {blind[0]} does not see {shown}; expected a folder that all machines share "
            f"under the same path. {cure}"
        )


def _versions(tools: Sequence[str]) -> dict[str, str]:
    """List what results depend on in this process, by name."""
    return {
        "the program's code": LOADED,
        "Python": platform.python_version(),
        SUMMED_ON: os.environ.get(SUMMED_ON, "none"),
        **{tool: tool_version(tool) for tool in tools},
    }
