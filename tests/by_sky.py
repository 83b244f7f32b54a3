"""Light and albedo one after the other, as the stages `lighting` and `decomposition` find them."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from stages.photometry.albedo.albedo_given_light import AlbedoSolution, decompose_under_light
from stages.photometry.albedo.paint_edges import PaintEdges
from stages.photometry.decomposition_settings import DecompositionSettings
from stages.photometry.joint.fast_alternation import FastSettings
from stages.photometry.light_search.light_estimate import LightSearchSettings
from stages.photometry.lighting.illumination import Illumination, IlluminationSettings, find_illumination
from stages.photometry.lighting.observations import Viewing
from stages.photometry.lighting.settings import LightingSettings
from stages.photometry.lighting.shared_or_own_lights import LightSharing
from stages.photometry.solver_settings import as_sky
from stages.photometry.specular.settings import SpecularSettings
from stages.photometry.stack import StackedViews
from stages.photometry.transport.lit_scenes import LitScene


@dataclass(frozen=True)
class BySky:
    """What is asked for: of the light, then of the albedo."""

    light: LightSearchSettings
    lighting: LightSharing
    specular: bool
    edges: PaintEdges
    descent: FastSettings


@dataclass(frozen=True, eq=False)
class FoundBySky:
    """The light, and the albedo under it."""

    light: Illumination
    solution: AlbedoSolution

    @property
    def albedo(self) -> np.ndarray:
        """With the photos' detail."""
        return self.solution.detail.albedo


def decompose_by_sky(
    views: StackedViews,
    images: list[np.ndarray],
    scenes: Sequence[LitScene],
    looks: Viewing,
    how: BySky,
    threads: int = 1,
) -> FoundBySky:
    """Find the light, then the albedo under it."""
    stage = LightingSettings(specular=SpecularSettings(remove=how.specular))
    of_light = IlluminationSettings(how.light, how.lighting, stage)
    found = find_illumination(views, images, scenes, looks, of_light, threads, lambda: None)
    asked = as_sky(DecompositionSettings(), how.descent.weights, views.side)
    asked = replace(asked, edges=how.edges, descent=how.descent)  # detail as by default
    under = (views, found.light.shading, found.observations, asked)
    return FoundBySky(found, decompose_under_light(*under, threads, lambda: None))
