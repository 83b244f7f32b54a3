"""The schedule of a descent under a known light: steps are large at first, and lead to the same albedo."""

from dataclasses import replace

import numpy as np
import pytest

from stages.photometry.albedo.smooth_albedo import albedo_under_light
from stages.photometry.joint.coarse_to_fine import from_coarse_to_fine
from stages.photometry.joint.fast_alternation import FastSolver
from stages.photometry.joint.problem_assembly import EdgeWeights, finest_level
from stages.photometry.joint.settings import FastSettings, StepSettings, Stopping
from stages.photometry.paper.energy import EnergyWeights
from stages.photometry.stack import StackedViews, stack_views
from stages.solvers.primal_dual.graph import PrimalDual

SIDE, PAINTS = 96, 30
WEIGHTS = EnergyWeights(10, 0.1)
FAR = Stopping(tolerance=1e-4, gap=0.02, max_rounds=100)


def painted_wall() -> tuple[StackedViews, np.ndarray, EdgeWeights]:
    """Paint rectangles of any brightness over each other; smoothness is strong but at their borders."""
    rng = np.random.default_rng(0)
    paint = np.zeros((SIDE, SIDE), int)
    for number in range(1, PAINTS):
        (top, left), (high, wide) = rng.integers(0, SIDE, 2), rng.integers(5, 40, 2)
        paint[top : top + high, left : left + wide] = number
    views = stack_views([paint >= 0], [np.broadcast_to([0.0, 0, 1], (SIDE, SIDE, 3))], {})
    albedo = rng.lognormal(-1, 1, PAINTS)[paint.ravel()][:, None] * np.ones(3)
    border = np.concatenate([paint.flat[one] != paint.flat[other] for one, other in views.neighbours()])
    return (
        views,
        albedo,
        EdgeWeights(np.where(border, 0.15, 10.0).astype(np.float32), np.empty(0, np.float32)),
    )


def solved(steps: StepSettings) -> np.ndarray:
    """Estimate the albedo of the wall under even light and noise."""
    views, albedo, edges = painted_wall()
    image = albedo * np.random.default_rng(1).uniform(0.9, 1.1, (len(albedo), 1))
    how = FastSolver(WEIGHTS, FAR, FastSettings(steps=steps))
    given = views, image, np.ones_like(image), np.ones(len(image), bool), edges, how, 1, lambda: None
    return albedo_under_light(*given).albedo


@pytest.mark.parametrize("scales", [(1,), (80, 1), (300,)])
def test_steps_on_coarse_levels_do_not_change_the_albedo(scales):
    usual, other = solved(StepSettings()), solved(StepSettings(coarse_scales=scales))
    assert np.sqrt(np.mean((usual - other) ** 2)) < 0.005 * usual.mean()


@pytest.mark.parametrize("scales", [(80, 20), (0.5,), None])
def test_on_the_finest_level_the_scale_is_that_of_the_settings(scales):
    """Whatever it was on the coarse ones."""
    views, albedo, edges = painted_wall()
    lit = replace(views, basis=np.ones((len(albedo), 1, 3), np.float32))
    level = finest_level(lit, list(albedo.T), WEIGHTS, edges)
    steps = StepSettings(scale=0.07, coarse_scales=scales)
    descent = from_coarse_to_fine(level, FastSettings(steps=steps), 1, np.ones((1, 3, 1)))
    assert descent.steps.scale == 0.07


def test_each_coarser_level_has_twice_the_iterations_in_equal_shares(monkeypatch):
    views, albedo, edges = painted_wall()
    lit = replace(views, basis=np.ones((len(albedo), 1, 3), np.float32))
    level, counts, iterate = finest_level(lit, list(albedo.T), WEIGHTS, edges), [], PrimalDual.iterate

    def counted(descent: PrimalDual, count: int) -> None:
        counts.append(count)
        iterate(descent, count)

    monkeypatch.setattr(PrimalDual, "iterate", counted)
    how = FastSettings(coarse_iterations=7, steps=StepSettings(coarse_scales=(3, 1)))
    from_coarse_to_fine(level, how, 1, np.ones((1, 3, 1)))
    assert len(counts) > 4 and counts[-2:] == [3, 3]
    assert counts == [7 * 2**depth // 2 for depth in reversed(range(len(counts) // 2)) for _ in range(2)]


def test_what_is_not_given_depends_on_whether_the_light_is_known():
    usual = FastSettings()
    assert usual.schedule(known_light=False).coarse_scales == (1,)
    assert usual.schedule(known_light=True).coarse_scales[0] > 1
    given = FastSettings(round_iterations=50, steps=StepSettings(epoch=5, coarse_scales=(3,)))
    for known_light in (False, True):
        schedule = given.schedule(known_light)
        assert (schedule.round_iterations, schedule.epoch) == (50, 5)
        assert schedule.coarse_scales == (3,)
