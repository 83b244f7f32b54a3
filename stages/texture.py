"""A textured model: albedo, shading and confidence of the views in textures, as GLB and OBJ."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from dataclasses import fields
from pathlib import Path
from typing import TYPE_CHECKING, Any

from pipeline import Artefact, Job, Stage
from stages.scene.distributions import OPEN3D, PICTURES
from stages.texturing.settings import TextureSettings

if TYPE_CHECKING:
    import numpy as np

    from stages.formats.meshes.textured_models import Texture
    from stages.scene.cameras import Camera
    from stages.texturing.gathering import Gathered, ViewMaps
    from stages.texturing.sheets import Charted, Sheet
    from stages.texturing.texels import Texels
    from stages.texturing.unwrapping import ChartedMesh

PARTS = 16  # of a texture that are encoded one after another: bounds the memory


def run(job: Job[TextureSettings]) -> None:
    """Chart the mesh, gather what the views show of each sheet, complete it, write the model."""
    from stages.formats.artefacts.array_store import ArrayStore
    from stages.formats.artefacts.camera_file import read_cameras
    from stages.solvers.kernels.threading_layer import use_threads
    from stages.texturing.completion import SurfaceMeans
    from stages.texturing.gathering import Gathered
    from stages.texturing.texels import texels_of

    use_threads(job.threads)
    cameras = read_cameras(job.inputs["cameras"])
    charted = _charted(job, cameras)
    sheets = charted.sheets
    held = {field.name: ArrayStore(job.scratch / field.name) for field in fields(Gathered)}
    means, counts = SurfaceMeans(charted.mesh), []
    with job.progress("texture", len(sheets) * (2 * len(cameras) + 1)) as step:
        for number, sheet in enumerate(sheets):
            texels = texels_of(sheet.part, sheet.side)
            seen = _gathered(job, sheet, texels, cameras, step)
            means.add(texels, sheet.part, seen.colours, seen.weight > 0)
            counts.append((len(texels), int((seen.weight > 0).sum()), texels.covered, texels.overlap()))
            for name, store in held.items():
                store[number] = getattr(seen, name)
        at_vertices, textures = means.spread(job.settings.completion), []
        for number, sheet in enumerate(sheets):
            seen = Gathered(**{name: store.pop(number) for name, store in held.items()})
            textures.append(_textured(job, charted.mesh, sheet, seen, at_vertices))
            step()
    _write_models(job, charted, tuple(textures), cameras)
    _tell(job, charted, counts)


def _charted(job: Job[TextureSettings], cameras: list[Camera]) -> Charted:
    """Take the charts that the mesh was given with, or unwrap it within its budget of faces."""
    from pipeline.process.free_memory import give_back_free_memory
    from stages.formats.meshes.mesh_files import read_uv_map
    from stages.formats.meshes.triangle_meshes import read_mesh
    from stages.texturing.given_charts import given_charts
    from stages.texturing.sheets import (
        Charted,
        obj_of_own_charts,
        sheet_of_own_charts,
        sheets_of_given_charts,
    )
    from stages.texturing.texels import side_of_atlas, side_of_charts
    from stages.texturing.unwrapping import unwrapped, within_budget

    how, surface = job.settings, read_mesh(job.inputs["mesh"])
    views = [_as_large_as_its_albedo(job.inputs, camera) for camera in cameras]
    wanted = "mesh_file" in job.inputs and how.given_uv.keep
    uv_map = read_uv_map(job.inputs["mesh_file"]) if wanted else None
    if uv_map is not None:
        given = given_charts(surface, *uv_map, how.given_uv)
        sheets = sheets_of_given_charts(given, views, how.charts)
        return Charted(given.mesh, sheets, given.obj, given=True)
    surface = within_budget(surface, how.charts)
    give_back_free_memory()  # of the decimation: the texture is elsewhere
    side = side_of_atlas(surface, views, how.charts)
    mesh = unwrapped(surface, side, how.charts)
    if (finer := side_of_charts(mesh, views, how.charts)) > side:  # small charts waste much of a small atlas
        side, mesh = finer, unwrapped(surface, finer, how.charts)
    return Charted(mesh, [sheet_of_own_charts(mesh, side)], obj_of_own_charts(mesh), given=False)


def _gathered(
    job: Job[TextureSettings], sheet: Sheet, texels: Texels, cameras: list[Camera], step: Callable[[], None]
) -> Gathered:
    """Average over the views in two passes, the second robust."""
    from stages.texturing.gathering import gathered, typical_footprint

    how, mesh = job.settings, sheet.part
    origin = mesh.vertices.mean(axis=0)
    return gathered(
        texels.interpolated(mesh, mesh.vertices - origin),
        texels.interpolated(mesh, mesh.normals),
        origin,
        typical_footprint(mesh.vertices, cameras),
        lambda: views_of(job.inputs, cameras, how),
        how.gathering,
        step,
    )


def views_of(inputs: Mapping[str, Path], cameras: list[Camera], how: TextureSettings) -> Iterator[ViewMaps]:
    """Open the views, one after another."""
    import numpy as np

    from stages.formats.images.exr import read_exr
    from stages.formats.images.photos import read_mask
    from stages.texturing.gathering import ViewMaps, weight_of

    for camera in cameras:
        mask = read_mask(inputs["mask"] / f"{camera.name}.png")
        depth, normal, shading = (
            read_exr(inputs[kind] / f"{camera.name}.exr") for kind in ("depth", "normal", "shading")
        )
        known = np.ones(mask.shape, np.float32)
        if "confidence" in inputs:
            known = read_exr(inputs["confidence"] / f"{camera.name}.exr")
        yield ViewMaps(
            camera,
            depth,
            weight_of(camera, mask, depth, known, how.gathering),
            np.concatenate([shading, normal, known[..., None]], axis=2),
            read_exr(_albedo_of(inputs, camera)),
        )


def _albedo_of(inputs: Mapping[str, Path], camera: Camera) -> Path:
    """Name the finest albedo of a view that there is."""
    return inputs["albedo_full" if "albedo_full" in inputs else "albedo"] / f"{camera.name}.exr"


def _as_large_as_its_albedo(inputs: Mapping[str, Path], camera: Camera) -> Camera:
    from stages.formats.images.exr import check_exr_header

    return camera.scaled(*check_exr_header(_albedo_of(inputs, camera)))


def _textured(
    job: Job[TextureSettings], mesh: ChartedMesh, sheet: Sheet, seen: Gathered, at_vertices: np.ndarray
) -> Texture:
    """Complete a sheet, and write its images."""
    import numpy as np

    from stages.formats.artefacts.png_scale import png_whites
    from stages.formats.images.exr import write_exr
    from stages.formats.images.photos import encode_srgb8, write_png8
    from stages.formats.meshes.textured_models import Texture
    from stages.texturing.completion import Gutters, completed
    from stages.texturing.normal_map import coded, tangent_space, tangents_of
    from stages.texturing.texels import texels_of

    texels, folder = texels_of(sheet.part, sheet.side), job.outputs["textured_model"]
    colours = completed(texels, sheet.part, seen.colours, seen.weight > 0, at_vertices)
    directions = tangent_space(texels, sheet.part, tangents_of(mesh), seen.normals)
    texels, (colours, confidence, directions) = texels.means(
        seen.weight, [colours, seen.confidence, directions]
    )
    gutters = Gutters(texels.image(np.ones(len(texels), bool), False))
    write_exr(folder / sheet.file("albedo", "exr"), gutters.fill(texels.image(colours[:, :3])))
    write_exr(folder / sheet.file("shading", "exr"), gutters.fill(texels.image(colours[:, 3:])))
    write_exr(folder / sheet.file("confidence", "exr"), texels.image(confidence[:, 0]))
    white = png_whites(job.inputs["scales"])["albedo"]
    codes = np.concatenate([encode_srgb8(part / white) for part in np.array_split(colours[:, :3], PARTS)])
    base_colour, normal_map = (folder / sheet.file(kind, "png") for kind in ("albedo", "normal"))
    write_png8(base_colour, gutters.fill(texels.image(codes)))
    write_png8(normal_map, gutters.fill(texels.image(coded(directions))))
    return Texture(sheet.material, sheet.faces, base_colour, normal_map)


def _write_models(
    job: Job[TextureSettings], charted: Charted, textures: tuple[Texture, ...], cameras: list[Camera]
) -> None:
    """Write GLB and OBJ, which show the textures."""
    import numpy as np

    from stages.formats.artefacts.light_npz import read_light
    from stages.formats.meshes.textured_models import TexturedModel, write_glb, write_obj
    from stages.scene.upright import gltf_from_world
    from stages.texturing.normal_map import tangents_of

    folder, mesh = job.outputs["textured_model"], charted.mesh
    roughness = read_light(job.inputs["found_light"]).specular_roughness if "found_light" in job.inputs else 0
    model = TexturedModel(
        mesh.vertices,
        mesh.normals,
        tangents_of(mesh),
        mesh.faces,
        mesh.uv,
        textures,
        float(np.sqrt(roughness)) if roughness else 1.0,
    )
    write_glb(folder / "model.glb", model, gltf_from_world(cameras, job.settings.upright_within_deg))
    write_obj(folder / "model.obj", charted.obj, textures)


def _tell(job: Job[TextureSettings], charted: Charted, counts: list[tuple[int, int, int, float]]) -> None:
    """Record what was textured, and how much of it is seen; warn where a given layout has no room for it.

    `counts`: of each sheet, places on faces, those of them that are seen, texels, and the share of texels
    that faces share.
    """
    from stages.texturing.texels import areas_in_texture

    places, seen, used = (sum(count[k] for count in counts) for k in range(3))
    shared = max(count[3] for count in counts)
    job.note(
        faces=len(charted.mesh.faces),
        charts="given" if charted.given else "own",
        textures=len(counts),
        side_px=max(sheet.side for sheet in charted.sheets),
        used=round(used / sum(sheet.side**2 for sheet in charted.sheets), 3),
        seen=round(seen / max(places, 1), 4),
    )
    if not seen:
        job.warn(
            "No view shows the front of the surface: the textures are empty. Is the mesh inside out? See "
            "what `raycast` says of it."
        )
    if not charted.given:
        return
    flat = int((areas_in_texture(charted.mesh.uv[charted.mesh.faces]) == 0).sum())
    job.note(shared=round(shared, 4), faces_without_texels=flat)
    if shared > job.settings.given_uv.shared_share:
        job.warn(
            f"Faces overlap in the texture coordinates of the mesh: up to {shared:.0%} of the texels of a "
            "texture belong to several faces, and show the mean of what views show of them. Where these "
            "differ, unwrap the mesh without overlap, or set texture.given_uv.keep=false."
        )
    if flat:
        job.warn(
            f"{flat} of {len(charted.mesh.faces)} faces have no area in the texture coordinates of the mesh: "
            "nothing can be shown on them but the colour of a point or a line."
        )


def in_words(facts: Mapping[str, Any]) -> str:
    """Tell in a few words what was found."""
    number = facts["textures"]
    textures = "a texture" if number == 1 else f"{number} textures"
    return f"{textures} of {facts['side_px']} px, {facts['seen']:.0%} of the surface seen"


TEXTURE = Stage(
    name="texture",
    version=6,
    about="A textured model, GLB and OBJ; on the texture coordinates of a given mesh where it has them.",
    settings=TextureSettings,
    takes=("mesh", "cameras", "mask", "depth", "normal", "albedo", "shading", "scales"),
    may_take=("mesh_file",),
    gives=(
        Artefact(
            "textured_model",
            "GLB, OBJ; albedo, shading, confidence (EXR, linear), albedo and normals (PNG)",
            output="model",
        ),
    ),
    run=run,
    tools=(
        "numpy",
        "scipy",
        "numba",
        "xatlas",
        "fast-simplification",
        *OPEN3D,
        *PICTURES,
    ),
    saves_memory="lower texture.charts.most_px",
    found=in_words,
)
FINER = ("confidence", "found_light", "albedo_full")  # what it takes besides, where a dataflow has it
