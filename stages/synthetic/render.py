"""Path-traced pictures of a painted mesh by Mitsuba 3: linear, with bounces, from exact cameras.

Mitsuba is an optional dependency (the extra `synthetic`), imported by the functions that need it. Pixels are
box-filtered: a pixel is the mean radiance over its own square, and shares no sample with its neighbours.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from stages.formats.meshes.triangle_meshes import Surface
from stages.scene.cameras import Camera
from stages.synthetic.lights import Dome, Environment, Lamp, Light, dome_picture

BLOCK = 16  # pixels: the squares that Mitsuba's threads take in turn

Description = dict[str, Any]  # of a part of a scene, as Mitsuba reads it


@dataclass(frozen=True)
class Quality:
    """How much work goes into a pixel.

    Attributes
    ----------
    samples : int
        Per pixel and light source, in strata; a square, or the product of two near factors.
    reflections : int
        How many times light may be reflected before it reaches the camera; 1 is direct light only.
    """

    samples: int = 121
    reflections: int = 5


@dataclass(frozen=True, eq=False)
class Gloss:
    """A rough mirror mixed into the paint.

    Attributes
    ----------
    share : ndarray, shape (V,), float
        How much of the reflection is the mirror's, 0 to 1; the diffuse albedo becomes (1 − share) · paint.
    roughness : ndarray, shape (V,), float
        α of the GGX distribution of its facets, 0.02 to 1.
    colour : ndarray, shape (V, 3)
        Reflectance of the mirror: white, or a metal's.
    """

    share: np.ndarray
    roughness: np.ndarray
    colour: np.ndarray

    @classmethod
    def white(cls, share: np.ndarray, roughness: float) -> Gloss:
        """Gloss of one roughness and no colour, as of varnish."""
        return cls(share, np.full(len(share), roughness), np.ones((len(share), 3)))


@dataclass(frozen=True)
class Tile:
    """A rectangle of pixels, rendered alone: its corner and its size."""

    x: int
    y: int
    width: int
    height: int

    @property
    def slices(self) -> tuple[slice, slice]:
        """Its place in an image array."""
        return slice(self.y, self.y + self.height), slice(self.x, self.x + self.width)


def tiles_of(camera: Camera, side: int = 64) -> list[Tile]:
    """Tiles of at most `side` pixels that cover a camera's picture."""
    return [
        Tile(x, y, min(side, camera.width - x), min(side, camera.height - y))
        for y in range(0, camera.height, side)
        for x in range(0, camera.width, side)
    ]


class Scene:
    """A painted mesh under a light, ready to be looked at.

    Parameters
    ----------
    surface : Surface
        Right hand outwards. Shaded flat: the surface that is rendered is the mesh itself.
    paint : ndarray, shape (V, 3)
        Linear, interpolated within faces: the albedo, where there is no gloss.
    light : Light
    gloss : Gloss, optional
    """

    def __init__(self, surface: Surface, paint: np.ndarray, light: Light, gloss: Gloss | None = None):
        mi = _mitsuba()
        sources = [_dome(mi, light.dome)] if light.dome is not None else []
        sources += [_lamp(mi, lamp) for lamp in light.lamps]
        self._scenes = [
            mi.load_dict({"type": "scene", "figure": _painted_mesh(mi, surface, paint, gloss), "s": source})
            for source in sources
        ]

    def photograph(self, camera: Camera, quality: Quality, seed: int, tile: Tile | None = None) -> np.ndarray:
        """Radiance towards the camera, linear, shape (height, width, 3), float32; the same for the same seed.

        With a `tile`, its pixels only.

        One pass per light source, summed: light adds up, and no sample is spent on choosing a source.
        """
        mi = _mitsuba()
        tile = tile or Tile(0, 0, camera.width, camera.height)
        integrator = mi.load_dict(
            {
                "type": "path",
                "max_depth": quality.reflections + 1,
                "rr_depth": 64,
                # Mitsuba seeds block by block, and would choose their size by the number of threads.
                "block_size": BLOCK,
            }
        )
        sensor = mi.load_dict(_sensor(mi, camera, quality, tile))
        passes = [
            mi.render(scene, sensor=sensor, integrator=integrator, spp=quality.samples, seed=seed)
            for scene in self._scenes
        ]
        return np.sum([np.array(image, np.float32)[..., :3] for image in passes], axis=0)


def use_threads(count: int) -> None:
    """Let Mitsuba use `count` threads, which does not change a picture."""
    _mitsuba()
    import drjit

    drjit.set_thread_count(count)


