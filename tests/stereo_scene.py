"""A painted sphere before a painted slanted wall that ends at an even sky, ray-traced from six cameras."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pycolmap

from stages.formats.colmap.depth_maps import read_map
from stages.formats.colmap.model import pinhole_model
from stages.formats.images.photos import write_png_srgb8
from stages.scene.cameras import Camera, footprint, normals_in_world, project, rays_in_world
from stages.stereo.depth.dense_stereo import ViewPlan

CENTRE, RADIUS = np.array([0.0, 0.1, 4.0]), 0.7
WALL_NORMAL, WALL_OFFSET = np.array([0.3, 0.1, -0.9486833]), -4.6  # n·X = offset
WALL_LEFT = -0.9
SKY = 0.5


@dataclass(frozen=True, eq=False)
class Traced:
    """What a camera sees: grey (h, w) in [0, 1], z-depth (h, w), 0 for sky, world normals (h, w, 3)."""

    grey: np.ndarray
    depth: np.ndarray
    normals: np.ndarray


def cameras(count: int = 6, width: int = 120, height: int = 90) -> list[Camera]:
    """Cameras on an arc, all looking at (0, 0, 4.3)."""
    K = np.array([[130.0 * width / 120, 0, width / 2], [0, 130.0 * width / 120, height / 2], [0, 0, 1]])
    found = []
    for index, angle in enumerate(np.deg2rad(np.linspace(-20, 20, count))):
        centre = np.array([4.3 * np.sin(angle), 0.3 * (index % 2), 4.3 - 4.3 * np.cos(angle)])
        z = np.array([0, 0, 4.3]) - centre
        z /= np.linalg.norm(z)
        x = np.cross([0.0, 1.0, 0.0], z)
        x /= np.linalg.norm(x)
        rotation = np.stack([x, np.cross(z, x), z])
        pose = np.column_stack([rotation, -rotation @ centre])
        found.append(Camera(f"view {index}", width, height, K, pose))
    return found


def paint(x_in_world: np.ndarray) -> np.ndarray:
    """Solid texture, (n,), about 0.1 to 0.9: waves of many directions, none shorter than four pixels."""
    rng = np.random.default_rng(3)
    waves = rng.normal(size=(40, 3)) * rng.uniform(6, 22, (40, 1)) / 1.7
    values = np.sin(x_in_world @ waves.T + rng.uniform(0, 6.28, 40)).sum(axis=1)
    return 0.5 + 0.4 * np.tanh(values / 5)


def trace(camera: Camera) -> Traced:
    """Ray-trace one view at its pixel centres."""
    rays = rays_in_world(camera).reshape(-1, 3)
    origin = camera.centre_in_world
    wall = (WALL_OFFSET - origin @ WALL_NORMAL) / (rays @ WALL_NORMAL)
    wall[(wall <= 0) | ((origin + rays * wall[:, None])[:, 0] < WALL_LEFT)] = np.inf
    a, b = np.sum(rays**2, axis=1), rays @ (origin - CENTRE)
    root = b**2 - a * (np.sum((origin - CENTRE) ** 2) - RADIUS**2)
    ball = np.where(root > 0, (-b - np.sqrt(np.maximum(root, 0))) / a, np.inf)
    depth = np.minimum(wall, ball)
    seen = np.isfinite(depth)
    x_in_world = origin + rays * np.where(seen, depth, 1)[:, None]
    normals = np.where((ball < wall)[:, None], (x_in_world - CENTRE) / RADIUS, WALL_NORMAL)
    grey = np.where(seen, paint(x_in_world), SKY)
    shape = camera.shape
    return Traced(
        grey.reshape(shape).astype(np.float32),
        np.where(seen, depth, 0).reshape(shape),
        np.where(seen[:, None], normals, 0).reshape(*shape, 3),
    )


def plans(views: list[Camera]) -> list[ViewPlan]:
    """Every view with its nearest three, over depths that hold the scene."""
    indices = range(len(views))
    return [ViewPlan(sorted(indices, key=lambda j: abs(j - i))[1:4], 2.5, 7.5) for i in indices]


def write_workspace(folder: Path, views: list[Camera], *, points: bool = True) -> Path:
    """The scene as a COLMAP dense workspace with sparse points on its surface."""
    model = pinhole_model(views)
    traced = [trace(camera) for camera in views]
    for camera, view in zip(views, traced, strict=True):
        write_png_srgb8(
            folder / "images" / f"{camera.name}.png", np.repeat(view.grey[..., None], 3, axis=2) ** 2.2
        )
    if points:
        _add_points(model, views, traced)
    (folder / "sparse").mkdir(parents=True)
    model.write(folder / "sparse")
    return folder


def _add_points(model: pycolmap.Reconstruction, views: list[Camera], traced: list[Traced]) -> None:
    """Every 13th surface pixel of the middle view, observed by all views that it falls into unhidden."""
    middle = views[len(views) // 2]
    depth = traced[len(views) // 2].depth.ravel()
    chosen = np.flatnonzero(depth > 0)[::13]
    rays = rays_in_world(middle).reshape(-1, 3)
    tracks = []
    for x_in_world in middle.centre_in_world + rays[chosen] * depth[chosen][:, None]:
        seen = []
        for index, camera in enumerate(views):
            xy, z = project(camera, x_in_world)
            column, row = int(xy[0]), int(xy[1])
            inside = 0 <= column < camera.width and 0 <= row < camera.height
            if inside and abs(traced[index].depth[row, column] - z) < 0.1:
                seen.append((camera.name, xy))
        tracks.append((x_in_world, seen))
    images = {image.name.removesuffix(".png"): image for image in model.images.values()}
    observed, points = {name: [] for name in images}, []
    for x_in_world, seen in tracks:
        elements = []
        for name, xy in seen:
            elements.append(pycolmap.TrackElement(images[name].image_id, len(observed[name])))
            observed[name].append(pycolmap.Point2D(xy))
        if len(elements) > 1:
            points.append((x_in_world, pycolmap.Track(elements)))
    for name, image in images.items():
        image.points2D = pycolmap.Point2DList(observed[name])
    for x_in_world, track in points:
        model.add_point3D(x_in_world, track, np.array([128, 128, 128], np.uint8))


def beside_truth(folder: Path) -> tuple[np.ndarray, np.ndarray, list[float]]:
    """Compare depth and normal maps, in COLMAP's layout, with the scene where both have surface.

    Errors of depth in footprints and of normals in degrees, of all views; share of the surface with depth,
    per view.
    """
    depths, normals, covered = [], [], []
    for camera in cameras():
        traced, name = trace(camera), f"{camera.name}.png.geometric.bin"
        depth, in_cam = (read_map(folder / kind / name) for kind in ("depth_maps", "normal_maps"))
        both = (depth > 0) & (traced.depth > 0)
        depths.append(np.abs(depth - traced.depth)[both] / footprint(camera, traced.depth[both]))
        cosine = np.sum(normals_in_world(camera, in_cam) * traced.normals, axis=-1)[both]
        normals.append(np.rad2deg(np.arccos(np.clip(cosine, -1, 1))))
        covered.append(both.sum() / (traced.depth > 0).sum())
    return np.concatenate(depths), np.concatenate(normals), covered
