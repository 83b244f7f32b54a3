"""The baseline: the cartoon of each image as its albedo, its texture as the shading."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from concurrent.futures import Executor
from dataclasses import dataclass

import numpy as np

from benchmarks.cartoon.primal_dual import CartoonOutcome, CartoonSettings, CartoonSolution, cartoon

BRIGHT_VALUE = 255.0  # what the images' 99th percentile becomes: the scale that λ's steps were chosen for


@dataclass(frozen=True)
class ChannelReport:
    """Outcome for one channel of one view; energy in [0, 255] values."""

    outcome: CartoonOutcome
    iterations: int
    energy: float
    relative_gap: float


@dataclass(frozen=True, eq=False)
class Cartoons:
    """Albedo estimates of all views, and the outcome of each.

    Attributes
    ----------
    albedos : list of ndarray, shape (h_i, w_i, c), float32
        In the images' own units; 0 outside the masks.
    reports : list of tuple of ChannelReport
        Per view, one per channel.
    """

    albedos: list[np.ndarray]
    reports: list[tuple[ChannelReport, ...]]

    @property
    def unconverged(self) -> int:
        """Channels of views that stopped at the limit of iterations."""
        limit = CartoonOutcome.LIMIT_REACHED
        return sum(report.outcome is limit for view in self.reports for report in view)

    @property
    def worst_gap(self) -> float:
        """Largest relative gap."""
        return max(report.relative_gap for view in self.reports for report in view)


def cartoon_texture(
    images: Sequence[np.ndarray],
    masks: Sequence[np.ndarray],
    settings: CartoonSettings,
    executor: Executor,
    after_each: Callable[[], None] = lambda: None,
) -> Cartoons:
    """Compute the TV-L1 cartoon of every channel of every view independently.

    Parameters
    ----------
    images : sequence of ndarray, shape (h_i, w_i, c), float32
        Linear light, finite.
    masks : sequence of ndarray, shape (h_i, w_i), bool
        At least one pixel each.
    settings : CartoonSettings
    executor : Executor
        Threads: the compiled iterations hold no lock. One channel is one task: the same bits for any number.
    after_each : callable
        Called in this thread after every view.

    Notes
    -----
    Values are brought to [0, 255] from **linear** light, by one number for the whole set (99th percentile of
    all masked values = 255, nothing clipped), and brought back. Linear, since the metrics are, and since
    it matters little: TV-L1 treats every level set of the image independently, so that a minimiser for any
    increasing curve of the image is that curve of the minimiser (exactly in the continuum; with isotropic
    differences nearly). sRGB changes the speed of convergence, not the minimiser.
    """
    scale = _bright_value(images, masks) / BRIGHT_VALUE
    pending = [
        [
            executor.submit(_channel, image[..., channel], mask, scale, settings)
            for channel in range(image.shape[-1])
        ]
        for image, mask in zip(images, masks, strict=True)
    ]
    albedos, reports = [], []
    for view in pending:
        solutions = [future.result() for future in view]
        albedos.append(np.stack([image for image, _ in solutions], axis=-1))
        reports.append(tuple(report for _, report in solutions))
        after_each()
    return Cartoons(albedos, reports)


def _bright_value(images: Sequence[np.ndarray], masks: Sequence[np.ndarray]) -> float:
    """Compute the 99th percentile of all masked values; 1 where they are black."""
    values = np.concatenate([image[mask].ravel() for image, mask in zip(images, masks, strict=True)])
    bright = float(np.percentile(values, 99))
    return bright if bright > 0 else BRIGHT_VALUE


def _channel(
    channel: np.ndarray, mask: np.ndarray, scale: float, settings: CartoonSettings
) -> tuple[np.ndarray, ChannelReport]:
    """Compute the cartoon of one channel within the box around its mask, in the image's units."""
    rows, columns = (np.flatnonzero(mask.any(axis=axis)) for axis in (1, 0))
    box = np.s_[rows[0] : rows[-1] + 1, columns[0] : columns[-1] + 1]
    solution: CartoonSolution = cartoon(channel[box] / np.float32(scale), mask[box], settings)
    albedo = np.zeros(mask.shape, np.float32)
    albedo[box] = solution.cartoon * np.float32(scale)
    report = ChannelReport(solution.outcome, solution.iterations, solution.energy, solution.relative_gap)
    return albedo, report
