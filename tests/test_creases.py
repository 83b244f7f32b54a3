"""Corners that lie on one another: one vertex on a sphere, three at the corner of a box."""

from __future__ import annotations

import numpy as np
import open3d as o3d
import pytest

from pipeline import UserError
from stages.adopt_mesh import ADOPT_MESH
from stages.formats.meshes.mesh_files import read_mesh_file
from stages.formats.meshes.triangle_meshes import Surface, from_open3d, read_mesh, to_open3d, write_mesh
from stages.geometry.creases import shared_corners
from stages.geometry.rays import vertex_normals

BOX = from_open3d(o3d.geometry.TriangleMesh.create_box(2.0, 3.0, 5.0))
SPHERE = from_open3d(o3d.geometry.TriangleMesh.create_sphere(1.0, 20))


def loose(surface: Surface) -> Surface:
    """The same faces, every one with corners of its own."""
    return Surface(
        surface.vertices[surface.faces.ravel()],
        np.arange(surface.faces.size, dtype=np.int32).reshape(-1, 3),
    )


def corners_of(surface: Surface) -> np.ndarray:
    return surface.vertices[surface.faces]


def leaning_deg(sphere: Surface) -> float:
    """How far normals of vertices lean from the radius, on average."""
    normals = vertex_normals(sphere.vertices, sphere.faces)
    return np.rad2deg(np.arccos(np.einsum("vk,vk->v", normals, sphere.vertices).clip(-1, 1))).mean()


def test_a_sphere_whose_faces_share_nothing_is_round_again():
    found = shared_corners(loose(SPHERE), 60.0)
    assert len(found.vertices) == len(SPHERE.vertices)
    np.testing.assert_array_equal(corners_of(found), corners_of(SPHERE))
    assert leaning_deg(found) < 0.2 * leaning_deg(loose(SPHERE))


def test_a_box_keeps_its_corners():
    found = shared_corners(loose(BOX), 60.0)
    assert len(found.vertices) == 24  # three at each of eight
    normals = np.abs(vertex_normals(found.vertices, found.faces))
    np.testing.assert_allclose(np.sort(normals, axis=1), np.tile([0, 0, 1], (24, 1)), atol=1e-6)
    assert len(shared_corners(loose(BOX), 100.0).vertices) == 8


def test_a_flap_that_stands_up_parts_from_a_floor_that_stays_whole():
    """Its fold is of 63.4 degrees, along one of two edges that meet in the middle of the floor's rim."""
    corners = [[0, 0, 0], [1, 0, 0], [2, 0, 0], [0, 1, 0], [1, 1, 0], [2, 1, 0], [0, 2, 2], [2, 2, 0]]
    faces = np.array([[0, 1, 4], [0, 4, 3], [1, 2, 5], [1, 5, 4], [4, 5, 7], [3, 4, 6]], np.int32)
    folded = loose(Surface(np.array(corners, float), faces))
    found = shared_corners(folded, 60.0)
    assert len(found.vertices) == len(corners) + 2
    assert not set(found.faces[5]) & set(found.faces[:5].ravel())
    assert len(shared_corners(folded, 65.0).vertices) == len(corners)


def test_what_the_file_says_is_shared_is_not_touched():
    assert shared_corners(BOX, 60.0) is BOX


def test_nor_is_it_where_two_other_vertices_lie_on_one_another():
    stray = Surface(np.concatenate([BOX.vertices, BOX.vertices[:1]]), BOX.faces)
    found = shared_corners(stray, 60.0)
    np.testing.assert_array_equal(corners_of(found), corners_of(BOX))
    assert len(found.vertices) == 8


def test_faces_of_opposite_winding_share_no_vertex():
    """Their normals would cancel."""
    square = Surface(
        np.array([[0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0]], float),
        np.array([[0, 1, 2], [0, 3, 2]], np.int32),
    )
    found = shared_corners(loose(square), 179.0)
    assert len(found.vertices) == 6
    assert (np.abs(vertex_normals(found.vertices, found.faces)) == [0, 0, 1]).all()


def test_faces_of_two_corners_go_and_carry_no_normal_over_a_crease():
    box = loose(BOX)
    a, b = box.vertices[box.faces[0, :2]]
    sliver = Surface(np.concatenate([box.vertices, [a, a, b]]), np.concatenate([box.faces, [[36, 37, 38]]]))
    found = shared_corners(sliver, 60.0)
    assert (len(found.vertices), len(found.faces)) == (24, 12)


@pytest.mark.parametrize("order", [0, 1])
def test_the_order_of_the_faces_does_not_matter(order):
    faces = np.random.default_rng(order).permutation(SPHERE.faces)
    found = shared_corners(loose(Surface(SPHERE.vertices, faces)), 60.0)
    np.testing.assert_array_equal(corners_of(found), SPHERE.vertices[faces])
    assert len(found.vertices) == len(SPHERE.vertices)


def test_stl_and_textured_obj_give_the_mesh_that_was_written(tmp_path):
    mesh = to_open3d(SPHERE)
    mesh.compute_vertex_normals()
    stl, obj = tmp_path / "sphere.stl", tmp_path / "sphere.obj"
    assert o3d.io.write_triangle_mesh(str(stl), mesh)
    _write_with_texture(obj, SPHERE)
    for path in (stl, obj):
        given = read_mesh_file(path)
        assert len(given.vertices) > len(SPHERE.vertices)  # else there is nothing to join
        assert len(shared_corners(given, 60.0).vertices) == len(SPHERE.vertices)


def test_vertices_without_faces_are_not_adopted(make_job, tmp_path):
    far = np.concatenate([BOX.vertices, np.full((50, 3), 1e4)])
    write_mesh(tmp_path / "strays.ply", Surface(far, BOX.faces))
    job = make_job(tmp_path / "out", ADOPT_MESH, mesh_file=tmp_path / "strays.ply")
    ADOPT_MESH.run(job)
    np.testing.assert_array_equal(corners_of(read_mesh(job.outputs["mesh"])), corners_of(BOX))
    assert len(read_mesh(job.outputs["mesh"]).vertices) == 8


def test_a_mesh_of_one_place_is_refused(make_job, tmp_path):
    write_mesh(tmp_path / "point.ply", Surface(np.zeros((3, 3)), np.array([[0, 1, 2]], np.int32)))
    with pytest.raises(UserError, match="1 triangles, each with corners in one place; expected a surface"):
        ADOPT_MESH.run(make_job(tmp_path / "out", ADOPT_MESH, mesh_file=tmp_path / "point.ply"))


def _write_with_texture(path, surface: Surface) -> None:
    """As photogrammetry writes it: corners of a vertex lie in different charts."""
    lines = [f"v {x:.9g} {y:.9g} {z:.9g}" for x, y, z in surface.vertices]
    lines += [f"vt {k / surface.faces.size:.6f} 0.5" for k in range(surface.faces.size)]
    lines += [
        "f " + " ".join(f"{vertex + 1}/{3 * face + corner + 1}" for corner, vertex in enumerate(corners))
        for face, corners in enumerate(surface.faces)
    ]
    path.write_text("\n".join(lines) + "\n")
