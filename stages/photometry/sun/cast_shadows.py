"""Shadows of suns that no ray explains: what hides them was not reconstructed."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from functools import partial

import numpy as np

from stages.photometry.light_search.light_estimate import LightEstimate
from stages.photometry.light_search.light_from_pairs import reliability
from stages.photometry.light_search.settings import PairSettings
from stages.photometry.stack import cropped
from stages.photometry.sun.pixel_rays import WHOLE
from stages.photometry.sun.settings import ShadowSettings
from stages.photometry.sun.shadow_labels import (
    SunlitView,
    beside_edges,
    edges_decided,
    sun_seen,
    texture_scales,
)
from stages.photometry.transport.directional_transport import arriving
from stages.photometry.transport.lit_scenes import LitScene
from stages.solvers.kernels.pixelwise import on_threads
from stages.solvers.kernels.sparse_rows import product


def cast_shadows(
    scene: LitScene,
    light: LightEstimate,
    shading: np.ndarray,
    image: np.ndarray,
    trusted: np.ndarray,
    masks: Sequence[np.ndarray],
    side: float,
    pairs: PairSettings,
    how: ShadowSettings,
) -> tuple[np.ndarray, np.ndarray]:
    """Find what pixels see of suns where the photos show shadows, sun by sun and view by view.

    Parameters
    ----------
    scene : LitScene
        Its suns are hidden by the mesh alone.
    light : LightEstimate
        One light for all pixels.
    shading : ndarray, shape (N, 3), float32
        By this light.
    image : ndarray, shape (N, 3), float32
        Gains of the views divided out.
    trusted : ndarray, shape (N,), bool
    masks : sequence of ndarray, shape (h_i, w_i), bool
        Of the views, or of parts cut out of them as by `cropped`: N pixels in all.
    side : float
        Mean side of the whole views, taken as squares, px.
    pairs : PairSettings
        Noise of the image, and its darkest.
    how : ShadowSettings

    Returns
    -------
    tuple of ndarray, shape (N, k), uint8, and ndarray, shape (N, k), bool
        How much of each sun every pixel sees, in 255ths; and pixels that something else than the mesh hides
        from each sun: those beside the edges of the mesh's own shadows, which lie elsewhere than it says, are
        none.
    """
    pixels, seen, shading = scene.pixels, scene.pixels.traced.copy(), shading.copy()
    hidden = np.zeros(seen.shape, bool)
    suns = range(len(pixels.directions) - seen.shape[1], len(pixels.directions))
    starts = np.cumsum([0, *(np.count_nonzero(mask) for mask in masks)])

    def hide(view: int) -> None:
        own, mask = slice(starts[view], starts[view + 1]), cropped(masks[view])
        for number, sun in enumerate(suns):
            facing = arriving(pixels.normals[own], pixels.offsets[own], pixels.directions[[sun]])
            unhidden = 4 * facing * (pixels.cells[sun] * light.radiance[0, sun] / WHOLE).astype(np.float32)
            by_sun = seen[own, number, None] * unhidden
            rest = shading[own] - by_sun
            laid_out = partial(_sunlit_view, mask, side, image[own], trusted[own], rest, how=pairs)
            sunlit, known = laid_out(by_sun), _on_mask(mask, seen[own, number] / np.float32(WHOLE))
            scales = texture_scales(sunlit, how)
            share = known * sun_seen(sunlit, scales, how)
            beside = beside_edges(known, mask, side, how)
            share = edges_decided(laid_out(WHOLE * unhidden), share, known, beside, scales, how)
            hidden[own, number] = (share < known)[mask] & ~beside[mask]
            seen[own, number] = np.rint(WHOLE * share[mask])
            shading[own] = rest + seen[own, number, None] * unhidden

    on_threads(hide, np.flatnonzero(np.diff(starts)).tolist())
    return seen, hidden


def _sunlit_view(
    mask: np.ndarray,
    side: float,
    image: np.ndarray,
    trusted: np.ndarray,
    rest: np.ndarray,
    by_sun: np.ndarray,
    how: PairSettings,
) -> SunlitView:
    """Lay out the pixels of a view, (n, ...)."""
    rest = np.maximum(rest, how.darkest)
    values = {
        "shaded": np.log(np.maximum(image, how.darkest) / rest),
        "gain": by_sun / rest,
        "weight": (trusted * reliability(image.min(axis=1), how)).astype(np.float32),
        "free": by_sun.any(axis=1),
    }
    return SunlitView(**{name: _on_mask(mask, value) for name, value in values.items()}, side=side)


def _on_mask(mask: np.ndarray, values: np.ndarray) -> np.ndarray:
    """Lay values of a mask's pixels out on it, 0 elsewhere."""
    laid_out = np.zeros((*mask.shape, *values.shape[1:]), values.dtype)
    laid_out[mask] = values
    return laid_out


def with_visibility(scene: LitScene, seen: np.ndarray) -> LitScene:
    """Set how much of the suns the pixels see, (N, k), and which of them the vertices see: most pixels'."""
    count = len(scene.pixels.directions)
    by_vertices = np.unpackbits(scene.vertices.visible, axis=1, count=count)
    weight = product(scene.to_vertices, np.ones((len(seen), 1), np.float32))
    share = product(scene.to_vertices, (seen > WHOLE // 2).astype(np.float32))
    hidden = (weight > 0) & (share < weight / 2)
    by_vertices[:, count - seen.shape[1] :] &= ~hidden
    visible = np.packbits(by_vertices, axis=1)
    return replace(
        scene,
        pixels=replace(scene.pixels, traced=seen, visible=visible),
        vertices=replace(scene.vertices, visible=visible),
    )
