"""Pictures of light: all directions, and a white ball that stands in it."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np

from stages.formats.artefacts.lighting_json import LightAround
from stages.formats.images.exr import read_exr
from stages.formats.images.photos import encode_srgb8
from stages.reporting.content.picture_size import encode_webp
from stages.reporting.parts import light_file, write_file
from stages.reporting.settings import PictureSettings
from stages.scene.cameras import Camera
from stages.scene.upright import vertical_of

SHARED = "shared"  # name of the picture of a light that all views have


def ball(light: LightAround, number: int, viewer_axes: np.ndarray, diameter_px: int) -> np.ndarray:
    """Compute the irradiance of a white ball that sees all directions, as shading has it.

    Parameters
    ----------
    light : LightAround
    number : int
        Which of its lights.
    viewer_axes : ndarray, shape (3, 3)
        To the right, upwards, and towards the viewer, in rows; world axes.
    diameter_px : int

    Returns
    -------
    ndarray, shape (d, d, 3), float32
        4 Σ cells max(0, n·w) radiance; nan outside the ball.
    """
    along = (np.arange(diameter_px) + 0.5) / diameter_px * 2 - 1
    x, y = np.meshgrid(along, -along)
    inside = x * x + y * y < 1
    local = np.stack([x, y, np.sqrt(np.maximum(1 - x * x - y * y, 0))], axis=-1)[inside]
    cosines = np.maximum((local @ viewer_axes) @ light.directions.T, 0)
    shown = np.full((diameter_px, diameter_px, 3), np.nan, np.float32)
    shown[inside] = 4 * cosines @ (light.cells[:, None] * light.radiance[number])
    return shown


def ball_picture(shown: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Encode a ball as 8-bit sRGB, its brightest point white, and where it is, (d, d), bool."""
    inside = np.isfinite(shown[..., 0])
    white = max(float(np.nanmax(shown)), 1e-12)
    return encode_srgb8(np.nan_to_num(shown) / white), inside


def environment_picture(picture: np.ndarray, quantile: float) -> np.ndarray:
    """Encode a picture of all directions, (h, 2h, 3), linear, as 8-bit sRGB; what is brighter clips."""
    white = max(float(np.quantile(picture.max(axis=2), quantile)), 1e-12)
    return encode_srgb8(np.maximum(picture, 0) / white)


def write_lights(
    light: LightAround, cameras: list[Camera], pictures: Path, folder: Path, how: PictureSettings
) -> dict[str, Any]:
    """Write environment and ball of the lights, and describe them.

    Parameters
    ----------
    light : LightAround
    cameras : list of Camera
    pictures : Path
        Folder of pictures of all directions, EXR: one that is shared, or one per view.
    folder : Path
        Of the report's content.
    how : PictureSettings

    Returns
    -------
    dict
        `shown`: name and number of each light that is shown; `gains`: name, light and gains of each view.
    """
    names = [camera.name for camera in cameras]
    numbers = light.light_of_view.tolist()
    lights = sorted(set(numbers))
    step = max(1, -(-len(lights) // how.lights))
    shown = []
    for number in lights[::step]:
        own = [name for name, one in zip(names, numbers, strict=True) if one == number]
        file = next(
            (pictures / f"{name}.exr" for name in (SHARED, *own) if (pictures / f"{name}.exr").is_file()),
            None,
        )
        if file is not None:
            environment = environment_picture(read_exr(file), how.light_quantile)
            write_file(folder, light_file(number, "environment"), encode_webp(environment, None, how))
        picture, inside = ball_picture(ball(light, number, viewer_axes(cameras), how.ball_px))
        write_file(folder, light_file(number, "ball"), encode_webp(picture, inside, how))
        shown.append({"number": number, "views": own, "environment": file is not None})
    gains = [
        {"name": name, "light": number, "gain": gain}
        for name, number, gain in zip(names, numbers, light.gains.tolist(), strict=True)
    ]
    radius = float(light.radius) if np.isfinite(light.radius) else None
    return {"shown": shown, "gains": gains, "distance": radius}


def viewer_axes(cameras: list[Camera]) -> np.ndarray:
    """Compute the axes of one who looks as the cameras do on average, held upright, (3, 3).

    Rows: to the right, upwards, towards the viewer; world axes.
    """
    up = vertical_of(cameras)
    towards = -np.mean([camera.rotation[2] for camera in cameras], axis=0)
    towards -= (towards @ up) * up
    if np.linalg.norm(towards) < 1e-6:  # from all around: as the first
        towards = -cameras[0].rotation[2] + (cameras[0].rotation[2] @ up) * up
    towards /= max(float(np.linalg.norm(towards)), 1e-12)
    return np.stack([np.cross(up, towards), up, towards])
