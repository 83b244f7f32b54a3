"""Poses and lenses of photos, as files of other programs give them, in COLMAP's terms."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np

from stages.formats.cameras.rational_lens import rational_distortion, undistorted_radius

Size = tuple[int, int]  # width, height, px


@dataclass(frozen=True)
class Lens:
    """A lens as a file gives it: what is missing follows from the size of the photo.

    Attributes
    ----------
    model : str
        COLMAP's name of a model whose parameters begin with fx, fy, cx, cy.
    distortion : tuple of float
        Its further parameters.
    size : tuple of int, optional
        Width and height, px; None: the photo's.
    focal_px : tuple of float, optional
        fx and fy; None: from `across_rad`.
    across_rad : tuple of float, optional
        Horizontal and vertical field of view, where there is no `focal_px`; vertical NaN: square pixels.
    centre_px : tuple of float, optional
        Principal point, the centre of the first pixel at (0.5, 0.5); None: the middle of the image.
    r8 : float
        Radial coefficient of r⁸, which no model of COLMAP has: see `at`.
    skew_px : float
        K's entry of the first row, second column, which no model of COLMAP has.
    missed : float
        Largest error of the rational distortion that `at` fitted, focal lengths.
    """

    model: str
    distortion: tuple[float, ...] = ()
    size: Size | None = None
    focal_px: tuple[float, float] | None = None
    across_rad: tuple[float, float] | None = None
    centre_px: tuple[float, float] | None = None
    r8: float = 0.0
    skew_px: float = 0.0
    missed: float = 0.0

    def parameters(self, size: Size) -> tuple[float, ...]:
        """List COLMAP's parameters at an image size."""
        width, height = size
        centre = self.centre_px or (width / 2, height / 2)
        return (*(self.focal_px or self._focal_from_view(size)), *centre, *self.distortion)

    def _focal_from_view(self, size: Size) -> tuple[float, float]:
        """fx and fy from the field of view: f = (w / 2) / tan(angle / 2)."""
        across, down = self.across_rad or (math.nan, math.nan)
        fx = size[0] / 2 / math.tan(across / 2)
        return fx, fx if math.isnan(down) else size[1] / 2 / math.tan(down / 2)

    def at(self, size: Size) -> Lens:
        """Convert the r⁸ term to the rational distortion of FULL_OPENCV, fitted within the image."""
        if not self.r8:
            return self
        k1, k2, p1, p2, k3, *_ = (*self.distortion, 0.0, 0.0, 0.0, 0.0, 0.0)
        radial = (k1, k2, k3, self.r8)
        with np.errstate(over="ignore", invalid="ignore"):
            farthest = undistorted_radius(radial, math.hypot(*self._reach(size)))
            (a1, a2, a3, *below), missed = rational_distortion(radial, farthest)
        return replace(
            self, model="FULL_OPENCV", distortion=(a1, a2, p1, p2, a3, *below), r8=0.0, missed=missed
        )

    def _reach(self, size: Size) -> tuple[float, float]:
        """Compute the farthest x and y in the image, in focal lengths from the principal point."""
        fx, fy, cx, cy = self.parameters(size)[:4]
        return max(abs(cx), abs(size[0] - cx)) / fx, max(abs(cy), abs(size[1] - cy)) / fy

    def dropped_px(self, size: Size) -> float:
        """Compute how far what COLMAP lacks moves a pixel at most, px: the skew, and what `at` missed."""
        by_skew = abs(self.skew_px) * self._reach(size)[1] if self.skew_px else 0.0
        return self.missed * max(self.parameters(size)[:2]) + by_skew


@dataclass(frozen=True, eq=False)
class PosedPhoto:
    """Pose and lens of a photo.

    Attributes
    ----------
    path : str
        The photo, as the file names it: a path or a bare name, with or without its extension.
    lens : Lens
    cam_from_world : ndarray, shape (3, 4), float64
        [R t]; axes of the camera: x right, y down, z forward.
    """

    path: str
    lens: Lens
    cam_from_world: np.ndarray


def distorted(
    radial: tuple[float, float, float, float], tangential: tuple[float, float], fisheye: bool = False
) -> tuple[str, tuple[float, ...], float]:
    """Choose COLMAP's model of polynomial distortion.

    With r the distance from the axis in the image plane, or the angle from it (fisheye), x' is
    x (1 + k₁ r² + k₂ r⁴ + k₃ r⁶ + k₄ r⁸) + 2 p₁ x y + p₂ (r² + 2 x²), and y'
    likewise with p₁ and p₂ exchanged.

    Parameters
    ----------
    radial : tuple of float
        k₁ to k₄.
    tangential : tuple of float
        p₁ and p₂, in OpenCV's order.
    fisheye : bool

    Returns
    -------
    model : str
    distortion : tuple of float
    r8 : float
        k₄, where the model lacks it.
    """
    k1, k2, k3, k4 = radial
    if fisheye and any(tangential):
        return "THIN_PRISM_FISHEYE", (k1, k2, *tangential, k3, k4, 0.0, 0.0), 0.0
    if fisheye:
        return "OPENCV_FISHEYE", (k1, k2, k3, k4), 0.0
    if k3:
        return "FULL_OPENCV", (k1, k2, *tangential, k3, 0.0, 0.0, 0.0), k4
    if k1 or k2 or any(tangential):
        return "OPENCV", (k1, k2, *tangential), k4
    return "PINHOLE", (), k4
