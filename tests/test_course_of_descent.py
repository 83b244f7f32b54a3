"""The course of a descent under a known light: steps large at first, small at last."""

import numpy as np

from stages.photometry.albedo.smooth_albedo import albedo_under_light
from stages.photometry.joint.fast_alternation import FastDescent, FastSolver
from stages.photometry.joint.problem_assembly import EdgeWeights
from stages.photometry.joint.settings import USUAL, FastSettings, StepSettings
from stages.photometry.paper.alternation import Outcome
from stages.photometry.paper.energy import EnergyWeights
from stages.photometry.stack import stack_views

DARK, BRIGHT = 0.2, 1.2


def of_a_marker(steps: StepSettings) -> tuple[FastDescent, np.ndarray]:
    """Solve a bright marker on a dark wall: strong smoothness, except at its border; with its pixels."""
    wall = np.ones((90, 90), bool)
    views = stack_views([wall], [np.broadcast_to([0.0, 0.0, 1.0], (90, 90, 3))], {})
    row, column = views.positions().T
    marker = (np.abs(row - 37) < 5) & (np.abs(column - 53) < 5)
    albedo = np.where(marker, BRIGHT, DARK)[:, None] * np.ones(3)
    image = albedo * np.random.default_rng(0).uniform(0.9, 1.1, (len(albedo), 1))
    border = np.concatenate([marker[one] != marker[other] for one, other in views.neighbours()])
    edges = EdgeWeights(np.where(border, 0.15, 10.0).astype(np.float32), np.empty(0, np.float32))
    everywhere = np.ones(len(albedo), bool)
    how = FastSolver(EnergyWeights(10, 0.1), USUAL["directions"], FastSettings(steps=steps))
    given = views, image, np.ones_like(albedo), everywhere, edges, how, 1, lambda: None
    return albedo_under_light(*given), marker


def test_a_bright_marker_that_coarse_levels_mixed_with_the_wall_comes_back_soon():
    """With small steps throughout the energy settles, too, but late: what is strongly tied moves slowly."""
    soon, marker = of_a_marker(StepSettings())
    late, _ = of_a_marker(StepSettings(coarse_scales=(1,), first_scales=()))
    assert soon.outcome is late.outcome is Outcome.CONVERGED
    assert np.abs(soon.albedo[marker] - BRIGHT).max() < 0.03
    assert np.abs(soon.albedo[~marker] - DARK).max() < 0.03
    assert late.rounds[-1].iterations > 2 * soon.rounds[-1].iterations


def test_steps_fall_to_the_last_and_stay():
    course = FastSettings(steps=StepSettings(first_scales=(9, 3))).course(known_light=True)
    assert [course.scale_in(number) for number in range(5)] == [9, 3, 1, 1, 1]


def test_where_the_light_is_found_as_well_the_scale_stays():
    course = FastSettings().course(known_light=False)
    assert course.coarse_scales == (1,) and course.scale_in(0) == 1
