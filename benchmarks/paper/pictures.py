"""Figures 3 to 7: image, truth and every method's albedo of three views, and the light on a sphere."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from benchmarks.paper.judging import Judge
from benchmarks.paper.methods import Estimate
from stages.evaluation.judged_views import CHANNELS
from stages.formats.images.contact_sheet import contact_sheet
from stages.formats.images.photos import encode_srgb8
from stages.photometry.paper.harmonics import shading_basis


def figure(
    judge: Judge,
    estimates: Sequence[Estimate],
    shown: Sequence[float] = (0, 0.5, 1),
    width_px: int = 220,
) -> np.ndarray:
    """Draw one row per view, one column per method, (h, w, 3) uint8 sRGB; albedo scaled to the truth.

    `shown` gives the relative positions of the views: 0 the first, 1 the last.
    """
    names = [judge.names[int(place * (len(judge.names) - 1))] for place in shown]
    exposure = 1 / np.percentile(np.concatenate([judge.images[n][judge.masks[n]] for n in judge.names]), 99.5)
    rows = {
        name: [
            encode_srgb8(judge.images[name] * exposure * judge.masks[name][..., None]),
            encode_srgb8(judge.true_albedo(name) * judge.masks[name][..., None]),
            *(encode_srgb8(fitted(estimate, name) * judge.masks[name][..., None]) for estimate in estimates),
            *(light_on_a_sphere(estimate, name, width_px) for estimate in estimates if estimate.light),
        ]
        for name in names
    }
    lights = [f"light, {estimate.method}" for estimate in estimates if estimate.light]
    return contact_sheet(rows, ["photo", "truth", *(e.method for e in estimates), *lights], width_px)


def fitted(estimate: Estimate, name: str) -> np.ndarray:
    """Scale a view's albedo as for si-RMSE: one factor per channel for all views."""
    return estimate.albedo[name] * np.array(estimate.scores.si_rmse_scales, np.float32)


def light_on_a_sphere(estimate: Estimate, name: str, width_px: int) -> np.ndarray:
    """Render the shading σ·ν of a white sphere in a view's light, from the front (−y), z up; maximum 1."""
    x, z = np.meshgrid(np.linspace(-1.05, 1.05, width_px), np.linspace(1.05, -1.05, width_px))
    inside = x * x + z * z < 1
    normals = np.stack([x, -np.sqrt(np.maximum(1 - x * x - z * z, 0)), z], axis=-1)[inside]
    light = np.array([_of_view(estimate.light, name)[channel] for channel in CHANNELS])
    ball = np.zeros((width_px, width_px, 3))
    ball[inside] = np.maximum(shading_basis(normals) @ light.T, 0)
    return encode_srgb8(ball / max(float(ball.max()), 1e-9))


def _of_view(light: list[dict[str, Any]], name: str) -> dict[str, Any]:
    return next(view for view in light if view["name"] == name)
