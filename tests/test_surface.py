"""Surface and rays, on shapes whose answer is known by hand."""

from __future__ import annotations

import json
import struct
from dataclasses import replace

import numpy as np
import open3d as o3d
import pytest

from pipeline import UserError
from stages.formats.meshes.mesh_files import read_mesh_file
from stages.formats.meshes.point_clouds import read_points
from stages.formats.meshes.triangle_meshes import Surface, from_open3d, read_mesh, write_mesh
from stages.geometry import surface as s
from stages.geometry.rays import NO_TRIANGLE, RayCaster
from stages.mesh import MeshSettings, estimated_memory, within
from stages.scene.cameras import Camera, back_project, smallest_footprints
from tests.sphere_scene import points_of_a_sphere

SQUARE = Surface(
    np.array([[-1, -1, 4], [1, -1, 4], [1, 1, 4], [-1, 1, 4]], float),
    np.array([[0, 2, 1], [0, 3, 2]], np.int32),
)  # wound so that its right-hand normal is −z, towards the camera


def camera(width=40, height=30, focal=40.0, centre=(0.0, 0.0, 0.0)) -> Camera:
    K = np.array([[focal, 0, width / 2], [0, focal, height / 2], [0, 0, 1]])
    pose = np.column_stack([np.eye(3), -np.asarray(centre, float)])
    return Camera("view", width, height, K, pose)


def test_rays_see_a_square_at_its_z_depth_everywhere_and_nothing_beside_it():
    seen = RayCaster(SQUARE).see(camera())
    assert seen.mask.sum() == 20 * 20  # side 2 at z 4, focal 40: 20 pixels
    assert seen.mask[5:25, 10:30].all()
    np.testing.assert_allclose(seen.depth[seen.mask], 4.0, rtol=1e-6)  # z, not ray length
    assert (seen.depth[~seen.mask] == 0).all()
    np.testing.assert_allclose(seen.normals[seen.mask], [[0, 0, -1]] * 400, atol=1e-6)
    assert (seen.triangles[~seen.mask] == NO_TRIANGLE).all()


def test_barycentric_coordinates_lead_back_to_the_point_that_was_hit():
    seen, cam = RayCaster(SQUARE).see(camera()), camera()
    u, v = seen.barycentric[seen.mask].T[..., None].astype(float)
    a, b, c = (SQUARE.vertices[SQUARE.faces[seen.triangles[seen.mask]][:, corner]] for corner in range(3))
    points = (1 - u - v) * a + u * b + v * c
    np.testing.assert_allclose(points, back_project(cam, seen.depth)[seen.mask], atol=1e-5)


def test_normals_face_the_camera_whichever_way_the_triangles_are_wound():
    turned = Surface(SQUARE.vertices, SQUARE.faces[:, ::-1].copy())
    first, second = (RayCaster(mesh).see(camera()).normals for mesh in (SQUARE, turned))
    np.testing.assert_allclose(first, second, atol=1e-6)


def test_a_georeferenced_scene_keeps_its_millimetres():
    """Moving everything by millions of metres changes depth by float32 rounding of the local scene only."""
    shift = np.array([4_000_000.0, 500_000.0, 300.0])
    far = RayCaster(Surface(SQUARE.vertices + shift, SQUARE.faces)).see(camera(centre=shift))
    near = RayCaster(SQUARE).see(camera())
    np.testing.assert_allclose(far.depth, near.depth, atol=1e-5)


def test_smooth_normals_of_a_sphere_point_along_its_radius():
    mesh = from_open3d(o3d.geometry.TriangleMesh.create_sphere(1.0, 60))
    cam = camera(centre=(0, 0, -4))
    seen = RayCaster(mesh).see(cam)
    radial = back_project(cam, seen.depth)[seen.mask]
    radial /= np.linalg.norm(radial, axis=1, keepdims=True)
    cosine = np.einsum("nk,nk->n", radial, seen.normals[seen.mask])
    assert np.degrees(np.arccos(np.clip(cosine, -1, 1))).max() < 2.0


def test_footprint_is_the_smallest_over_the_views_that_hold_the_point():
    near, far = camera(centre=(0, 0, 2)), camera(centre=(0, 0, 0))
    points = np.array([[0, 0, 4], [0, 0, 1], [100, 0, 4]], float)
    found = smallest_footprints(points, [near, far])
    np.testing.assert_allclose(found, [2 / 40, 1 / 40, np.inf])


def test_octree_depth_follows_extent_over_cell_and_is_bounded():
    points = s.OrientedPoints(
        np.array([[0, 0, 0], [8, 0, 0.0]]), np.zeros((2, 3)), np.array([0.01, 0.01]), np.ones(2)
    )
    assert s.octree_depth(points, cell_footprints=1.0, shallowest=5, deepest=12) == 10  # 800 cells
    assert s.octree_depth(points, cell_footprints=2.0, shallowest=5, deepest=12) == 9
    assert s.octree_depth(points, cell_footprints=1.0, shallowest=5, deepest=7) == 7


