"""`transfer.npz`: visibility and form factors at a proxy's vertices, and interpolation to a mesh's."""

from __future__ import annotations

from dataclasses import dataclass, fields
from pathlib import Path
from zipfile import BadZipFile

import numpy as np
import scipy.sparse as sp

from pipeline import UserError

MATRICES = ("form_factors", "behind")


@dataclass(frozen=True, eq=False)
class StoredTransfer:
    """As the `transfer` stage leaves it; P vertices of a proxy stand for V of the mesh with short edges.

    Attributes
    ----------
    blocked : ndarray, shape (P, K), float32
        What a vertex lacks of the open sky's ν, per harmonic.
    normals : ndarray, shape (P, 3), float32
        Unit, world axes.
    form_factors, behind : csr_array, shape (P, P), float32
        Shares of what a vertex sees instead of the sky: fronts, backs.
    corners : ndarray, shape (V, 3), int32
    weights : ndarray, shape (V, 3), float32
        Every vertex of the mesh with short edges as a blend of the proxy's.
    longest_edge : ndarray, shape (), float64
        What makes that mesh of the mesh itself again, model units.
    vertices : ndarray, shape (P, 3), float64
        Of the proxy, world.
    faces : ndarray, shape (F, 3), int32
        Of the proxy.
    probes : ndarray, shape (P, 3), float64
        Where rays from its vertices begin, world.
    directions : ndarray, shape (), int64
        M, directions that light is looked for in.
    centre : ndarray, shape (3,), float64
        Of the spheres that light may come from, world.
    radii : ndarray, shape (D,), float64
        Of these spheres, model units; infinite: light from far away.
    visible : ndarray, shape (D, P, ⌈M/8⌉), uint8
        Which of the directions each vertex sees the sphere in: a bit each, the first in the highest bit.
    """

    blocked: np.ndarray
    normals: np.ndarray
    form_factors: sp.csr_array
    behind: sp.csr_array
    corners: np.ndarray
    weights: np.ndarray
    longest_edge: np.ndarray
    vertices: np.ndarray
    faces: np.ndarray
    probes: np.ndarray
    directions: np.ndarray
    centre: np.ndarray
    radii: np.ndarray
    visible: np.ndarray


def write_transfer(path: Path, transfer: StoredTransfer) -> None:
    """Write the transfer uncompressed: form factors hardly shrink."""
    arrays = {field.name: getattr(transfer, field.name) for field in fields(transfer)}
    for name in MATRICES:
        matrix = arrays.pop(name)
        for part in ("data", "indices", "indptr"):
            arrays[f"{name}_{part}"] = getattr(matrix, part)
    np.savez(path, **arrays)


def read_transfer(path: Path) -> StoredTransfer:
    """Read what `write_transfer` wrote.

    Raises
    ------
    UserError
        The file holds something else.
    """
    try:
        with np.load(path, allow_pickle=False) as file:
            arrays = {name: file[name] for name in file.files}
        count = len(arrays["blocked"])
        for name in MATRICES:
            parts = tuple(arrays.pop(f"{name}_{part}") for part in ("data", "indices", "indptr"))
            arrays[name] = sp.csr_array(parts, shape=(count, count))
        return StoredTransfer(**arrays)
    except (OSError, EOFError, BadZipFile, ValueError, KeyError, TypeError) as error:
        raise UserError(
            f"{path} cannot be read as transfer vectors ({type(error).__name__}: {error}); expected "
            "transfer.npz as in cache/transfer/KEY."
        ) from error
