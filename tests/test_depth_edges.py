"""Borders of depth maps follow the edges of the photo, beyond which stereo widens them before even sky."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.ndimage import binary_dilation, gaussian_filter

from stages.stereo.depth.depth_edges import up_to_edges
from stages.stereo.mvs_settings import DepthEdgeSettings

SHAPE, HOW = (120, 160), DepthEdgeSettings()
ROW, COLUMN = np.mgrid[: SHAPE[0], : SHAPE[1]]
DISC = np.hypot(ROW - 60, COLUMN - 80) < 35
ROD = np.abs(COLUMN - 80) < 3
EVERYWHERE = np.ones(SHAPE, bool)


def widened(shape: np.ndarray, by_px: int = 4) -> np.ndarray:
    return binary_dilation(shape, iterations=by_px)


def photo(shape: np.ndarray, seed: int = 0) -> np.ndarray:
    """Painted surface before an even sky that grows a little darker downwards; noise of one step."""
    rng = np.random.default_rng(seed)
    paint = 110 + 60 * gaussian_filter(rng.normal(0, 1, (*SHAPE, 3)), (1.5, 1.5, 0)) * 4
    sky = np.stack([200 - 0.1 * ROW, 210 - 0.1 * ROW, 220 - 0.1 * ROW], axis=-1)
    seen = np.where(shape[..., None], np.clip(paint, 30, 170), sky) + rng.normal(0, 0.7, (*SHAPE, 3))
    return np.clip(np.rint(seen), 0, 255).astype(np.uint8)


@pytest.mark.parametrize("shape", [DISC, ROD], ids=["disc", "rod"])
def test_what_stereo_added_around_an_outline_goes(shape):
    kept = widened(shape)
    found, background = up_to_edges(kept, ~kept, photo(shape), HOW)
    np.testing.assert_array_equal(background, ~found)
    added, added_before = (found & ~shape).sum(), (kept & ~shape).sum()
    assert added < 0.12 * added_before  # a pixel's width is the line between the two sides
    assert (found & shape).sum() > 0.97 * shape.sum()


def test_surface_of_one_colour_before_a_sky_of_another_keeps_its_outline():
    """Nothing but the edge tells the two apart: it stays with the side that has depth farther inside."""
    kept = widened(DISC)
    image = np.where(DISC[..., None], np.uint8(90), np.uint8(210)) * np.ones(3, np.uint8)
    found, _ = up_to_edges(kept, ~kept, image, HOW)
    assert (found & ~DISC).sum() < 0.25 * (kept & ~DISC).sum() and (found & DISC).sum() > 0.97 * DISC.sum()


@pytest.mark.parametrize("shape", [np.abs(COLUMN - 80) < 2, DISC & (COLUMN == 80)], ids=["rod", "line"])
def test_what_is_too_thin_to_have_a_middle_stays_as_it_is(shape):
    found, background = up_to_edges(shape, ~shape, photo(shape), HOW)
    np.testing.assert_array_equal(found, shape)
    np.testing.assert_array_equal(background, ~shape)


def test_the_outermost_rows_are_no_exception():
    shape = (ROW > 70) & (np.abs(COLUMN - 80) < 30)
    kept = widened(shape)
    found, _ = up_to_edges(kept, ~kept, photo(shape), HOW)
    assert (found & ~shape)[-1].sum() <= 3 < (kept & ~shape)[-1].sum()


def test_where_the_background_has_texture_nothing_is_taken():
    """There stereo has depth of its own, or none for other reasons: surface that other views do not see."""
    kept = widened(DISC)
    np.testing.assert_array_equal(up_to_edges(kept, ~EVERYWHERE, photo(DISC), HOW)[0], kept)


def test_depth_is_taken_near_borders_only_and_never_added():
    kept = DISC & (COLUMN > 60)
    found, _ = up_to_edges(kept, ~DISC, photo(DISC), HOW)
    assert not (found & ~kept).any()
    deep = ~binary_dilation(~kept, np.ones((13, 13), bool))
    assert found[deep].all()


@pytest.mark.parametrize("kept", [EVERYWHERE, ~EVERYWHERE], ids=["all", "none"])
def test_without_a_border_nothing_changes(kept):
    np.testing.assert_array_equal(up_to_edges(kept, ~kept, photo(DISC), HOW)[0], kept)


def test_no_reach_takes_nothing():
    kept = widened(DISC)
    off = DepthEdgeSettings(reach_px=0)
    np.testing.assert_array_equal(up_to_edges(kept, ~kept, photo(DISC), off)[0], kept)
