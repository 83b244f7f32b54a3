"""Textured models on disk: GLB (metallic-roughness), and OBJ with its material."""

from __future__ import annotations

from dataclasses import dataclass
from io import BytesIO
from pathlib import Path

import numpy as np
import trimesh
from PIL import Image
from trimesh.exchange.obj import export_obj
from trimesh.visual.material import SimpleMaterial
from trimesh.visual.texture import TextureVisuals

from stages.formats.meshes.gltf_binary import BinaryBuffer, packed

MATERIAL = "albedo"
LINEAR_FILTER, TRILINEAR_FILTER = 9729, 9987  # of glTF: enlarged, reduced


@dataclass(frozen=True, eq=False)
class TexturedModel:
    """A mesh with one atlas.

    Attributes
    ----------
    vertices : ndarray, shape (V, 3), float64
    normals : ndarray, shape (V, 3)
        Unit.
    tangents : ndarray, shape (V, 4)
        Unit, and the sign of the bitangent, as glTF has them.
    faces : ndarray, shape (F, 3), int32
    uv : ndarray, shape (V, 2), float64
        v downwards, as rows of an image.
    base_colour : ndarray, shape (s, s, 3), uint8
        sRGB.
    normal_map : ndarray, shape (s, s, 3), uint8
        Tangent space, y against v.
    roughness : float
        Of glTF: the root of α of GGX.
    """

    vertices: np.ndarray
    normals: np.ndarray
    tangents: np.ndarray
    faces: np.ndarray
    uv: np.ndarray
    base_colour: np.ndarray
    normal_map: np.ndarray
    roughness: float


def write_glb(path: Path, model: TexturedModel, gltf_from_world: np.ndarray) -> None:
    """Write a GLB: one mesh, one lit metallic-roughness material, base colour and normals as PNG inside.

    Parameters
    ----------
    path : Path
    model : TexturedModel
    gltf_from_world : ndarray, shape (3, 3)
        Rotation from the model's axes to glTF's, y up.
    """
    buffer = BinaryBuffer()
    attributes = {
        "POSITION": buffer.attribute(model.vertices @ gltf_from_world.T, bounded=True),
        "NORMAL": buffer.attribute(model.normals @ gltf_from_world.T),
        "TANGENT": buffer.attribute(
            np.column_stack([model.tangents[:, :3] @ gltf_from_world.T, model.tangents[:, 3]])
        ),
        "TEXCOORD_0": buffer.attribute(model.uv),
    }
    primitive = {"attributes": attributes, "indices": buffer.indices(model.faces), "material": 0}
    images = [buffer.add(_png(image)) for image in (model.base_colour, model.normal_map)]
    material = {
        "name": MATERIAL,
        "pbrMetallicRoughness": {
            "baseColorTexture": {"index": 0},
            "metallicFactor": 0.0,
            "roughnessFactor": float(model.roughness),
        },
        "normalTexture": {"index": 1},
        "doubleSided": True,  # a scan is open where nobody could look
    }
    content = {
        "asset": {"version": "2.0", "generator": "Unshade"},
        "scene": 0,
        "scenes": [{"nodes": [0]}],
        "nodes": [{"mesh": 0}],
        "meshes": [{"primitives": [primitive]}],
        "materials": [material],
        "textures": [{"source": number, "sampler": 0} for number in range(len(images))],
        "samplers": [{"magFilter": LINEAR_FILTER, "minFilter": TRILINEAR_FILTER}],
        "images": [{"bufferView": view, "mimeType": "image/png"} for view in images],
    }
    path.write_bytes(packed(content, buffer))


def write_obj(path: Path, model: TexturedModel, base_colour: str, normal_map: str) -> None:
    """Write an OBJ and its MTL, which name textures that lie beside them; axes are the model's."""
    material_file = path.with_suffix(".mtl")
    upwards = np.column_stack([model.uv[:, 0], 1 - model.uv[:, 1]])  # OBJ's v
    mesh = trimesh.Trimesh(
        model.vertices,
        model.faces,
        vertex_normals=model.normals,
        visual=TextureVisuals(uv=upwards, material=SimpleMaterial(name=MATERIAL)),
        process=False,
    )
    text = export_obj(
        mesh, include_normals=True, write_texture=False, mtl_name=material_file.name, header=None
    )
    path.write_text(text + "\n", encoding="ascii")
    shading = [f"newmtl {MATERIAL}", "Kd 1 1 1", "Ks 0 0 0", f"map_Kd {base_colour}", f"norm {normal_map}"]
    material_file.write_text("\n".join(shading) + "\n", encoding="ascii")


def _png(image: np.ndarray) -> bytes:
    stream = BytesIO()
    Image.fromarray(image).save(stream, "png")
    return stream.getvalue()
