"""Detail of the albedo: the residual of a smooth albedo, filtered by the uncertainty of shading and noise.

A Wiener filter per octave and colour axis: residual energy against that of shading error and noise.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import partial
from pathlib import Path

import numpy as np

from pipeline.process.free_memory import give_back_free_memory
from stages.photometry.detail.detail_octaves import (
    AXES,
    QUOTIENT,
    TINY,
    DetailOctave,
    DetailScene,
    channels_of,
    octaves_of_views,
)
from stages.photometry.detail.octaves import response_to_noise
from stages.photometry.detail.part_of_scene import PartOfScene, whole_scene
from stages.photometry.detail.scene_statistics import (
    DetailStatistics,
    OctaveNoise,
    SampledDetail,
    SampledOctave,
    SampledViews,
    has_few_links,
)
from stages.photometry.detail.settings import DetailSettings
from stages.photometry.stack import StackedViews
from stages.solvers.kernels.arrays_in_files import in_file
from stages.solvers.kernels.pixelwise import pixelwise


@dataclass(frozen=True, eq=False)
class Detail:
    """The albedo with its detail.

    Attributes
    ----------
    albedo : ndarray, shape (N, 3), float32
    variance : ndarray, shape (N,), float32
        Expected variance of the albedo's mean logarithm; its square root is the relative error.
    sample : SampledDetail
        What the statistics of these views, or of all, are computed from.
    """

    albedo: np.ndarray
    variance: np.ndarray
    sample: SampledDetail


def with_detail(
    views: StackedViews,
    albedo: np.ndarray,
    image: np.ndarray,
    shading: np.ndarray,
    trusted: np.ndarray,
    how: DetailSettings,
    part: PartOfScene | None = None,
    known: DetailStatistics | None = None,
    folder: Path | None = None,
    gains: np.ndarray | None = None,
) -> Detail:
    """Add the photo's detail to a smooth albedo, except what noise and shading error explain.

    Parameters
    ----------
    views : StackedViews
    albedo : ndarray, shape (N, 3)
        The smooth albedo, inferred from all views.
    image, shading : ndarray, shape (N, 3)
        Scaled, without specular reflection.
    trusted : ndarray, shape (N,), bool
        Pixels with valid data. The others take the kept detail of corresponding pixels; those without
        correspondences keep the smooth albedo.
    how : DetailSettings
    part : PartOfScene or None
        What part of a scene these pixels are; None: they are all of it.
    known : DetailStatistics or None
        Of the scene; None: they are measured.
    folder : Path or None
        Where the model waits until its octaves are filtered; None: in memory.
    gains : ndarray, shape (n,), or None
        Brightness of the views, which image and shading include; None: 1.

    Notes
    -----
    ``ρ + (ρ + d/S) (exp(Σ_k g_k r_k) − 1)``: r = log (I + d)/(ρ S + d), d the offset, as mean logarithm,
    log R/G and log B/G, divided into octaves r_k; the result is I/S where all g_k are 1. In every octave:

    1. In the finest octaves, the brightness band of the shading is reduced to the change that the photos
       show (`ShownChange`).
    2. r_k is averaged with that of other views, by inverse variance of noise and misregistration.
    3. ``g_k = max(0, 1 − U/E)``: E the local variance of r_k, from the mean of |r_k|^1.5; U the variance
       expected from noise and the shading's error, ``κ² L²`` (`ShadingUncertainty`).
    4. E − U is limited where the shading changes to what evenly lit surface has (`texture_limit`).

    Where the residual does not exceed its uncertainty, the smooth albedo stays. Where it exceeds it by far,
    the albedo is I/S. The transition is gradual.

    The variance is the sum over the octaves of ``g² U + (1 − g)² E`` and of a share of L², plus a share of
    the local mean square of r, plus the variance between views.
    """
    part = part or whole_scene(shading, image, how.log_offset, how.sample_pixels)
    least = np.float32(part.typical.least_light(how.least_light))
    of_pixel = np.repeat(
        np.full(views.view_count, least) if gains is None else least * gains, np.diff(views.starts)
    )
    light, smooth, explained = in_file(pixelwise(_model, albedo, shading, of_pixel), folder)
    del of_pixel
    scene = DetailScene(views, image, light, explained, trusted, how, part, known)
    kept, variance, octaves, alone = _kept(scene)
    filled, has_value = scene.others.filled_in(np.column_stack([kept, variance]))
    add_kept = partial(_with_kept, how.log_offset)
    detailed = pixelwise(add_kept, smooth, explained, light, filled[:, :3], has_value)
    variance = filled[:, 3] / np.maximum(scene.response, how.variance.least_response) ** 2
    between, typical = _variance_between_views(scene, detailed)
    sample = SampledDetail(octaves, alone, typical, *scene.measured_and_linked)
    return Detail(detailed, (variance + between).astype(np.float32), sample)


def _model(
    albedo: np.ndarray, shading: np.ndarray, least: np.ndarray
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Bound the shading and the smooth albedo from below; returns both and their product."""
    light = np.maximum(shading, least[:, None])
    smooth = np.maximum(albedo, 0).astype(np.float32)
    return light, smooth, smooth * light


