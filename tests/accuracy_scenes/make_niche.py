"""Render the niche of `tests/test_niche.py`: ``python -m tests.accuracy_scenes.make_niche`` (a minute).

A box of grey walls, open in front, stands on grey ground under an even sky; its left wall is red inside. What
is inside it is dark by what blocks the sky, and reddish by what the red wall sends on: no albedo is either.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np

from stages.formats.meshes.triangle_meshes import Surface
from stages.scene.cameras import Camera
from stages.synthetic.lights import SKY_DOME
from stages.synthetic.render import Quality, Scene
from stages.synthetic.truth import PaintedSurface
from stages.synthetic.views import arc_of_views, framed

FILE = Path(__file__).parent / "niche.npz"
GREY, RED = (0.5, 0.5, 0.5), (0.6, 0.12, 0.1)
HALF, DEPTH, HEIGHT, WALL = 0.5, 0.9, 0.8, 0.06  # of the box, in its own unit
SPACING = 0.06
SIDE_PX, VIEWS = 64, 4
QUALITY = Quality(samples=1024, reflections=8)


def sheet(corner: tuple, along: tuple, across: tuple) -> tuple[np.ndarray, np.ndarray]:
    """A rectangle of triangles, seen from where `along` turns to `across` counter-clockwise."""
    corner, along, across = np.array(corner), np.array(along), np.array(across)
    n, m = (max(1, round(float(np.linalg.norm(side)) / SPACING)) for side in (along, across))
    u, v = (one.ravel() for one in np.meshgrid(np.linspace(0, 1, n + 1), np.linspace(0, 1, m + 1)))
    first = (np.arange(m)[:, None] * (n + 1) + np.arange(n)).ravel()
    squares = np.column_stack([first, first + 1, first + n + 2, first + n + 1])
    return corner + u[:, None] * along + v[:, None] * across, np.concatenate(
        [squares[:, :3], squares[:, [0, 2, 3]]]
    )


def block(low: tuple, high: tuple) -> list[tuple[np.ndarray, np.ndarray]]:
    """The six sides of a box, seen from outside."""
    low, size = np.array(low), np.array(high) - np.array(low)
    x, y, z = np.diag(size)
    return [
        sheet(low, y, x),
        sheet(low + z, x, y),
        sheet(low, x, z),
        sheet(low + y, z, x),
        sheet(low, z, y),
        sheet(low + x, y, z),
    ]


def scene() -> tuple[Surface, np.ndarray]:
    """Mesh and albedo per vertex, (V, 3): ground, back, right, lid and left wall, which is red."""
    blocks = [
        block((-0.75, -0.6, -0.1), (0.75, 1.0, 0.0)),
        block((-HALF, DEPTH - WALL, 0), (HALF, DEPTH, HEIGHT)),
        block((HALF - WALL, 0, 0), (HALF, DEPTH, HEIGHT)),
        block((-HALF, 0, HEIGHT - WALL), (HALF, DEPTH, HEIGHT)),
        block((-HALF, 0, 0), (-HALF + WALL, DEPTH, HEIGHT)),
    ]
    vertices, faces, albedo, count = [], [], [], 0
    for number, sides in enumerate(blocks):
        for points, triangles in sides:
            vertices.append(points)
            faces.append(triangles + count)
            albedo.append(np.tile(RED if number == 4 else GREY, (len(points), 1)))
            count += len(points)
    return Surface(np.concatenate(vertices), np.concatenate(faces)), np.concatenate(albedo)


def views(surface: Surface) -> list[Camera]:
    """From the front, where one sees both side walls and the ground inside."""
    around, steep = np.linspace(-35, 35, VIEWS).tolist(), [12.0, 26.0] * (VIEWS // 2)
    centre = np.array([0.0, 0.2, 0.3])
    return framed(arc_of_views(around, steep, 6.0, centre, (SIDE_PX, SIDE_PX), 1.0), surface.vertices)


def main() -> None:
    """Render and store."""
    surface, albedo = scene()
    lit, painted = Scene(surface, albedo, SKY_DOME), PaintedSurface(surface, albedo)
    stored = {"vertices": surface.vertices.astype(np.float32), "faces": surface.faces.astype(np.int32)}
    for number, camera in enumerate(views(surface)):
        truth = painted.truth(camera)
        name = f"{number:03d}"
        stored |= {
            f"image_{name}": lit.photograph(camera, QUALITY, seed=number).astype(np.float16),
            f"albedo_{name}": truth.albedo.astype(np.float16),
            f"mask_{name}": truth.mask,
            f"depth_{name}": truth.depth,
            f"intrinsics_{name}": camera.intrinsics,
            f"cam_from_world_{name}": camera.cam_from_world,
        }
    np.savez_compressed(FILE, **stored)


if __name__ == "__main__":
    main()
