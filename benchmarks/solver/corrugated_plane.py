"""A coloured, corrugated plane in nine views shifted along it, synthesised at any number of pixels."""

from __future__ import annotations

from itertools import combinations

import numpy as np
import scipy.sparse as sp

from benchmarks.solver.problems import RaceProblem
from stages.formats.artefacts.view_files import scaled_channels
from stages.photometry.paper.energy import EnergyWeights
from stages.photometry.paper.harmonics import shading_basis
from stages.photometry.stack import stack_views

VIEWS = 9  # all pairs share nearly all pixels: nearly four links per pixel, a little fewer than the bust has
SHIFT_PX = 1  # from one view to the next
PAINT_PX = 12
LIGHT = np.array([2.2, 0.3, 0.9, 0.5, 0.2, -0.1, 0.2, 0.1, -0.15])


def corrugated_plane(pixels: int, smoothness: float = 3.0, agreement: float = 1.0) -> RaceProblem:
    """Make the problem with about that many pixels in all views together.

    Every view has its own light, a band in shadow and 1 % of noise, none of which nine harmonics explain.
    """
    width = max(round((pixels / VIEWS) ** 0.5), 2 * VIEWS * SHIFT_PX)
    height = max(round(pixels / VIEWS / width), 4)
    rows, columns = np.mgrid[:height, :width]
    generator = np.random.default_rng(0)
    masks, normals, values = [], [], []
    for view in range(VIEWS):
        along = columns + view * SHIFT_PX
        masks.append(np.ones((height, width), bool))
        normals.append(_normals(rows, along))
        values.append(_image(rows, along, normals[-1], view, generator).reshape(-1, 3))
    correspondences = {
        (i, j): _links(height, width, (j - i) * SHIFT_PX) for i, j in combinations(range(VIEWS), 2)
    }
    views = stack_views(masks, normals, correspondences)
    return RaceProblem(
        name=f"plane-{views.starts[-1]}",
        about=f"corrugated plane, {VIEWS} views of {width}×{height}",
        views=views,
        images=scaled_channels(np.concatenate(values))[0],
        weights=EnergyWeights(smoothness, agreement),
    )


def _normals(rows: np.ndarray, along: np.ndarray) -> np.ndarray:
    """Compute normals of two crossed waves, (h, w, 3)."""
    slopes = [0.6 * np.cos(along / 9), 0.5 * np.cos(rows / 7 + along / 23), np.ones(rows.shape)]
    normals = np.stack(slopes, axis=-1)
    return normals / np.linalg.norm(normals, axis=-1, keepdims=True)


def _image(
    rows: np.ndarray, along: np.ndarray, normals: np.ndarray, view: int, generator: np.random.Generator
) -> np.ndarray:
    turn = 2 * np.pi * view / VIEWS
    cosine, sine = np.cos(turn), np.sin(turn)
    turned = normals @ np.array([[cosine, -sine, 0], [sine, cosine, 0], [0, 0, 1]])
    shadow = np.where(np.abs(rows - rows.shape[0] * (view + 0.5) / VIEWS) < 0.04 * rows.shape[0], 0.5, 1.0)
    shading = shading_basis(turned) @ LIGHT * shadow
    noise = 1 + 0.01 * generator.standard_normal((*rows.shape, 3))
    return np.maximum(_paint(rows, along) * shading[..., None] * noise, 0)


def _paint(rows: np.ndarray, along: np.ndarray) -> np.ndarray:
    """Draw an albedo of patches of random colours, (h, w, 3)."""
    colours = np.random.default_rng(1).uniform(0.1, 0.9, (1009, 3))
    patch = (rows // PAINT_PX) * 31 + (along // PAINT_PX) * 17
    return colours[(patch * patch + patch) % len(colours)]


def _links(height: int, width: int, shift: int) -> sp.csr_array:
    """Build correspondences: column x of one view is column x − shift of the other."""
    pixels = np.arange(height * width, dtype=np.int32).reshape(height, width)
    linked = np.ones(pixels.shape, np.int32)
    linked[:, :shift] = 0
    firsts = np.concatenate([[0], np.cumsum(linked.ravel(), dtype=np.int32)]).astype(np.int32)
    there = pixels[:, : width - shift].ravel()
    return sp.csr_array((np.ones(there.size, np.uint8), there, firsts), shape=2 * (pixels.size,))
