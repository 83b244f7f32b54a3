"""UV maps of mesh files: OBJ, PLY and GLB, as programs write them; and what cannot be meant."""

from __future__ import annotations

import json
import struct

import numpy as np
import pytest
import trimesh

from pipeline import UserError
from stages.formats.meshes.mesh_files import read_mesh_file, read_uv_map
from stages.formats.meshes.polygons import distinct, triangulate

CORNERS = np.array([[0.0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0]])
UV = np.array([[0.1, 0.2], [0.3, 0.25], [1.7, 0.9], [0.123456789, 1 / 3]])
OBJ = (
    "".join(f"v {x} {y} {z}\n" for x, y, z in CORNERS)
    + "".join(f"vt {u!r} {v!r}\n" for u, v in UV.tolist())
    + "usemtl old wood\nf 1/1 2/2 3/3\nusemtl iron\nf 3/4 4/2 1/1\n"
    + "usemtl old wood\nf -4/-4 -3/-3 -2/-2 -1/-1\n"
)
VT_OF_CORNERS = [0, 1, 2, 3, 1, 0, 0, 1, 2, 3]


def of_file(path):
    found = read_uv_map(path)
    assert found is not None
    return found


def test_an_obj_keeps_texture_coordinates_polygons_and_materials(tmp_path):
    (tmp_path / "a.obj").write_text(OBJ)
    polygons, found = of_file(tmp_path / "a.obj")
    np.testing.assert_array_equal(found.uv, UV)
    np.testing.assert_array_equal(found.corners, VT_OF_CORNERS)
    np.testing.assert_array_equal(polygons.sizes, [3, 3, 4])
    assert len(polygons.vertices) == 4
    assert [found.materials[number] for number in found.material] == ["old wood", "iron", "old wood"]
    assert found.with_v(upwards=True) is found.uv
    np.testing.assert_allclose(found.with_v(upwards=False)[:, 1], 1 - UV[:, 1])


def ply_of(header: list[str], rows: list[tuple]) -> bytes:
    head = ["ply", "format ascii 1.0", "comment TextureFile wood.png", "comment TextureFile iron plate.jpg"]
    head += ["element vertex 4", *(f"property double {axis}" for axis in "xyz"), *header, "end_header"]
    return ("\n".join(head) + "\n" + "\n".join(" ".join(map(repr, row)) for row in rows) + "\n").encode()


@pytest.mark.parametrize("names", ["s t", "u v", "texture_u texture_v"])
def test_a_ply_has_texture_coordinates_of_vertices_under_several_names(tmp_path, names):
    header = [f"property double {name}" for name in names.split()]
    header += ["element face 1", "property list uchar int vertex_indices"]
    rows = [(*place, *uv) for place, uv in zip(CORNERS.tolist(), UV.tolist(), strict=True)]
    (tmp_path / "a.ply").write_bytes(ply_of(header, [*rows, (4, 0, 1, 2, 3)]))
    polygons, found = of_file(tmp_path / "a.ply")
    np.testing.assert_array_equal(found.uv[found.corners], UV[polygons.corners])
    assert found.v_upwards


def test_a_ply_of_meshlab_has_them_of_corners_and_textures_by_number(tmp_path):
    header = ["element face 2", "property list uchar int vertex_indices"]
    header += ["property list uchar double texcoord", "property int texnumber"]
    uv = [UV[[0, 1, 2]].ravel().tolist(), UV[[3, 1, 0]].ravel().tolist()]
    rows = [*map(tuple, CORNERS.tolist()), (3, 0, 1, 2, 6, *uv[0], 1), (3, 2, 3, 0, 6, *uv[1], 0)]
    (tmp_path / "a.ply").write_bytes(ply_of(header, rows))
    _, found = of_file(tmp_path / "a.ply")
    np.testing.assert_array_equal(found.uv[found.corners], UV[VT_OF_CORNERS[:6]])
    assert [found.materials[number] for number in found.material] == ["iron plate", "wood"]
    rows[4] = (3, 0, 1, 2, 4, *uv[0][:4], 1)
    (tmp_path / "a.ply").write_bytes(ply_of(header, rows))
    with pytest.raises(UserError, match=r"a\.ply has 4 texture coordinates on face number 0; expected two"):
        read_uv_map(tmp_path / "a.ply")


