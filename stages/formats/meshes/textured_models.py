"""Textured models on disk: GLB (metallic-roughness), and OBJ with its materials."""

from __future__ import annotations

import re
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from pipeline import UserError
from stages.formats.meshes.gltf_binary import BinaryBuffer, packed
from stages.formats.meshes.mesh_files import read_uv_map
from stages.formats.meshes.polygons import Polygons, distinct, triangulate
from stages.formats.meshes.triangle_meshes import Surface

FAR_OFF = 100  # from the origin, in diagonals of a model: single precision then rounds its relief
LINEAR_FILTER, TRILINEAR_FILTER = 9729, 9987  # of glTF: enlarged, reduced
NO_PART_OF_NAMES = re.compile(r"[\x00-\x1f\x7f#]+")  # of materials in text


@dataclass(frozen=True, eq=False)
class Texture:
    """A material and its images, on some faces of a model.

    Attributes
    ----------
    material : str
    faces : ndarray, shape (f,), int64
    base_colour : Path
        PNG, sRGB.
    normal_map : Path
        PNG, tangent space, y against v.
    """

    material: str
    faces: np.ndarray
    base_colour: Path
    normal_map: Path


@dataclass(frozen=True, eq=False)
class TexturedModel:
    """A mesh with textures.

    Attributes
    ----------
    vertices : ndarray, shape (V, 3), float64
    normals : ndarray, shape (V, 3)
        Unit.
    tangents : ndarray, shape (V, 4)
        Unit, and the sign of the bitangent, as glTF has them.
    faces : ndarray, shape (F, 3), int32
    uv : ndarray, shape (V, 2), float64
        Of each texture, v downwards, as rows of an image.
    textures : tuple of Texture
        No two on one face or vertex.
    roughness : float
        Of glTF: the root of α of GGX.
    """

    vertices: np.ndarray
    normals: np.ndarray
    tangents: np.ndarray
    faces: np.ndarray
    uv: np.ndarray
    textures: tuple[Texture, ...]
    roughness: float


@dataclass(frozen=True, eq=False)
class ObjCorners:
    """Faces as OBJ has them: with places, texture coordinates and normals of corners in tables of their own.

    Attributes
    ----------
    positions : ndarray, shape (p, 3), float64
    uv : ndarray, shape (t, 2), float64
        v upwards; beyond 0 to 1 in UDIM tiles.
    normals : ndarray, shape (n, 3)
    sizes : ndarray, shape (f,)
        Corners of each face.
    corners : ndarray, shape (sum of sizes, 3)
        Rows of the three tables.
    texture : ndarray, shape (f,)
        Number of each face's texture.
    """

    positions: np.ndarray
    uv: np.ndarray
    normals: np.ndarray
    sizes: np.ndarray
    corners: np.ndarray
    texture: np.ndarray


def write_glb(path: Path, model: TexturedModel, gltf_from_world: np.ndarray) -> None:
    """Write a GLB: one mesh; a primitive and a lit metallic-roughness material for each texture, PNG inside.

    Parameters
    ----------
    path : Path
    model : TexturedModel
    gltf_from_world : ndarray, shape (3, 3)
        Rotation from the model's axes to glTF's, y up.
    """
    buffer, origin = BinaryBuffer(), _origin_of(model.vertices)
    primitives = [
        _primitive(buffer, model, texture.faces, origin, gltf_from_world) | {"material": number}
        for number, texture in enumerate(model.textures)
    ]
    moved = {"translation": (gltf_from_world @ origin).tolist()} if origin.any() else {}
    files = [file for texture in model.textures for file in (texture.base_colour, texture.normal_map)]
    images = [buffer.add(file.read_bytes()) for file in files]
    content = {
        "asset": {"version": "2.0", "generator": "Unshade"},
        "scene": 0,
        "scenes": [{"nodes": [0]}],
        "nodes": [{"mesh": 0} | moved],
        "meshes": [{"primitives": primitives}],
        "materials": [
            _material(texture.material, 2 * number, model.roughness)
            for number, texture in enumerate(model.textures)
        ],
        "textures": [{"source": number, "sampler": 0} for number in range(len(images))],
        "samplers": [{"magFilter": LINEAR_FILTER, "minFilter": TRILINEAR_FILTER}],
        "images": [{"bufferView": view, "mimeType": "image/png"} for view in images],
    }
    path.write_bytes(packed(content, buffer))


def _origin_of(vertices: np.ndarray) -> np.ndarray:
    """Choose what vertices, (v, 3), count from: the origin, or a place amid them where they are `FAR_OFF`."""
    far = np.abs(vertices).max() > FAR_OFF * np.linalg.norm(np.ptp(vertices, axis=0))
    return np.round(vertices.mean(axis=0)) if far else np.zeros(3)


