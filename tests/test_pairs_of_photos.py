"""Pairs of photos on synthetic matches: a turn, a wall square on, relief, and what stands still."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from stages.motion.pairs import Pair, Side, sample, shows_depth, still_share, turn_residual
from stages.motion.sfm_settings import PairSettings

SETTINGS = PairSettings()
NOISE = 2e-4  # longest sides: a third of a pixel of 1600


def pair(x_in_cam: np.ndarray, turn_deg: tuple, step: tuple, focal: float, known: bool = False) -> Pair:
    """What two cameras see of points (n, 3): the second turned, and moved by `step`."""
    rng = np.random.default_rng(0)
    moved = x_in_cam @ Rotation.from_euler("xyz", turn_deg, degrees=True).as_matrix().T + np.asarray(step)
    one, other = (focal * x[:, :2] / x[:, 2:] + rng.normal(0, NOISE, (len(x), 2)) for x in (x_in_cam, moved))
    return Pair(Side(0, one, focal if known else None), Side(1, other, focal if known else None))


def points(relief: float, focal: float) -> np.ndarray:
    """Points all over a picture, at depth 1 and up to `relief` nearer."""
    rng = np.random.default_rng(1)
    depth = 1 - relief * rng.random((400, 1))
    return np.hstack([rng.uniform(-0.45, 0.45, (400, 2)) / focal, np.ones((400, 1))]) * depth


@pytest.mark.parametrize("known", [False, True])
@pytest.mark.parametrize("focal", [0.6, 1.0, 3.0])
def test_a_turn_shows_no_depth_whatever_the_lens(focal, known):
    turned = pair(points(0.5, focal), (3.0 / focal, -8.0 / focal, 2.0), (0, 0, 0), focal, known)
    assert not shows_depth(turned, SETTINGS)
    assert turn_residual(turned, SETTINGS) < 2 * NOISE


@pytest.mark.parametrize("known", [False, True])
def test_relief_and_a_wall_square_on_show_depth(known):
    assert shows_depth(pair(points(0.3, 1.0), (0, 0, 0), (0.1, 0, 0), 1.0, known), SETTINGS)
    assert shows_depth(pair(points(0.0, 1.0), (0, 0, 0), (0.3, 0, 0), 1.0, known), SETTINGS)


def test_what_stands_still_is_counted():
    one = np.random.default_rng(2).random((10, 2))
    moved = pair(points(0.0, 1.0)[:10], (0, 0, 0), (0.1, 0, 0), 1.0)
    assert still_share(Pair(Side(0, one, None), Side(1, one.copy(), None)), SETTINGS) == 1
    assert still_share(moved, SETTINGS) == 0


def test_a_sample_is_spread_evenly():
    assert list(sample(list(range(10)), 4)) == [0, 3, 6, 9]  # type: ignore[arg-type, type-var]
    assert list(sample(list(range(3)), 4)) == [0, 1, 2]  # type: ignore[arg-type, type-var]
