"""Detail of the albedo: the residual of a smooth albedo, filtered by the uncertainty of shading and noise.

A Wiener filter per octave and colour axis: residual energy against that of shading error and noise.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from pipeline.process.free_memory import give_back_free_memory
from stages.photometry.detail.detail_octaves import (
    TINY,
    DetailOctave,
    LocalEnergies,
    octaves_of_views,
)
from stages.photometry.detail.detail_scene import AXES, QUOTIENT, DetailScene, channels_of
from stages.photometry.detail.octaves import response_to_noise
from stages.photometry.detail.scene_statistics import (
    DetailStatistics,
    OctaveNoise,
    OctaveStatistics,
    SampledDetail,
    SampledOctave,
    SampledViews,
    has_few_links,
)
from stages.solvers.kernels.pixelwise import EVERYWHERE, Chosen, pixelwise


@dataclass(frozen=True, eq=False)
class Detail:
    """The albedo with its detail.

    Attributes
    ----------
    albedo : ndarray, shape (N, 3), float32
    variance : ndarray, shape (N,), float32
        Expected variance of the albedo's mean logarithm; its square root is the relative error.
    statistics : DetailStatistics
        By which it was filtered.
    """

    albedo: np.ndarray
    variance: np.ndarray
    statistics: DetailStatistics


def with_detail(scene: DetailScene, known: DetailStatistics | None = None) -> Detail:
    """Add the photo's detail to a smooth albedo, except what noise and shading error explain.

    Parameters
    ----------
    scene : DetailScene
        Pixels without trusted data take the kept detail of corresponding pixels; those without
        correspondences keep the smooth albedo.
    known : DetailStatistics or None
        Of the scene, where these pixels are a part of it; None: they are measured.

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
    found = _filtered(scene, EVERYWHERE, known)
    filled, has_value = scene.others.filled_in(np.column_stack([found.kept, found.variance]))
    detailed = _with_kept(scene, filled[:, :3], has_value, EVERYWHERE)
    variance = filled[:, 3] / np.maximum(scene.response, scene.how.variance.least_response) ** 2
    logs = _log_albedo(detailed, scene)
    typical = _typical_square(scene, logs) if known is None else known.between_views
    variance = (variance + _square_between_views(scene, logs, typical)).astype(np.float32)
    return Detail(detailed, variance, DetailStatistics(found.statistics, typical))


def sampled_detail(scene: DetailScene) -> SampledDetail:
    """Sample what the statistics of a scene are computed from, of which these pixels may be a part.

    Only the sampled pixels and those that correspond to them are filtered.
    """
    at = scene.others.around(scene.sample)
    found = _filtered(scene, at, None)
    logs = np.zeros((len(scene.trusted), 1), np.float32)
    logs[at] = _log_albedo(_with_kept(scene, found.kept, scene.trusted[at], at), scene)
    return SampledDetail(found.samples, found.alone, _typical_square(scene, logs), *scene.measured_and_linked)


def _with_kept(scene: DetailScene, kept: np.ndarray, has_value: np.ndarray, at: Chosen) -> np.ndarray:
    """Add what is kept of the residual to the smooth albedo of n pixels, (n, 3), where there is any."""
    offset = scene.how.log_offset

    def add(
        smooth: np.ndarray, explained: np.ndarray, light: np.ndarray, kept: np.ndarray, has_value: np.ndarray
    ) -> np.ndarray:
        added = (explained + offset) * np.expm1(channels_of(kept)) / light
        return np.where(has_value[:, None], np.maximum(smooth + added, 0), smooth).astype(np.float32)

    return pixelwise(add, scene.smooth[at], scene.explained[at], scene.light[at], kept, has_value)


def _log_albedo(albedo: np.ndarray, scene: DetailScene) -> np.ndarray:
    """Compute the logarithm of the albedo's mean over the channels, (n, 1), float32."""
    return np.log(albedo.mean(axis=1, keepdims=True) + scene.how.log_offset).astype(np.float32)


def _typical_square(scene: DetailScene, logs: np.ndarray) -> float:
    """Average the squared difference of log albedo, (N, 1), between views, over sampled pixels."""
    seen = scene.sample[scene.others.count[scene.sample] > 0]
    if not len(seen):
        return 0.0
    return float(np.mean(np.square(logs[seen] - scene.others.mean(logs, seen)), dtype=np.float64))


