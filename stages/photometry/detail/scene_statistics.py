"""Statistics of a scene by which the detail of its albedo is filtered, the same for all of its pixels."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from stages.photometry.detail.shading_uncertainty import ShadingUncertainty, ShownChange
from stages.photometry.detail.texture_limit import TextureLimit


@dataclass(frozen=True, eq=False)
class OctaveStatistics:
    """Statistics of one octave.

    Attributes
    ----------
    shown : ShownChange or None
        How much of the shading's change the photos show; None where it is not compared.
    of_change : float
        κ, the standard deviation of the shading's error over its own local change.
    noise : ndarray, shape (3,)
        Standard deviation of white noise in a pixel, in three axes.
    limit : TextureLimit
    """

    shown: ShownChange | None
    of_change: float
    noise: np.ndarray
    limit: TextureLimit

    @classmethod
    def merged(cls, several: Sequence[OctaveStatistics], weights: Sequence[float]) -> OctaveStatistics:
        """Average the statistics of an octave in parts of a scene."""
        shown = [one.shown for one in several if one.shown is not None]
        noise = np.average([np.square(one.noise) for one in several], axis=0, weights=weights)
        return cls(
            ShownChange.merged(shown, weights) if shown else None,
            float(np.sqrt(np.average([one.of_change**2 for one in several], weights=weights))),
            np.sqrt(noise),
            TextureLimit.merged([one.limit for one in several], weights),
        )


@dataclass(frozen=True, eq=False)
class DetailStatistics:
    """Statistics of all octaves, finest first, and of the pixels.

    Attributes
    ----------
    octaves : tuple of OctaveStatistics
    typical_light : float
        Median shading.
    typical_noise : ndarray, shape (3,)
        Median of `relative_noise_variance`, in three axes.
    between_views : float
        Mean square difference of log albedo between views.
    measured, linked : int
        Trusted pixels that were measured, and those of them with correspondences.
    """

    octaves: tuple[OctaveStatistics, ...]
    typical_light: float
    typical_noise: np.ndarray
    between_views: float
    measured: int
    linked: int

    @classmethod
    def merged(cls, several: Sequence[DetailStatistics], fewest: int) -> DetailStatistics:
        """Average the statistics of parts of a scene: deviations as root mean squares, the rest as means.

        Parts count by the pixels that were measured. Those with fewer than `fewest` do not, unless all have:
        nothing can be told from them.
        """
        measured = np.array([one.measured for one in several], float)
        weights = np.where(measured >= fewest, measured, 0.0)
        weights = weights if weights.any() else measured + 1
        linked = np.array([one.linked for one in several], float)
        by_octave = zip(*(one.octaves for one in several), strict=True)
        return cls(
            tuple(OctaveStatistics.merged(octave, weights.tolist()) for octave in by_octave),
            float(np.average([one.typical_light for one in several], weights=weights)),
            np.average([one.typical_noise for one in several], axis=0, weights=weights),
            float(
                np.average([one.between_views for one in several], weights=linked if linked.any() else None)
            ),
            int(measured.sum()),
            int(linked.sum()),
        )

    @property
    def uncertainty(self) -> ShadingUncertainty:
        """Summarise for records."""
        shown = tuple(1.0 if one.shown is None else one.shown.shown for one in self.octaves)
        noise = np.max([one.noise for one in self.octaves], axis=0)
        return ShadingUncertainty(shown, tuple(one.of_change for one in self.octaves), tuple(noise.tolist()))
