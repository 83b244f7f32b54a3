"""`lighting.json`: the light of every view and channel, with all that gives its numbers a meaning."""

from __future__ import annotations

import json
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from pipeline import json_text
from stages.scene.cameras import Camera
from stages.scene.upright import vertical_of

CONVENTION = (
    "shading = sum over k of light[k] (A_l / pi) Y_k(n), image = albedo * shading, linear; Y_k: real "
    "orthonormal spherical harmonics without Condon-Shortley phase, ordered by (l, m), of the normal in "
    "world axes; A_0 = pi, A_1 = 2 pi / 3, A_2 = pi / 4, A_3 = 0, A_4 = -pi / 24, A_5 = 0, A_6 = pi / 64"
)
BY_TRANSFER = (
    "; instead of (A_l / pi) Y_k(n), which is for points that see the whole sky, the transfer vector of the "
    "point: (1 / pi) times the integral of V max(0, n.w) Y_k(w), and what bounces from other surface"
)
BY_DIRECTIONS = (
    "shading = gain[view] * 4 * sum over the directions d of cells[d] V_d max(0, n.w_d) radiance[light of "
    "the view][d], plus what bounces from other surface, image = albedo * shading, linear; cells: share of "
    "all directions that each stands for; V_d: whether the point sees direction d; n: normal in world axes. "
    "Where the light is not infinitely far, w_d points from the surface to centre + distance * direction, "
    "and the light falls with the square of the way and the angle there"
)
GAUGE = "in each channel the sum of |albedo| equals the sum of |image| over all masked pixels"
BY_SHADING = "in each channel the mean of shading over all masked pixels is 1"
BY_REFERENCES = "albedo is reflectance, by cards or charts in photos (calibration.json)"
ABSOLUTE = "none: the light is in the unit of the images, as it was given"


def write_lighting(
    path: Path, cameras: list[Camera], light: np.ndarray, image_scale: float, by_transfer: bool = False
) -> None:
    """Write the light of every view.

    Parameters
    ----------
    path : Path
    cameras : list of Camera
        n views.
    light : ndarray, shape (n, 3, K)
        σ per view and channel (red, green, blue).
    image_scale : float
        What the images were divided by while the energy was minimised; albedo and shading are free of it.
    by_transfer : bool
        Whether the light meets transfer vectors rather than ν of the normal.
    """
    content = {
        "convention": CONVENTION + BY_TRANSFER * by_transfer,
        "gauge": GAUGE,
        "image_scale": image_scale,
        "world_up": vertical_of(cameras).tolist(),
        "views": [
            {"name": camera.name, **dict(zip(("red", "green", "blue"), sigma.tolist(), strict=True))}
            for camera, sigma in zip(cameras, light, strict=True)
        ],
    }
    path.write_text(json_text(content, indent=1) + "\n", encoding="utf-8")


@dataclass(frozen=True, eq=False)
class LightAround:
    """Light from all around.

    Attributes
    ----------
    directions : ndarray, shape (M, 3)
        Unit, world axes.
    cells : ndarray, shape (M,)
        Share of all directions that each stands for; together 1.
    radiance : ndarray, shape (G, M, 3)
        Of every light from every direction.
    light_of_view : ndarray, shape (n,)
        Which of the lights each view stands in.
    gains : ndarray, shape (n, 3)
        Of every view and channel.
    centre, radius : ndarray, shape (3,), float
        The sphere that it comes from, world; infinite: from far away.
    """

    directions: np.ndarray
    cells: np.ndarray
    radiance: np.ndarray
    light_of_view: np.ndarray
    gains: np.ndarray
    centre: np.ndarray
    radius: float


def write_light_around(
    path: Path, cameras: list[Camera], light: LightAround, image_scale: float, absolute: bool = False
) -> None:
    """Write light from all around.

    Parameters
    ----------
    path : Path
    cameras : list of Camera
        n views.
    light : LightAround
    image_scale : float
        As for `write_lighting`.
    absolute : bool
        Whether the light is in the unit of the photos.
    """
    names = [camera.name for camera in cameras]
    views = zip(names, light.light_of_view.tolist(), light.gains.tolist(), strict=True)
    content = {
        "convention": BY_DIRECTIONS,
        "gauge": ABSOLUTE if absolute else BY_SHADING,
        "image_scale": image_scale,
        "world_up": vertical_of(cameras).tolist(),
        "centre": light.centre.tolist(),
        "distance": light.radius if np.isfinite(light.radius) else None,
        "directions": light.directions.tolist(),
        "cells": light.cells.tolist(),
        "radiance": light.radiance.tolist(),
        "views": [{"name": name, "light": number, "gain": gain} for name, number, gain in views],
    }
    path.write_text(json_text(content) + "\n", encoding="utf-8")


def calibrated_lighting(text: str, factors: np.ndarray) -> str:
    """Rewrite a `lighting.json` for an albedo that was multiplied by a factor per channel, (3,).

    The light is divided by them.
    """
    content = json.loads(text)
    if "radiance" in content:
        content["radiance"] = (np.array(content["radiance"]) / factors).tolist()
        content["gauge"] = BY_REFERENCES
        return json_text(content) + "\n"
    for view in content["views"]:
        for channel, factor in zip(("red", "green", "blue"), factors, strict=True):
            view[channel] = (np.array(view[channel]) / factor).tolist()
    content["gauge"] = BY_REFERENCES
    return json_text(content, indent=1) + "\n"