def _with_kept(
    offset: float,
    smooth: np.ndarray,
    explained: np.ndarray,
    light: np.ndarray,
    kept: np.ndarray,
    has_value: np.ndarray,
) -> np.ndarray:
    """Add what is kept of the residual to the smooth albedo, where there is any."""
    added = (explained + offset) * np.expm1(channels_of(kept)) / light
    return np.where(has_value[:, None], np.maximum(smooth + added, 0), smooth).astype(np.float32)


def _variance_between_views(scene: DetailScene, albedo: np.ndarray) -> tuple[np.ndarray, float]:
    """Average the squared difference of log albedo between views, around every pixel, (N,), and over all.

    Pixels without correspondences take the mean over all.
    """
    logs = np.log(albedo.mean(axis=1, keepdims=True) + scene.how.log_offset).astype(np.float32)
    seen = scene.others.count > 0
    typical = 0.0 if scene.known is None else scene.known.between_views
    if not seen.any():
        return np.full(len(albedo), typical, np.float32), typical
    difference = np.where(seen, (logs - scene.others.mean(logs))[:, 0], 0)
    square = scene.seen_by_others.mean_of(np.square, difference, sigma_px=scene.how.variance.window_px)
    if scene.known is None and (measured := seen & scene.part.own).any():
        typical = float(square[measured].mean())
    return np.where(seen, square, np.float32(typical)), typical


def _kept(
    scene: DetailScene,
) -> tuple[np.ndarray, np.ndarray, tuple[SampledOctave, ...], SampledViews | None]:
    """Filter the three axes: the kept albedo, (N, 3), its expected variance, (N,), and what was sampled."""
    how, limits, response = scene.how, scene.how.uncertainty, response_to_noise(scene.how.sigmas_px)
    alone = None
    if scene.known is None and has_few_links(*scene.measured_and_linked, how):
        alone = octaves_of_views(scene)
    noise = OctaveNoise.of(alone, how)
    maps = scene.maps()
    kept = np.zeros((len(maps), 3), np.float32)
    residual = scene.pixels.mean_of(np.square, maps[:, 0], sigma_px=how.variance.window_px)
    variance = limits.level**2 + how.variance.residual_share * residual
    sampled: list[SampledOctave] = []
    octaves = scene.pixels.octaves(maps, how.sigmas_px)
    bands, sigma_px = next(octaves)
    for number in range(len(how.sigmas_px)):
        give_back_free_memory()  # what the octave before has read of the model
        octave = DetailOctave.of(scene, number, bands, sigma_px)
        bands, sigma_px = next(octaves)  # those of this octave are freed for its filter
        if scene.known is not None:
            now = scene.known.octaves[number]
            error, deviation, limit = now.of_change, now.noise, now.limit
        else:
            if number < how.noise.compared_octaves and alone is None:
                octave = octave.with_differences(bands[:, QUOTIENT])
            error, limit = octave.sample.error_of_change(octave.shown, how), None
            deviation = noise.at(octave.sample)
        own, expected, sample = octave.kept(error, deviation * response[number], limit)
        sampled.append(sample)
        kept += own
        variance += expected + how.variance.shading_change_share * octave.stated
    rest = bands[:, AXES]
    of_level = limits.level * np.array(limits.of_axes, np.float32)
    kept += rest * _share_of_signal(rest**2, of_level**2)
    return kept, variance, tuple(sampled), alone


def _share_of_signal(energy: np.ndarray, uncertain: np.ndarray) -> np.ndarray:
    """Compute the Wiener share of signal: ``max(0, 1 − U/E)``, U the uncertainty, E the energy."""
    return np.maximum(0, 1 - uncertain / np.maximum(energy, TINY)).astype(np.float32)
