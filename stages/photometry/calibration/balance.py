"""The factors that bring an albedo to the known reflectances of cards and charts, and what remains."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import cv2
import numpy as np

from pipeline import UserError
from stages.photometry.calibration.references import Reference

TO_DEVIATION = 1.4826  # median absolute to standard deviation, were the errors Gaussian


@dataclass(frozen=True, eq=False)
class Reading:
    """The albedo of a reference's patches.

    Attributes
    ----------
    reference : Reference
    view : str
    albedo : ndarray, shape (n, 3)
        Medians; NaN of patches with too few pixels.
    spread : ndarray, shape (n,)
        Robust deviation within the patch, the largest of the channels, relative to their mean.
    pixels : ndarray, shape (n,), int
    """

    reference: Reference
    view: str
    albedo: np.ndarray
    spread: np.ndarray
    pixels: np.ndarray

    @property
    def used(self) -> np.ndarray:
        """Grey patches with an albedo, (n,), bool."""
        return self.reference.is_grey & np.isfinite(self.albedo).all(axis=1)

    def factors(self) -> np.ndarray:
        """Fit the factor of each channel, (3,): least squares ``k a = ρ`` over the grey patches."""
        albedo, known = self.albedo[self.used], self.reference.reflectances[self.used]
        return (albedo * known).sum(axis=0) / (albedo**2).sum(axis=0)

    def residual(self, factors: np.ndarray, grey_alone: bool) -> float:
        """Compute the RMS difference of scaled albedo and known reflectance, over patches and channels."""
        some = self.used if grey_alone else np.isfinite(self.albedo).all(axis=1)
        off = self.albedo[some] * factors - self.reference.reflectances[some]
        return float(np.sqrt((off**2).mean()))

    def as_json(self, factors: np.ndarray) -> dict[str, Any]:
        """Convert to plain JSON values, with what remains after the factors."""
        known = np.isfinite(self.albedo).all(axis=1)
        patches = [
            {
                "reflectance": np.round(self.reference.reflectances[k], 4).tolist(),
                "albedo": np.round(self.albedo[k] * factors, 4).tolist(),
                "spread": round(float(self.spread[k]), 4),
                "pixels": int(self.pixels[k]),
            }
            for k in np.flatnonzero(known)
        ]
        return {
            "given": self.reference.given,
            "view": self.view,
            "own_factors": np.round(self.factors(), 5).tolist(),
            "rms_of_greys": round(self.residual(factors, True), 4),
            "rms": round(self.residual(factors, False), 4),
            "patches": patches,
        }


def read_reference(
    reference: Reference, view: str, albedo: np.ndarray, mask: np.ndarray, xy: np.ndarray, fewest: int
) -> Reading:
    """Measure the albedo of a card or of a chart's patches.

    Parameters
    ----------
    reference : Reference
    view : str
    albedo : ndarray, shape (h, w, 3), float32
    mask : ndarray, shape (h, w), bool
        Where it is known.
    xy : ndarray, shape (h, w, 2)
        Where its pixels lie in the upright photo, px.
    fewest : int
        Pixels that a patch must have.

    Raises
    ------
    UserError
        The card, or every grey patch of the chart, has fewer.
    """
    labels = _labels(reference, xy)
    inside = [(labels == number) & mask for number in range(len(reference.boxes))]
    medians, spreads = np.full((len(inside), 3), np.nan), np.full(len(inside), np.nan)
    for number, patch in enumerate(inside):
        values = albedo[patch]
        middle = np.median(values, axis=0) if len(values) >= fewest else np.zeros(3)
        lit = middle.min() > 0 if reference.is_grey[number] else middle.max() > 0
        if lit:
            medians[number] = middle
            spreads[number] = TO_DEVIATION * np.median(np.abs(values - middle), axis=0).max() / middle.mean()
    pixels = np.array([int(patch.sum()) for patch in inside])
    reading = Reading(reference, view, medians, spreads, pixels)
    if not reading.used.any():
        _refuse(reading, int((labels >= 0).sum()), fewest)
    return reading


def common_factors(readings: Sequence[Reading]) -> np.ndarray:
    """Average the factors of all references, (3,), as logarithms."""
    return np.exp(np.mean([np.log(reading.factors()) for reading in readings], axis=0))


def disagreement(readings: Sequence[Reading]) -> float:
    """Measure how far apart the factors of the references are: the largest difference of logarithms."""
    logs = np.log([reading.factors() for reading in readings])
    return float((logs.max(axis=0) - logs.min(axis=0)).max())


def _labels(reference: Reference, xy: np.ndarray) -> np.ndarray:
    """Number the patch that each pixel lies in, (h, w), −1 for none; of a card without its border."""
    square = np.array([[0, 0], [1, 0], [1, 1], [0, 1]], np.float32)
    to_square = cv2.getPerspectiveTransform(reference.corners.astype(np.float32), square)
    place = np.concatenate([np.nan_to_num(xy, nan=-1e6), np.ones((*xy.shape[:2], 1))], axis=2) @ to_square.T
    with np.errstate(divide="ignore", invalid="ignore"):
        u, v = place[..., 0] / place[..., 2], place[..., 1] / place[..., 2]
    labels = np.full(xy.shape[:2], -1)
    for number, (left, top, right, bottom) in enumerate(reference.boxes):
        inside = (u > left) & (u < right) & (v > top) & (v < bottom)
        if not reference.is_chart:  # pixels that are wholly inside
            inside = cv2.erode(inside.astype(np.uint8), np.ones((3, 3)), borderValue=0) > 0
        labels[inside] = number
    return labels


def _refuse(reading: Reading, shown: int, fewest: int) -> None:
    """Explain why a reference cannot be used.

    Raises
    ------
    UserError
        Always.
    """
    what = "The greys of the chart" if reading.reference.is_chart else "The card"
    most = int(reading.pixels[reading.reference.is_grey].max())
    if shown < fewest:
        raise UserError(
            f"{reading.reference.given}: it covers {shown} pixels of the undistorted image of {reading.view} "
            f"at working size; expected {fewest}. Check the numbers, which are pixels of the photo as it is "
            "shown, give a larger part of the card, or work at a larger size (undistort.max_size_px, "
            "raycast.reduce)."
        )
    raise UserError(
        f"{reading.reference.given}: {what} in {reading.view} has {most} pixels with an albedo above 0; "
        f"expected {fewest} (calibration.fewest_pixels). It is overexposed, or lies outside of the masks or "
        "of the surface: include it in the mask, give another photo in which it is seen, or lay it on the "
        "surface when the photos are taken."
    )
