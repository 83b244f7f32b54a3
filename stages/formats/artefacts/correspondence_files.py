"""Correspondences on disk: a sparse matrix per pair of views, and `index.json` that names them."""

from __future__ import annotations

import json
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any
from zipfile import ZIP_DEFLATED, BadZipFile, ZipFile

import numpy as np
import scipy.sparse as sp

from pipeline import UserError
from stages.scene.cameras import Camera


def read_correspondences(folder: Path) -> dict[tuple[str, str], sp.csr_array]:
    """Read the matrices of the `correspondence` stage, by the names of the two views.

    Raises
    ------
    UserError
        The folder holds something else.
    """
    with _refused(folder):
        return {
            (row["i"], row["j"]): sp.csr_array(sp.load_npz(folder / row["file"])) for row in _index(folder)
        }


def link_count(folder: Path) -> int:
    """Sum the links of all pairs, without opening the matrices.

    Raises
    ------
    UserError
        The folder holds something else.
    """
    with _refused(folder):
        return sum(int(row["links"]) for row in _index(folder))


def _index(folder: Path) -> list[dict[str, Any]]:
    return json.loads((folder / "index.json").read_text(encoding="utf-8"))


@contextmanager
def _refused(folder: Path) -> Iterator[None]:
    """Turn what cannot be read into a sentence."""
    try:
        yield
    except (OSError, EOFError, BadZipFile, ValueError, KeyError, TypeError) as error:
        raise UserError(
            f"{folder} cannot be read as correspondences ({type(error).__name__}: {error}); expected "
            "index.json and its matrices, as in cache/correspondence/KEY/correspondences."
        ) from error


def write_matrix(path: Path, matrix: sp.csr_array) -> None:
    """Write a matrix as `scipy.sparse.save_npz` does, for `load_npz`; compressed in a seventh of the time.

    Indices of neighbours differ by little: the fastest compression leaves no more of them than the best.
    """
    parts = {
        "indices": matrix.indices,
        "indptr": matrix.indptr,
        "format": np.array(b"csr"),
        "shape": np.array(matrix.shape),
        "data": matrix.data,
        "_is_array": np.array(True),
    }
    with ZipFile(path, "w", ZIP_DEFLATED, compresslevel=1) as archive:
        for name, array in parts.items():
            with archive.open(f"{name}.npy", "w", force_zip64=True) as file:
                np.lib.format.write_array(file, array, allow_pickle=False)


@dataclass(frozen=True, eq=False)
class CorrespondenceFiles:
    """The matrices by the indices of the two cameras, not opened: only those that hold links.

    An empty matrix takes a number per row, and of many views most see nothing of most others.

    Attributes
    ----------
    folder : Path
    rows : mapping of (i, j), i < j, to (str, int)
        File and number of links of every pair.
    views : int
        n, the number of cameras.
    """

    folder: Path
    rows: Mapping[tuple[int, int], tuple[str, int]]
    views: int

    @classmethod
    def of(cls, folder: Path, cameras: Sequence[Camera]) -> CorrespondenceFiles:
        """Read the index.

        Raises
        ------
        UserError
            The folder holds something else.
        """
        number = {camera.name: i for i, camera in enumerate(cameras)}
        with _refused(folder):
            return cls(
                folder,
                {
                    (number[row["i"]], number[row["j"]]): (row["file"], int(row["links"]))
                    for row in _index(folder)
                    if row["links"]
                },
                len(cameras),
            )

    @property
    def pairs(self) -> list[tuple[int, int]]:
        """Pairs of views that have links."""
        return list(self.rows)

    def read(self, i: int, j: int) -> sp.csr_array:
        """Read the matrix of a pair: C_ij of Eq. 18.

        Raises
        ------
        UserError
            The file is none.
        """
        with _refused(self.folder):
            return sp.csr_array(sp.load_npz(self.folder / self.rows[i, j][0]))

    def counts(self) -> sp.csr_array:
        """Tabulate the number of links between two views, (n, n), symmetric."""
        pairs = np.array(self.pairs, np.int64).reshape(-1, 2)
        links = np.array([count for _, count in self.rows.values()], np.int64)
        above = sp.csr_array((links, (pairs[:, 0], pairs[:, 1])), shape=(self.views, self.views))
        return sp.csr_array(above + above.T)


def numbered_correspondences(folder: Path, cameras: Sequence[Camera]) -> dict[tuple[int, int], sp.csr_array]:
    """Read all matrices that hold links, by the indices of the two cameras."""
    files = CorrespondenceFiles.of(folder, cameras)
    return {(i, j): files.read(i, j) for i, j in files.pairs}
