"""Correspondences on disk: a sparse matrix per pair of views, and `index.json` that names them."""

from __future__ import annotations

import json
from collections.abc import Sequence
from pathlib import Path
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
    try:
        rows = json.loads((folder / "index.json").read_text(encoding="utf-8"))
        return {(row["i"], row["j"]): sp.csr_array(sp.load_npz(folder / row["file"])) for row in rows}
    except (OSError, EOFError, BadZipFile, ValueError, KeyError, TypeError) as error:
        raise UserError(
            f"{folder} cannot be read as correspondences ({type(error).__name__}: {error}); expected "
            "index.json and its matrices, as in cache/correspondence/KEY/correspondences."
        ) from error


def link_count(folder: Path) -> int:
    """Sum the links of all pairs, without opening the matrices."""
    rows = json.loads((folder / "index.json").read_text(encoding="utf-8"))
    return sum(int(row["links"]) for row in rows)


def numbered_correspondences(folder: Path, cameras: Sequence[Camera]) -> dict[tuple[int, int], sp.csr_array]:
    """Read them by the indices of the two cameras: C_ij of Eq. 18; only those that hold links.

    An empty matrix takes a number per row, and of many views most see nothing of most others.
    """
    index = {camera.name: i for i, camera in enumerate(cameras)}
    return {
        (index[i], index[j]): block for (i, j), block in read_correspondences(folder).items() if block.nnz
    }
