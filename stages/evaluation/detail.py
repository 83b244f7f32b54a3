"""Detail of albedo, octave by octave: its gain and its error."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np

from stages.evaluation.judged_views import JudgedView
from stages.evaluation.octave_bands import (
    BANDS,
    BRIGHTNESS,
    CHROMA,
    BandSettings,
    eroded,
    log_floors,
    log_signals,
    octave_bands,
    smooth_inside,
)
from stages.evaluation.scaled_error import least_squares_scale

KINDS = (BRIGHTNESS, CHROMA)


@dataclass(frozen=True)
class OctaveDetail:
    """One octave against the truth; nan where the truth's band is too weak for a ratio.

    Attributes
    ----------
    sigma_low_px, sigma_high_px : float
    brightness_error, chroma_error : float
        ``rms(b(estimate) − b(truth)) / rms(b(truth))``: 0 at best, 1 for a flat estimate.
    brightness_gain, chroma_gain : float
        ``⟨b(estimate), b(truth)⟩ / ⟨b(truth)²⟩``: 1 at best, below 1 where detail is lost.
    """

    sigma_low_px: float
    sigma_high_px: float
    brightness_error: float
    brightness_gain: float
    chroma_error: float
    chroma_gain: float


@dataclass(frozen=True)
class PhotoOctave:
    """One octave against the photos, where the shading's band is weak; nan without such pixels.

    Attributes
    ----------
    sigma_low_px, sigma_high_px : float
    brightness_gain, chroma_gain : float
        ``⟨b(albedo), b(photo)⟩ / ⟨b(photo)²⟩`` over the counted pixels.
    brightness_share, chroma_share : float
        Share of the eroded masks that is counted; nan where the erosion leaves no pixel.
    """

    sigma_low_px: float
    sigma_high_px: float
    brightness_gain: float
    brightness_share: float
    chroma_gain: float
    chroma_share: float


@dataclass(frozen=True, eq=False)
class PhotoView:
    """One view and its decomposition; all maps linear, shape (h, w, 3).

    Attributes
    ----------
    name : str
    photo, albedo, shading : ndarray, shape (h, w, 3)
        Finite inside the mask, not read outside.
    mask : ndarray, shape (h, w), bool
    """

    name: str
    photo: np.ndarray
    albedo: np.ndarray
    shading: np.ndarray
    mask: np.ndarray


def octave_details(views: Sequence[JudgedView], settings: BandSettings = BANDS) -> tuple[OctaveDetail, ...]:
    """Compare octave bands of estimate and truth, of log brightness and of chroma, all views together.

    Sums run over the judged pixels eroded by ``settings.erosion_px``; those of the two chroma bands are
    added. The estimate has one least-squares scale per channel, as for si-RMSE: a constant factor per channel
    changes nothing.
    """
    masks = [view.judged for view in views]
    estimates, truths = [view.prediction for view in views], [view.truth for view in views]
    scales = _scales_onto(truths, estimates, masks)
    moments, count = np.zeros((len(settings.octaves), len(KINDS), 3)), 0
    logs = zip(
        masks, _logs(estimates, masks, scales, settings), _logs(truths, masks, 1, settings), strict=True
    )
    for mask, estimate, truth in logs:
        inner = eroded(mask, settings.erosion_px)
        count += int(inner.sum())
        both = np.concatenate([estimate, truth], axis=-1)
        for k, band in enumerate(octave_bands(both, mask, settings)):
            estimate_band, truth_band = np.split(band[inner], 2, axis=-1)
            moments[k] += [_moments(estimate_band[:, kind], truth_band[:, kind]) for kind in KINDS]
    return tuple(
        OctaveDetail(*octave, *(ratio for row in rows for ratio in _error_and_gain(row, count, settings)))
        for octave, rows in zip(settings.octaves, moments, strict=True)
    )


def detail_remarks(octaves: Sequence[OctaveDetail]) -> list[str]:
    """Explain octaves without figures, in a sentence for brightness and one for chroma."""
    sentences = []
    for kind in ("brightness", "chroma"):
        weak = [one for one in octaves if math.isnan(getattr(one, f"{kind}_gain"))]
        if weak:
            named = ", ".join(f"{one.sigma_low_px:g}–{one.sigma_high_px:g}" for one in weak)
            sentences.append(
                f"detail of {kind}: at σ {named} px the truth's band is below {BANDS.least_rms} log units, "
                "or the masks' erosion leaves no pixel"
            )
    return sentences


def photo_octaves(views: Sequence[PhotoView], settings: BandSettings = BANDS) -> tuple[PhotoOctave, ...]:
    """Compare octave bands of albedo and photo where the shading's band is weak, all views together.

    A pixel of the eroded masks is counted in an octave where ``A(shading) < shading_share · A(photo)`` and
    ``A(photo) ≥ least_rms``, with the local band ``A(f) = √(G(σ_high) ∗ b(f)²)`` by normalised convolution:
    there the decomposition itself attributes the photo's detail to the albedo. The albedo has one
    least-squares scale per channel onto the photos.

    Notes
    -----
    Where albedo × shading equals the photo, the bands add up and every gain is near 1: detail in the shading
    lowers the share instead. Both figures are needed.
    """
    masks = [view.mask for view in views]
    albedos, photos = [view.albedo for view in views], [view.photo for view in views]
    maps = (albedos, photos, [view.shading for view in views])
    scales: tuple[np.ndarray | float, ...] = (_scales_onto(photos, albedos, masks), 1, 1)
    logs = (_logs(images, masks, scale, settings) for images, scale in zip(maps, scales, strict=True))
    moments, total = np.zeros((len(settings.octaves), len(KINDS), 4)), 0
    for mask, *signals in zip(masks, *logs, strict=True):
        inner = eroded(mask, settings.erosion_px)
        total += int(inner.sum())
        moments += _photo_moments(np.concatenate(signals, axis=-1), mask, inner, settings)
    return tuple(
        PhotoOctave(*octave, *(value for row in rows for value in _gain_and_share(row, total, settings)))
        for octave, rows in zip(settings.octaves, moments, strict=True)
    )


def _photo_moments(
    signals: np.ndarray, mask: np.ndarray, inner: np.ndarray, settings: BandSettings
) -> np.ndarray:
    """Sum `_moments` of albedo and photo over the counted pixels of one view, and their number.

    Parameters
    ----------
    signals : ndarray, shape (h, w, 9)
        Log signals of albedo, photo and shading.

    Returns
    -------
    ndarray, shape (octaves, 2, 4), float64
        Of brightness and of chroma.
    """
    sums = []
    for (_, sigma), band in zip(settings.octaves, octave_bands(signals, mask, settings), strict=True):
        for kind in KINDS:
            albedo, photo, shading = (one[..., kind] for one in np.split(band, 3, axis=-1))
            counted = inner & _weakly_shaded(photo, shading, mask, sigma, settings)
            sums.append([*_moments(albedo[counted], photo[counted]), counted.sum()])
    return np.reshape(sums, (len(settings.octaves), len(KINDS), 4))


def _weakly_shaded(
    photo: np.ndarray, shading: np.ndarray, mask: np.ndarray, sigma_px: float, settings: BandSettings
) -> np.ndarray:
    """Find pixels where the shading's local band is weak against the photo's, shape (h, w), bool.

    Parameters
    ----------
    photo, shading : ndarray, shape (h, w, c)
        One band of brightness or of chroma.
    """
    squares = np.stack([(photo**2).sum(axis=-1), (shading**2).sum(axis=-1)], axis=-1)
    local = np.sqrt(np.maximum(smooth_inside(squares, mask, sigma_px), 0))
    return (local[..., 1] < settings.shading_share * local[..., 0]) & (local[..., 0] >= settings.least_rms)


def _scales_onto(
    references: Sequence[np.ndarray], estimates: Sequence[np.ndarray], masks: Sequence[np.ndarray]
) -> np.ndarray:
    """Fit one scale per channel of the estimates to the references, all views together, shape (3,)."""
    reference, estimate = (
        np.concatenate([image[mask].astype(np.float64) for image, mask in zip(images, masks, strict=True)])
        for images in (references, estimates)
    )
    return np.array([least_squares_scale(e, r) for e, r in zip(estimate.T, reference.T, strict=True)])


def _logs(
    images: Sequence[np.ndarray],
    masks: Sequence[np.ndarray],
    scales: np.ndarray | float,
    settings: BandSettings,
) -> Iterator[np.ndarray]:
    """Compute log signals of one map view by view, with floors from all views together."""
    values = np.concatenate([image[mask] * scales for image, mask in zip(images, masks, strict=True)])
    floors = log_floors(values, settings)
    for image, mask in zip(images, masks, strict=True):
        yield log_signals(np.where(mask[..., None], image, 0) * scales, mask, floors)


def _moments(estimate: np.ndarray, reference: np.ndarray) -> np.ndarray:
    """Compute ``Σ (e − r)²``, ``Σ e·r`` and ``Σ r²`` of bands of one shape."""
    estimate, reference = estimate.astype(np.float64), reference.astype(np.float64)
    gap = estimate - reference
    return np.array([(gap * gap).sum(), (estimate * reference).sum(), (reference * reference).sum()])


def _error_and_gain(moments: np.ndarray, count: int, settings: BandSettings) -> tuple[float, float]:
    """Compute the ratios of `_moments` over `count` pixels; nan where the reference has no energy."""
    difference, product, energy = (float(moment) for moment in moments)
    if energy < settings.least_rms**2 * max(count, 1):
        return math.nan, math.nan
    return math.sqrt(difference / energy), product / energy


def _gain_and_share(sums: np.ndarray, total: int, settings: BandSettings) -> tuple[float, float]:
    """Compute gain and share of `total` of the counted pixels from a row of `_photo_moments`."""
    count = int(sums[3])
    return _error_and_gain(sums[:3], count, settings)[1], count / total if total else math.nan
