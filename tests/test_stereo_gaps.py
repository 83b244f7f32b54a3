"""Gaps of a cloud, closed by stereo at smaller sizes: what is added and what is not."""

from __future__ import annotations

import numpy as np
import pytest

from stages.scene.cameras import back_project
from stages.stereo.depth.fusion import FusedPoints
from stages.stereo.gaps import scales_of, with_gaps_closed, without_surface
from stages.stereo.mvs_settings import GapSettings
from tests import stereo_scene

VIEWS = stereo_scene.cameras()
TRACED = [stereo_scene.trace(camera) for camera in VIEWS]
HOW = GapSettings()


def cloud_of(view: int, chosen: np.ndarray, nearer: float = 1.0) -> FusedPoints:
    """Points of a view's pixels, all at a share of their depth."""
    x_in_world = back_project(VIEWS[view], nearer * TRACED[view].depth)[chosen]
    normals = TRACED[view].normals[chosen].astype(np.float32)
    return FusedPoints.at_full_size(x_in_world, normals, np.zeros((len(x_in_world), 3), np.uint8))


def closed(fine: FusedPoints, coarse: FusedPoints, known: np.ndarray, threads: int = 2) -> FusedPoints:
    """Close gaps where only view 2 has a depth map, of the known pixels."""

    def depth_of(view: int) -> np.ndarray:
        return np.where(known & (view == 2), TRACED[2].depth, 0)

    return with_gaps_closed(fine, coarse, VIEWS, depth_of, HOW, threads)


def gap() -> np.ndarray:
    """A square of the middle view's pixels."""
    mask = np.zeros(VIEWS[2].shape, bool)
    mask[30:60, 40:70] = True
    return mask & (TRACED[2].depth > 0)


def test_points_are_taken_in_a_gap_and_nowhere_else():
    seen = TRACED[2].depth > 0
    fine, coarse = cloud_of(2, seen & ~gap()), cloud_of(2, seen)
    whole = closed(fine, coarse, seen & ~gap())
    np.testing.assert_array_equal(whole.x_in_world[: len(fine.x_in_world)], fine.x_in_world)
    added = whole.x_in_world[len(fine.x_in_world) :]
    inside = {tuple(x) for x in cloud_of(2, gap()).x_in_world}
    assert 0.5 * gap().sum() < len(added) <= gap().sum()
    assert all(tuple(x) in inside for x in added)


def test_what_floats_before_surface_that_a_depth_map_confirms_is_not_taken():
    seen = TRACED[2].depth > 0
    fine, floating = cloud_of(2, seen & ~gap()), cloud_of(2, gap(), nearer=0.7)
    assert len(closed(fine, floating, seen).x_in_world) == len(fine.x_in_world)
    assert len(closed(fine, floating, seen & ~gap()).x_in_world) > len(fine.x_in_world)


def test_an_empty_cloud_takes_all_of_the_other_and_threads_change_nothing():
    seen = TRACED[2].depth > 0
    none, all_of_it = cloud_of(2, np.zeros_like(seen)), cloud_of(2, seen)
    assert closed(none, all_of_it, seen) is all_of_it
    assert closed(all_of_it, none, seen) is all_of_it
    fine = cloud_of(2, seen & ~gap())
    one, two = (closed(fine, all_of_it, seen & ~gap(), threads) for threads in (1, 2))
    np.testing.assert_array_equal(one.x_in_world, two.x_in_world)


def test_points_say_with_which_pixels_they_were_found():
    seen = TRACED[2].depth > 0
    fine, coarse = cloud_of(2, seen & ~gap()), cloud_of(2, seen).at_scale(0.25)
    whole = closed(fine, coarse, seen & ~gap())
    np.testing.assert_array_equal(
        whole.pixel_sizes == 4, np.arange(len(whole.x_in_world)) >= len(fine.x_in_world)
    )
    assert set(whole.pixel_sizes) == {1, 4}


def test_wide_surface_with_depth_at_a_smaller_size_is_no_background_and_a_rim_is():
    """Paving in the evening, too even for patches of the full size; sky beside a tower, five pixels wide."""
    coarse_kept = np.zeros((30, 40), bool)
    coarse_kept[20:] = True  # paving
    coarse_kept[:, 10:20] = True  # the tower, with five pixels beside it on either side at twice the size
    background = np.ones((60, 80), bool)
    background[:40, 25:35] = False
    left = without_surface(background, coarse_kept, reach_px=10)
    np.testing.assert_array_equal(left[:38], background[:38])
    assert not left[42:].any()


@pytest.mark.parametrize(
    ("longest", "scales"), [(480, [1]), (799, [1]), (800, [1, 0.5]), (3072, [1, 0.5, 0.25])]
)
def test_images_are_halved_while_they_have_pixels_enough(longest, scales):
    assert scales_of([VIEWS[0].scaled(longest, longest // 2), VIEWS[1].scaled(100, 100)], HOW) == scales
