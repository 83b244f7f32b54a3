"""Textured models: charts, texels, what views show of them, tangents, files; the stage on a ball."""

from __future__ import annotations

import json
import struct

import cv2
import numpy as np
import pytest
import trimesh
from PIL import Image

from pipeline import UserError
from stages.formats.artefacts.camera_file import write_cameras
from stages.formats.colour.srgb import srgb_from_linear
from stages.formats.images.exr import read_exr, write_exr
from stages.formats.images.photos import write_mask
from stages.formats.meshes import gltf_binary
from stages.formats.meshes.mesh_files import read_mesh_file
from stages.formats.meshes.textured_models import Texture, TexturedModel, write_glb
from stages.formats.meshes.triangle_meshes import Surface, write_mesh
from stages.geometry.rays import NO_TRIANGLE, RayCaster
from stages.scene.cameras import Camera, back_project
from stages.synthetic.views import look_at
from stages.texture import TEXTURE
from stages.texturing.completion import Gutters, SurfaceMeans, completed
from stages.texturing.gathering import typical_footprint
from stages.texturing.normal_map import tangent_space, tangents_of
from stages.texturing.settings import ChartSettings, CompletionSettings, TextureSettings
from stages.texturing.texels import Texels, areas_in_texture, side_of_atlas, texels_of
from stages.texturing.unwrapping import ChartedMesh, unwrapped, within_budget

BALL = trimesh.creation.icosphere(subdivisions=4)
SURFACE = Surface(np.asarray(BALL.vertices), np.asarray(BALL.faces, np.int32))
TO_Y_UP = np.array([[1.0, 0, 0], [0, 0, 1], [0, -1, 0]])


def cameras(count: int = 8, side: int = 160) -> list[Camera]:
    """A ring around the ball, alternately from above and below; the world's z is up."""
    K = np.array([[1.6 * side, 0, side / 2], [0, 1.6 * side, side / 2], [0, 0, 1]])
    found = []
    for index in range(count):
        angle, high = 2 * np.pi * index / count, 1.2 * (-1) ** index
        centre = np.array([4 * np.cos(angle), 4 * np.sin(angle), high])
        found.append(Camera(f"view {index}", side, side, K, look_at(centre, np.zeros(3))))
    return found


def paint(x_in_world: np.ndarray) -> np.ndarray:
    """Smooth colours of the ball, 0.1 to 0.9."""
    waves = [np.sin(k * x_in_world[..., k % 3] + k) for k in (3, 4, 5)]
    return (0.5 + 0.4 * np.stack(waves, axis=-1)).astype(np.float32)


def write_views(folder, views: list[Camera], stained: int | None = None) -> dict:
    """Write what the stage takes; view `stained` has a dark square on its albedo."""
    caster, places = RayCaster(SURFACE), {}
    for kind in ("mask", "depth", "normal", "albedo", "shading", "confidence"):
        places[kind] = folder / kind
    for index, camera in enumerate(views):
        seen = caster.see(camera, threads=1)
        albedo = np.where(seen.mask[..., None], paint(back_project(camera, seen.depth)), 0)
        if index == stained:
            albedo[60:100, 60:100] *= 0.3
        write_mask(places["mask"] / f"{camera.name}.png", seen.mask)
        write_exr(places["depth"] / f"{camera.name}.exr", seen.depth)
        write_exr(places["normal"] / f"{camera.name}.exr", seen.normals)
        write_exr(places["albedo"] / f"{camera.name}.exr", albedo.astype(np.float32))
        write_exr(places["shading"] / f"{camera.name}.exr", np.ones_like(albedo, np.float32))
        write_exr(places["confidence"] / f"{camera.name}.exr", seen.mask.astype(np.float32))
    places |= {
        "cameras": folder / "cameras.json",
        "mesh": folder / "mesh.ply",
        "scales": folder / "scales.json",
    }
    write_cameras(places["cameras"], views)
    write_mesh(places["mesh"], SURFACE)
    places["scales"].write_text(json.dumps({"png_white": {"albedo": 1.0}}), encoding="utf-8")
    return places


