"""Public photo sets by name: read from `UNSHADE_DATA`, else fetched once; checksums are always verified."""

from __future__ import annotations

import hashlib
import json
import os
from collections.abc import Callable
from importlib.resources import files
from pathlib import Path
from typing import Any, NoReturn

from pipeline import UserError
from pipeline.settings import near

DATA_VARIABLE = "UNSHADE_DATA"


def dataset_folder(name: str, fetch: bool = True) -> Path:
    """Find or fetch the folder that holds a data set's files, every checksum verified.

    Raises
    ------
    UserError
        The name is unknown; a file has another checksum; or the set is absent, and cannot or may not be
        fetched.
    """
    known = json.loads(files("stages.scene").joinpath("datasets.json").read_text(encoding="utf-8"))
    if name not in known:
        raise UserError(f"There is no data set {name!r}; {near(name, known)}")
    given = os.environ.get(DATA_VARIABLE)
    folder = Path(given) / name if given else None
    if folder is not None and folder.is_dir():
        _verify(folder, known[name]["sha256"])
        return folder
    return _fetched(name, known[name], folder, None if fetch else _refuse)


def _verify(folder: Path, checksums: dict[str, str]) -> None:
    for file, expected in checksums.items():
        path = folder / file
        if not path.is_file():
            raise UserError(
                f"{path} is missing; copy it there, or unset {DATA_VARIABLE} to fetch the data set."
            )
        found = hashlib.sha256(path.read_bytes()).hexdigest()
        if found != expected:
            raise UserError(
                f"{path} has the checksum {found[:12]}…, expected {expected[:12]}…; replace it with the "
                f"original, or unset {DATA_VARIABLE} to fetch the data set."
            )


def _refuse(url: str, *_: Any) -> NoReturn:
    """Raise instead of downloading, where only a plan is requested."""
    raise UserError(
        f"{url} is not on this machine yet, and a plan fetches nothing; `unshade run` fetches it."
    )


def _fetched(
    name: str, known: dict[str, Any], looked_in: Path | None, download: Callable[..., None] | None
) -> Path:
    """Download missing files; pooch verifies each before it gets its name."""
    import pooch

    pooch.get_logger().setLevel("WARNING")
    cache = Path(pooch.os_cache("unshade")) / name
    try:
        for file, checksum in known["sha256"].items():
            pooch.retrieve(
                known["url"] + file,
                known_hash=f"sha256:{checksum}",
                fname=Path(file).name,
                path=cache / Path(file).parent,
                downloader=download,
            )
    except (OSError, ValueError) as error:
        wanted = looked_in or cache
        raise UserError(
            f"The data set {name} could not be fetched ({type(error).__name__}). Put its files "
            f"({', '.join(list(known['sha256'])[:2])}, …) into {wanted}"
            + ("." if looked_in is None else f", where {DATA_VARIABLE} points.")
        ) from error
    return cache
