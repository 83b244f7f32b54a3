"""A procedural bust of our own: hair, a face with its mouth wide open, a shirt, a plinth.

The figure looks along −y, z is up, x is its left; it is about 1 unit tall. The mouth is a real cavity: the
paper's hardest place is the inside of a mouth, where little of the sky is seen and much light bounces.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cache, partial

import numpy as np
from scipy.spatial import cKDTree

from stages.formats.meshes.triangle_meshes import Surface
from stages.synthetic.subjects.distances import (
    capsule,
    ellipsoid,
    smooth_subtraction,
    smooth_union,
    sphere,
    torus,
    upright_cylinder,
)
from stages.synthetic.subjects.isosurface import closed_surface

PARTS = ("hair", "face", "shirt", "plinth")
# Odd numbers: the figure's flat faces must not fall on the grid, where triangles would have no area.
LOW, HIGH = np.array([-0.3917, -0.3923, -0.0931]), np.array([0.39, 0.39, 1.02])

HEAD_CENTRE = np.array([0.0, 0.0, 0.745])
HEAD_RADII = np.array([0.122, 0.148, 0.170])
BROAD, NARROW = 0.360, 0.190  # radii of the slab: the sample's, and one that leaves the picture to the figure
MOUTH_CENTRE = (0.0, -0.135, 0.652)


@dataclass(frozen=True, eq=False)
class Bust:
    """A closed triangle mesh with a part per vertex.

    Attributes
    ----------
    surface : Surface
        Right hand outwards.
    parts : ndarray, shape (V,), uint8
        Index into `PARTS`.
    """

    surface: Surface
    parts: np.ndarray


def build_bust(spacing: float, slab: float = BROAD) -> Bust:
    """Mesh the bust on a grid of cells of side `spacing` (0.01: 50 k faces; 0.004: 320 k faces).

    `slab` is the radius of the plate that the plinth stands on, model units.
    """
    surface = closed_surface(partial(solid_distance, slab=slab), LOW, HIGH, spacing)
    return Bust(surface, part_at(surface.vertices.astype(np.float32)))


def solid_distance(x: np.ndarray, slab: float = BROAD) -> np.ndarray:
    """Signed distance of the whole figure, shape (n,), at points (n, 3); negative inside."""
    return part_distances(x, slab).min(axis=0)


def part_at(x: np.ndarray) -> np.ndarray:
    """Part that each surface point belongs to, uint8 index into `PARTS`, shape (n,)."""
    return part_distances(x).argmin(axis=0).astype(np.uint8)


def part_distances(x: np.ndarray, slab: float = BROAD) -> np.ndarray:
    """Signed distance of every part, shape (4, n), in the order of `PARTS`."""
    mouth = _mouth(x)
    return np.stack(
        [smooth_subtraction(_hair(x), mouth, 0.004), _skin(x, mouth), _shirt(x), _plinth(x, slab)]
    )


def _mirrored(x: np.ndarray) -> np.ndarray:
    """The points with |x|: features made once on the figure's left appear on both sides."""
    return np.stack([np.abs(x[:, 0]), x[:, 1], x[:, 2]], axis=-1)


def _mouth(x: np.ndarray) -> np.ndarray:
    """The open mouth: a deep hole, wider than tall at the corners, with a tongue lying in it."""
    hole = ellipsoid(x, MOUTH_CENTRE, (0.050, 0.085, 0.052))
    corners = ellipsoid(x, (0.0, -0.150, 0.672), (0.060, 0.060, 0.026))
    hole = smooth_union(hole, corners, 0.02)
    tongue = ellipsoid(x, (0.0, -0.105, 0.612), (0.030, 0.058, 0.022))
    return smooth_subtraction(hole, tongue, 0.01)


