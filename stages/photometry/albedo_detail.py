"""The albedo's detail: what the photo shows beyond a smooth albedo, but for what the light could have done.

Per octave and colour axis, a Wiener filter: what is left over, against how far the shading is to be doubted.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from stages.photometry.observations import UNLIT
from stages.photometry.octaves import gaussian_mean, octaves
from stages.photometry.shading_doubt import (
    DARK,
    Evidence,
    ShadingDoubt,
    grain_of,
    log_quotient,
    log_shading,
    shading_doubt,
)
from stages.photometry.stack import StackedViews
from stages.scene.view_files import image_of

STRONGEST = 1.0  # of the logarithm: what differs by more (glints, shadows that are not there) is cut to this
OF_NORMAL = 2 / np.pi  # square of the mean size of normal deviates of variance 1: lone borders count for less
CHROMA_NOISE = 6.0  # variance of log R/G and log B/G over that of the mean logarithm, for equal noise in all


@dataclass(frozen=True)
class DetailSettings:
    """How far the shading may be doubted; see the settings of the stage.

    Attributes
    ----------
    least_doubt : tuple of float
        Per octave, share of the shading's own change.
    most_doubt : float
        In all octaves.
    chroma : float
        Of that, what its colour may be wrong by.
    level : float
        What is coarser than all octaves may be wrong by, of the logarithm.
    window : float
        σ of the surroundings that energies are averaged over, in σ of the octave.
    """

    least_doubt: tuple[float, ...]
    most_doubt: float
    chroma: float
    level: float
    window: float


def with_detail(
    views: StackedViews,
    albedo: np.ndarray,
    image: np.ndarray,
    shading: np.ndarray,
    trusted: np.ndarray,
    settings: DetailSettings,
) -> tuple[np.ndarray, ShadingDoubt]:
    """Give a smooth albedo the detail that the photo has and the light cannot have made.

    Parameters
    ----------
    views : StackedViews
    albedo : ndarray, shape (N, 3)
        As far as it is known by smoothness and other views.
    image, shading : ndarray, shape (N, 3)
        Scaled, without gloss.
    trusted : ndarray, shape (N,), bool
        Pixels whose data count; the others keep their albedo.
    settings : DetailSettings

    Returns
    -------
    tuple of ndarray, shape (N, 3), float32, and ShadingDoubt

    Notes
    -----
    ``ρ + (ρ + d/S) (exp(Σ_k g_k r_k) − 1)``: r = log (I + d)/(ρ S + d), d = 0.01, as mean logarithm, log R/G
    and log B/G, divided into octaves r_k; I/S where all g_k are 1;
    ``g_k = max(0, 1 − U/E)``, E the local variance of r_k, by its mean size, and U that of what noise and the
    shading's error make of it, `ShadingDoubt`. Where the photo differs from the smooth albedo by no more than
    doubt, the smooth albedo stands; where by much more, the photo divided by its shading does; between, by
    degrees.
    """
    light = np.maximum(shading, UNLIT * max(float(np.median(shading)), 1e-6))
    detailed = np.maximum(albedo, 0).astype(np.float32)
    explained = detailed * light
    axes = _axes_of(np.clip(log_quotient(image, explained), -STRONGEST, STRONGEST))
    evidence = Evidence(
        quotient=log_quotient(image, light).mean(axis=1),
        left=axes[:, 0],
        lit=log_shading(light),
        response=(explained / (explained + DARK)).mean(axis=1),
        grain=grain_of(explained),
        trusted=trusted,
    )
    doubt = shading_doubt(views, evidence, settings.least_doubt, settings.most_doubt)
    for view, mask in enumerate(views.masks):
        own = views.view(view)
        weight = image_of(mask, trusted[own].astype(np.float32))
        known = (image_of(mask, each[own]) for each in (evidence.lit, evidence.response, evidence.grain))
        left = image_of(mask, axes[own]) * weight[..., None]
        kept = _channels_of(_kept_of_view(left, *known, weight, doubt, settings)[mask])
        added = (explained[own] + DARK) * np.expm1(kept) / light[own]
        detailed[own] = np.maximum(detailed[own] + added, 0)
    return detailed, doubt


def _kept_of_view(
    left: np.ndarray,
    lit: np.ndarray,
    response: np.ndarray,
    grain: np.ndarray,
    weight: np.ndarray,
    doubt: ShadingDoubt,
    settings: DetailSettings,
) -> np.ndarray:
    """What of the three axes of a view, (h, w, 3), is albedo."""
    shares = np.array([1.0, settings.chroma, settings.chroma], np.float32)
    noises = np.array([1.0, CHROMA_NOISE, CHROMA_NOISE], np.float32)
    kept = np.zeros_like(left)
    bands = zip(octaves(left, weight), octaves(lit * weight, weight), strict=True)
    for octave, ((band, sigma_px), (change, _)) in enumerate(bands):
        if not np.isfinite(sigma_px):
            doubted = (settings.level * shares) ** 2
            kept += band * _wiener(band**2, doubted)
            continue
        local = gaussian_mean((change * response) ** 2, weight, max(sigma_px, 1.0))
        error = doubt.error(octave, local)[..., None] * shares**2
        error += (doubt.noise_in(octave) * grain[..., None]) ** 2 * noises
        wide_px = max(settings.window * sigma_px, 1.5)
        typical, doubted = (
            gaussian_mean(each * weight[..., None], weight, wide_px) for each in (np.abs(band), error)
        )
        kept += band * _wiener(typical**2 / OF_NORMAL, doubted)
    return kept


def _wiener(energy: np.ndarray, doubted: np.ndarray) -> np.ndarray:
    """Share of a value that is signal: its variance without the doubt's, over all of it."""
    return np.maximum(0, 1 - doubted / np.maximum(energy, 1e-12)).astype(np.float32)


def _axes_of(logs: np.ndarray) -> np.ndarray:
    """Mean logarithm, log R/G and log B/G of the channels' logarithms, (N, 3)."""
    red, green, blue = logs.T
    return np.stack([logs.mean(axis=1), red - green, blue - green], axis=1)


def _channels_of(axes: np.ndarray) -> np.ndarray:
    """The way back from `_axes_of`."""
    mean, red, blue = axes.T
    green = mean - (red + blue) / 3
    return np.stack([green + red, green, green + blue], axis=1)
