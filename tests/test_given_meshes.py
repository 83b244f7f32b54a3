"""Meshes as users bring them: open, in pieces, not manifold, with faces without area, inside out."""

from __future__ import annotations

import json
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
import trimesh

from stages.adopt_mesh import ADOPT_MESH
from stages.cli import main
from stages.formats.artefacts.transfer_file import read_transfer
from stages.formats.colmap.model import pinhole_model
from stages.formats.images.exr import read_exr
from stages.formats.meshes.triangle_meshes import Surface, read_mesh, write_mesh
from stages.raycast import RAYCAST_OF_GIVEN_SURFACE
from stages.scene.cameras import Camera
from stages.texture import TEXTURE
from stages.transfer import TRANSFER, TransferSettings
from tests.sphere_scene import camera_looking_at_origin
from tests.test_texture import SURFACE, cameras, write_views

SAMPLE = Path(__file__).parent.parent / "sample_data"
FACES = SURFACE.faces
CENTRES = SURFACE.vertices[FACES].mean(axis=1)


def with_faces(*more: np.ndarray) -> Surface:
    return Surface(SURFACE.vertices, np.concatenate([FACES, *more]).astype(np.int32))


def in_pieces() -> Surface:
    """Eight parts of the ball, each with vertices of its own, a little apart."""
    octant = (CENTRES > 0) @ [1, 2, 4]
    parts = [trimesh.Trimesh(SURFACE.vertices, FACES[octant == k], process=False) for k in range(8)]
    for part in parts:
        part.remove_unreferenced_vertices()
        part.apply_translation(0.01 * part.centroid)
    whole = trimesh.util.concatenate(parts)
    return Surface(np.asarray(whole.vertices), np.asarray(whole.faces, np.int32))


def with_fins() -> Surface:
    """Edges of three faces, faces twice and the other way round, and a vertex at which two cones meet."""
    vertices = np.concatenate([SURFACE.vertices, SURFACE.vertices[:1] * 1.2, [[0, 0, 0.3], [0.1, 0, 0.3]]])
    tip = len(SURFACE.vertices)
    more = [[*FACES[0][:2], tip], FACES[1], FACES[2][::-1], [0, tip + 1, tip + 2]]
    return Surface(vertices, np.concatenate([FACES, more]).astype(np.int32))


SHAPES: dict[str, Callable[[], Surface]] = {
    "open": lambda: Surface(SURFACE.vertices, FACES[CENTRES[:, 2] > -0.2]),
    "in pieces": in_pieces,
    "not manifold": with_fins,
    "lines and points": lambda: with_faces(FACES[:9, [0, 0, 1]], FACES[:5, [2, 2, 2]]),
    "slivers": lambda: with_faces(*[np.roll(FACES[:200], 1, axis=1)[:, [0, 1, 1]]]),
    "nothing shared": lambda: Surface(
        SURFACE.vertices[FACES.ravel()], np.arange(FACES.size, dtype=np.int32).reshape(-1, 3)
    ),
}


def workspace_of(folder, views: list[Camera]) -> None:
    pinhole_model(views).write(folder)


def raycast(folder, surface: Surface, make_job, views: list[Camera]):
    """Adopt a surface, and cast the rays of all views on to it."""
    write_mesh(folder / "given.ply", surface)
    adopt = make_job(folder / "adopt", ADOPT_MESH, None, mesh_file=folder / "given.ply")
    ADOPT_MESH.run(adopt)
    (folder / "workspace/sparse").mkdir(parents=True)
    (folder / "kept").mkdir()
    workspace_of(folder / "workspace/sparse", views)
    inputs = {"mesh": adopt.outputs["mesh"], "workspace": folder / "workspace", "kept": folder / "kept"}
    job = make_job(folder / "rays", RAYCAST_OF_GIVEN_SURFACE, None, **inputs)
    RAYCAST_OF_GIVEN_SURFACE.run(job)
    return adopt, job


