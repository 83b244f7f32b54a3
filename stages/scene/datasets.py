"""Public photo sets by name: read from `UNSHADE_DATA`, else fetched once; checksums are always verified."""

from __future__ import annotations

import hashlib
import json
import os
from collections.abc import Mapping
from dataclasses import dataclass
from importlib.resources import files
from pathlib import Path

from pipeline import UserError
from pipeline.settings import near

DATA_VARIABLE = "UNSHADE_DATA"
UNFINISHED = "tmp*"  # what an interrupted download leaves: pooch names a file only when it is verified


@dataclass(frozen=True)
class Dataset:
    """A published set of files whose content is known, wherever it is.

    Attributes
    ----------
    name, url : str
    folder : Path
        Where its files are or will be.
    given : bool
        Whether the folder is the user's (`UNSHADE_DATA`), where nothing is fetched.
    sha256, blake3 : mapping of str to str
        Checksum, and digest as in keys, of each file by path below the folder.
    """

    name: str
    url: str
    folder: Path
    given: bool
    sha256: Mapping[str, str]
    blake3: Mapping[str, str]

    def digests(self, part: str) -> dict[str, str]:
        """List the digests of the files in a subfolder, by path below it."""
        inside = f"{part}/"
        return {
            name.removeprefix(inside): digest
            for name, digest in self.blake3.items()
            if name.startswith(inside)
        }

    def is_here(self) -> bool:
        """Check whether every file is there and has its checksum.

        Raises
        ------
        UserError
            A file in the user's own folder is missing or is another.
        """
        faults = (fault for name in self.sha256 if (fault := self._fault(name)))
        fault = next(faults, None)
        if fault is not None and self.given:
            raise UserError(f"{fault}, or unset {DATA_VARIABLE} to fetch the data set.")
        return fault is None

    def _fault(self, name: str) -> str | None:
        """Describe what is wrong with a file, and what to do; None if it is as published."""
        path, expected = self.folder / name, self.sha256[name]
        if not path.is_file():
            return f"{path} is missing; copy it there"
        found = hashlib.sha256(path.read_bytes()).hexdigest()
        if found == expected:
            return None
        return (
            f"{path} has the checksum {found[:12]}…, expected {expected[:12]}…; replace it with the original"
        )

    def fetch(self) -> None:
        """Download missing files, one run at a time; each is verified before it gets its name.

        Raises
        ------
        UserError
            They cannot be fetched. Files that came before are kept.
        """
        import pooch
        from filelock import FileLock

        pooch.get_logger().setLevel("WARNING")
        try:
            self.folder.mkdir(parents=True, exist_ok=True)
            with FileLock(self.folder / ".lock"):
                for left in self.folder.rglob(UNFINISHED):
                    left.unlink()
                for name, checksum in self.sha256.items():
                    path = self.folder / name
                    pooch.retrieve(
                        self.url + name,
                        known_hash=f"sha256:{checksum}",
                        fname=path.name,
                        path=path.parent,
                    )
        except (OSError, ValueError) as error:  # requests' errors are OSErrors; ValueError: another checksum
            raise UserError(
                f"The data set {self.name} is not on this machine and could not be fetched "
                f"({type(error).__name__}). Try again with a network, or put its files "
                f"({', '.join(list(self.sha256)[:2])}, …) into {self._place_for_files()}."
            ) from error

    def _place_for_files(self) -> str:
        given = os.environ.get(DATA_VARIABLE)
        return f"{Path(given, self.name)}, where {DATA_VARIABLE} points" if given else str(self.folder)


def find_dataset(name: str) -> Dataset:
    """Find a data set: in the folder that `UNSHADE_DATA` names, else in the user's cache, there or not yet.

    Raises
    ------
    UserError
        The name is unknown.
    """
    known = json.loads(files("stages.scene").joinpath("datasets.json").read_text(encoding="utf-8"))
    if name not in known:
        raise UserError(f"There is no data set {name!r}; {near(name, known)}")
    given = os.environ.get(DATA_VARIABLE)
    if given and Path(given, name).is_dir():
        return Dataset(name, folder=Path(given, name), given=True, **known[name])
    import pooch

    return Dataset(name, folder=Path(pooch.os_cache("unshade")) / name, given=False, **known[name])


def dataset_folder(name: str) -> Path:
    """Find or fetch the folder that holds a data set's files, every checksum verified.

    Raises
    ------
    UserError
        The name is unknown; a file has another checksum; or the set is absent and cannot be fetched.
    """
    dataset = find_dataset(name)
    if not dataset.is_here():
        dataset.fetch()
    return dataset.folder