@pytest.fixture(scope="module")
def textured(tmp_path_factory, make_job):
    folder = tmp_path_factory.mktemp("texture")
    job = make_job(folder / "out", TEXTURE, None, **write_views(folder, cameras()))
    TEXTURE.run(job)
    return job


@pytest.fixture(scope="module")
def charted() -> tuple[ChartedMesh, Texels]:
    mesh = unwrapped(SURFACE, 256, ChartSettings())
    return mesh, texels_of(mesh, 256)


def test_the_model_shows_the_paint_from_where_the_photos_were_not(textured):
    """Rays from a new camera on to the GLB as trimesh reads it: its texture there is the paint."""
    model = trimesh.load(textured.outputs["textured_model"] / "model.glb", force="mesh", process=False)
    vertices, faces = np.asarray(model.vertices) @ TO_Y_UP, np.asarray(model.faces)
    np.testing.assert_allclose(np.linalg.norm(vertices, axis=1), 1, atol=1e-5)  # z is up again
    camera = cameras(5, 200)[1]
    seen = RayCaster(Surface(vertices, faces.astype(np.int32))).see(camera, threads=1)
    hit = seen.triangles != NO_TRIANGLE
    u, v = seen.barycentric[hit].T
    corners = model.visual.uv[faces[seen.triangles[hit]]]
    place = (1 - u - v)[:, None] * corners[:, 0] + u[:, None] * corners[:, 1] + v[:, None] * corners[:, 2]
    texture = np.asarray(model.visual.material.baseColorTexture).astype(float) / 255
    side = len(texture)
    row = np.clip((1 - place[:, 1]) * side, 0, side - 1).astype(int)
    shown = texture[row, np.clip(place[:, 0] * side, 0, side - 1).astype(int)]
    truth = srgb_from_linear(paint(back_project(camera, seen.depth)[hit]))
    error = np.sqrt(np.mean((shown - truth) ** 2))
    assert -20 * np.log10(error) > 34
    assert textured.facts["seen"] > 0.9


def test_files_for_other_programs_say_the_same(textured):
    folder = textured.outputs["textured_model"]
    glb = trimesh.load(folder / "model.glb", force="mesh", process=False)
    obj = trimesh.load(folder / "model.obj", force="mesh", process=False)
    assert len(obj.faces) == len(glb.faces) == textured.facts["faces"] == len(SURFACE.faces)
    assert sorted(np.round(obj.area_faces, 6)) == pytest.approx(sorted(np.round(glb.area_faces, 6)), abs=1e-5)
    assert obj.visual.material.image.size == glb.visual.material.baseColorTexture.size
    linear = read_exr(folder / "albedo.exr")
    picture = np.asarray(glb.visual.material.baseColorTexture).astype(float) / 255
    np.testing.assert_allclose(picture, srgb_from_linear(linear), atol=1 / 255)
    assert float(read_exr(folder / "confidence.exr").max()) == 1.0
    np.testing.assert_allclose(read_exr(folder / "shading.exr"), 1, atol=1e-3)


def test_there_is_no_seam_between_charts(textured):
    """Doubled vertices are one place on the ball: the texture there differs less than along an edge."""
    folder = textured.outputs["textured_model"]
    model = trimesh.load(folder / "model.glb", force="mesh", process=False)
    albedo, seen = read_exr(folder / "albedo.exr"), read_exr(folder / "confidence.exr")
    side = len(albedo)
    at = (np.column_stack([model.visual.uv[:, 0], 1 - model.visual.uv[:, 1]]) * side - 0.5).astype(np.float32)
    shown = cv2.remap(albedo, at[None, :, 0], at[None, :, 1], cv2.INTER_LINEAR)[0]
    known = cv2.remap(seen, at[None, :, 0], at[None, :, 1], cv2.INTER_NEAREST)[0] > 0
    _, place = np.unique(np.round(model.vertices, 6), axis=0, return_inverse=True)
    order = np.argsort(place.ravel(), kind="stable")
    pairs = np.column_stack([order[:-1], order[1:]])
    pairs = pairs[(place.ravel()[pairs[:, 0]] == place.ravel()[pairs[:, 1]]) & known[pairs].all(axis=1)]
    edges = model.faces[:, :2][known[model.faces[:, :2]].all(axis=1)]
    assert len(pairs) > 30
    across, along = (np.abs(shown[ends[:, 0]] - shown[ends[:, 1]]).mean() for ends in (pairs, edges))
    assert across < 0.5 * along, (across, along)