def test_a_few_stray_points_do_not_decide_the_extent():
    points = points_of_a_sphere(2000)
    stray = s.OrientedPoints(
        np.vstack([points.x_in_world, [[500, 0, 0]]]),
        np.vstack([points.normals, [[1, 0, 0]]]),
        np.full(2001, 0.03),
        np.ones(2001),
    )
    kept = s.robust_crop(stray, outliers=0.002, margin=0.2)
    assert len(kept) == 2000


def test_poisson_finds_the_sphere_the_same_twice():
    first, second = (s.poisson(points_of_a_sphere(4000), depth=5) for _ in range(2))
    assert np.abs(np.linalg.norm(first.vertices, axis=1) - 1).mean() < 0.01
    np.testing.assert_array_equal(first.vertices, second.vertices)
    np.testing.assert_array_equal(first.faces, second.faces)


def test_poisson_of_a_georeferenced_scan_is_the_one_at_the_origin():
    points, shift = points_of_a_sphere(4000), np.array([500_000.0, 5_700_000.0, 120.0])
    far = s.poisson(replace(points, x_in_world=points.x_in_world + shift), depth=5)
    assert np.abs(np.linalg.norm(far.vertices - shift, axis=1) - 1).mean() < 0.01


@pytest.mark.parametrize("shift", [np.zeros(3), np.array([4_000_000.0, 500_000.0, 4_900_000.0])])
def test_decimation_far_from_the_origin_is_as_at_it(shift):
    sphere = s.poisson(points_of_a_sphere(4000), depth=5)
    far = s.decimated(Surface(sphere.vertices + shift, sphere.faces), 1000)
    radii = np.linalg.norm(far.vertices - shift, axis=1)
    assert len(far.faces) <= 1000 and np.abs(radii - 1).max() < 0.05


def test_crumbs_go_and_the_largest_component_stays():
    big = from_open3d(o3d.geometry.TriangleMesh.create_sphere(1.0, 20))
    crumb = Surface(SQUARE.vertices + 10, SQUARE.faces)
    both = Surface(
        np.vstack([big.vertices, crumb.vertices]), np.vstack([big.faces, crumb.faces + len(big.vertices)])
    )
    assert len(s.without_crumbs(both, 0.01).faces) == len(big.faces)
    assert len(s.without_crumbs(both, 0.0).faces) == len(both.faces)


def test_decimation_and_smoothing_are_off_unless_asked_for():
    sphere = from_open3d(o3d.geometry.TriangleMesh.create_sphere(1.0, 20))
    assert s.decimated(sphere, None) is sphere
    assert s.smoothed(sphere, 0) is sphere
    assert len(s.decimated(sphere, 200).faces) <= 200
    assert s.smoothed(sphere, 3).vertices.shape == sphere.vertices.shape


@pytest.mark.parametrize("suffix", [".ply", ".obj", ".off", ".stl"])
def test_meshes_of_every_format_are_read(tmp_path, suffix):
    path = tmp_path / f"mesh{suffix}"
    mesh = o3d.geometry.TriangleMesh.create_box()
    mesh.compute_triangle_normals()
    o3d.io.write_triangle_mesh(str(path), mesh)
    assert len(read_mesh_file(path).faces) == 12


def test_a_glb_is_read_where_its_scene_places_it(tmp_path):
    write_glb(tmp_path / "mesh.glb", SQUARE, translation=[10.0, 0.0, 0.0])
    found, expected = read_mesh_file(tmp_path / "mesh.glb"), SQUARE.vertices + [10, 0, 0]
    np.testing.assert_array_equal(
        np.sort(found.vertices[found.faces], axis=1), np.sort(expected[SQUARE.faces], axis=1)
    )


def write_glb(path, surface: Surface, translation: list[float]) -> None:
    """By hand, as the format has it: what open3d writes as GLB no reader of its own takes."""
    data = surface.vertices.astype("<f4").tobytes() + surface.faces.astype("<u4").tobytes()
    split = 12 * len(surface.vertices)
    low, high = surface.vertices.min(axis=0).tolist(), surface.vertices.max(axis=0).tolist()
    places = {"bufferView": 0, "componentType": 5126, "count": len(surface.vertices), "type": "VEC3"}
    corners = {"bufferView": 1, "componentType": 5125, "count": surface.faces.size, "type": "SCALAR"}
    text = json.dumps(
        {
            "asset": {"version": "2.0"},
            "scene": 0,
            "scenes": [{"nodes": [0]}],
            "nodes": [{"mesh": 0, "translation": translation}],
            "meshes": [{"primitives": [{"attributes": {"POSITION": 0}, "indices": 1}]}],
            "buffers": [{"byteLength": len(data)}],
            "bufferViews": [
                {"buffer": 0, "byteOffset": 0, "byteLength": split},
                {"buffer": 0, "byteOffset": split, "byteLength": len(data) - split},
            ],
            "accessors": [{**places, "min": low, "max": high}, corners],
        }
    ).encode()
    text += b" " * (-len(text) % 4)
    length = 12 + 8 + len(text) + 8 + len(data)
    chunks = struct.pack("<I4s", len(text), b"JSON") + text + struct.pack("<I4s", len(data), b"BIN\0") + data
    path.write_bytes(struct.pack("<4sII", b"glTF", 2, length) + chunks)


