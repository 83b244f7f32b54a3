"""The rule that ends `solver: fast`: neither a crawl nor a standstill passes for the goal."""

import numpy as np
import pytest

from stages.photometry.joint.settings import FastSettings, Stopping
from stages.photometry.joint.stopping_rule import Round, left_to_gain, verdict
from stages.photometry.paper.alternation import Outcome

LIMIT = 3.0  # what the energies below fall to
HOW = FastSettings()


def ended(rounds: list[Round], tolerance: float) -> Outcome | None:
    """The verdict with a gap of 0.1 allowed."""
    return verdict(rounds, Stopping(tolerance, gap=0.1, max_rounds=100), HOW)


def descent(order: float, count: int, gap: float = 0.0) -> list[Round]:
    """Energies whose error falls as iterations to the power of −order."""
    errors = [1.0, *(0.1 * k**-order for k in range(1, count))]
    return [Round(60 * k, (LIMIT * (1 + error), 0.0), gap) for k, error in enumerate(errors)]


@pytest.mark.parametrize("order", [1.0, 1.5, 3.0])
@pytest.mark.parametrize("tolerance", [1e-2, 1e-3])
def test_where_it_ends_about_the_tolerance_is_left_to_gain(order, tolerance):
    """Not exactly: between two rounds the energy is taken to fall evenly."""
    rounds = descent(order, 2)
    while ended(rounds, tolerance) is None:
        rounds = descent(order, len(rounds) + 1)
    assert ended(rounds, tolerance) is Outcome.CONVERGED
    assert sum(rounds[-1].energy) - LIMIT <= 1.5 * tolerance * LIMIT


@pytest.mark.parametrize("count", [41, 81, 321])
@pytest.mark.parametrize("order", [0.5, 1.0, 2.0])
def test_of_a_power_of_the_rounds_what_is_left_is_known(order, count):
    rounds = descent(order, count)
    left = sum(rounds[-1].energy) / LIMIT - 1
    assert left_to_gain(rounds) == pytest.approx(left, rel=0.02)


WARM = [lambda k: 0.02 * 20 / (k + 20), lambda k: 0.03 * 60 / (k + 60), lambda k: 0.025 * np.exp(-k / 200)]


@pytest.mark.parametrize("error", WARM)
def test_a_crawl_from_near_the_goal_is_not_taken_for_it(error):
    """As after coarser levels: from one round to the next it gains less than the tolerance, for long."""
    rounds = [Round(60 * k, (LIMIT * (1 + error(k)),), 0.0) for k in range(400)]
    assert (rounds[0].energy[0] - rounds[1].energy[0]) / LIMIT < 1e-3
    for count in range(HOW.min_rounds + 1, 400):
        assert ended(rounds[:count], 1e-3) is None or error(count - 1) <= 2e-3


def test_an_open_gap_keeps_it_going_until_going_on_is_waste():
    first = next(k for k in range(2, 100) if ended(descent(2.0, k), 1e-3) is Outcome.CONVERGED)
    outcomes = [ended(descent(2.0, k, gap=0.5), 1e-3) for k in range(first, 3 * first)]
    assert outcomes[0] is None
    assert outcomes[-1] is Outcome.STALLED


def test_energies_that_swing_count_by_the_least_so_far_and_are_not_settled_above_it():
    swinging = [Round(60 * k, (energy,), 0.0) for k, energy in enumerate([4.0, 3.0, 3.5, 3.2, 3.4, 3.3])]
    assert left_to_gain(swinging) == pytest.approx(0.1)
    assert ended(swinging, 1e-3) is None
    assert left_to_gain([*swinging, Round(360, (3.0,), 0.0)]) == 0.0
    assert left_to_gain([*swinging, Round(360, (2.0,), 0.0)]) == float("inf")


def test_a_few_rounds_say_nothing_yet():
    still = [Round(60 * k, (1.0,), 0.0) for k in range(HOW.min_rounds + 1)]
    assert ended(still[: HOW.min_rounds], 1e-3) is None
    assert ended(still, 1e-3) is Outcome.CONVERGED
    assert left_to_gain([Round(0, (0.0,), 0.0)]) == 0.0  # a black image