@pytest.mark.parametrize("shape", SHAPES)
def test_they_are_seen_lit_and_textured(tmp_path, make_job, shape):
    views = cameras(4)
    adopt, rays = raycast(tmp_path, SHAPES[shape](), make_job, views)
    assert not rays.warnings and rays.facts["seen_from_behind"] < 0.2
    for camera in views:
        normals = read_exr(rays.outputs["normal"] / f"{camera.name}.exr")
        length = np.linalg.norm(normals, axis=2)
        hit = read_exr(rays.outputs["depth"] / f"{camera.name}.exr") > 0
        assert hit.mean() > 0.2
        np.testing.assert_allclose(length[hit], 1, atol=1e-3)
    few = TransferSettings(directions=16, sky_directions=16, light_distances=())
    mesh = adopt.outputs["mesh"]
    transfer = make_job(tmp_path / "transfer", TRANSFER, few, mesh=mesh, cameras=rays.outputs["cameras"])
    TRANSFER.run(transfer)
    stored = read_transfer(transfer.outputs["transfer"])
    assert np.isfinite(stored.blocked).all() and np.isfinite(stored.weights).all()
    inputs = write_views(tmp_path / "views", views) | {"mesh": mesh, "mesh_file": tmp_path / "given.ply"}
    texture = make_job(tmp_path / "texture", TEXTURE, None, **inputs)
    TEXTURE.run(texture)
    albedo = read_exr(texture.outputs["textured_model"] / "albedo.exr")
    assert np.isfinite(albedo).all() and albedo.max() <= 1 and texture.facts["seen"] > 0.5
    assert texture.facts["charts"] == "own"


def test_a_mesh_inside_out_is_said_to_be(tmp_path, make_job):
    turned = Surface(SURFACE.vertices, FACES[:, ::-1])
    adopt, rays = raycast(tmp_path, turned, make_job, cameras(4))
    (said,) = rays.warnings
    assert said.startswith("The mesh seems to be inside out: 100% of what the views see of it are backs")
    inputs = write_views(tmp_path / "views", cameras(4)) | {"mesh": adopt.outputs["mesh"]}
    texture = make_job(tmp_path / "texture", TEXTURE, None, **inputs)
    TEXTURE.run(texture)
    assert texture.warnings[0].startswith("No view shows the front of the surface")


def test_new_texture_coordinates_leave_all_but_the_texture_as_it_is(tmp_path, capsys):
    """The surface is the same: `adopt_mesh` reads the file again, and nothing after it runs."""
    surface = read_mesh(SAMPLE / "truth/mesh.ply")
    words = ["run", "--colmap", SAMPLE / "linear", "--images", SAMPLE / "linear/images", "--json"]
    words += ["--mesh", tmp_path / "a.obj", "--workspace", tmp_path / "w", "--to", "raycast"]
    actions = []
    for scale in (1.0, 0.5):
        write_flat_obj(tmp_path / "a.obj", surface, scale)
        assert main([str(word) for word in words]) == 0
        rows = json.loads(capsys.readouterr().out)["stages"]
        actions.append({row["stage"]: row["action"] for row in rows})
    assert actions[1]["adopt_mesh"] == "run" and actions[1]["raycast"] == "reuse"
    assert "mesh_file" in TEXTURE.may_take


def write_flat_obj(path, surface: Surface, scale: float) -> None:
    """A surface with the same places along x and y as texture coordinates."""
    low, size = surface.vertices.min(axis=0), np.ptp(surface.vertices, axis=0)
    lines = [f"v {x!r} {y!r} {z!r}" for x, y, z in surface.vertices.tolist()]
    lines += [f"vt {u!r} {v!r}" for u, v, _ in (scale * (surface.vertices - low) / size).tolist()]
    lines += ["f " + " ".join(f"{k}/{k}" for k in face) for face in (surface.faces + 1).tolist()]
    path.write_text("\n".join(lines))


def test_a_room_that_is_seen_from_inside_is_not_inside_out(tmp_path, make_job):
    """Its faces are turned to the cameras in it; as a solid it would be inside out."""
    room = Surface(2 * SURFACE.vertices, FACES[:, ::-1])
    inside = [camera_looking_at_origin(str(k), 0.5 * np.array([np.cos(k), np.sin(k), 0]), 40, 30, 30.0)
              for k in range(3)]  # fmt: skip
    _, rays = raycast(tmp_path, room, make_job, inside)
    assert not rays.warnings and rays.facts["seen_from_behind"] == 0
