"""A mesh with texture coordinates of its own is textured on them: UDIM tiles, materials, overlaps."""

from __future__ import annotations

import json
import re
from pathlib import Path

import numpy as np
import pytest
import trimesh

from pipeline import UserError
from stages.adopt_mesh import ADOPT_MESH
from stages.formats.colour.srgb import srgb_from_linear
from stages.formats.images.exr import read_exr
from stages.formats.meshes.gltf_binary import BinaryBuffer, packed
from stages.formats.meshes.mesh_files import read_uv_map
from stages.formats.meshes.polygons import Polygons, UVMap
from stages.formats.meshes.triangle_meshes import Surface, read_mesh
from stages.geometry.rays import NO_TRIANGLE, RayCaster
from stages.scene.cameras import Camera, back_project
from stages.texture import TEXTURE
from stages.texturing.given_charts import Chart, given_charts
from stages.texturing.normal_map import tangents_of
from stages.texturing.settings import GivenUVSettings, TextureSettings
from stages.texturing.sheets import names_of
from stages.texturing.texels import texels_of
from tests.test_texture import SURFACE, TO_Y_UP, cameras, paint, write_views

UPPER = SURFACE.vertices[SURFACE.faces].mean(axis=1)[:, 2] > 0


def hemispheres() -> tuple[np.ndarray, np.ndarray]:
    """Charts by hand, v upwards: coordinates (2 V, 2) of both hemispheres, and their rows of the corners."""
    x, y, z = SURFACE.vertices.T
    upper, lower = (
        0.5 + 0.38 * np.column_stack([side * x, y]) / np.maximum(1 + side * z, 0.5)[:, None]
        for side in (1, -1)
    )
    rows = SURFACE.faces + np.where(UPPER, 0, len(upper))[:, None]
    return np.concatenate([upper, lower]).astype(np.float32).astype(float), rows


