"""Refinement of directions where light is bright: suns and lamps lie between the sampled directions."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from stages.photometry.light_search.light_estimate import LightEstimate
from stages.photometry.light_search.settings import RefinementSettings
from stages.photometry.transport.directional_transport import AROUND, DirectionalTransport, honeycomb
from stages.photometry.transport.lit_scenes import LitScene


def divided(scene: LitScene, found: LightEstimate, how: RefinementSettings) -> tuple[LitScene, LightEstimate]:
    """Subdivide bright cells into seven of the same radiance.

    The light is unchanged; it can then be re-estimated with shadows as sharp as the finer cells. Without
    bright cells, or without visibility probes, the inputs are returned.
    """
    transport = scene.pixels
    bright = bright_cells(found.radiance, transport.cells, how)
    if scene.probes is None or not bright.size:
        return scene, found
    around = honeycomb(transport.directions[bright], transport.cells[bright] / (AROUND + 1))
    finer = _with_more(transport, bright, around, scene.probes.see(around, scene.sphere))
    vertices = replace(scene.vertices, directions=finer.directions, cells=finer.cells, visible=finer.visible)
    scene = replace(scene, pixels=finer, vertices=vertices)
    of_new = found.radiance[:, np.repeat(bright, AROUND)]
    return scene, replace(found, radiance=np.concatenate([found.radiance, of_new], axis=1))


def bright_cells(radiance: np.ndarray, cells: np.ndarray, how: RefinementSettings) -> np.ndarray:
    """Select the cells, (M,), that are far brighter than the mean in any light (G, M, 3): sorted indices."""
    light = radiance.sum(axis=2)
    brightness = (light / np.maximum(light @ cells, 1e-12)[:, None]).max(axis=0)
    bright = np.flatnonzero(brightness > how.bright)
    strongest = np.argsort(-(cells * brightness)[bright], kind="stable")[: how.max_cells]
    return np.sort(bright[strongest])


def _with_more(
    transport: DirectionalTransport, bright: np.ndarray, around: np.ndarray, visible: np.ndarray
) -> DirectionalTransport:
    """Add directions, (n, 3), six for each bright cell, with their cells and visibility, (P, ⌈n/8⌉)."""
    cells = transport.cells.copy()
    cells[bright] /= AROUND + 1
    whole, rest = divmod(len(cells), 8)
    begun = np.unpackbits(transport.visible[:, whole:], axis=1)[:, :rest]
    further = np.concatenate([begun, np.unpackbits(visible, axis=1, count=len(around))], axis=1)
    return replace(
        transport,
        directions=np.concatenate([transport.directions, around]),
        cells=np.concatenate([cells, np.repeat(cells[bright], AROUND)]),
        visible=np.concatenate([transport.visible[:, :whole], np.packbits(further, axis=1)], axis=1),
    )