def test_a_mesh_survives_being_written(tmp_path):
    write_mesh(tmp_path / "deep/er/mesh.ply", SQUARE)
    back = read_mesh(tmp_path / "deep/er/mesh.ply")
    np.testing.assert_array_equal(back.vertices, SQUARE.vertices)
    np.testing.assert_array_equal(back.faces, SQUARE.faces)


def test_a_file_without_triangles_is_refused(tmp_path):
    header = "ply\nformat ascii 1.0\nelement vertex 0\n"
    header += "".join(f"property float {axis}\n" for axis in "xyz")
    (tmp_path / "points.ply").write_text(f"{header}end_header\n")
    with pytest.raises(UserError, match="no faces; expected a mesh"):
        read_mesh(tmp_path / "points.ply")


@pytest.mark.parametrize("corner", [3, -1])
def test_triangles_of_missing_vertices_are_refused(tmp_path, corner):
    header = "ply\nformat ascii 1.0\nelement vertex 3\nproperty float x\nproperty float y\nproperty float z\n"
    header += "element face 1\nproperty list uchar int vertex_indices\nend_header\n"
    (tmp_path / "holes.ply").write_text(f"{header}0 0 0\n1 0 0\n0 1 0\n3 0 1 {corner}\n")
    with pytest.raises(UserError, match=rf"holes\.ply .* {corner}.*; expected 0 to 2"):
        read_mesh(tmp_path / "holes.ply")


def test_a_mesh_in_two_files_is_refused(tmp_path):
    o3d.io.write_triangle_mesh(str(tmp_path / "box.gltf"), o3d.geometry.TriangleMesh.create_box())
    with pytest.raises(UserError, match=r"box\.gltf .* expected PLY, OBJ, STL, OFF or GLB"):
        read_mesh_file(tmp_path / "box.gltf")


def test_points_that_are_not_finite_are_left_out(tmp_path):
    cloud = o3d.geometry.PointCloud(o3d.utility.Vector3dVector([[0, 0, 0], [np.nan, 0, 0]]))
    cloud.normals = o3d.utility.Vector3dVector([[0, 0, 1], [0, 0, 1]])
    o3d.io.write_point_cloud(str(tmp_path / "cloud.ply"), cloud)
    points, normals, _ = read_points(tmp_path / "cloud.ply")
    assert points.shape == normals.shape == (1, 3)


@pytest.mark.parametrize(
    ("most", "depth"), [(10**6, 7), (20_000, 7), (16_000, 6), (4000, 5), (1000, 4), (1, 3)]
)
def test_a_mesh_has_the_deepest_octree_whose_cells_fit(most, depth):
    """A square sheet of points occupies (2^depth)² cells, or (2^depth + 1)², by where a grid begins."""
    x, y = (axis.ravel() for axis in np.meshgrid(np.arange(300), np.arange(300)))
    sheet = np.stack([x, y, np.zeros(x.size)], axis=1) + 0.25
    points = s.OrientedPoints(sheet, np.tile([0.0, 0, 1], (x.size, 1)), np.ones(x.size), np.ones(x.size))
    assert s.depth_within(points, 7, 3, most) == depth


def test_points_in_one_place_have_any_depth():
    nowhere = s.OrientedPoints(np.zeros((5, 3)), np.tile([0.0, 0, 1], (5, 1)), np.ones(5), np.ones(5))
    assert s.depth_within(nowhere, 9, 5, 1) == 9


def test_little_memory_allows_fewer_cells_and_its_estimate_is_no_more(tmp_path):
    (tmp_path / "fused.ply").write_bytes(bytes(30_000_000))
    points = {"fused": tmp_path / "fused.ply"}
    usual = MeshSettings()
    for memory in (5 * 10**8, 10**9, 2 * 10**9, 10**11):
        bounded = within(usual, memory)
        assert bounded.most_cells <= usual.most_cells
        if memory >= 10**9:
            assert estimated_memory(bounded, points, 2) <= memory
    assert within(usual, 10**11) == usual
