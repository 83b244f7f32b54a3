"""Arrays by number in a folder, so that a stage need not hold all views at once."""

from __future__ import annotations

from collections.abc import Iterator, MutableMapping
from io import BytesIO
from pathlib import Path

import numpy as np


class ArrayStore(MutableMapping[int, np.ndarray]):
    """A mapping of int to ndarray whose values are ``.npy`` files; reading gives a fresh copy."""

    def __init__(self, folder: Path) -> None:
        self._folder = folder
        folder.mkdir(parents=True, exist_ok=True)

    def _file(self, number: object) -> Path:
        return self._folder / f"{number}.npy"

    def __getitem__(self, number: int) -> np.ndarray:
        if number not in self:
            raise KeyError(number)
        return np.load(self._file(number), allow_pickle=False)

    def __setitem__(self, number: int, array: np.ndarray) -> None:
        buffer = BytesIO()  # numpy does not notice when a disk takes less than the end of what it writes
        np.save(buffer, array, allow_pickle=False)
        self._file(number).write_bytes(buffer.getbuffer())

    def __delitem__(self, number: int) -> None:
        if number not in self:
            raise KeyError(number)
        self._file(number).unlink()

    def __contains__(self, number: object) -> bool:
        return self._file(number).is_file()

    def __iter__(self) -> Iterator[int]:
        return iter(sorted(int(file.stem) for file in self._folder.glob("*.npy")))

    def __len__(self) -> int:
        return sum(1 for _ in self)
