"""Correspondences on disk: a sparse matrix per pair of views, and `index.json` that names them."""

from __future__ import annotations

import json
from pathlib import Path

import scipy.sparse as sp

from pipeline import UserError


def read_links(folder: Path) -> dict[tuple[str, str], sp.csr_array]:
    """What the `correspondence` stage wrote, by the names of the two views.

    Raises
    ------
    UserError
        The folder holds something else.
    """
    try:
        rows = json.loads((folder / "index.json").read_text(encoding="utf-8"))
        return {(row["i"], row["j"]): sp.csr_array(sp.load_npz(folder / row["file"])) for row in rows}
    except (OSError, ValueError, KeyError, TypeError) as error:
        raise UserError(
            f"{folder} cannot be read as correspondences ({type(error).__name__}: {error}); expected "
            "index.json and its matrices, as in cache/correspondence/KEY/correspondences."
        ) from error