def test_the_glb_has_what_a_validator_asks_for(textured):
    data = (textured.outputs["textured_model"] / "model.glb").read_bytes()
    magic, version, length = struct.unpack("<4sII", data[:12])
    assert (magic, version, length) == (b"glTF", 2, len(data))
    size = struct.unpack("<I", data[12:16])[0]
    content, binary = json.loads(data[20 : 20 + size]), data[28 + size :]
    assert content["buffers"][0]["byteLength"] == len(binary)
    (primitive,) = content["meshes"][0]["primitives"]

    def values(name: str, width: int) -> np.ndarray:
        accessor = content["accessors"][primitive["attributes"][name]]
        view = content["bufferViews"][accessor["bufferView"]]
        assert view["target"] == 34962 and view["byteOffset"] % 4 == 0
        part = binary[view["byteOffset"] : view["byteOffset"] + view["byteLength"]]
        return np.frombuffer(part, "<f4").reshape(-1, width)

    normals, tangents = values("NORMAL", 3), values("TANGENT", 4)
    np.testing.assert_allclose(np.linalg.norm(normals, axis=1), 1, atol=1e-5)
    np.testing.assert_allclose(np.linalg.norm(tangents[:, :3], axis=1), 1, atol=1e-5)
    np.testing.assert_allclose((normals * tangents[:, :3]).sum(axis=1), 0, atol=1e-5)
    assert set(np.unique(tangents[:, 3])) <= {-1.0, 1.0}
    bounds = content["accessors"][primitive["attributes"]["POSITION"]]
    np.testing.assert_array_equal(values("POSITION", 3).min(axis=0), np.float32(bounds["min"]))
    material = content["materials"][0]
    assert material["pbrMetallicRoughness"]["metallicFactor"] == 0 and "extensions" not in content


def test_what_one_view_alone_shows_is_not_the_surface(textured, tmp_path, make_job):
    places, lost = write_views(tmp_path, cameras(), stained=2), []
    clean = read_exr(textured.outputs["textured_model"] / "albedo.exr")
    for tolerance in (100.0, TextureSettings().gathering.tolerance):
        how = TextureSettings(gathering={"tolerance": tolerance})
        job = make_job(tmp_path / str(tolerance), TEXTURE, how, **places)
        TEXTURE.run(job)
        stained = read_exr(job.outputs["textured_model"] / "albedo.exr")
        lost.append((stained < 0.8 * clean).any(axis=2).mean())
    assert lost[1] < 0.6 * lost[0], lost  # what is left, no other view shows but at its border
    assert lost[1] < 0.01, lost


def test_any_number_of_threads_gives_the_same_bytes(textured, tmp_path, make_job):
    job = make_job(tmp_path / "out", TEXTURE, None, 1, **write_views(tmp_path, cameras()))
    TEXTURE.run(job)
    for path in textured.outputs["textured_model"].iterdir():
        assert path.read_bytes() == (job.outputs["textured_model"] / path.name).read_bytes(), path.name


def test_texels_lie_on_their_faces_and_cover_the_charts(charted):
    mesh, texels = charted
    uv = texels.interpolated(mesh, mesh.uv) * texels.side
    np.testing.assert_allclose(uv[:, 0], texels.place % texels.side + 0.5, atol=1e-2)
    np.testing.assert_allclose(uv[:, 1], texels.place // texels.side + 0.5, atol=1e-2)
    corners = mesh.uv[mesh.faces] * texels.side
    one, other = corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]
    area = np.abs(one[:, 0] * other[:, 1] - one[:, 1] * other[:, 0]).sum() / 2
    assert len(texels) == pytest.approx(area, rel=0.02)
    assert len(np.unique(texels.place)) == len(texels)


