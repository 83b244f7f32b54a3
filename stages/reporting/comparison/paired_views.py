"""A view of two results: maps at one size, their ratio, and pictures on one scale."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from stages.formats.artefacts.png_scale import png_whites
from stages.formats.images.exr import read_exr
from stages.formats.images.photos import encode_srgb8, read_mask
from stages.formats.images.resize import reduce_by_area
from stages.reporting.content.picture_size import size_within
from stages.reporting.content.pictures import (
    area_mean,
    confidence_picture,
    masked_mean,
    photo_picture,
    residual_picture,
)
from stages.reporting.settings import ComparisonSettings, PictureSettings
from stages.scene.cameras import Camera

Pictures = dict[str, tuple[np.ndarray, np.ndarray | None]]  # uint8 by kind, with the visible pixels


@dataclass(frozen=True, eq=False)
class Side:
    """One of the two results.

    Attributes
    ----------
    cameras : mapping of str to Camera
        By name.
    places : mapping of str to Path
        Of `linear`, `albedo`, and as far as there are, `mask`, `shading`, `confidence`, `scales`.
    """

    cameras: Mapping[str, Camera]
    places: Mapping[str, Path]

    def share(self, name: str, size: tuple[int, int]) -> np.ndarray:
        """Read how much of each pixel of a view, reduced to height and width, is inside its mask."""
        return area_mean(self._mask(name).astype(np.float32), size)

    def map_of(self, kind: str, name: str, share: np.ndarray) -> np.ndarray:
        """Read a view's map, reduced to the size of `share` over the pixels of the mask alone."""
        mask, values = self._mask(name), read_exr(self.places[kind] / f"{name}.exr")
        return masked_mean(values * (mask if values.ndim == 2 else mask[..., None]), share)

    def photo(self, name: str, size: tuple[int, int]) -> np.ndarray:
        """Read a view's photo, linear, reduced to height and width."""
        photo = read_exr(self.places["linear"] / f"{name}.exr")
        return area_mean(reduce_by_area(photo, self.cameras[name].shape), size)

    def whites(self) -> dict[str, float]:
        """Read which values are white; empty where the export has not chosen them."""
        return png_whites(self.places["scales"]) if "scales" in self.places else {}

    def _mask(self, name: str) -> np.ndarray:
        if "mask" in self.places:
            return read_mask(self.places["mask"] / f"{name}.png")
        return np.ones(self.cameras[name].shape, bool)


@dataclass(frozen=True, eq=False)
class Ratio:
    """How the albedos of two results relate.

    Attributes
    ----------
    scale : ndarray, shape (3,), float32
        Albedo of B over that of A, one factor per channel for all views: what no method determines.
    stops : float
        Ratio, in powers of two, at which the picture of the difference has its full colour.
    """

    scale: np.ndarray
    stops: float


def common_size(a: Side, b: Side, name: str, longest_px: int) -> tuple[int, int]:
    """Choose height and width at which a view of both is compared: those of the smaller, or less."""
    shapes = a.cameras[name].shape, b.cameras[name].shape
    return size_within((min(one[0] for one in shapes), min(one[1] for one in shapes)), longest_px)


def sampled_albedos(
    a: Side, b: Side, name: str, longest_px: int, pixels: int
) -> tuple[np.ndarray, np.ndarray]:
    """Sample the albedos of a view, evenly, where both results have surface: two of (n, 3), float32."""
    size = common_size(a, b, name, longest_px)
    shares = a.share(name, size), b.share(name, size)
    first, second = (side.map_of("albedo", name, share) for side, share in zip((a, b), shares, strict=True))
    both = (shares[0] > 0.5) & (shares[1] > 0.5) & (first > 0).all(axis=2) & (second > 0).all(axis=2)
    inside = np.flatnonzero(both)
    some = inside[:: max(1, len(inside) // pixels)]
    return first.reshape(-1, 3)[some], second.reshape(-1, 3)[some]


def ratio_of(samples: Iterable[tuple[np.ndarray, np.ndarray]], how: ComparisonSettings) -> Ratio:
    """Estimate the scale of B over A, and the range of what remains.

    Notes
    -----
    Per channel, log s = median log(B / A) over the sampled pixels of all views. The range is a quantile of
    |log2(B / (s A))| of the mean of the channels. Without a common pixel, s = 1.
    """
    pairs = [pair for pair in samples if len(pair[0])]
    if not pairs:
        return Ratio(np.ones(3, np.float32), how.least_stops)
    first, second = (np.concatenate(values).astype(np.float64) for values in zip(*pairs, strict=True))
    scale = np.exp(np.median(np.log(second / first), axis=0))
    left = np.abs(np.log2((second / scale).mean(axis=1) / first.mean(axis=1)))
    return Ratio(scale.astype(np.float32), max(float(np.quantile(left, how.quantile)), how.least_stops))


def difference_of(samples: Sequence[tuple[np.ndarray, np.ndarray]], ratio: Ratio) -> list[float] | None:
    """Compute mean |A − B / s| over mean A, per channel; None without a common pixel."""
    pairs = [pair for pair in samples if len(pair[0])]
    if not pairs:
        return None
    first, second = (np.concatenate(values).astype(np.float64) for values in zip(*pairs, strict=True))
    gaps = np.abs(first - second / ratio.scale).mean(axis=0)
    return (gaps / first.mean(axis=0)).tolist()


def paired_pictures(
    a: Side, b: Side, name: str, longest_px: int, ratio: Ratio, how: PictureSettings
) -> Pictures:
    """Encode the maps of a view of both results as pictures, all at one size.

    Albedo and shading of B are on the scale of A: B's albedo is divided by `ratio.scale`, its shading
    multiplied. One white holds for both.
    """
    size = common_size(a, b, name, longest_px)
    pictures: Pictures = {"photo": (photo_picture(a.photo(name, size), how), None)}
    whites, albedos, shares = a.whites(), list[np.ndarray](), [side.share(name, size) for side in (a, b)]
    for kind, factor in (("albedo", 1 / ratio.scale), ("shading", ratio.scale), ("confidence", None)):
        if not all(kind in side.places for side in (a, b)):
            continue
        maps = [side.map_of(kind, name, share) for side, share in zip((a, b), shares, strict=True)]
        if factor is None:
            encoded = [confidence_picture(one) for one in maps]
        else:
            maps[1] = maps[1] * factor
            white = whites.get(kind) or max(float(np.quantile(maps[0], how.white_quantile)), 1e-6)
            encoded = [encode_srgb8(one / white) for one in maps]
        albedos += maps if kind == "albedo" else []
        for label, picture, share in zip("AB", encoded, shares, strict=True):
            pictures[f"{kind} {label}"] = picture, share > 0.5
    both = (shares[0] > 0.5) & (shares[1] > 0.5)
    even = np.ones_like(albedos[0])
    pictures["difference"] = residual_picture(albedos[1], albedos[0], even, ratio.stops), both
    return pictures


def shift_px(a: Side, b: Side, name: str) -> float:
    """Estimate by how many pixels of A's size the corners of a view lie apart in both, by the intrinsics."""
    first, second = a.cameras[name], b.cameras[name].scaled(a.cameras[name].width, a.cameras[name].height)
    corners = np.array([[0, 0, 1], [first.width, first.height, 1]], float).T
    rays = np.linalg.solve(first.intrinsics, corners)
    return float(np.abs(second.intrinsics @ rays - corners).max())
