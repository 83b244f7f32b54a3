"""Mesh files come in whole or are refused: faces of any size, every format, and what is left after damage."""

from __future__ import annotations

import json
import struct
from collections.abc import Callable, Sequence
from pathlib import Path

import numpy as np
import open3d as o3d
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from pipeline import UserError
from stages.cli import main
from stages.formats.meshes.mesh_files import read_mesh_file
from stages.formats.meshes.polygons import Polygons, triangulate
from stages.formats.meshes.triangle_meshes import (
    read_mesh,
    read_vertex_colours,
    to_open3d,
    write_mesh,
)
from tests.test_surface import SQUARE

Faces = Sequence[Sequence[int]]
TEXTS = ("obj", "off", "ply")


def obj_of(vertices: np.ndarray, faces: Faces) -> bytes:
    lines = [f"v {x!r} {y!r} {z!r}" for x, y, z in vertices.tolist()]
    lines += ["o one", "usemtl red"] + [_obj_face(face) for face in faces[::2]]
    lines += ["o two", "usemtl blue"] + [_obj_face(face) for face in faces[1::2]]
    return ("\n".join(lines) + "\n").encode()


def _obj_face(face: Sequence[int]) -> str:
    return "f " + " ".join(str(corner + 1) for corner in face)


def obj_backwards_of(vertices: np.ndarray, faces: Faces) -> bytes:
    """The same with indices that count from the end, and texture coordinates that part nothing."""
    lines = [f"v {x!r} {y!r} {z!r}" for x, y, z in vertices.tolist()] + ["vt 0 0"]
    lines += ["f " + " ".join(f"{corner - len(vertices)}/-1" for corner in face) for face in faces]
    return ("\r\n".join(lines) + "\r\n").encode()


def off_of(vertices: np.ndarray, faces: Faces) -> bytes:
    lines = ["OFF", "# by hand", f"{len(vertices)} {len(faces)} 0"]
    lines += [f"{x!r} {y!r} {z!r}" for x, y, z in vertices.tolist()]
    lines += [f"{len(face)} {' '.join(map(str, face))} 255 0 0" for face in faces]
    return ("\n".join(lines) + "\n").encode()


def ply_header(vertices: np.ndarray, faces: Faces, form: str) -> bytes:
    lines = ["ply", f"format {form} 1.0", "comment by hand", f"element vertex {len(vertices)}"]
    lines += [f"property double {axis}" for axis in "xyz"]
    lines += [f"element face {len(faces)}", "property list uchar int vertex_indices", "property uchar kind"]
    return ("\n".join([*lines, "end_header"]) + "\n").encode()


def ply_text_of(vertices: np.ndarray, faces: Faces) -> bytes:
    lines = [f"{x!r} {y!r} {z!r}" for x, y, z in vertices.tolist()]
    lines += [f"{len(face)} {' '.join(map(str, face))} 7" for face in faces]
    return ply_header(vertices, faces, "ascii") + ("\n".join(lines) + "\n").encode()


def ply_of(vertices: np.ndarray, faces: Faces, order: str = "<") -> bytes:
    form = "binary_little_endian" if order == "<" else "binary_big_endian"
    rows = [struct.pack(f"{order}B{len(face)}iB", len(face), *face, 7) for face in faces]
    return ply_header(vertices, faces, form) + vertices.astype(f"{order}f8").tobytes() + b"".join(rows)


def ply_other_order_of(vertices: np.ndarray, faces: Faces) -> bytes:
    return ply_of(vertices, faces, ">")


BY_HAND: dict[str, tuple[str, Callable[[np.ndarray, Faces], bytes]]] = {
    "obj": ("obj", obj_of),
    "obj backwards": ("obj", obj_backwards_of),
    "off": ("off", off_of),
    "ply text": ("ply", ply_text_of),
    "ply": ("ply", ply_of),
    "ply big-endian": ("ply", ply_other_order_of),
}
COUNTED = {"off", "ply text", "ply", "ply big-endian"}  # which say how many faces they hold


