"""Finer cells where light is bright: suns and lamps lie between the directions they were looked for in."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from stages.photometry.sky import SkyTransport
from stages.photometry.sky_light import FoundLight, SkyScene

BRIGHT = 3.0  # times the mean light: cells that are divided
MOST = 24  # of them, those that send most: each costs six directions more, and lamps are few
AROUND = 6  # new directions around the one in the middle, as honeycombs have it


def divided(scene: SkyScene, found: FoundLight) -> tuple[SkyScene, FoundLight]:
    """Divide the cells that are bright into seven, each as bright as the whole.

    The light is the same; it can now be found anew with shadows as sharp as the finer cells are. Nothing
    changes where no cell is bright, or nobody can look.
    """
    transport = scene.pixels
    bright = bright_cells(found.radiance, transport.cells)
    if scene.eyes is None or not bright.size:
        return scene, found
    around = honeycomb(transport.directions[bright], transport.cells[bright] / (AROUND + 1))
    finer = _with_more(transport, bright, around, scene.eyes.see(around, scene.sphere))
    scene = replace(scene, pixels=replace(scene.pixels, **finer), vertices=replace(scene.vertices, **finer))
    of_new = found.radiance[:, np.repeat(bright, AROUND)]
    return scene, replace(found, radiance=np.concatenate([found.radiance, of_new], axis=1))


def bright_cells(radiance: np.ndarray, cells: np.ndarray) -> np.ndarray:
    """Numbers of the cells, (M,), that are far brighter than the mean of all lights (G, M, 3), sorted."""
    light = radiance.sum(axis=(0, 2))
    bright = np.flatnonzero(light > BRIGHT * (cells * light).sum())
    strongest = np.argsort(-(cells * light)[bright], kind="stable")[:MOST]
    return np.sort(bright[strongest])


def honeycomb(directions: np.ndarray, cells: np.ndarray) -> np.ndarray:
    """Six directions around each of some, (n, 3), as far away as cells of such a size lie apart, (6 n, 3).

    A cell of the honeycomb whose share of all directions is c is as wide as ``√(2/√3 · 4π c)``.
    """
    directions = directions.astype(np.float64)
    width = np.sqrt(2 / np.sqrt(3) * 4 * np.pi * cells.astype(np.float64))[:, None, None]
    aside = np.eye(3)[np.argmin(np.abs(directions), axis=1)]
    one = np.cross(directions, aside)
    one /= np.linalg.norm(one, axis=1, keepdims=True)
    other = np.cross(directions, one)
    turn = 2 * np.pi * np.arange(AROUND)[None, :, None] / AROUND
    off = np.cos(turn) * one[:, None] + np.sin(turn) * other[:, None]
    return (np.cos(width) * directions[:, None] + np.sin(width) * off).reshape(-1, 3).astype(np.float32)


def _with_more(
    transport: SkyTransport, bright: np.ndarray, around: np.ndarray, seen: np.ndarray
) -> dict[str, np.ndarray]:
    """Directions, cells and what vertices see, with six further directions for each bright cell, (n, 3).

    `seen`, (P, ⌈n/8⌉), is what they see of these.
    """
    cells = transport.cells.copy()
    cells[bright] /= AROUND + 1
    before = np.unpackbits(transport.visible, axis=1, count=len(cells))
    further = np.unpackbits(seen, axis=1, count=len(around))
    return {
        "directions": np.concatenate([transport.directions, around]),
        "cells": np.concatenate([cells, np.repeat(cells[bright], AROUND)]),
        "visible": np.packbits(np.concatenate([before, further], axis=1), axis=1),
    }
