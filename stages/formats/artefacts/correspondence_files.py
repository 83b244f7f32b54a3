"""Correspondences on disk: a sparse matrix per pair of views, and `index.json` that names them."""

from __future__ import annotations

import json
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Any
from zipfile import BadZipFile

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


def numbered_correspondences(folder: Path, cameras: Sequence[Camera]) -> dict[tuple[int, int], sp.csr_array]:
    """Read them by the indices of the two cameras: C_ij of Eq. 18; only those that hold links.

    An empty matrix takes a number per row, and of many views most see nothing of most others.
    """
    index = {camera.name: i for i, camera in enumerate(cameras)}
    return {
        (index[i], index[j]): block for (i, j), block in read_correspondences(folder).items() if block.nnz
    }