@st.composite
def meshes(draw) -> tuple[np.ndarray, list[list[int]]]:
    """Vertices anywhere, faces of 3 to 7 corners among them."""
    count = draw(st.integers(3, 12))
    rng = np.random.default_rng(draw(st.integers(0, 2**32 - 1)))
    sizes = draw(st.lists(st.integers(3, min(7, count)), min_size=1, max_size=8))
    return rng.normal(size=(count, 3)), [rng.permutation(count)[:size].tolist() for size in sizes]


def triangles_of(faces: Faces) -> int:
    return sum(len(face) - 2 for face in faces)


def edges_of(triangles: np.ndarray) -> set[frozenset[int]]:
    return {frozenset(edge) for one in triangles.tolist() for edge in zip(one, np.roll(one, 1), strict=True)}


@pytest.mark.parametrize("form", BY_HAND)
@settings(max_examples=60, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(mesh=meshes())
def test_faces_of_any_size_come_in_whole(tmp_path, form, mesh):
    vertices, faces = mesh
    suffix, writer = BY_HAND[form]
    path = tmp_path / f"a.{suffix}"
    path.write_bytes(writer(vertices, faces))
    surface = read_mesh_file(path)
    assert len(surface.faces) == triangles_of(faces)
    places = surface.vertices[surface.faces].reshape(-1, 3)
    used = vertices[sorted({corner for face in faces for corner in face})]
    np.testing.assert_array_equal(np.unique(places, axis=0), np.unique(used, axis=0))


@pytest.mark.parametrize("form", BY_HAND)
@settings(max_examples=80, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(mesh=meshes(), cut=st.floats(0, 1, exclude_max=True))
def test_what_is_cut_is_refused_or_holds_what_is_left_of_it(tmp_path, form, mesh, cut):
    """Where the format says how many faces there are, a part is refused; OBJ has only what stands there."""
    suffix, writer = BY_HAND[form]
    whole = writer(*mesh)
    part = whole[: int(cut * len(whole))]
    path = tmp_path / f"a.{suffix}"
    path.write_bytes(part)
    try:
        surface = read_mesh_file(path)
    except UserError:
        return
    if form in COUNTED:
        assert len(surface.faces) == triangles_of(mesh[1])  # what is gone had no meaning: a colour, a blank
    else:
        left = [line.split()[1:] for line in part.decode().splitlines() if line.startswith("f ")]
        assert len(surface.faces) == triangles_of(left)


@pytest.mark.parametrize("form", BY_HAND)
@settings(max_examples=80, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(
    mesh=meshes(),
    places=st.lists(st.floats(0, 1, exclude_max=True), min_size=1, max_size=3),
    byte=st.binary(min_size=3, max_size=3),
)
def test_damage_is_a_mesh_or_a_sentence(tmp_path, form, mesh, places, byte):
    suffix, writer = BY_HAND[form]
    data = bytearray(writer(*mesh))
    for place, value in zip(places, byte, strict=False):
        data[int(place * len(data))] = value
    path = tmp_path / f"a.{suffix}"
    path.write_bytes(data)
    try:
        surface = read_mesh_file(path)
    except UserError:
        return
    assert surface.faces.min() >= 0 and surface.faces.max() < len(surface.vertices)


@pytest.mark.parametrize("suffix", ["stl", "glb", "ply", "obj", "off"])
@pytest.mark.parametrize("seed", range(4))
def test_what_the_library_writes_is_read_whole_and_a_part_of_it_is_refused(tmp_path, suffix, seed):
    rng = np.random.default_rng(seed)
    mesh = o3d.geometry.TriangleMesh.create_icosahedron()
    mesh = mesh.subdivide_midpoint(int(rng.integers(0, 3)))
    mesh.compute_vertex_normals()
    path = tmp_path / f"whole.{suffix}"
    assert o3d.io.write_triangle_mesh(str(path), mesh)
    assert len(read_mesh_file(path).faces) == len(mesh.triangles)
    whole = path.read_bytes()
    if suffix == "obj":
        return  # says nothing of how much it holds
    for share in rng.uniform(0, 1, 12):
        part = whole[: int(share * len(whole))]
        path.write_bytes(part)
        if part.strip() != whole.strip():
            with pytest.raises(UserError, match=r"whole\.\w+"):
                read_mesh_file(path)


def test_stl_in_text_is_read_whole_and_a_part_of_it_is_refused(tmp_path):
    mesh = o3d.geometry.TriangleMesh.create_icosahedron()
    corners = np.asarray(mesh.vertices)[np.asarray(mesh.triangles)]
    facets = [
        "facet normal 0 0 0\n outer loop\n"
        + "".join(f"  vertex {x:.9g} {y:.9g} {z:.9g}\n" for x, y, z in one)
        + " endloop\nendfacet\n"
        for one in corners
    ]
    whole = "solid ball\n" + "".join(facets) + "endsolid ball\n"
    path = tmp_path / "a.stl"
    path.write_text(whole)
    assert len(read_mesh_file(path).faces) == 20
    for end in range(11, len(whole) - len("endsolid ball\n"), 97):
        path.write_text(whole[:end])
        with pytest.raises(UserError, match=r"a\.stl"):
            read_mesh_file(path)


def test_a_header_that_promises_more_is_refused_before_anything_is_allocated(tmp_path):
    path = tmp_path / "a.ply"
    path.write_bytes(
        ply_of(SQUARE.vertices, SQUARE.faces.tolist()).replace(b"face 2\n", b"face 999999999999\n")
    )
    with pytest.raises(UserError, match="promises 999999999999 rows of face and holds"):
        read_mesh_file(path)


def test_points_that_were_cut_are_refused(tmp_path):
    from stages.formats.meshes.point_clouds import read_points, write_points

    path = tmp_path / "fused.ply"
    write_points(path, np.ones((9, 3)), np.ones((9, 3)), np.zeros((9, 3)))
    assert len(read_points(path)[0]) == 9
    path.write_bytes(path.read_bytes()[:-1])
    with pytest.raises(UserError, match=r"fused\.ply"):
        read_points(path)


def test_colours_and_places_come_back_to_the_bit(tmp_path):
    surface = read_mesh_of(SQUARE, tmp_path)
    np.testing.assert_array_equal(surface.vertices, SQUARE.vertices)
    np.testing.assert_array_equal(surface.faces, SQUARE.faces)


def read_mesh_of(surface, folder: Path):
    write_mesh(folder / "m.ply", surface)
    assert len(o3d.io.read_triangle_mesh(str(folder / "m.ply")).triangles) == len(surface.faces)
    return read_mesh(folder / "m.ply")


def test_the_fan_of_a_concave_face_folds_no_triangle_over():
    """An arrow whose notch every fan but that from its own corner would cover."""
    arrow = np.array([[0, 0, 0], [2, 1, 0], [0, 2, 0], [0.5, 1, 0]], float)
    for turn in range(4):
        corners = np.roll(np.arange(4), turn)
        triangles = triangulate(Polygons(arrow, np.array([4]), corners))
        a, b, c = np.moveaxis(arrow[triangles], 1, 0)
        areas = np.cross(b - a, c - a)[:, 2] / 2
        assert (areas > 0).all()
        assert areas.sum() == pytest.approx(1.5)


def test_triangles_of_a_face_have_its_edges():
    faces = [[0, 1, 2, 3, 4], [4, 3, 5], [5, 0, 4, 2]]
    vertices = np.random.default_rng(0).normal(size=(6, 3))
    corners = np.concatenate(faces)
    triangles = triangulate(Polygons(vertices, np.array([5, 3, 4]), corners))
    assert triangles.shape == (6, 3) and triangles.dtype == np.int32
    np.testing.assert_array_equal(triangles[3], [4, 3, 5])
    for face, part in zip(faces, (triangles[:3], triangles[3:4], triangles[4:]), strict=True):
        assert {frozenset(edge) for edge in zip(face, np.roll(face, 1), strict=True)} <= edges_of(part)


@pytest.mark.parametrize("damage", ["cut", "quad"])
def test_the_command_refuses_a_part_and_takes_quads(tmp_path, capsys, damage):
    """A floor of one quad once vanished; 803 of 3,000 faces once were the mesh."""
    path = tmp_path / "floor.obj" if damage == "quad" else tmp_path / "floor.ply"
    if damage == "quad":
        path.write_bytes(obj_of(SQUARE.vertices, [[0, 1, 2, 3]]))
    else:
        o3d.io.write_triangle_mesh(str(path), to_open3d(SQUARE).subdivide_midpoint(4))
        path.write_bytes(path.read_bytes()[:-4000])
    sample = Path(__file__).parent.parent / "sample_data"
    words = ["run", "--colmap", sample / "truth", "--images", sample / "photos", "--mesh", path]
    words += ["--workspace", tmp_path / "w", "--to", "adopt_mesh"]
    words += ["--set", "undistort.max_size_px=64"]
    code = main([str(word) for word in words])
    said = " ".join(capsys.readouterr().err.split())
    assert "Traceback" not in said
    if damage == "quad":
        assert code == 0
        (mesh,) = (tmp_path / "w/cache/adopt_mesh").glob("*/mesh.ply")
        assert len(read_mesh(mesh).faces) == 2
    else:
        assert code == 2 and "it was cut off or damaged" in said
        assert not list((tmp_path / "w/cache/adopt_mesh").glob("*/mesh.ply"))


CORNERS = [[0.0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0]]
TEXT_V = "".join(f"v {x:g} {y:g} {z:g}\n" for x, y, z in CORNERS)


@pytest.mark.parametrize(
    "text",
    [
        "# C:\\models\\\n" + TEXT_V + "f 1 2 3 4\n",
        "mtllib C:\\models\\\n" + TEXT_V + "f 1 2 3 4\n",
        "\ufeff" + TEXT_V + "f 1 2 3 4",
        TEXT_V + "vt 0 0\nvn 0 0 1\nf 1/1/1 2/1/1 3/1/1 4/1/1 # four\nl 1 2\np 1\n",
        TEXT_V + "f 1 2 \\ \n 3 4\n",
        TEXT_V.replace("\nv", " .1 .2 .3\nv") + "fo -4 -3 -2 -1\r\n",
    ],
)
def test_obj_as_programs_write_it(tmp_path, text):
    (tmp_path / "a.obj").write_text(text, encoding="utf-8")
    surface = read_mesh_file(tmp_path / "a.obj")
    assert len(surface.faces) == 2
    np.testing.assert_array_equal(np.unique(surface.vertices, axis=0), np.unique(CORNERS, axis=0))


@pytest.mark.parametrize("text", ["v 0 0 1.#QNAN\n", "v 0 0\n", "surf 0 1 0 1 1 2 3\n", "f 1 2 9\n"])
def test_obj_that_cannot_be_meant_is_refused(tmp_path, text):
    (tmp_path / "a.obj").write_text(TEXT_V + "f 1 2 3\n" + text)
    with pytest.raises(UserError, match=r"a\.obj"):
        read_mesh_file(tmp_path / "a.obj")


@pytest.mark.parametrize("head", ["OFF\n4 1 0", "OFF4 1 0", "OFF 4 1 0", "COFF\n4 1 0", "4 1 0"])
def test_off_as_programs_write_it(tmp_path, head):
    rows = [f"{x:g} {y:g} {z:g}" + (" 255 0 0 255" if head[0] == "C" else "") for x, y, z in CORNERS]
    (tmp_path / "a.off").write_text("\n".join([head, *rows, "4 0 1 2 3 0.5 0.5 0.5"]) + "\n\n")
    surface = read_mesh_file(tmp_path / "a.off")
    assert len(surface.faces) == 2
    np.testing.assert_array_equal(surface.vertices, CORNERS)


@pytest.mark.parametrize(
    "text", ["OFF\n6 1 0\n" + "0 1\n" * 6 + "3 0 1 2\n", "4OFF\n4 1 0\n", "OFF BINARY\n"]
)
def test_off_of_another_kind_is_refused(tmp_path, text):
    (tmp_path / "a.off").write_text(text)
    with pytest.raises(UserError, match=r"a\.off cannot be read as OFF"):
        read_mesh_file(tmp_path / "a.off")


@pytest.mark.parametrize("name", ["multifacet", "vertex paint", "facet normal", "endsolid"])
def test_solids_may_be_called_what_they_like(tmp_path, name):
    one = (
        "facet\tnormal 0 0 1\nouter loop\n"
        + "vertex 0 0 0\nvertex 1 0 0\nVERTEX 1 1 0\n"
        + "endloop\nendfacet\n"
    )
    (tmp_path / "a.stl").write_text(f"solid {name}\n{one}endsolid {name}\nsolid two\n{one}endsolid two\n")
    assert len(read_mesh_file(tmp_path / "a.stl").faces) == 2


def test_binary_stl_may_begin_with_solid_and_end_with_a_line(tmp_path):
    mesh = o3d.geometry.TriangleMesh.create_icosahedron()
    mesh.compute_vertex_normals()
    o3d.io.write_triangle_mesh(str(tmp_path / "a.stl"), mesh)
    data = bytearray((tmp_path / "a.stl").read_bytes())
    data[:6] = b"solid "
    (tmp_path / "a.stl").write_bytes(data + b"\n")
    assert len(read_mesh_file(tmp_path / "a.stl").faces) == 20


@pytest.mark.parametrize("end", ["\n", "\r\n", "\r"])
@pytest.mark.parametrize("form", ["ascii", "binary_little_endian"])
def test_ply_as_programs_write_it(tmp_path, end, form):
    """Three ends of lines, comments about end_header, edges, texture coordinates, a name twice, padding."""
    head = ["ply", f"format {form} 1.0", "comment the end_header follows", "obj_info x", "element vertex 4"]
    head += [f"property float {name}" for name in ("x", "y", "z", "alpha", "alpha")]
    head += ["element edge 1", "property int vertex1", "property int vertex2", "element face 1"]
    head += ["property list uchar int vertex_indices", "property list uchar float texcoord", "end_header"]
    rows = [(*corner, 0.5, 0.25) for corner in CORNERS]
    if form == "ascii":
        body = (
            end.join(" ".join(map(str, row)) for row in [*rows, (0, 1), (4, 0, 1, 2, 3, 2, 0.5, 0.5)]) + end
        )
        data = body.encode()
    else:
        data = b"".join(struct.pack("<5f", *row) for row in rows) + struct.pack("<2i", 0, 1)
        data += struct.pack("<B4iB2f", 4, 0, 1, 2, 3, 2, 0.5, 0.5) + b"\n\0\0"
    (tmp_path / "a.ply").write_bytes((end.join(head) + end).encode() + data)
    surface = read_mesh_file(tmp_path / "a.ply")
    assert len(surface.faces) == 2
    np.testing.assert_array_equal(surface.vertices, CORNERS)


def test_what_is_left_over_in_a_ply_is_no_part_of_it(tmp_path):
    data = ply_of(SQUARE.vertices, SQUARE.faces.tolist())
    (tmp_path / "a.ply").write_bytes(data + data[-30:])
    with pytest.raises(UserError, match="30 bytes are left over"):
        read_mesh_file(tmp_path / "a.ply")


@pytest.mark.parametrize(("kind", "value"), [("uchar", 128), ("ushort", 32896), ("float", 128 / 255)])
@pytest.mark.parametrize("form", ["ascii", "binary_little_endian"])
def test_colours_are_what_their_type_says(tmp_path, kind, value, form):
    """Of text, 128 once was a hundred thousand times white."""
    head = ["ply", f"format {form} 1.0", "element vertex 1"]
    head += [f"property float {axis}" for axis in "xyz"]
    head += [f"property {kind} {colour}" for colour in ("red", "green", "blue")] + ["end_header\n"]
    packed = struct.pack(f"<3f3{ {'uchar': 'B', 'ushort': 'H', 'float': 'f'}[kind] }", 0, 0, 0, *[value] * 3)
    body = f"0 0 0 {value} {value} {value}\n".encode() if form == "ascii" else packed
    (tmp_path / "a.ply").write_bytes("\n".join(head).encode() + body)
    np.testing.assert_allclose(read_vertex_colours(tmp_path / "a.ply"), 0.2158605, rtol=1e-4)


def glb_of(**changed) -> bytes:
    """A square as one indexed primitive, placed twice, with other parts of the JSON where they are given."""
    data = SQUARE.vertices.astype("<f4").tobytes() + SQUARE.faces.astype("<u4").tobytes()
    split = 12 * len(SQUARE.vertices)
    places = {"bufferView": 0, "componentType": 5126, "count": len(SQUARE.vertices), "type": "VEC3"}
    corners = {"bufferView": 1, "componentType": 5125, "count": SQUARE.faces.size, "type": "SCALAR"}
    content = {
        "asset": {"version": "2.0"},
        "scenes": [{"nodes": [0]}],
        "nodes": [{"children": [1, 2]}, {"mesh": 0}, {"mesh": 0, "translation": [0.0, 0, 5]}],
        "meshes": [{"primitives": [{"attributes": {"POSITION": 0}, "indices": 1}]}],
        "buffers": [{"byteLength": len(data)}],
        "bufferViews": [
            {"buffer": 0, "byteOffset": 0, "byteLength": split},
            {"buffer": 0, "byteOffset": split, "byteLength": len(data) - split},
        ],
        "accessors": [places, corners],
        **changed,
    }
    text = json.dumps(content).encode()
    text += b" " * (-len(text) % 4)
    chunks = struct.pack("<I4s", len(text), b"JSON") + text + struct.pack("<I4s", len(data), b"BIN\0") + data
    return struct.pack("<4sII", b"glTF", 2, 12 + len(chunks)) + chunks


def test_a_glb_comes_in_as_often_as_its_scene_places_it(tmp_path):
    (tmp_path / "a.glb").write_bytes(glb_of())
    surface = read_mesh_file(tmp_path / "a.glb")
    assert len(surface.faces) == 4
    assert sorted(np.unique(surface.vertices[:, 2] - SQUARE.vertices[0, 2])) == [0, 5]


PRIMITIVE = {"attributes": {"POSITION": 0}, "indices": 1}
PLACES = {"bufferView": 0, "componentType": 5126, "count": 4, "type": "VEC3"}
INDICES = {"bufferView": 1, "componentType": 5125, "count": 6, "type": "SCALAR"}
UNREAD = {
    "KHR_mesh_quantization": {"extensionsRequired": ["KHR_mesh_quantization"]},
    "KHR_draco_mesh_compression": {
        "meshes": [{"primitives": [PRIMITIVE | {"extensions": {"KHR_draco_mesh_compression": {}}}]}]
    },
    "EXT_mesh_gpu_instancing": {"nodes": [{"mesh": 0, "extensions": {"EXT_mesh_gpu_instancing": {}}}]},
    "a skin": {"nodes": [{"mesh": 0, "skin": 0}]},
    "morphs": {"meshes": [{"primitives": [PRIMITIVE], "weights": [0.5]}]},
    "sparse accessors": {"accessors": [PLACES | {"sparse": {}}, INDICES]},
    "packed coordinates": {"accessors": [PLACES | {"normalized": True}, INDICES]},
    "data in another file": {"buffers": [{"byteLength": 1, "uri": "other.bin"}]},
}


@pytest.mark.parametrize("what", UNREAD)
def test_what_would_be_passed_over_in_a_glb_is_refused_by_name(tmp_path, what):
    (tmp_path / "a.glb").write_bytes(glb_of(**UNREAD[what]))
    with pytest.raises(UserError, match=f"uses {what}, which is not read here"):
        read_mesh_file(tmp_path / "a.glb")


def test_materials_and_lights_of_a_glb_say_nothing_of_its_shape(tmp_path):
    (tmp_path / "a.glb").write_bytes(
        glb_of(extensionsRequired=["KHR_materials_unlit", "KHR_texture_transform"])
    )
    assert len(read_mesh_file(tmp_path / "a.glb").faces) == 4


def test_a_glb_of_fewer_triangles_than_it_says_is_refused(tmp_path):
    (tmp_path / "a.glb").write_bytes(glb_of(accessors=[PLACES, INDICES | {"count": 9}]))
    with pytest.raises(UserError, match=r"a\.glb"):
        read_mesh_file(tmp_path / "a.glb")
