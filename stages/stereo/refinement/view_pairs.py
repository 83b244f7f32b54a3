"""Which views each view is compared with, from the surface that they see."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from stages.formats.meshes.triangle_meshes import Surface
from stages.geometry.rays import RayCaster
from stages.scene.cameras import Camera, footprint, pixels_of
from stages.stereo.mvs_settings import MvsSettings
from stages.stereo.refinement.settings import ViewPairSettings
from stages.stereo.view_selection import SparsePoints, select_sources


def sources_of_views(
    surface: Surface, cameras: Sequence[Camera], neighbours: int, settings: ViewPairSettings, threads: int
) -> list[list[int]]:
    """Choose for each view up to so many others by stereo's rule: shared surface, angle, alike in scale."""
    every = max(len(surface.vertices) // settings.vertices, 1)
    points = surface.vertices[::every]
    caster, seen = RayCaster(surface), np.zeros((len(cameras), len(points)), bool)
    for view, camera in enumerate(cameras):
        small = camera.reduced(min(1.0, settings.width_px / camera.width))
        depth = caster.hits(small, threads).depth
        inside, pixel, z = pixels_of(small, points)
        seen[view, inside] = np.abs(depth[pixel] - z) < settings.hidden * footprint(small, z)
    sparse, how = SparsePoints(points, seen), MvsSettings(sources=neighbours)
    return [select_sources(list(cameras), sparse, view, how) for view in range(len(cameras))]