def glb_of(nodes: list[dict], primitives: list[dict], packed: bool = False, **changed) -> bytes:
    """A square with texture coordinates, its numbers interleaved: as strip, fan or triangles."""
    uv = np.rint(UV % 1 * 65535).astype("<u2") if packed else UV.astype("<f4")
    table = [np.ascontiguousarray(part).view(np.uint8).reshape(4, -1) for part in (CORNERS.astype("<f4"), uv)]
    interleaved = np.concatenate(table, axis=1)
    orders = {"triangles": [0, 1, 2, 0, 2, 3], "strip": [0, 1, 3, 2], "fan": [0, 1, 2, 3]}
    indices = [np.array(order, "<u2").tobytes() for order in orders.values()]
    data = interleaved.tobytes() + b"".join(indices)
    stride, at = interleaved.shape[1], 4 * interleaved.shape[1]
    views = [{"buffer": 0, "byteLength": at, "byteStride": stride}]
    accessors = [
        {"bufferView": 0, "componentType": 5126, "count": 4, "type": "VEC3"},
        {"bufferView": 0, "byteOffset": 12, "componentType": 5123 if packed else 5126, "count": 4}
        | {"type": "VEC2", "normalized": packed},
    ]
    for part in indices:
        accessors.append(
            {"bufferView": len(views), "componentType": 5123, "count": len(part) // 2, "type": "SCALAR"}
        )
        views.append({"buffer": 0, "byteOffset": at, "byteLength": len(part)})
        at += len(part)
    data += bytes(-len(data) % 4)
    content = {
        "asset": {"version": "2.0"},
        "scene": 0,
        "scenes": [{"nodes": [0]}],
        "nodes": nodes,
        "meshes": [{"primitives": primitives}],
        "materials": [{"name": "skin"}, {}],
        "buffers": [{"byteLength": len(data)}],
        "bufferViews": views,
        "accessors": accessors,
        **changed,
    }
    text = json.dumps(content).encode()
    text += b" " * (-len(text) % 4)
    chunks = struct.pack("<I4s", len(text), b"JSON") + text + struct.pack("<I4s", len(data), b"BIN\0") + data
    return struct.pack("<4sII", b"glTF", 2, 12 + len(chunks)) + chunks


BOTH = {"POSITION": 0, "TEXCOORD_0": 1}
PARTS = [
    {"attributes": BOTH, "indices": 2, "material": 1},
    {"attributes": BOTH, "indices": 3, "mode": 5, "material": 0},
    {"attributes": BOTH, "indices": 4, "mode": 6},
]
NODES = [
    {"children": [1, 2], "rotation": [0.5, 0.5, 0.5, 0.5], "translation": [1.0, 2, 3]},
    {"mesh": 0, "scale": [2.0, 1, -3]},
    {"mesh": 0, "matrix": [1, 0, 0, 0, 0, 0, 1, 0, 0, -1, 0, 0, 5, 6, 7, 1]},
]


def test_a_glb_keeps_texture_coordinates_to_the_bit_and_materials(tmp_path):
    (tmp_path / "a.glb").write_bytes(glb_of(NODES, PARTS))
    polygons, found = of_file(tmp_path / "a.glb")
    assert not found.v_upwards and len(polygons.sizes) == 12
    np.testing.assert_array_equal(found.uv.astype(np.float32).reshape(6, 4, 2)[4], UV.astype(np.float32))
    assert found.materials == ("material_1", "skin", "material")
    np.testing.assert_array_equal(found.material, np.repeat([0, 1, 2, 0, 1, 2], 2))
    assert (found.uv[found.corners] == found.uv[polygons.corners]).all()


def test_materials_of_one_name_are_told_apart(tmp_path):
    (tmp_path / "a.glb").write_bytes(glb_of(NODES, PARTS, materials=[{"name": "skin"}, {"name": "skin"}]))
    assert of_file(tmp_path / "a.glb")[1].materials == ("skin_2", "skin", "material")
    assert distinct(["skin", "wood", "skin", "skin_2", "skin"]) == [
        "skin",
        "wood",
        "skin_2",
        "skin_2_2",
        "skin_3",
    ]
    words = ["木".encode("shift_jis"), "石".encode("shift_jis")]
    (tmp_path / "a.obj").write_bytes(OBJ.encode().replace(b"old wood", words[0]).replace(b"iron", words[1]))
    assert len(of_file(tmp_path / "a.obj")[1].materials) == 2


def test_a_glb_is_placed_as_trimesh_places_it(tmp_path):
    """Triangles and their winding: turned, scaled, mirrored; of strips and lists (trimesh reads no fans)."""
    (tmp_path / "a.glb").write_bytes(glb_of(NODES, PARTS[:2]))
    ours = read_mesh_file(tmp_path / "a.glb")
    theirs = trimesh.load_scene(tmp_path / "a.glb", process=False).to_mesh()

    def triangles(vertices: np.ndarray, faces: np.ndarray) -> set:
        corners = np.round(np.asarray(vertices)[faces], 5) + 0.0
        return {min(tuple(map(tuple, np.roll(one, k, axis=0).tolist())) for k in range(3)) for one in corners}

    found = triangles(ours.vertices, ours.faces)
    assert found == triangles(theirs.vertices, theirs.faces) and len(found) == 8


def test_packed_texture_coordinates_are_shares(tmp_path):
    (tmp_path / "a.glb").write_bytes(glb_of(NODES[:1] + [{"mesh": 0}, {}], PARTS[:1], packed=True))
    _, found = of_file(tmp_path / "a.glb")
    np.testing.assert_allclose(found.uv, UV % 1, atol=1e-5)


@pytest.mark.parametrize("change", [{"count": 5}, {"byteOffset": 16}, {"bufferView": 9}, {"type": "VEC3"}])
def test_a_glb_whose_texture_coordinates_are_not_there_is_refused(tmp_path, change):
    content = glb_of(NODES, PARTS)
    size = struct.unpack_from("<I", content, 12)[0]
    accessors = json.loads(content[20 : 20 + size])["accessors"]
    accessors[1] |= change
    (tmp_path / "a.glb").write_bytes(glb_of(NODES, PARTS, accessors=accessors))
    with pytest.raises(UserError, match=r"a\.glb does not hold what it promises"):
        read_uv_map(tmp_path / "a.glb")


@pytest.mark.parametrize(
    ("text", "said"),
    [
        (OBJ + "f 1 2 3\n", "no texture coordinates on 1 of its 4 faces .the first is number 3"),
        (OBJ + "f 1/1 2/9 3/1\n", "name texture coordinates 0 to 8; expected 0 to 3"),
        (OBJ.replace("0.3 0.25", "nan 0.25"), "not finite"),
        (OBJ.replace("0.3 0.25", "1e9 0.25"), "beyond 1e"),
        (OBJ.replace("0.3 0.25", "one 0.25"), "line 6"),
        (OBJ.replace("0.3 0.25", ""), "one number or more"),
    ],
)
def test_texture_coordinates_that_cannot_be_meant_are_refused(tmp_path, text, said):
    (tmp_path / "a.obj").write_text(text)
    with pytest.raises(UserError, match=rf"a\.obj.*{said}"):
        read_uv_map(tmp_path / "a.obj")


def test_files_without_texture_coordinates_have_no_uv_map(tmp_path):
    mesh = trimesh.creation.icosphere(1)
    for suffix in ("ply", "obj", "glb", "stl", "off"):
        mesh.export(tmp_path / f"a.{suffix}")
        assert read_uv_map(tmp_path / f"a.{suffix}") is None


@pytest.mark.parametrize("suffix", ["obj", "glb"])
def test_faces_with_and_without_their_uv_map_are_the_same_in_one_order(tmp_path, suffix):
    (tmp_path / "a.obj").write_text(OBJ)
    (tmp_path / "a.glb").write_bytes(glb_of(NODES, PARTS))
    surface = read_mesh_file(tmp_path / f"a.{suffix}")
    polygons, _ = of_file(tmp_path / f"a.{suffix}")
    np.testing.assert_array_equal(surface.vertices[surface.faces], polygons.vertices[triangulate(polygons)])