def obj_text(tiles: bool, materials: tuple[str, str] = ("skin", "skin")) -> str:
    uv, rows = hemispheres()
    uv[len(uv) // 2 :, 0] += tiles
    lines = [f"v {x!r} {y!r} {z!r}" for x, y, z in SURFACE.vertices.tolist()]
    lines += [f"vt {u!r} {v!r}" for u, v in uv.tolist()]
    for face, row, upper in zip(SURFACE.faces + 1, rows + 1, UPPER, strict=True):
        lines += [f"usemtl {materials[not upper]}"]
        lines += ["f " + " ".join(f"{v}/{t}" for v, t in zip(face, row, strict=True))]
    return "\n".join(lines) + "\n"


def glb_bytes() -> bytes:
    """The hemispheres as two primitives with materials of their own."""
    uv, rows = hemispheres()
    buffer, primitives, half = BinaryBuffer(), [], len(uv) // 2
    for number, chosen in enumerate((UPPER, ~UPPER)):
        used, faces = np.unique(rows[chosen], return_inverse=True)
        downwards = np.column_stack([uv[used, 0], 1 - uv[used, 1]])
        attributes = {
            "POSITION": buffer.attribute(SURFACE.vertices[used % half], bounded=True),
            "TEXCOORD_0": buffer.attribute(downwards),
        }
        indices = buffer.indices(faces.reshape(-1, 3))
        primitives.append({"attributes": attributes, "indices": indices, "material": number})
    content = {"asset": {"version": "2.0"}, "scene": 0, "scenes": [{"nodes": [0]}], "nodes": [{"mesh": 0}]}
    content |= {"meshes": [{"primitives": primitives}], "materials": [{"name": "top"}, {"name": "Bottom/2"}]}
    return packed(content, buffer)


FILES = {
    "tiles.obj": lambda: obj_text(tiles=True).encode(),
    "materials.obj": lambda: obj_text(tiles=False, materials=("top half", "bottom")).encode(),
    "materials.glb": glb_bytes,
}


@pytest.fixture(scope="module")
def texture(tmp_path_factory, make_job):
    """``texture(file)``: the model of the ball, given as that file; each is made once."""
    views, made = write_views(tmp_path_factory.mktemp("views"), cameras()), {}

    def of(name: str, data: bytes, how: TextureSettings | None = None):
        if name not in made:
            folder = tmp_path_factory.mktemp("model")
            (folder / name).write_bytes(data)
            adopt = make_job(folder / "adopt", ADOPT_MESH, None, mesh_file=folder / name)
            ADOPT_MESH.run(adopt)
            inputs = views | {"mesh": adopt.outputs["mesh"], "mesh_file": folder / name}
            made[name] = make_job(folder / "out", TEXTURE, how, **inputs)
            TEXTURE.run(made[name])
        return made[name]

    return of


def shown_by(model: Path, camera: Camera) -> tuple[np.ndarray, np.ndarray]:
    """What a GLB shows a camera, as trimesh reads it: sRGB of the pixels that hit it, and their truth."""
    scene = trimesh.load_scene(model, process=False)
    parts = list(scene.geometry.values())
    starts = np.cumsum([0, *(len(part.vertices) for part in parts)])
    faces = np.concatenate([part.faces + start for part, start in zip(parts, starts[:-1], strict=True)])
    vertices = np.concatenate([part.vertices for part in parts]) @ TO_Y_UP
    seen = RayCaster(Surface(vertices, faces.astype(np.int32))).see(camera, threads=1)
    hit = seen.triangles != NO_TRIANGLE
    u, v = seen.barycentric[hit].T
    corners = np.concatenate([part.visual.uv for part in parts])[faces[seen.triangles[hit]]]
    place = np.einsum("nk,nkc->nc", np.column_stack([1 - u - v, u, v]), corners)
    of = np.repeat(np.arange(len(parts)), [len(part.faces) for part in parts])[seen.triangles[hit]]
    shown = np.zeros((len(place), 3))
    for number, part in enumerate(parts):
        image = np.asarray(part.visual.material.baseColorTexture).astype(float) / 255
        at = np.clip(np.column_stack([1 - place[:, 1], place[:, 0]]) * len(image), 0, len(image) - 1)
        row, column = at[of == number].astype(int).T
        shown[of == number] = image[row, column]
    return shown, srgb_from_linear(paint(back_project(camera, seen.depth)[hit]))


@pytest.mark.parametrize("name", FILES)
def test_the_model_shows_the_paint_and_agrees_with_charts_of_our_own(texture, name):
    camera = cameras(5, 200)[1]
    given = texture(name, FILES[name]())
    shown, truth = shown_by(given.outputs["textured_model"] / "model.glb", camera)
    assert -20 * np.log10(np.sqrt(np.mean((shown - truth) ** 2))) > 34
    own = texture(f"own {name}", FILES[name](), TextureSettings(given_uv={"keep": False}))
    other, same = shown_by(own.outputs["textured_model"] / "model.glb", camera)
    assert abs(len(other) - len(shown)) < 10 and own.facts["charts"] == "own"
    assert -20 * np.log10(np.sqrt(np.mean((other - same) ** 2))) > 34
    assert given.facts["charts"] == "given" and given.facts["textures"] == 2 and not given.warnings
    assert given.facts["seen"] > 0.9 and given.facts["shared"] == 0


@pytest.mark.parametrize("name", FILES)
def test_an_obj_comes_back_with_its_faces_and_texture_coordinates_to_the_bit(texture, name):
    folder = texture(name, FILES[name]()).outputs["textured_model"]
    (folder / name).with_name(f"given.{name[-3:]}").write_bytes(FILES[name]())
    (before, uv_before), (after, uv_after) = (
        read_uv_map(path) for path in (folder / f"given.{name[-3:]}", folder / "model.obj")
    )
    np.testing.assert_array_equal(after.sizes, before.sizes)
    places = [polygons.vertices[polygons.corners] for polygons in (before, after)]
    assert places[0].tobytes() == places[1].tobytes()
    upwards = [one.with_v(upwards=True)[one.corners].astype(np.float32) for one in (uv_before, uv_after)]
    assert upwards[0].tobytes() == upwards[1].tobytes()
    np.testing.assert_array_equal(uv_after.material, uv_before.material if "tiles" not in name else ~UPPER)


def test_a_glb_comes_back_with_its_texture_coordinates_to_the_bit(texture):
    folder = texture("materials.glb", glb_bytes()).outputs["textured_model"]
    before, after = glb_bytes(), (folder / "model.glb").read_bytes()
    for number in range(2):
        np.testing.assert_array_equal(
            values(before, number, "TEXCOORD_0", 2), values(after, number, "TEXCOORD_0", 2)
        )
        np.testing.assert_array_equal(values(before, number, None, 3), values(after, number, None, 3))
    assert [one["name"] for one in content_of(after)["materials"]] == ["top", "Bottom/2"]
    assert (folder / "albedo.Bottom_2.png").is_file()


def content_of(glb: bytes) -> dict:
    return json.loads(glb[20 : 20 + int.from_bytes(glb[12:16], "little")])


def values(glb: bytes, primitive: int, name: str | None, width: int) -> np.ndarray:
    """An attribute of a primitive as its file has it, or its indices."""
    content = content_of(glb)
    chosen = content["meshes"][0]["primitives"][primitive]
    view = content["bufferViews"][
        content["accessors"][chosen["attributes"][name] if name else chosen["indices"]]["bufferView"]
    ]
    start = 28 + int.from_bytes(glb[12:16], "little") + view["byteOffset"]
    return np.frombuffer(glb[start : start + view["byteLength"]], "<f4" if name else "<u4").reshape(-1, width)


def test_udim_tiles_have_files_and_materials_of_their_own_and_lie_in_the_unit_square_of_a_glb(texture):
    folder = texture("tiles.obj", FILES["tiles.obj"]()).outputs["textured_model"]
    for kind in ("albedo.{}.exr", "albedo.{}.png", "normal.{}.png", "shading.{}.exr", "confidence.{}.exr"):
        assert all((folder / kind.format(tile)).is_file() for tile in (1001, 1002))
    assert all(read_exr(folder / f"confidence.{tile}.exr").max() > 0.9 for tile in (1001, 1002))
    data = (folder / "model.glb").read_bytes()
    for number in range(2):
        uv = values(data, number, "TEXCOORD_0", 2)
        assert uv.min() >= 0 and uv.max() <= 1
    assert [one["name"] for one in content_of(data)["materials"]] == ["skin.1001", "skin.1002"]
    mtl = (folder / "model.mtl").read_text()
    assert re.findall(r"newmtl (\S+)", mtl) == ["skin.1001", "skin.1002"]
    assert re.findall(r"map_Kd (\S+)", mtl) == ["albedo.1001.png", "albedo.1002.png"]


SQUARE = np.array([[0.0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0]])
WHOLE = np.array([[0.0, 0], [1, 0], [1, 1], [0, 1]])


def of_quads(*uv_of_quads: np.ndarray, materials: tuple[str, ...] = ("wood",), most: int = 100):
    """Quads side by side, v upwards, one after another of the materials."""
    count = len(uv_of_quads)
    places = np.concatenate([SQUARE + [number, 0, 0] for number in range(count)])
    polygons = Polygons(places, np.full(count, 4), np.arange(4 * count))
    material = np.arange(count) % len(materials)
    uv_map = UVMap(np.concatenate(uv_of_quads), np.arange(4 * count), material, materials, v_upwards=True)
    faces = np.arange(4 * count).reshape(-1, 4)[:, [0, 1, 2, 0, 2, 3]].reshape(-1, 3)
    return given_charts(
        Surface(places, faces.astype(np.int32)), polygons, uv_map, GivenUVSettings(most_textures=most)
    )


def test_tiles_are_numbered_by_columns_of_ten_and_a_border_is_of_the_tile_that_it_ends():
    given = of_quads(WHOLE, WHOLE + [9, 0], WHOLE + [0, 1], WHOLE + [3, 2], 0 * WHOLE + [1, 0.5])
    assert [chart.tile for chart in given.charts] == [1001, 1010, 1011, 1024]
    np.testing.assert_array_equal(given.charts[0].faces, [0, 1, 8, 9])
    for chart in given.charts[:4]:
        uv = given.mesh.uv[given.mesh.faces[chart.faces[:2]]]
        np.testing.assert_array_equal(uv.min(axis=(0, 1)), [0, 0])
        np.testing.assert_array_equal(uv.max(axis=(0, 1)), [1, 1])


@pytest.mark.parametrize("shift", [[-1.0, 0], [0.5, 0], [12, 0]])
def test_what_is_no_udim_tile_repeats_the_texture(shift):
    given = of_quads(WHOLE + shift)
    assert [chart.tile for chart in given.charts] == [1001]
    texels = texels_of(given.mesh, 8)
    assert texels.covered == 64 and texels.overlap() == 0
    uv = texels.interpolated(given.mesh, given.mesh.uv) * 8 - 0.5
    np.testing.assert_allclose(uv[:, 0] % 8, texels.place % 8, atol=1e-4)


def test_a_pattern_that_repeats_over_a_wall_is_refused_and_so_are_many_textures():
    with pytest.raises(UserError, match="'wood' cover their texture 100 times; expected at most 8"):
        of_quads(10 * WHOLE)
    with pytest.raises(UserError, match="'wood' cover their texture 12 times"):
        of_quads(WHOLE * [12, 0.1])
    with pytest.raises(UserError, match="'wood' cover their texture 9 times"):
        of_quads(*[WHOLE] * 9)
    with pytest.raises(UserError, match="has 3 textures, by material and UDIM tile; expected at most 2"):
        of_quads(WHOLE, WHOLE, WHOLE + [1, 0], materials=("wood", "iron"), most=2)


def test_texels_of_faces_on_one_another_take_the_mean_of_what_is_seen():
    given = of_quads(WHOLE, WHOLE)
    texels = texels_of(given.mesh, 8)
    assert texels.overlap() > 0.8 and texels.covered == 64
    first = (texels.face < 2).astype(np.float32)
    for weight, mean in ((1 + 0 * first, 0.5), (first, 1.0), (0 * first, 0.5)):
        alone, (found,) = texels.means(weight, [first[:, None]])
        assert len(alone) == 64
        np.testing.assert_allclose(found, mean)


def test_tangents_of_mirrored_charts_follow_their_own_u():
    """Two halves on one image share an edge in it: there, vertices are parted, and both keep a tangent."""
    mirrored = WHOLE * [-1, 1] + [1, 0]
    given = of_quads(WHOLE, mirrored)
    tangents = tangents_of(given.mesh)
    for quad, sign in ((0, 1), (1, -1)):
        corners = given.mesh.faces[2 * quad : 2 * quad + 2]
        np.testing.assert_allclose(tangents[corners][..., 0], sign, atol=1e-6)
        assert len(np.unique(tangents[corners][..., 3])) == 1


def test_names_of_files_are_told_apart_on_every_disk():
    charts = [
        Chart(name, tile, np.arange(1)) for name in ("Wood", "wood", "../x", "") for tile in (1001, 1003)
    ]
    labels = [label for _, label in names_of(charts)]
    assert labels[:4] == ["Wood.1001", "Wood.1003", "wood_2.1001", "wood_2.1003"]
    assert len({label.lower() for label in labels}) == 8
    assert not any("/" in label or label.startswith(".") for label in labels)
    assert [name for name, _ in names_of(charts[:1])] == ["Wood"]
    assert names_of(charts[:1])[0][1] == ""


def test_a_face_without_area_keeps_its_place(tmp_path, make_job):
    """Merging the corners of an OBJ drops such faces from the surface; the model has them still."""
    text = obj_text(tiles=False, materials=("a", "a")).replace("usemtl a\n", "")
    lines = text.splitlines()
    first = next(number for number, line in enumerate(lines) if line.startswith("f "))
    lines.insert(first + 5, "f 1/1 1/2 2/2")
    lines += ["v 2 0 0", "v 2 0 0", "f -1/1 -2/2 -1/2"]
    (tmp_path / "a.obj").write_text("\n".join(lines))
    job = make_job(tmp_path / "adopt", ADOPT_MESH, None, mesh_file=tmp_path / "a.obj")
    ADOPT_MESH.run(job)
    surface = read_mesh(job.outputs["mesh"])
    given = given_charts(surface, *read_uv_map(tmp_path / "a.obj"), GivenUVSettings())
    assert len(given.mesh.faces) == len(SURFACE.faces) + 2 == len(surface.faces) + 2
    np.testing.assert_allclose(np.linalg.norm(given.mesh.normals, axis=1), 1)
    np.testing.assert_allclose(np.linalg.norm(tangents_of(given.mesh)[:, :3], axis=1), 1)
    np.testing.assert_array_equal(given.mesh.vertices[given.mesh.faces[5]], SURFACE.vertices[[0, 0, 1]])
