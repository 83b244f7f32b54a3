"""What a decomposition gives, and the ways of `mode: paper` to it."""

from __future__ import annotations

from collections.abc import Callable
from concurrent.futures import Executor
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from stages.photometry.albedo.confidence import confidence, confidence_of
from stages.photometry.albedo.detail import Detail
from stages.photometry.energy_history import descent_as_json, rounds_as_json
from stages.photometry.joint.fast_alternation import FastDescent, FastSettings, solve
from stages.photometry.paper.alternation import AlternationSettings, Outcome, decompose_channels
from stages.photometry.paper.harmonics import real_harmonics
from stages.photometry.stack import StackedViews
from stages.photometry.transport.directional_transport import even_directions

SAMPLED = 512  # directions that harmonic light is shown at


@dataclass(frozen=True, eq=False)
class Solved:
    """What a solver gives.

    Attributes
    ----------
    views : StackedViews
        With the basis that the light is meant for.
    albedo : ndarray, shape (N, 3)
        In the unit of the scaled images.
    shading : ndarray, shape (N, 3)
    light : ndarray, shape (n, 3, K), or None
        Of the basis; None where the light was given.
    histories : list of dict
        Per channel, for `energy.json`.
    outcomes : list of Outcome
        Per channel.
    albedo_tv : ndarray, shape (N, 3), or None
        Eq. 2's own, where `albedo` is another.
    confidence : ndarray, shape (N,), or None
        In `mode: transfer`.
    detail : Detail or None
        Where the light was given: how far it is doubted, and the albedo with it.
    """

    views: StackedViews
    albedo: np.ndarray
    shading: np.ndarray
    light: np.ndarray | None
    histories: list[dict[str, Any]]
    outcomes: list[Outcome]
    albedo_tv: np.ndarray | None = None
    confidence: np.ndarray | None = None
    detail: Detail | None = None

    def judged(
        self, views: StackedViews, image: np.ndarray, incidence: np.ndarray, trusted: np.ndarray
    ) -> Solved:
        """The same with the confidence of every pixel: by its expected error, else by its circumstances."""
        if self.detail is not None:
            return replace(self, confidence=confidence_of(self.detail.variance, trusted))
        return replace(
            self, confidence=confidence(views, image, self.shading, self.albedo, incidence, trusted)
        )

    def sampled_light(self) -> tuple[np.ndarray, np.ndarray]:
        """Directions (M, 3), and the harmonic light from there, (n, M, 3)."""
        directions = even_directions(SAMPLED)
        degree = int(self.light.shape[2] ** 0.5) - 1
        return directions, np.einsum("mk,nck->nmc", real_harmonics(directions, degree), self.light)


def as_the_paper(
    views: StackedViews,
    images: list[np.ndarray],
    settings: AlternationSettings,
    executor: Executor,
    step: Callable[[], None],
) -> Solved:
    """`solver: paper`, channels apart."""
    exact = [image.astype(np.float64) for image in images]
    descents = decompose_channels(views, exact, settings, executor, step)
    light = np.stack([descent.state.light for descent in descents], axis=1)
    return Solved(
        views=views,
        albedo=np.stack([descent.state.albedo for descent in descents], axis=-1),
        shading=views.shadings(light),
        light=light,
        histories=[descent_as_json(descent) for descent in descents],
        outcomes=[descent.outcome for descent in descents],
    )


def fast(
    views: StackedViews,
    images: list[np.ndarray],
    settings: FastSettings,
    threads: int,
    step: Callable[[], None],
) -> Solved:
    """`solver: fast` under the paper's light."""
    return solution_of(solve(views, images, settings, threads, step), views, settings)


def solution_of(descent: FastDescent, views: StackedViews, settings: FastSettings) -> Solved:
    """What the fast solver found, in all channels together."""
    histories = rounds_as_json(descent, settings.weights)
    outcomes = [descent.outcome] * len(histories)
    return Solved(views, descent.albedo, descent.shading, descent.light, histories, outcomes)
