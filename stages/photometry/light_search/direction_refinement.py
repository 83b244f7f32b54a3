"""Finer cells where light is bright: suns and lamps lie between the directions they were looked for in."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from stages.photometry.light_search.light_estimate import LightEstimate
from stages.photometry.light_search.settings import RefinementSettings
from stages.photometry.transport.directional_transport import AROUND, DirectionalTransport, honeycomb
from stages.photometry.transport.lit_scenes import LitScene


def divided(scene: LitScene, found: LightEstimate, how: RefinementSettings) -> tuple[LitScene, LightEstimate]:
    """Divide the cells that are bright into seven, each as bright as the whole.

    The light is the same; it can now be found anew with shadows as sharp as the finer cells are. Nothing
    changes where no cell is bright, or nobody can look.
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
    """Numbers of the cells, (M,), that any of the lights (G, M, 3) has far brighter than its mean, sorted."""
    light = radiance.sum(axis=2)
    brightness = (light / np.maximum(light @ cells, 1e-12)[:, None]).max(axis=0)
    bright = np.flatnonzero(brightness > how.bright)
    strongest = np.argsort(-(cells * brightness)[bright], kind="stable")[: how.max_cells]
    return np.sort(bright[strongest])


def _with_more(
    transport: DirectionalTransport, bright: np.ndarray, around: np.ndarray, seen: np.ndarray
) -> DirectionalTransport:
    """The same with six further directions for each bright cell, (n, 3), their cells, and what vertices see.

    `seen`, (P, ⌈n/8⌉), is what they see of these.
    """
    cells = transport.cells.copy()
    cells[bright] /= AROUND + 1
    whole, rest = divmod(len(cells), 8)
    begun = np.unpackbits(transport.visible[:, whole:], axis=1)[:, :rest]
    further = np.concatenate([begun, np.unpackbits(seen, axis=1, count=len(around))], axis=1)
    return replace(
        transport,
        directions=np.concatenate([transport.directions, around]),
        cells=np.concatenate([cells, np.repeat(cells[bright], AROUND)]),
        visible=np.concatenate([transport.visible[:, :whole], np.packbits(further, axis=1)], axis=1),
    )