def _square_between_views(scene: DetailScene, logs: np.ndarray, typical: float) -> np.ndarray:
    """Average the squared difference of log albedo, (N, 1), between views, around every pixel, (N,).

    Pixels without correspondences take the typical one.
    """
    seen = scene.others.count > 0
    if not seen.any():
        return np.full(len(logs), typical, np.float32)
    difference = np.where(seen, (logs - scene.others.mean(logs))[:, 0], 0)
    square = scene.seen_by_others.mean_of(np.square, difference, sigma_px=scene.how.variance.window_px)
    return np.where(seen, square, np.float32(typical))


@dataclass(frozen=True, eq=False)
class _Filtered:
    """The residual of n pixels, filtered.

    Attributes
    ----------
    kept : ndarray, shape (n, 3)
        What is albedo, in three axes.
    variance : ndarray, shape (n,)
        Its expected variance.
    statistics : tuple of OctaveStatistics
    samples : tuple of SampledOctave
        They are measured from; none where they are known.
    alone : SampledViews or None
        Where correspondences are few.
    """

    kept: np.ndarray
    variance: np.ndarray
    statistics: tuple[OctaveStatistics, ...]
    samples: tuple[SampledOctave, ...]
    alone: SampledViews | None


def _filtered(scene: DetailScene, at: Chosen, known: DetailStatistics | None) -> _Filtered:
    """Filter the three axes, octave by octave, by statistics that are known or measured on the way."""
    how, limits = scene.how, scene.how.uncertainty
    few = known is None and has_few_links(*scene.measured_and_linked, how)
    alone = octaves_of_views(scene) if few else None
    noise, maps = OctaveNoise.of(alone, how), scene.maps()
    residual = scene.pixels.mean_of(np.square, maps[:, 0], sigma_px=how.variance.window_px)[at]
    variance = limits.level**2 + how.variance.residual_share * residual
    kept = np.zeros((len(variance), 3), np.float32)
    statistics: list[OctaveStatistics] = []
    samples: list[SampledOctave] = []
    octaves = scene.pixels.octaves(maps, how.sigmas_px)
    bands, sigma_px = next(octaves)
    for number, response in enumerate(response_to_noise(how.sigmas_px)):
        give_back_free_memory()  # what the octave before has read of the model
        given = None if known is None else known.octaves[number]
        octave = DetailOctave.of(scene, number, bands, sigma_px, given)
        bands, sigma_px = next(octaves)  # those of this octave are freed for its filter
        if given is None:
            local, by, sample = _measured(octave, bands[:, QUOTIENT], noise, response)
            samples.append(sample)
        else:
            local, by = octave.local(given.noise * response), given
        own, expected = octave.filtered(local, by, at)
        del local  # frees memory
        statistics.append(by)
        kept += own
        variance += expected + how.variance.shading_change_share * octave.stated[at]
    rest = bands[at, AXES]
    of_level = limits.level * np.array(limits.of_axes, np.float32)
    kept += rest * _share_of_signal(rest**2, of_level**2)
    return _Filtered(kept, variance, tuple(statistics), tuple(samples), alone)


def _measured(
    octave: DetailOctave, coarser: np.ndarray, noise: OctaveNoise, response: float
) -> tuple[LocalEnergies, OctaveStatistics, SampledOctave]:
    """Measure the statistics of an octave; `coarser`: the band of log I/S in the next one."""
    how, shown, sample = octave.scene.how, octave.shown, octave.sample
    if noise.by_views and sample.number < how.noise.compared_octaves:
        sample = octave.compared(coarser)
    error, deviation = sample.error_of_change(shown, how), noise.at(sample)
    local = octave.local(deviation * response)
    sample = octave.measured(sample, local)
    return local, OctaveStatistics(shown, error, deviation, sample.limit(error, shown, how)), sample


def _share_of_signal(energy: np.ndarray, uncertain: np.ndarray) -> np.ndarray:
    """Compute the Wiener share of signal: ``max(0, 1 − U/E)``, U the uncertainty, E the energy."""
    return np.maximum(0, 1 - uncertain / np.maximum(energy, TINY)).astype(np.float32)
