"""Errors after the one scale per channel that is undetermined: si-RMSE, LMSE, PSNR-H."""

from __future__ import annotations

from collections.abc import Sequence

import cv2
import numpy as np
from numpy.lib.stride_tricks import sliding_window_view

from stages.evaluation.judged_views import CHANNELS, JudgedView, channel_values

WINDOW_PX, STEP_PX = 20, 10  # Grosse 2009
EROSION_PX = 5  # Stanford-ORB: side of the square by which masks are eroded


def least_squares_scale(prediction: np.ndarray, truth: np.ndarray) -> float:
    """Compute ``a = Σ t·p / Σ p²``, which minimises ``Σ (t − a·p)²``; arrays of one shape; 0 if p is 0."""
    energy = float((prediction * prediction).sum())
    return float((truth * prediction).sum()) / energy if energy > 0 else 0.0


def si_rmse(views: Sequence[JudgedView]) -> tuple[tuple[float, ...], tuple[float, ...]]:
    """Compute RMSE per channel after one least-squares scale for all views together, and these scales.

    ``√(mean (t − a·p)²)`` over the judged pixels of all views: one scale, since views must agree.
    """
    errors, scales = [], []
    for channel in range(len(CHANNELS)):
        prediction, truth = channel_values(views, channel)
        scales.append(least_squares_scale(prediction, truth))
        errors.append(float(np.sqrt(np.mean((truth - scales[-1] * prediction) ** 2))))
    return tuple(errors), tuple(scales)


def lmse(views: Sequence[JudgedView]) -> tuple[float, ...]:
    """Compute local mean squared error per channel (equation 8 of Grosse et al. 2009), all views together.

    ``Σ_w min_a ‖t_w − a·p_w‖² / Σ_w ‖t_w‖²`` over windows w of 20 × 20 pixels, every 10 pixels, judged pixels
    only: 0 at best, at most 1.

    Notes
    -----
    As in their code, windows lie wholly in the image, so that up to 9 pixels at the right and lower border
    may be in none. There are two differences. The energy in the denominator is summed over every window, as
    in the article, where the code adds one window per row only. A black window is one whose p is 0, not one
    of low energy, so that the scale of p changes nothing. Without any window, or with a black truth, nan.
    """
    scores = []
    for channel in range(len(CHANNELS)):
        sums = np.sum([_window_sums(view, channel) for view in views], axis=0)
        scores.append(float(sums[0] / sums[1]) if sums[1] > 0 else float("nan"))
    return tuple(scores)


def _window_sums(view: JudgedView, channel: int) -> tuple[float, float]:
    """Compute ``Σ_w min_a ‖t_w − a·p_w‖²`` and ``Σ_w ‖t_w‖²`` of one view; unjudged pixels are 0 in both."""
    if min(view.judged.shape) < WINDOW_PX:
        return 0.0, 0.0
    p, t = (
        sliding_window_view(image[..., channel].astype(np.float64), (WINDOW_PX, WINDOW_PX))[
            ::STEP_PX, ::STEP_PX
        ]
        for image in (view.prediction, view.truth)
    )
    energy = np.einsum("ijkl,ijkl->ij", p, p)
    scale = np.einsum("ijkl,ijkl->ij", t, p) / np.where(energy > 0, energy, 1)
    residual = t - scale[..., None, None] * p
    return float((residual**2).sum()), float((t**2).sum())


def psnr_h(views: Sequence[JudgedView]) -> dict[str, float]:
    """Compute PSNR per view as in Stanford-ORB (its PSNR-H, peak 1), dB; inf where there is no error.

    ``−10·log10(mean (clip(a·p) − clip(t))²)`` over the whole frame and all channels, both clipped to [0, 1]
    and set to 0 outside the mask, which is eroded by 5 × 5 pixels. Applicable to any two sets of linear
    images, for instance relit ones.

    Notes
    -----
    The scale a is one per channel for all views together, where Stanford-ORB takes one per image. Pixels
    beyond the image's border count as judged, as in OpenCV's erosion: the frame is no silhouette. The empty
    part of the frame counts as correct, so that figures are comparable between methods, not between scenes. A
    view of which the erosion leaves nothing is absent.
    """
    eroded = {view.name: mask for view in views if (mask := _eroded(view.judged)).any()}
    kept = [view for view in views if view.name in eroded]
    if not kept:
        return {}
    scales = np.array([_scale_within(kept, eroded, channel) for channel in range(len(CHANNELS))])
    decibels = {}
    for view in kept:
        mask = eroded[view.name][..., None]
        prediction = np.clip(view.prediction.astype(np.float64) * scales, 0, 1) * mask
        truth = np.clip(view.truth.astype(np.float64), 0, 1) * mask
        error = float(np.mean((prediction - truth) ** 2))
        decibels[view.name] = -10 * float(np.log10(error)) if error > 0 else float("inf")
    return decibels


def _eroded(mask: np.ndarray) -> np.ndarray:
    return cv2.erode(mask.astype(np.uint8), np.ones((EROSION_PX, EROSION_PX), np.uint8)) > 0


def _scale_within(views: Sequence[JudgedView], masks: dict[str, np.ndarray], channel: int) -> float:
    prediction, truth = (
        np.concatenate([image[masks[view.name], channel] for view, image in zip(views, images, strict=True)])
        for images in ([view.prediction for view in views], [view.truth for view in views])
    )
    return least_squares_scale(prediction.astype(np.float64), truth.astype(np.float64))
