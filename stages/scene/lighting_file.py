"""`lighting.json`: the light of every view and channel, with all that gives its numbers a meaning."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np

from stages.scene.cameras import Camera

CONVENTION = (
    "shading = sum over k of light[k] (A_l / pi) Y_k(n), image = albedo * shading, linear; Y_k: real "
    "orthonormal spherical harmonics without Condon-Shortley phase, ordered by (l, m), of the normal in "
    "world axes; A_0 = pi, A_1 = 2 pi / 3, A_2 = pi / 4, A_3 = 0, A_4 = -pi / 24, A_5 = 0, A_6 = pi / 64"
)
BY_TRANSFER = (
    "; instead of (A_l / pi) Y_k(n), which is for points that see the whole sky, the transfer vector of the "
    "point: (1 / pi) times the integral of V max(0, n.w) Y_k(w), and what bounces from other surface"
)
GAUGE = "in each channel the sum of |albedo| equals the sum of |image| over all masked pixels"


def mean_camera_up(cameras: list[Camera]) -> np.ndarray:
    """World up as the photographers held it: unit mean of the cameras' up (−y) axes, shape (3,)."""
    up = -np.mean([camera.rotation[1] for camera in cameras], axis=0)
    length = float(np.linalg.norm(up))
    return up / length if length > 1e-6 else -cameras[0].rotation[1]


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
        "world_up": mean_camera_up(cameras).tolist(),
        "views": [
            {"name": camera.name, **dict(zip(("red", "green", "blue"), sigma.tolist(), strict=True))}
            for camera, sigma in zip(cameras, light, strict=True)
        ],
    }
    path.write_text(json.dumps(content, indent=1) + "\n", encoding="utf-8")