def _skin(x: np.ndarray, mouth: np.ndarray) -> np.ndarray:
    both = _mirrored(x)
    skull = ellipsoid(x, HEAD_CENTRE, HEAD_RADII)
    jaw = ellipsoid(x, (0.0, -0.055, 0.645), (0.086, 0.096, 0.092))
    chin = sphere(x, (0.0, -0.112, 0.572), 0.026)
    cheeks = sphere(both, (0.066, -0.098, 0.712), 0.036)
    head = smooth_union(smooth_union(skull, jaw, 0.06), chin, 0.05)
    head = smooth_union(head, cheeks, 0.035)
    head = _with_eyes(smooth_union(head, _brows(both), 0.02), both)
    head = smooth_union(head, _nose(x, both), 0.018)
    lips = np.abs(mouth + 0.002) - x.dtype.type(0.011)
    lips = np.maximum(lips, np.abs(x[:, 1] + x.dtype.type(0.152)) - x.dtype.type(0.012))
    head = smooth_union(head, np.maximum(lips, head - x.dtype.type(0.010)), 0.012)
    head = smooth_subtraction(head, mouth, 0.008)
    head = smooth_union(head, _ears(both), 0.012)
    neck = capsule(x, (0.0, 0.035, 0.40), (0.0, 0.012, 0.64), 0.078, 0.066)
    return smooth_union(head, np.maximum(neck, -mouth), 0.03)


def _brows(both: np.ndarray) -> np.ndarray:
    inner = capsule(both, (0.018, -0.143, 0.812), (0.050, -0.136, 0.826), 0.010, 0.011)
    return np.minimum(inner, capsule(both, (0.050, -0.136, 0.826), (0.084, -0.108, 0.812), 0.011, 0.007))


def _nose(x: np.ndarray, both: np.ndarray) -> np.ndarray:
    bridge = capsule(x, (0.0, -0.140, 0.795), (0.0, -0.172, 0.737), 0.012, 0.019)
    nose = smooth_union(bridge, sphere(both, (0.019, -0.160, 0.731), 0.013), 0.012)
    return smooth_subtraction(nose, sphere(both, (0.010, -0.172, 0.719), 0.006), 0.004)


def _with_eyes(head: np.ndarray, both: np.ndarray) -> np.ndarray:
    """Sink the sockets, set the eyeballs, close the lids a little: almond eyes."""
    head = smooth_subtraction(head, ellipsoid(both, (0.050, -0.150, 0.779), (0.034, 0.026, 0.022)), 0.02)
    ball = sphere(both, (0.050, -0.105, 0.778), 0.027)
    lid = sphere(both, (0.050, -0.105, 0.778), 0.0315)
    above = (
        both.dtype.type(0.784)
        - both[:, 2]
        + both.dtype.type(0.12) * np.abs(both[:, 0] - both.dtype.type(0.05))
    )
    below = both[:, 2] - both.dtype.type(0.768)
    lids = np.minimum(np.maximum(lid, above), np.maximum(lid, below))
    return smooth_union(smooth_union(head, ball, 0.002), lids, 0.006)


def _ears(both: np.ndarray) -> np.ndarray:
    shell = ellipsoid(both, (0.128, 0.005, 0.748), (0.016, 0.030, 0.044))
    return smooth_subtraction(shell, ellipsoid(both, (0.142, -0.006, 0.754), (0.010, 0.017, 0.026)), 0.008)


@cache
def _curls() -> cKDTree:
    """Centres of the curls: a golden spiral over the skull, without the face, the ears and the nape."""
    count = 150
    height = 1 - 2 * (np.arange(count) + 0.5) / count
    turn = np.arange(count) * np.pi * (3 - np.sqrt(5))
    ring = np.sqrt(1 - height**2)
    direction = np.stack([ring * np.cos(turn), ring * np.sin(turn), height], axis=-1)
    front = -direction[:, 1]
    hairline = np.where(
        front > 0.1, 0.42 + 0.35 * front - 0.45 * np.abs(direction[:, 0]), -0.45 - 0.3 * front
    )
    beside_ear = (np.abs(direction[:, 0]) > 0.75) & (front > -0.35)
    hairline = np.where(beside_ear, np.maximum(hairline, 0.32), hairline)
    return cKDTree(HEAD_CENTRE + direction[height > hairline] * (HEAD_RADII + 0.002))


