"""The rule that ends `solver: fast`: neither a crawl nor a standstill passes for the goal."""

import pytest

from stages.photometry.alternation import Outcome
from stages.photometry.stopping_rule import FEWEST, Round, gained, verdict

LIMIT = 3.0  # what the energies below fall to


def descent(order: float, count: int, gap: float = 0.0) -> list[Round]:
    """Energies whose error falls as iterations to the power of −order."""
    errors = [1.0, *(0.1 * k**-order for k in range(1, count))]
    return [Round(60 * k, (LIMIT * (1 + error), 0.0), gap) for k, error in enumerate(errors)]


@pytest.mark.parametrize("order", [1.0, 1.5, 3.0])
@pytest.mark.parametrize("tolerance", [1e-2, 1e-3])
def test_where_it_ends_no_more_than_the_tolerance_is_left_to_gain(order, tolerance):
    rounds = descent(order, 2)
    while verdict(rounds, tolerance, 0.1) is None:
        rounds = descent(order, len(rounds) + 1)
    assert verdict(rounds, tolerance, 0.1) is Outcome.CONVERGED
    assert sum(rounds[-1].energy) - LIMIT <= tolerance * LIMIT * (1 + 1e-9)


def test_a_crawl_is_not_taken_for_the_goal():
    """From one round to the next it changes by less than the tolerance, from half of the way on by more."""
    rounds = descent(1.0, 12)
    before, last = (sum(one.energy) for one in rounds[-2:])
    assert (before - last) / last < 1e-3
    assert verdict(rounds, 1e-3, 0.1) is None


def test_an_open_gap_keeps_it_going_until_going_on_is_waste():
    first = next(k for k in range(2, 100) if verdict(descent(2.0, k), 1e-3, 0.1) is Outcome.CONVERGED)
    outcomes = [verdict(descent(2.0, k, gap=0.5), 1e-3, 0.1) for k in range(first, 3 * first)]
    assert outcomes[0] is None
    assert outcomes[-1] is Outcome.STALLED


def test_energies_that_swing_count_by_the_least_so_far():
    swinging = [Round(60 * k, (energy,), 0.0) for k, energy in enumerate([4.0, 3.0, 3.5, 3.2, 3.4, 3.3])]
    assert gained(swinging[:3]) == 0.0
    assert gained(swinging) == 0.0
    assert gained([*swinging, Round(360, (2.0,), 0.0)]) == pytest.approx(0.5)


def test_a_few_rounds_say_nothing_yet():
    still = [Round(60 * k, (1.0,), 0.0) for k in range(FEWEST + 1)]
    assert verdict(still[:FEWEST], 1e-3, 0.1) is None
    assert verdict(still, 1e-3, 0.1) is Outcome.CONVERGED
    assert gained([Round(0, (0.0,), 0.0)]) == 0.0  # a black image
