"""The albedo's detail: what the photo shows beyond a smooth albedo, but for what the light could have done.

Per octave and colour axis, a Wiener filter: what is left over, against how far the shading is to be doubted.
"""

from __future__ import annotations

from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from stages.photometry.albedo_data import UNLIT
from stages.photometry.detail.detail_octaves import (
    AXES,
    QUOTIENT,
    DetailOctave,
    DetailScene,
    DetailSettings,
    channels_of,
    noise_without_others,
)
from stages.photometry.detail.octaves import response_to_noise
from stages.photometry.detail.shading_uncertainty import DARK, ShadingUncertainty
from stages.photometry.stack import StackedViews

MEASURED = 2  # octaves in which views are compared for noise; in coarser ones it is white
LINKED = 0.2  # share of the pixels that other views must see for their differences to tell the noise
AROUND_PX = 1.5  # σ of the surroundings whose differences are told of a pixel
LEFT_OVER = 0.25  # of the square of what the smooth albedo leaves over: expected to be wrong, kept or not
LEAST_RESPONSE = 0.1  # of a pixel's logarithm to light: what is darker is as doubtful as that
OF_CHANGE = 0.05  # of the square of the shading's change in every octave: what its error is where it is large


@dataclass(frozen=True, eq=False)
class Detail:
    """What comes back.

    Attributes
    ----------
    albedo : ndarray, shape (N, 3), float32
    variance : ndarray, shape (N,), float32
        Of the albedo's mean logarithm, that is expected: its square root is the relative error.
    doubt : ShadingUncertainty
    """

    albedo: np.ndarray
    variance: np.ndarray
    doubt: ShadingUncertainty


def with_detail(
    views: StackedViews,
    albedo: np.ndarray,
    image: np.ndarray,
    shading: np.ndarray,
    trusted: np.ndarray,
    settings: DetailSettings,
) -> Detail:
    """Give a smooth albedo the detail that the photo has and the light cannot have made.

    Parameters
    ----------
    views : StackedViews
    albedo : ndarray, shape (N, 3)
        As far as it is known by smoothness and other views.
    image, shading : ndarray, shape (N, 3)
        Scaled, without gloss.
    trusted : ndarray, shape (N,), bool
        Pixels whose data count. The others have the detail that is kept of their surface in other views; what
        no other view shows keeps its albedo.
    settings : DetailSettings

    Notes
    -----
    ``ρ + (ρ + d/S) (exp(Σ_k g_k r_k) − 1)``: r = log (I + d)/(ρ S + d), d = 0.01, as mean logarithm, log R/G
    and log B/G, divided into octaves r_k; I/S where all g_k are 1. In every octave:

    1. Of brightness, in the four finest octaves, the shading's own change is taken for as much as the photos
       show of it, `ShownChange`.
    2. r_k of the other views is averaged in, as far as noise is more than what views see misplaced.
    3. ``g_k = max(0, 1 − U/E)``: E the local variance of r_k, by the mean of |r_k|^1.5, U that of
       what noise and the shading's error, ``κ² L²``, make of it (`ShadingUncertainty`).
    4. Beyond ``2 L²``, which a shadow in the wrong place can make, all of E may be paint; below, no more than
       hardly any surface has where light is even.

    Where the photo differs from the smooth albedo by no more than doubt, the smooth albedo stands; where by
    much more, the photo divided by its shading does; between, by degrees.

    The variance adds up what is expected of every octave, ``g² U + (1 − g)² E``; of the light where it
    changes much, a twentieth of L²; a quarter of the square of what the smooth albedo left over around; and
    what the albedos of different views differ by.
    """
    light = np.maximum(shading, UNLIT * max(float(np.median(shading)), 1e-6))
    detailed = np.maximum(albedo, 0).astype(np.float32)
    explained = detailed * light
    scene = DetailScene(views, image, light, explained, trusted, settings)
    kept, variance, doubt = _kept(scene)
    told, known = scene.others.lent(np.column_stack([kept, variance]))
    added = (explained + DARK) * np.expm1(channels_of(told[:, :3])) / light
    detailed = np.where(known[:, None], np.maximum(detailed + added, 0), detailed).astype(np.float32)
    variance = told[:, 3] / np.maximum(scene.response, LEAST_RESPONSE) ** 2
    return Detail(detailed, (variance + _apart(scene, detailed)).astype(np.float32), doubt)


def _apart(scene: DetailScene, albedo: np.ndarray) -> np.ndarray:
    """Mean square of what the logarithm of the albedo differs by from that of other views, around, (N,).

    Where no other view sees the surface, as much as elsewhere: that nobody contradicts is no proof.
    """
    logs = np.log(albedo.mean(axis=1, keepdims=True) + DARK).astype(np.float32)
    seen = scene.others.count > 0
    if not seen.any():
        return np.zeros(len(albedo), np.float32)
    difference = np.where(seen, (logs - scene.others.mean(logs))[:, 0], 0)
    apart = scene.seen_by_others.mean(difference**2, AROUND_PX)
    return np.where(seen, apart, apart[seen].mean())


def _kept(scene: DetailScene) -> tuple[np.ndarray, np.ndarray, ShadingUncertainty]:
    """What of the three axes is albedo, (N, 3), its expected variance, and the doubt."""
    settings = scene.settings
    noise = np.zeros((MEASURED, 3))
    if scene.others.share < LINKED:
        noise[:] = noise_without_others(scene)
    kept = np.zeros((len(scene.maps), 3), np.float32)
    variance = settings.level**2 + LEFT_OVER * scene.pixels.mean(scene.maps[:, 0] ** 2, AROUND_PX)
    shown, of_change = [], []
    octaves = enumerate(pairwise(scene.pixels.octaves(scene.maps)))
    for number, ((bands, sigma_px), (coarser, _)) in octaves:
        octave = DetailOctave.of(scene, number, bands, sigma_px)
        shown.append(octave.shown)
        of_change.append(
            float(np.clip(octave.error_of_change(), settings.least_doubt[number], settings.most_doubt))
        )
        if number < MEASURED and scene.others.share >= LINKED:
            noise[number] = octave.noise(coarser[:, QUOTIENT]) / response_to_noise()[number]
        deviation = noise[number] if number < MEASURED else noise.max(axis=0)
        own, expected = octave.kept(of_change[-1], deviation * response_to_noise()[number])
        kept += own
        variance += expected + OF_CHANGE * octave.stated
        rest = coarser[:, AXES]
    kept += rest * _share_of_signal(rest**2, (settings.level * settings.of_axes) ** 2)
    doubt = ShadingUncertainty(tuple(shown), tuple(of_change), tuple(noise.max(axis=0).tolist()))
    return kept, variance, doubt


def _share_of_signal(energy: np.ndarray, doubted: np.ndarray) -> np.ndarray:
    """Share of a value that is signal: its variance without the doubt's, over all of it."""
    return np.maximum(0, 1 - doubted / np.maximum(energy, 1e-12)).astype(np.float32)