def _primitive(
    buffer: BinaryBuffer,
    model: TexturedModel,
    of_texture: np.ndarray,
    origin: np.ndarray,
    gltf_from_world: np.ndarray,
) -> dict[str, Any]:
    """Add the faces of a texture and the vertices that they use, in their order."""
    used, faces = np.unique(model.faces[of_texture], return_inverse=True)
    tangents = model.tangents[used]
    attributes = {
        "POSITION": buffer.attribute((model.vertices[used] - origin) @ gltf_from_world.T, bounded=True),
        "NORMAL": buffer.attribute(model.normals[used] @ gltf_from_world.T),
        "TANGENT": buffer.attribute(np.column_stack([tangents[:, :3] @ gltf_from_world.T, tangents[:, 3]])),
        "TEXCOORD_0": buffer.attribute(model.uv[used]),
    }
    return {"attributes": attributes, "indices": buffer.indices(faces.reshape(-1, 3))}


def _material(name: str, texture: int, roughness: float) -> dict[str, Any]:
    return {
        "name": name,
        "pbrMetallicRoughness": {
            "baseColorTexture": {"index": texture},
            "metallicFactor": 0.0,
            "roughnessFactor": float(roughness),
        },
        "normalTexture": {"index": texture + 1},
        "doubleSided": True,  # a scan is open where nobody could look
    }


def write_obj(path: Path, model: ObjCorners, textures: tuple[Texture, ...]) -> None:
    """Write an OBJ and its MTL, which name textures that lie beside them; axes are the model's.

    Numbers are written with as many digits as tell them from all others.
    """
    material_file = path.with_suffix(".mtl")
    names = distinct([_in_a_line(texture.material) for texture in textures])
    with path.open("w", encoding="utf-8", newline="\n") as file:
        file.write(f"mtllib {material_file.name}\n")
        for word, table in (("v", model.positions), ("vt", model.uv), ("vn", model.normals)):
            file.writelines(f"{word} {' '.join(map(repr, row))}\n" for row in table.tolist())
        file.writelines(_faces(model, names))
    materials = map(_mtl_of, names, textures)
    material_file.write_text("\n".join(materials), encoding="utf-8", newline="\n")


def _in_a_line(material: str) -> str:
    """Write a name in a line as readers that divide it at blanks give it back."""
    return " ".join(NO_PART_OF_NAMES.sub("_", material).split()) or "material"


def _mtl_of(name: str, texture: Texture) -> str:
    images = f"map_Kd {texture.base_colour.name}\nnorm {texture.normal_map.name}\n"
    return f"newmtl {name}\nKd 1 1 1\nKs 0 0 0\n{images}"


def _faces(model: ObjCorners, names: list[str]) -> Iterator[str]:
    """Write a line for each face, and one where another material begins."""
    corners = iter((model.corners + 1).tolist())
    before = None
    for size, texture in zip(model.sizes.tolist(), model.texture.tolist(), strict=True):
        if texture != before:
            yield f"usemtl {names[texture]}\n"
            before = texture
        yield "f " + " ".join("{}/{}/{}".format(*next(corners)) for _ in range(size)) + "\n"


@dataclass(frozen=True, eq=False)
class ReadModel:
    """What `write_obj` wrote, as triangles.

    Attributes
    ----------
    surface : Surface
        F faces.
    uv : ndarray, shape (F, 3, 2), float64
        Of the corners; v downwards.
    base_colours : tuple of Path
        PNGs, of the materials.
    texture : ndarray, shape (F,), int64
        Of each face: which of them.
    """

    surface: Surface
    uv: np.ndarray
    base_colours: tuple[Path, ...]
    texture: np.ndarray


def read_model(path: Path) -> ReadModel:
    """Read a textured OBJ that `write_obj` wrote, and its MTL.

    Raises
    ------
    UserError
        It is damaged, or has no texture coordinates.
    """
    found = read_uv_map(path)
    if found is None:
        raise UserError(f"{path} has no texture coordinates; expected the OBJ of a textured model.")
    polygons, uv_map = found
    count = len(polygons.corners)
    corners = triangulate(Polygons(polygons.vertices[polygons.corners], polygons.sizes, np.arange(count)))
    files = _base_colours(path.with_suffix(".mtl"))
    return ReadModel(
        Surface(polygons.vertices, polygons.corners[corners].astype(np.int32)),
        uv_map.with_v(upwards=False)[uv_map.corners[corners]],
        tuple(path.parent / files[name] for name in uv_map.materials),
        np.repeat(uv_map.material, polygons.sizes - 2),
    )


def _base_colours(path: Path) -> dict[str, str]:
    """Read which picture each material of an MTL has."""
    found, name = {}, ""
    for line in path.read_text(encoding="utf-8").splitlines():
        word, _, rest = line.partition(" ")
        if word == "newmtl":
            name = rest
        elif word == "map_Kd":
            found[name] = rest
    return found