@pytest.mark.parametrize("unit", [1e-3, 1e4])
def test_every_face_has_its_place_in_the_atlas_whatever_the_unit(charted, unit):
    """A small object in metres, a castle in millimetres: the same charts as at the size of 1."""
    mesh, _ = charted
    other = unwrapped(Surface(unit * SURFACE.vertices, SURFACE.faces), 256, ChartSettings())
    at_one, areas = (np.sort(np.abs(areas_in_texture(one.uv[one.faces]))) for one in (mesh, other))
    assert areas.min() > 0
    assert np.isclose(areas, at_one, rtol=0.02).mean() > 0.9


def test_the_mesh_s_own_normals_are_flat_in_tangent_space_and_tilts_have_their_signs(charted):
    mesh, texels = charted
    tangents = tangents_of(mesh)
    normals = texels.interpolated(mesh, mesh.normals)
    flat = tangent_space(texels, mesh, tangents, normals)
    np.testing.assert_allclose(flat, np.broadcast_to([0, 0, 1], flat.shape), atol=1e-3)
    np.testing.assert_array_equal(tangent_space(texels, mesh, tangents, 0 * normals), flat)
    along_u = texels.interpolated(mesh, tangents[:, :3])
    tilted = tangent_space(texels, mesh, tangents, normals + 0.5 * along_u)
    assert np.quantile(tilted[:, 0], 0.02) > 0.3 and np.abs(tilted[:, 1]).max() < 0.1
    # Along the surface in the direction of growing v the place in the atlas moves down: y is against it.
    step = 1e-3
    inner = mesh.faces[texels.face]
    edge_uv = mesh.uv[inner[:, 1]] - mesh.uv[inner[:, 0]]
    edge = (mesh.vertices[inner[:, 1]] - mesh.vertices[inner[:, 0]]).astype(np.float32)
    y = tangent_space(texels, mesh, tangents, normals + 20 * edge)[:, 1]
    clear = np.abs(edge_uv[:, 1]) > 2 * np.abs(edge_uv[:, 0]) + step
    assert clear.sum() > 100
    assert np.mean(np.sign(y[clear]) == -np.sign(edge_uv[clear, 1])) > 0.99


def test_unseen_surface_is_filled_from_around_across_chart_borders(charted):
    mesh, texels = charted
    height = texels.interpolated(mesh, mesh.vertices)[:, 2:]
    seen = np.abs(height[:, 0]) > 0.3
    means = SurfaceMeans(mesh)
    means.add(texels, mesh, np.where(seen[:, None], height, -9), seen)
    filled = completed(texels, mesh, height, seen, means.spread(CompletionSettings()))
    np.testing.assert_array_equal(filled[seen], height[seen])
    assert np.abs(filled - height).max() < 0.15  # nearly linear between the two rims
    assert completed(texels, mesh, height, np.ones(len(texels), bool), np.zeros((0, 1))) is height
    assert not SurfaceMeans(mesh).spread(CompletionSettings()).any()


def test_gutters_take_the_nearest_texel():
    image = np.zeros((8, 8, 3), np.float32)
    image[2, 2], image[6, 6] = 1, 2
    inside = image[..., 0] > 0
    filled = Gutters(inside).fill(image.copy())
    assert filled[0, 0, 0] == 1 and filled[7, 7, 0] == 2 and (filled > 0).all()


def test_a_large_mesh_is_brought_within_its_budget_and_a_small_one_is_left_alone():
    assert len(within_budget(SURFACE, ChartSettings()).faces) == len(SURFACE.faces)
    fewer = within_budget(SURFACE, ChartSettings(most_faces=1000))
    assert len(fewer.faces) <= 1000
    assert np.abs(np.linalg.norm(fewer.vertices, axis=1) - 1).max() < 0.05
    broken = Surface(
        SURFACE.vertices, np.concatenate([SURFACE.faces, [[0, 0, 1], [5, 5, 5]]]).astype(np.int32)
    )
    assert len(within_budget(broken, ChartSettings()).faces) == len(SURFACE.faces)


