"""Accuracy held: stored renders through the real program, from linear photos to albedo.

Figures are those of the day they were written down; a method may better them and then says so here. What
makes one of them worse by an eighth is a regression, even if nothing else fails. The scenes are rendered by
`tests/accuracy_scenes/make.py`.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import cache

import numpy as np
import pytest

from benchmarks.accuracy.stored_scene import FEWER, StoredScene
from stages.evaluation.agreement import relative_difference

WORSE = 1.125


@dataclass(frozen=True)
class Held:
    """Mean si-RMSE of the channels, and of the five octaves error and gain of log brightness."""

    si_rmse: float
    error: tuple[float, ...]
    gain: tuple[float, ...]


HELD = {
    "relief": Held(0.0511, (0.402, 0.363, 0.332, 0.517, 0.567), (0.788, 0.829, 0.935, 0.884, 0.592)),
    "bust": Held(0.0324, (0.618, 0.599, 0.400, 0.348, 0.588), (0.655, 0.782, 1.001, 0.951, 0.986)),
    "courtyard": Held(0.0491, (0.415, 0.488, 0.942, 1.641, 2.453), (0.882, 0.826, 0.621, 0.802, 1.025)),
}


TWO_LIGHTS = ("relief", "relief_dome")  # one scene, one set of views
HELD_RATIO = 0.30  # RMS difference of the albedos over that of the photos


@dataclass(frozen=True, eq=False)
class Decomposed:
    """A stored scene, and the albedo that the program finds."""

    scene: StoredScene
    albedo: dict[str, np.ndarray]

    def inside(self, maps: dict[str, np.ndarray]) -> np.ndarray:
        """Pixels inside the masks of all views, (N, 3)."""
        return np.concatenate([maps[view][self.scene.of_view(view)["mask"]] for view in self.scene.names])


@pytest.fixture(scope="module")
def decomposed(tmp_path_factory: pytest.TempPathFactory) -> Callable[[str], Decomposed]:
    """Decompose a scene, once."""

    @cache
    def of(name: str) -> Decomposed:
        scene = StoredScene.unpacked(name, tmp_path_factory.mktemp(name))
        return Decomposed(scene, scene.decomposed(FEWER)["albedo"])

    return of


@pytest.mark.parametrize("name", HELD)
def test_no_figure_has_become_worse_by_an_eighth(name: str, decomposed: Callable[[str], Decomposed]):
    done, held = decomposed(name), HELD[name]
    scores = done.scene.scores(done.albedo)
    found = Held(
        round(float(np.mean(scores.si_rmse)), 4),
        tuple(round(float(octave.brightness_error), 3) for octave in scores.detail),
        tuple(round(float(octave.brightness_gain), 3) for octave in scores.detail),
    )
    assert found.si_rmse <= WORSE * held.si_rmse, found
    assert np.all(np.array(found.error) <= WORSE * np.array(held.error)), found
    assert np.all(np.array(found.gain) >= np.array(held.gain) - 0.06), found


def test_albedos_under_two_lights_differ_far_less_than_photos(decomposed: Callable[[str], Decomposed]):
    sun, dome = (decomposed(name) for name in TWO_LIGHTS)
    photos = relative_difference(sun.inside(sun.scene.photos()), dome.inside(dome.scene.photos()))
    albedos = relative_difference(sun.inside(sun.albedo), dome.inside(dome.albedo))
    assert np.all(np.array(photos) > 0.2), "lights that hardly differ are no test"
    assert np.mean(albedos) / np.mean(photos) <= WORSE * HELD_RATIO, (albedos, photos)