def _hair(x: np.ndarray) -> np.ndarray:
    """The curls near the head; far from it, a bound that costs less than looking for the nearest curl."""
    distance = ellipsoid(x, HEAD_CENTRE, HEAD_RADII + 0.036)
    near = distance < 0.03
    distance[near] = _curled(x[near])
    return distance


def _curled(x: np.ndarray) -> np.ndarray:
    """Curls as overlapping balls, each carved by a spiral groove; deep clefts between them."""
    distance, which = map(np.asarray, _curls().query(x, k=6, workers=1))
    distance = distance.astype(x.dtype)
    offset = x - _curls().data[which[:, 0]].astype(x.dtype)
    outward = (_curls().data[which[:, 0]] - HEAD_CENTRE).astype(x.dtype)
    outward /= np.linalg.norm(outward, axis=-1, keepdims=True)
    sideways = np.cross(outward, np.array([0.0, 0.3, 1.0], x.dtype))
    sideways /= np.linalg.norm(sideways, axis=-1, keepdims=True)
    angle = np.arctan2((offset * np.cross(outward, sideways)).sum(-1), (offset * sideways).sum(-1))
    from_axis = np.linalg.norm(np.cross(offset, outward), axis=-1)
    groove = x.dtype.type(0.0016) * np.cos(angle + from_axis * x.dtype.type(2 * np.pi / 0.013))
    groove *= np.clip(
        from_axis * x.dtype.type(100), 0, 1
    )  # no seam at the curl's pole, where the angle jumps
    balls = distance - x.dtype.type(0.032)
    hair = balls[:, 0] + groove
    for neighbour in balls.T[1:]:
        hair = smooth_union(hair, neighbour + x.dtype.type(0.001), 0.006)
    return hair


def _shirt(x: np.ndarray) -> np.ndarray:
    """Chest and shoulders with folds that run down from the collar, buttons, and a flat cut below."""
    both = _mirrored(x)
    chest = ellipsoid(x, (0.0, 0.015, 0.365), (0.205, 0.140, 0.170))
    shoulders = capsule(both, (0.10, 0.025, 0.455), (0.205, 0.030, 0.392), 0.070, 0.082)
    body = smooth_union(chest, shoulders, 0.07)
    turn = np.arctan2(both[:, 0], -x[:, 1] + x.dtype.type(0.05))
    folds = np.sin(x.dtype.type(9) * turn + x.dtype.type(14) * x[:, 2]) * np.sin(
        x.dtype.type(5) * turn - x.dtype.type(23) * x[:, 2] + x.dtype.type(40) * x[:, 0]
    )
    body = body + x.dtype.type(0.005) * folds
    collar = torus(x, (0.0, 0.018, 0.525), (0.0, -0.42, 1.0), 0.088, 0.017)
    lapel = capsule(both, (0.060, -0.062, 0.490), (0.012, -0.128, 0.405), 0.015, 0.010)
    body = smooth_union(smooth_union(body, collar, 0.012), lapel, 0.008)
    for height, depth in ((0.37, -0.124), (0.32, -0.126), (0.27, -0.115)):
        body = smooth_union(body, ellipsoid(x, (0.0, depth, height), (0.011, 0.010, 0.011)), 0.003)
    return np.maximum(body, x.dtype.type(0.215) - x[:, 2])


def _plinth(x: np.ndarray, slab_radius: float) -> np.ndarray:
    """A turned column with mouldings on a round slab."""
    column = upright_cylinder(x, -0.02, 0.225, 0.105, 0.008)
    column = column + x.dtype.type(0.004) * np.cos(x.dtype.type(16) * np.arctan2(x[:, 1], x[:, 0]))
    top = upright_cylinder(x, 0.195, 0.235, 0.135, 0.010)
    foot = upright_cylinder(x, -0.01, 0.040, 0.150, 0.012)
    ring = torus(x, (0.0, 0.0, 0.058), (0, 0, 1), 0.118, 0.014)
    column = smooth_union(smooth_union(column, top, 0.012), foot, 0.015)
    column = smooth_union(column, ring, 0.006)
    slab = upright_cylinder(x, -0.060, 0.0, slab_radius, 0.012)
    return smooth_union(column, slab, 0.01)
