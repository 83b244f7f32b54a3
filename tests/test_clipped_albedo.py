"""The albedo of pixels that are clipped in the photos: no darker than these, unless a highlight clips."""

from __future__ import annotations

import numpy as np
import pytest

from stages.photometry.albedo.clipped_pixels import raised_where_clipped
from stages.photometry.albedo.settings import ClippedSettings
from stages.photometry.stack import StackedViews
from tests.sphere_scene import sphere_scene

LIGHT, FILLED = 0.5, 0.2  # shading, and albedo of the neighbourhood
HOW = ClippedSettings()


@pytest.fixture(scope="module")
def views() -> StackedViews:
    return sphere_scene(view_count=3).stacked()


def raised(views: StackedViews, radiance: float, clipped: np.ndarray) -> np.ndarray:
    image = np.full((len(clipped), 3), radiance, np.float32)
    return raised_where_clipped(
        views, np.full_like(image, FILLED), image, np.full_like(image, LIGHT), LIGHT / 10, clipped, HOW
    )


def linked_with(views: StackedViews, view: int) -> np.ndarray:
    """Pixels of a view with correspondences, (N,) bool."""
    linked = np.zeros(int(views.starts[-1]), bool)
    for one, other in views.linked_pixels():
        linked[one] = linked[other] = True
    linked[: views.starts[view]] = linked[views.starts[view + 1] :] = False
    return linked


def test_what_all_views_clip_is_as_bright_as_they_show(views):
    everywhere = np.ones(int(views.starts[-1]), bool)
    linked = np.any([linked_with(views, view) for view in range(3)], axis=0)
    found = raised(views, 1.0, everywhere)
    assert np.allclose(found[linked], 1.0 / LIGHT)
    assert linked.any() and not linked.all()
    assert np.allclose(found[~linked], FILLED)  # nothing tells them from highlights


def test_what_one_view_clips_is_a_highlight(views):
    assert np.allclose(raised(views, 1.0, linked_with(views, 1)), FILLED)


def test_it_is_a_lower_bound(views):
    everywhere = np.ones(int(views.starts[-1]), bool)
    assert np.allclose(raised(views, 0.9 * FILLED * LIGHT, everywhere), FILLED)


def test_pixels_that_are_not_clipped_stay(views):
    nowhere = np.zeros(int(views.starts[-1]), bool)
    assert np.allclose(raised(views, 1.0, nowhere), FILLED)
