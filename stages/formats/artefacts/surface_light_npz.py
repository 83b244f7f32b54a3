"""`surface_light.npz`: what lights the surface under another light, for views that are no photo's."""

from __future__ import annotations

from dataclasses import dataclass, fields
from pathlib import Path
from zipfile import BadZipFile

import numpy as np

from pipeline import UserError


@dataclass(frozen=True, eq=False)
class StoredSurfaceLight:
    """As the `relight` stage leaves it, for P vertices of the transfer's proxy.

    Attributes
    ----------
    sky : ndarray, shape (M, 3)
        Radiance from the directions of the transfer.
    indirect : ndarray, shape (P, 3), float32
        Shading of the vertices by the surface itself.
    to_absolute : float
        By which albedo is multiplied to be on the absolute scale.
    white : float
        Radiance that is white in the pictures of the relit views.
    """

    sky: np.ndarray
    indirect: np.ndarray
    to_absolute: float
    white: float


def write_surface_light(path: Path, light: StoredSurfaceLight) -> None:
    """Write it, uncompressed."""
    np.savez(path, **{field.name: getattr(light, field.name) for field in fields(light)})


def read_surface_light(path: Path) -> StoredSurfaceLight:
    """Read what `write_surface_light` wrote.

    Raises
    ------
    UserError
        The file holds something else.
    """
    try:
        with np.load(path, allow_pickle=False) as file:
            return StoredSurfaceLight(
                file["sky"], file["indirect"], file["to_absolute"].item(), file["white"].item()
            )
    except (OSError, EOFError, BadZipFile, ValueError, KeyError) as error:
        raise UserError(
            f"{path} cannot be read as the light of a surface ({type(error).__name__}: {error}); expected "
            "surface_light.npz as in cache/relight/KEY."
        ) from error
