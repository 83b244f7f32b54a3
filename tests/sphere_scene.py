"""A bumpy sphere painted in three uniform parts, turning below its light, seen by four cameras.

The bumps are in the normals only, a function of the surface point; depths are those of the unit sphere.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from itertools import combinations

import numpy as np
import scipy.sparse as sp

from stages.geometry.covisibility.correspondences import find_correspondences
from stages.geometry.surface import OrientedPoints
from stages.photometry.paper.harmonics import shading_basis
from stages.photometry.stack import StackedViews, stack_pixels, stack_views
from stages.scene.cameras import Camera, back_project, rays_in_world

PAINTS = np.array([[0.8, 0.45, 0.3], [0.25, 0.3, 0.7], [0.5, 0.6, 0.2]])
LIGHT = np.array([2.2, 0.9, 0.9, -0.5, 0.2, -0.1, 0.2, 0.1, -0.15])


@dataclass
class SphereScene:
    """Per view: camera, depth, mask, normals, true albedo (h, w, 3) and shading (h, w); links per pair."""

    cameras: list[Camera] = field(default_factory=list)
    depths: list[np.ndarray] = field(default_factory=list)
    masks: list[np.ndarray] = field(default_factory=list)
    normals: list[np.ndarray] = field(default_factory=list)
    albedos: list[np.ndarray] = field(default_factory=list)
    shadings: list[np.ndarray] = field(default_factory=list)
    correspondences: dict[tuple[int, int], sp.csr_array] = field(default_factory=dict)

    @property
    def images(self) -> list[np.ndarray]:
        return [
            albedo * shading[..., None] for albedo, shading in zip(self.albedos, self.shadings, strict=True)
        ]

    def stacked(self) -> StackedViews:
        return stack_views(self.masks, self.normals, self.correspondences)

    def channels(self) -> list[np.ndarray]:
        """The channels of the images over all masked pixels, 99th percentile = 1."""
        pixels = stack_pixels(self.masks, self.images)
        return list(np.ascontiguousarray((pixels / np.percentile(pixels, 99)).T))

    def true_channels(self) -> list[np.ndarray]:
        return list(stack_pixels(self.masks, self.albedos).T)


def camera_looking_at_origin(name: str, centre: np.ndarray, width: int, height: int, focal: float) -> Camera:
    """World up is z; the camera's y points down."""
    forward = -centre / np.linalg.norm(centre)
    right = np.cross(forward, [0.0, 0.0, 1.0])
    right /= np.linalg.norm(right)
    rotation = np.stack([right, np.cross(forward, right), forward])
    intrinsics = np.array([[focal, 0, width / 2], [0, focal, height / 2], [0, 0, 1]])
    return Camera(name, width, height, intrinsics, np.column_stack([rotation, -rotation @ centre]))


def unit_sphere_depth(camera: Camera) -> np.ndarray:
    """z of the unit sphere at the origin in every pixel, 0 where it is missed."""
    rays, centre = rays_in_world(camera), camera.centre_in_world
    a, b = np.sum(rays * rays, -1), rays @ centre
    under = b * b - a * (centre @ centre - 1)
    return np.where(under > 0, (-b - np.sqrt(np.maximum(under, 0))) / a, 0.0)


def sphere_scene(
    view_count: int = 4, width: int = 48, height: int = 40, turn_deg: float = 90.0
) -> SphereScene:
    """Cameras 20° apart; the light turns by `turn_deg` about the vertical from one view to the next."""
    scene = SphereScene()
    for i in range(view_count):
        angle = np.deg2rad(20 * i)
        centre = 4.0 * np.array([np.cos(angle), np.sin(angle), 0.35])
        camera = camera_looking_at_origin(f"view {i}", centre, width, height, focal=1.6 * width)
        depth = unit_sphere_depth(camera)
        mask = depth > 0
        points = np.where(mask[..., None], back_project(camera, depth), [0.0, 0.0, 1.0])
        normals = bumpy(points)
        scene.cameras.append(camera)
        scene.depths.append(depth)
        scene.masks.append(mask)
        scene.normals.append(normals)
        scene.albedos.append(np.where(mask[..., None], PAINTS[_part(points)], 0.0))
        shading = shading_basis(normals @ _turn(turn_deg * i)) @ LIGHT
        scene.shadings.append(np.where(mask, shading, 0.0))
    for i, j in combinations(range(view_count), 2):
        scene.correspondences[i, j] = find_correspondences(
            scene.cameras[i], scene.depths[i], scene.masks[i],
            scene.cameras[j], scene.depths[j], scene.masks[j], epsilon=3.0,
        )  # fmt: skip
    return scene


def bumpy(points: np.ndarray) -> np.ndarray:
    normals = points + 0.5 * np.sin(9 * points[..., [1, 2, 0]])
    return normals / np.linalg.norm(normals, axis=-1, keepdims=True)


def _part(points: np.ndarray) -> np.ndarray:
    east = np.sin(np.arctan2(points[..., 1], points[..., 0])) > 0.3
    return np.where(east, 1, np.where(points[..., 2] > 0.45, 2, 0))


def _turn(angle_deg: float) -> np.ndarray:
    cosine, sine = np.cos(np.deg2rad(angle_deg)), np.sin(np.deg2rad(angle_deg))
    return np.array([[cosine, -sine, 0], [sine, cosine, 0], [0, 0, 1]])


def points_of_a_sphere(count: int, radius: float = 1.0) -> OrientedPoints:
    """Points all over a sphere around the origin, a footprint of .03 each."""
    normals = np.random.default_rng(0).normal(size=(count, 3))
    normals /= np.linalg.norm(normals, axis=1, keepdims=True)
    return OrientedPoints(radius * normals, normals, np.full(count, 0.03), np.ones(count))
