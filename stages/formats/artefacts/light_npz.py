"""`light.npz`: the light that was found, for the stages that go on from it."""

from __future__ import annotations

from dataclasses import dataclass, fields
from pathlib import Path
from zipfile import BadZipFile

import numpy as np

from pipeline import UserError
from stages.formats.artefacts.lighting_json import LightAround


@dataclass(frozen=True, eq=False)
class StoredLight:
    """As the `lighting` stage leaves it.

    Attributes
    ----------
    around : LightAround
    image_scale : float
        What the images were divided by: light and shading are of the scaled images.
    mean_shading : ndarray, shape (3,)
        By the unit of the light, per channel: 1 unless it is that of the photos, which is known then.
    specular_strength : ndarray, shape (3,)
        What the surface's mirror adds of the light, per channel; 0 where no specular reflection was found.
    specular_roughness : float
        α of GGX; 0 where no specular reflection was found.
    glossy : float
        How far there may be gloss of some paints, 0 to 1: they were found, or could not be looked for.
    trusted : bool
        Whether there were trusted pixels; if there were none, all had to do, and the albedo is a guess.
    brightest : float
        What the brightest material reflects, as far as that was found or given; 0 where it was not.
    """

    around: LightAround
    image_scale: float
    mean_shading: np.ndarray
    specular_strength: np.ndarray
    specular_roughness: float
    glossy: float
    trusted: bool
    brightest: float


def write_light(path: Path, light: StoredLight) -> None:
    """Write the light, uncompressed."""
    around = {field.name: getattr(light.around, field.name) for field in fields(LightAround)}
    own = {field.name: getattr(light, field.name) for field in fields(StoredLight) if field.name != "around"}
    np.savez(path, **around, **own)


def read_light(path: Path) -> StoredLight:
    """Read what `write_light` wrote.

    Raises
    ------
    UserError
        The file holds something else.
    """
    try:
        with np.load(path, allow_pickle=False) as file:
            return StoredLight(
                around=LightAround(
                    directions=file["directions"],
                    cells=file["cells"],
                    radiance=file["radiance"],
                    light_of_view=file["light_of_view"],
                    gains=file["gains"],
                    centre=file["centre"],
                    radius=file["radius"].item(),
                ),
                image_scale=file["image_scale"].item(),
                mean_shading=file["mean_shading"],
                specular_strength=file["specular_strength"],
                specular_roughness=file["specular_roughness"].item(),
                glossy=file["glossy"].item(),
                trusted=file["trusted"].item(),
                brightest=file["brightest"].item(),
            )
    except (OSError, EOFError, BadZipFile, ValueError, KeyError, TypeError) as error:
        raise UserError(
            f"{path} cannot be read as light ({type(error).__name__}: {error}); expected light.npz as in "
            "cache/lighting/KEY."
        ) from error
