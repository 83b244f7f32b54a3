"""The three ways to decompose, with one kind of answer."""

from __future__ import annotations

from collections.abc import Callable
from concurrent.futures import Executor
from dataclasses import dataclass
from typing import Any

import numpy as np

from stages.photometry.alternation import AlternationSettings, Outcome, decompose_channels
from stages.photometry.energy_history import descent_as_json, rounds_as_json
from stages.photometry.fast_alternation import FastDescent, FastSettings, solve
from stages.photometry.pixel_transfer import PixelTransfer
from stages.photometry.stack import StackedViews
from stages.photometry.transfer_alternation import TransferAlternation, solve_with_transfer


@dataclass(frozen=True, eq=False)
class Solved:
    """What a solver gives.

    Attributes
    ----------
    views : StackedViews
        With the basis that the light is meant for.
    albedo : ndarray, shape (N, 3)
        In the unit of the scaled images.
    light : ndarray, shape (n, 3, K)
    histories : list of dict
        Per channel, for `energy.json`.
    outcomes : list of Outcome
        Per channel.
    """

    views: StackedViews
    albedo: np.ndarray
    light: np.ndarray
    histories: list[dict[str, Any]]
    outcomes: list[Outcome]

    def shading(self) -> np.ndarray:
        """S of all pixels, shape (N, 3)."""
        channels = range(self.light.shape[1])
        return np.stack([self.views.of_channel(c).shading(self.light[:, c]) for c in channels], axis=-1)


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
    return Solved(
        views=views,
        albedo=np.stack([descent.state.albedo for descent in descents], axis=-1),
        light=np.stack([descent.state.light for descent in descents], axis=1),
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
    return _solved(solve(views, images, settings, threads, step), views, settings)


def by_transfer(
    views: StackedViews,
    images: list[np.ndarray],
    transfer: PixelTransfer,
    settings: TransferAlternation,
    threads: int,
    step: Callable[[], None],
) -> Solved:
    """`mode: transfer`."""
    descent, views = solve_with_transfer(views, images, transfer, settings, threads, step)
    return _solved(descent, views, settings.descent)


def _solved(descent: FastDescent, views: StackedViews, settings: FastSettings) -> Solved:
    histories = rounds_as_json(descent, settings.weights)
    return Solved(views, descent.albedo, descent.light, histories, [descent.outcome] * len(histories))