def test_the_atlas_is_as_fine_as_the_views_within_bounds():
    how, views = ChartSettings(), cameras()
    side = side_of_atlas(SURFACE, views, how)
    finer = side_of_atlas(SURFACE, [camera.scaled(640, 640) for camera in views], how)
    assert finer == 4 * side
    assert side_of_atlas(SURFACE, [camera.scaled(64_000, 64_000) for camera in views], how) == how.most_px
    assert side_of_atlas(SURFACE, [camera.scaled(4, 4) for camera in views], how) == how.least_px


def test_a_wall_of_two_triangles_larger_than_the_photos_is_as_fine_as_they_are():
    how, views = ChartSettings(), cameras()
    corners = np.array([[-9.0, -9, -0.2], [9, -9, -0.2], [9, 9, -0.2], [-9, 9, -0.2]])
    wall = Surface(corners + [4, 0, 0], np.array([[0, 1, 2], [0, 2, 3]], np.int32))
    texel = 18 / side_of_atlas(wall, views, how)
    assert texel < 1.1 * typical_footprint(np.zeros((1, 3)), views) / np.sqrt(how.expected_use)
    assert 0 < typical_footprint(corners + [400, 0, 0], views) < np.inf


def test_settings_of_the_stage_are_told_by_name():
    assert TextureSettings().charts.most_px == 4096


def test_a_glb_that_no_header_could_tell_the_length_of_is_refused(monkeypatch):
    monkeypatch.setattr(gltf_binary, "LARGEST_FILE", gltf_binary.ROOM_FOR_TEXT + 10)
    buffer = gltf_binary.BinaryBuffer()
    buffer.add(bytes(8))
    assert len(gltf_binary.packed({}, buffer)) > 8
    buffer.add(bytes(8))
    with pytest.raises(UserError, match=r"would be a GLB of .* GB; expected at most 4.2 GB"):
        gltf_binary.packed({}, buffer)


@pytest.mark.parametrize("shift", [[0.0, 0, 0], [500_000.0, 5_700_000, 120]])
def test_axes_of_a_glb_are_turned_and_nothing_else(tmp_path, shift):
    """Not even in metres of UTM, where numbers of single precision are half a metre apart."""
    square = np.array([[0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0.5]]) + shift
    uv = np.array([[0, 1], [1, 1], [1, 0], [0, 0.0]])
    image = np.arange(4 * 4 * 3, dtype=np.uint8).reshape(4, 4, 3)
    up = np.tile([[0.0, 0, 1]], (4, 1))
    tangents = np.tile([[1.0, 0, 0, 1]], (4, 1))
    faces = np.array([[0, 1, 2], [0, 2, 3]], np.int32)
    Image.fromarray(image).save(tmp_path / "i.png")
    texture = Texture("wood", np.arange(2), tmp_path / "i.png", tmp_path / "i.png")
    model = TexturedModel(square, up, tangents, faces, uv, (texture,), 0.5)
    write_glb(tmp_path / "m.glb", model, TO_Y_UP)
    back = trimesh.load(tmp_path / "m.glb", force="mesh", process=False)
    np.testing.assert_allclose(np.asarray(back.vertices) @ TO_Y_UP, square, atol=1e-6)
    np.testing.assert_allclose(read_mesh_file(tmp_path / "m.glb").vertices @ TO_Y_UP, square, atol=1e-6)
    np.testing.assert_allclose(back.visual.uv, np.column_stack([uv[:, 0], 1 - uv[:, 1]]), atol=1e-6)
    np.testing.assert_array_equal(np.asarray(back.visual.material.baseColorTexture), image)
    assert back.visual.material.roughnessFactor == 0.5
