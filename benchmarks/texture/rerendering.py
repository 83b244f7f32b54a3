"""The texture, rendered into views by rays, against the albedo that the views have."""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np

from stages.formats.colour.srgb import srgb_from_linear
from stages.scene.cameras import Camera, footprint
from stages.texturing.rendering import TexturedSurface

JUMP_FOOTPRINTS = 8  # between neighbouring pixels, from which they are of different surfaces
AROUND = np.ones((3, 3), np.uint8)  # a pixel and its neighbours


@dataclass(frozen=True, eq=False)
class Rendered:
    """A view of a textured mesh.

    Attributes
    ----------
    albedo : ndarray, shape (h, w, 3), float32
        Linear; 0 where nothing is hit.
    hit : ndarray, shape (h, w), bool
    outline : ndarray, shape (h, w), bool
        Hit, but a neighbour is not, or its depth is that of another surface: half of such a pixel's photo
        shows what is behind.
    """

    albedo: np.ndarray
    hit: np.ndarray
    outline: np.ndarray


@dataclass(frozen=True)
class Squares:
    """Squared differences of some pixels, mean over the channels, over the square of white.

    Attributes
    ----------
    total : float
        Sum, weighted.
    weight : float
        Of all pixels: their number, where all weigh 1.
    """

    total: float
    weight: float

    @classmethod
    def of(cls, squares: np.ndarray, weight: np.ndarray) -> Squares:
        """Sum up pixels, (h, w), by their weight."""
        return cls(float((squares * weight).sum()), float(weight.sum()))

    def __add__(self, other: Squares) -> Squares:
        return Squares(self.total + other.total, self.weight + other.weight)

    @property
    def psnr(self) -> float:
        """Compute the peak signal-to-noise ratio, dB, for a peak of 1; nan without pixels."""
        if not self.weight:
            return float("nan")
        return float("inf") if self.total == 0 else -10 * float(np.log10(self.total / self.weight))


@dataclass(frozen=True)
class ViewError:
    """How far a rendered view is from its albedo.

    Attributes
    ----------
    name : str
    encoded : Squares
        Of all pixels, as pictures show them: sRGB, cut off at white.
    linear : Squares
        Of all pixels, linear.
    inner : Squares
        As `encoded`, of the pixels that are on no outline.
    known : Squares
        As `encoded`, weighted by the confidence of the view's own albedo, as the texture weighs it.
    missed : int
        Masked pixels whose ray passes the mesh.
    """

    name: str
    encoded: Squares
    linear: Squares
    inner: Squares
    known: Squares
    missed: int

    def __add__(self, other: ViewError) -> ViewError:
        kinds = ("encoded", "linear", "inner", "known")
        sums = (getattr(self, kind) + getattr(other, kind) for kind in kinds)
        return ViewError("all", *sums, self.missed + other.missed)


def rendered(textured: TexturedSurface, camera: Camera) -> Rendered:
    """Render the texture at the pixel centres of a view, without light."""
    seen = textured.seen_by(camera)
    albedo = np.zeros((*seen.mask.shape, 3), np.float32)
    albedo[seen.mask] = seen.texture
    return Rendered(albedo, seen.mask, outlines(camera, seen.mask, seen.depth))


def outlines(camera: Camera, hit: np.ndarray, depth: np.ndarray) -> np.ndarray:
    """Find the pixels beside which the surface ends or another one begins, (h, w), bool."""
    jump = cv2.dilate(depth, AROUND) - cv2.erode(depth, AROUND)
    ends = cv2.erode(hit.astype(np.uint8), AROUND) == 0
    return hit & (ends | (jump > JUMP_FOOTPRINTS * footprint(camera, depth)))


def error_of(
    name: str, shown: Rendered, albedo: np.ndarray, mask: np.ndarray, confidence: np.ndarray, white: float
) -> ViewError:
    """Compare a rendered view with its albedo where the mask and rays meet surface.

    Parameters
    ----------
    name : str
    shown : Rendered
    albedo : ndarray, shape (h, w, 3)
        Linear.
    mask : ndarray, shape (h, w), bool
    confidence : ndarray, shape (h, w)
        Of the albedo, 0 to 1.
    white : float
        Albedo that is white in pictures.
    """
    compared = mask & shown.hit
    one, other = shown.albedo / white, albedo / white
    linear = _mean_square(one, other)
    encoded = _mean_square(srgb_from_linear(one), srgb_from_linear(other))
    return ViewError(
        name,
        Squares.of(encoded, compared),
        Squares.of(linear, compared),
        Squares.of(encoded, compared & ~shown.outline),
        Squares.of(encoded, compared * confidence),
        int((mask & ~shown.hit).sum()),
    )


def _mean_square(one: np.ndarray, other: np.ndarray) -> np.ndarray:
    return ((one - other) ** 2).mean(axis=2, dtype=np.float64)