def _mitsuba():
    """Mitsuba with the variant that runs everywhere: no LLVM, no GPU."""
    import mitsuba

    if mitsuba.variant() != "scalar_rgb":
        mitsuba.set_variant("scalar_rgb")
    return mitsuba


def _painted_mesh(mi, surface: Surface, paint: np.ndarray, gloss: Gloss | None):
    properties = mi.Properties()
    properties["mesh_bsdf"] = mi.load_dict(_material(gloss))
    mesh = mi.Mesh("figure", len(surface.vertices), len(surface.faces), props=properties)
    mesh.add_attribute("vertex_color", 3, np.ascontiguousarray(paint, np.float32).ravel())
    if gloss is not None:
        for name, values in (("gloss", gloss.share), ("rough", gloss.roughness), ("mirror", gloss.colour)):
            values = np.ascontiguousarray(values, np.float32)
            mesh.add_attribute(f"vertex_{name}", values.size // len(values), values.ravel())
    parameters = mi.traverse(mesh)
    parameters["vertex_positions"] = np.ascontiguousarray(surface.vertices, np.float32).ravel()
    parameters["faces"] = np.ascontiguousarray(surface.faces, np.uint32).ravel()
    parameters.update()
    return mesh


def _material(gloss: Gloss | None) -> Description:
    diffuse = {"type": "diffuse", "reflectance": {"type": "mesh_attribute", "name": "vertex_color"}}
    if gloss is None:
        return diffuse
    mirror = {
        "type": "roughconductor",
        "material": "none",
        "distribution": "ggx",
        "alpha": {"type": "mesh_attribute", "name": "vertex_rough"},
        "specular_reflectance": {"type": "mesh_attribute", "name": "vertex_mirror"},
    }
    share = {"type": "mesh_attribute", "name": "vertex_gloss"}
    return {"type": "blendbsdf", "weight": share, "first": diffuse, "second": mirror}


def _dome(mi, dome: Dome | Environment) -> Description:
    if isinstance(dome, Dome):
        if dome.sky == dome.ground:
            return {"type": "constant", "radiance": {"type": "rgb", "value": list(dome.sky)}}
        dome = dome_picture(dome)
    transform = mi.ScalarTransform4f
    upright = transform().rotate([1, 0, 0], 90)  # Mitsuba's dome has y up, our world z
    return {
        "type": "envmap",
        "bitmap": mi.Bitmap(np.ascontiguousarray(dome.radiance, np.float32)),
        "to_world": transform().rotate([0, 0, 1], dome.turn_deg) @ upright,
    }


def _lamp(mi, lamp: Lamp) -> Description:
    place = mi.ScalarTransform4f().look_at(origin=list(lamp.centre), target=list(lamp.towards), up=[0, 0, 1])
    return {
        "type": "rectangle",
        "to_world": place @ mi.ScalarTransform4f().scale(lamp.side / 2),
        "emitter": {"type": "area", "radiance": {"type": "rgb", "value": list(lamp.radiance)}},
    }


def _sensor(mi, camera: Camera, quality: Quality, tile: Tile) -> Description:
    """Our camera in Mitsuba's words: x to the left, y up, z forward; principal point from the centre."""
    K = camera.intrinsics
    if abs(K[0, 0] - K[1, 1]) > 1e-9 * K[0, 0]:
        raise ValueError("Mitsuba's perspective camera has square pixels: K[0, 0] and K[1, 1] must be equal")
    world_from_cam = np.eye(4)
    world_from_cam[:3, :3] = camera.rotation.T @ np.diag([-1.0, -1.0, 1.0])
    world_from_cam[:3, 3] = camera.centre_in_world
    return {
        "type": "perspective",
        "to_world": mi.ScalarTransform4f(world_from_cam),
        "fov": float(np.rad2deg(2 * np.arctan(camera.width / (2 * K[0, 0])))),
        "fov_axis": "x",
        "principal_point_offset_x": float(0.5 - K[0, 2] / camera.width),
        "principal_point_offset_y": float(0.5 - K[1, 2] / camera.height),
        "near_clip": 1e-3,
        "far_clip": 1e4,
        "film": {
            "type": "hdrfilm",
            "width": camera.width,
            "height": camera.height,
            "crop_offset_x": tile.x,
            "crop_offset_y": tile.y,
            "crop_width": tile.width,
            "crop_height": tile.height,
            "rfilter": {"type": "box"},
            "pixel_format": "rgb",
            "component_format": "float32",
        },
        "sampler": {"type": "multijitter", "sample_count": quality.samples},
    }
