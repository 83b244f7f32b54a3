"""Mesh files come in whole or are refused: faces of any size, every format, and what is left after damage."""

from __future__ import annotations

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
from stages.scene.mesh_files import read_mesh_file
from stages.scene.meshes import read_mesh, read_points, to_open3d, write_mesh
from stages.scene.polygons import Polygons, triangulate
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
    from stages.scene.point_clouds import write_points

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
