"""The scene of `sample_data`: the bust in a paint for matching, a sky and one soft lamp, twelve views."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from stages.formats.meshes.triangle_meshes import Surface, to_open3d
from stages.scene.cameras import Camera
from stages.synthetic.lights import Dome, Lamp, Light
from stages.synthetic.paints.paint import paint_for_matching
from stages.synthetic.render import Quality
from stages.synthetic.subjects.bust import Bust, build_bust
from stages.synthetic.views import arc_of_views

DISTANCE = 3.0
WIDTH, HEIGHT, FOCAL_PX = 360, 480, 1250.0
LIGHT = Light(
    dome=Dome(sky=(0.80, 0.95, 1.15), ground=(0.35, 0.33, 0.30)),
    lamps=(Lamp(centre=(-2.2, -2.6, 2.8), towards=(0.0, 0.0, 0.5), side=1.2, radiance=(42.0, 37.0, 29.0)),),
)
QUALITY = Quality(samples=121, reflections=5)


@dataclass(frozen=True, eq=False)
class SampleScene:
    """What is rendered: `bust`, its `albedo` per vertex (V, 3), the `cameras`, `light` and `quality`."""

    bust: Bust
    albedo: np.ndarray
    cameras: list[Camera]
    light: Light
    quality: Quality


def sample_scene(spacing: float = 0.0025, shrink: float = 1.0, quality: Quality = QUALITY) -> SampleScene:
    """Build the scene; the mesh is finer than the pixels, since its vertices carry the paint.

    Parameters
    ----------
    spacing : float
        Grid of the rendered mesh, model units; 0.0025 gives 828 k faces and is one pixel footprint.
    shrink : float
        Factor on the pictures' size, for quick looks.
    quality : Quality
    """
    bust = build_bust(spacing)
    footprint = DISTANCE / FOCAL_PX
    albedo = paint_for_matching(bust.surface.vertices, bust.parts, finest=2.4 * footprint)
    return SampleScene(bust, albedo, sample_cameras(shrink), LIGHT, quality)


def sample_cameras(shrink: float = 1.0) -> list[Camera]:
    """Two arcs of six views, 16° apart, at elevations of 8° and 24°; 360×480 pixels times `shrink`."""
    azimuths = [-40.0, -24.0, -8.0, 8.0, 24.0, 40.0]
    cameras = arc_of_views(
        azimuths * 2, [8.0] * 6 + [24.0] * 6, DISTANCE, np.array([0.0, 0.0, 0.45]), (WIDTH, HEIGHT), FOCAL_PX
    )
    return [camera.scaled(round(WIDTH * shrink), round(HEIGHT * shrink)) for camera in cameras]


def exposure(images: list[np.ndarray], masks: list[np.ndarray], saturated: float = 0.001) -> float:
    """One factor for all images: at most a share `saturated` of masked pixels reaches 1 in any channel."""
    brightest = np.concatenate([image[mask].max(axis=-1) for image, mask in zip(images, masks, strict=True)])
    return float(1 / np.quantile(brightest, 1 - saturated))


def halved(image: np.ndarray) -> np.ndarray:
    """Mean over blocks of 2×2 pixels: exactly what the camera ``scaled`` to half the size would have seen."""
    height, width = image.shape[:2]
    return image.reshape(height // 2, 2, width // 2, 2, -1).mean(axis=(1, 3)).astype(np.float32)


def compact_mesh(surface: Surface, faces: int) -> Surface:
    """The same surface with fewer faces, by quadric decimation; vertices rounded to float32."""
    coarse = to_open3d(surface).simplify_quadric_decimation(faces)
    vertices = np.asarray(coarse.vertices).astype(np.float32)
    return Surface(vertices.astype(float), np.asarray(coarse.triangles, np.int32).copy())


def rounded(values: np.ndarray, bits: int = 8) -> np.ndarray:
    """Values rounded to `bits` significant bits (relative error at most 2^−bits), so that files compress."""
    mantissa, exponent = np.frexp(values)
    return np.ldexp(np.round(mantissa * 2**bits) / 2**bits, exponent).astype(np.float32)
