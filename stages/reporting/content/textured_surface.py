"""The textured model for the page: its mesh, and its textures at the size of a screen."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from PIL import Image

from stages.formats.images.exr import read_exr
from stages.formats.meshes.textured_models import read_model
from stages.formats.meshes.triangle_meshes import Surface
from stages.geometry.rays import vertex_normals
from stages.reporting.content.picture_size import reduced_picture
from stages.reporting.content.pictures import confidence_picture, srgb_picture
from stages.reporting.content.vertex_maps import bright
from stages.reporting.settings import SurfaceSettings

UV_CODES = 65535  # texture coordinates in sixteen bits: a sixteenth of a texel of 4096


@dataclass(frozen=True, eq=False)
class TexturedSurface:
    """A mesh whose vertices have one place in a texture each, the faces of a texture one after another.

    Attributes
    ----------
    surface : Surface
        V vertices, F faces.
    normals : ndarray, shape (V, 3), float32
        Unit.
    uv : ndarray, shape (V, 2), float64
        0 to 1; v downwards, as rows of an image.
    base_colours : tuple of Path
        PNGs of the T textures.
    faces_of : ndarray, shape (T,), int64
        How many faces each has.
    """

    surface: Surface
    normals: np.ndarray
    uv: np.ndarray
    base_colours: tuple[Path, ...]
    faces_of: np.ndarray

    @classmethod
    def of(cls, folder: Path, how: SurfaceSettings) -> TexturedSurface | None:
        """Read the model of the stage `texture`; None where it has more faces than a page takes."""
        model = read_model(folder / "model.obj")
        if len(model.surface.faces) > how.most_textured_faces:
            return None
        order = np.argsort(model.texture, kind="stable")
        faces, uv = model.surface.faces[order], model.uv[order]
        uv = (uv - np.floor(uv.mean(axis=1, keepdims=True))).clip(0, 1)  # into the tile that repeats
        corners = np.column_stack([faces.reshape(-1), uv.reshape(-1, 2)])
        corners = np.column_stack([corners, np.repeat(model.texture[order], 3)])
        own, rows = np.unique(corners, axis=0, return_inverse=True)
        place = own[:, 0].astype(np.int64)
        origin = model.surface.vertices.mean(axis=0)
        normals = vertex_normals(model.surface.vertices - origin, model.surface.faces)
        return cls(
            Surface(model.surface.vertices[place], rows.reshape(-1, 3).astype(np.int32)),
            normals[place].astype(np.float32),
            own[:, 1:3],
            model.base_colours,
            np.bincount(model.texture, minlength=len(model.base_colours)),
        )

    def uv_codes(self) -> np.ndarray:
        """Code the texture coordinates, (V, 2), uint16."""
        return np.rint(self.uv * UV_CODES).astype("<u2")

    def pictures(self, albedo_white: float, how: SurfaceSettings) -> Iterator[dict[str, np.ndarray]]:
        """Yield for each texture its pictures by kind, (s, s, 3), uint8; photo is albedo × shading."""
        side = int(how.texture_px / np.ceil(np.sqrt(len(self.base_colours))))
        whites: dict[str, float] = {}
        for base_colour in self.base_colours:
            albedo, shading, confidence = (
                reduced_picture(read_exr(_beside(base_colour, kind, ".exr")), side)
                for kind in ("albedo", "shading", "confidence")
            )
            linear = {"photo": albedo * shading, "shading": shading}
            for kind, values in linear.items():  # of the first texture, so that all are alike
                whites.setdefault(kind, bright(values[confidence > 0], how))
            yield {
                "albedo": srgb_picture(albedo / max(albedo_white, 1e-12)),
                **{kind: srgb_picture(values / whites[kind]) for kind, values in linear.items()},
                "confidence": confidence_picture(confidence),
                "relief": reduced_picture(_read_png(_beside(base_colour, "normal", ".png")), side),
            }


def _beside(base_colour: Path, kind: str, suffix: str) -> Path:
    """Name the file of another kind of the same texture."""
    return base_colour.with_name(base_colour.name.replace("albedo", kind, 1)).with_suffix(suffix)


def _read_png(path: Path) -> np.ndarray:
    with Image.open(path) as image:
        return np.asarray(image.convert("RGB"))
