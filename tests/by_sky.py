"""Light and albedo one after the other, as the stages `lighting` and `decomposition` find them."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from stages.photometry.albedo.albedo_given_light import (
    SmoothAlbedos,
    smooth_albedos_under_light,
    weights_of_edges,
)
from stages.photometry.albedo.settings import EdgeSettings
from stages.photometry.albedo_data import typical_light_of
from stages.photometry.detail.albedo_detail import Detail, with_detail
from stages.photometry.detail.detail_scene import DetailScene
from stages.photometry.detail.settings import DetailSettings
from stages.photometry.joint.fast_alternation import FastSolver
from stages.photometry.lighting.estimate_illumination import find_illumination
from stages.photometry.lighting.illumination import Illumination
from stages.photometry.lighting.settings import LightingSettings
from stages.photometry.lighting.trusted_pixels import Viewing
from stages.photometry.stack import StackedViews
from stages.photometry.transport.lit_scenes import LitScene


@dataclass(frozen=True)
class BySky:
    """What is asked for: of the light, then of the albedo."""

    light: LightingSettings
    edges: EdgeSettings
    descent: FastSolver

    def with_light(self, **changes: Any) -> BySky:
        """The same, but for some settings of the light, which are not checked."""
        return replace(self, light=self.light.model_copy(update=changes))

    def with_specular(self, remove: bool) -> BySky:
        """The same, but that specular reflection is looked for, or is not."""
        specular = self.light.specular.model_copy(update={"remove": remove})
        return self.with_light(specular=specular)


@dataclass(frozen=True, eq=False)
class FoundBySky:
    """The light, and the albedo under it."""

    light: Illumination
    smooth: SmoothAlbedos
    detail: Detail

    @property
    def albedo(self) -> np.ndarray:
        """With the photos' detail."""
        return self.detail.albedo


def decompose_by_sky(
    views: StackedViews,
    images: list[np.ndarray],
    scenes: Sequence[LitScene],
    viewing: Viewing,
    how: BySky,
    threads: int = 1,
) -> FoundBySky:
    """Find the light, then the albedo under it."""
    found = find_illumination(views, images, scenes, viewing, how.light, threads, lambda: None)
    shading, seen = found.light.shading, found.observations
    typical = typical_light_of(shading)
    by_edge = weights_of_edges(views, shading, seen, how.edges, how.descent.weights.consistency, typical)
    smooth = smooth_albedos_under_light(views, shading, seen, by_edge, how.descent, threads, lambda: None)
    albedo = smooth.by_edge.albedo
    scene = DetailScene.of(views, albedo, seen.diffuse, shading, seen.trusted, DetailSettings())
    return FoundBySky(found, smooth, with_detail(scene))
