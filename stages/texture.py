"""A textured model: albedo, shading and confidence of the views in one atlas, as GLB and OBJ."""

from __future__ import annotations

import json
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

from pipeline import Artefact, Job, Stage
from stages.scene.distributions import OPEN3D, PICTURES
from stages.texturing.settings import TextureSettings

if TYPE_CHECKING:
    import numpy as np

    from stages.scene.cameras import Camera
    from stages.texturing.gathering import ViewMaps
    from stages.texturing.texels import Texels
    from stages.texturing.unwrapping import ChartedMesh

PARTS = 16  # of an atlas that are encoded one after another: bounds the memory
BASE_COLOUR, NORMALS = "albedo.png", "normal.png"


@dataclass(frozen=True, eq=False)
class Atlas:
    """Values of texels, (T, …), and the mesh that they are of.

    Attributes
    ----------
    mesh : ChartedMesh
    texels : Texels
    seen : ndarray, shape (T,), bool
        Shown by a view.
    albedo, shading : ndarray, shape (T, 3), float32
        Linear.
    normals : ndarray, shape (T, 3), float32
        World axes; zeros where unseen.
    confidence : ndarray, shape (T,), float32
        0 where unseen.
    """

    mesh: ChartedMesh
    texels: Texels
    seen: np.ndarray
    albedo: np.ndarray
    shading: np.ndarray
    normals: np.ndarray
    confidence: np.ndarray


def run(job: Job[TextureSettings]) -> None:
    """Unwrap the mesh, gather what the views show, complete it, write the model."""
    from stages.formats.artefacts.camera_file import read_cameras
    from stages.formats.meshes.triangle_meshes import read_mesh
    from stages.scene.upright import gltf_from_world
    from stages.solvers.kernels.threading_layer import use_threads
    from stages.texturing.texels import side_of_atlas, texels_of
    from stages.texturing.unwrapping import unwrapped, within_budget

    use_threads(job.threads)
    how, cameras = job.settings, read_cameras(job.inputs["cameras"])
    with job.progress("texture", 2 * len(cameras) + 3) as step:
        surface = within_budget(read_mesh(job.inputs["mesh"]), how.charts)
        side = side_of_atlas(surface, [_as_large_as_its_albedo(job.inputs, c) for c in cameras], how.charts)
        mesh = unwrapped(surface, side, how.charts)
        step()
        texels = texels_of(mesh, side, job.threads)
        step()
        atlas = _gathered(job, mesh, texels, cameras, step)
        _write(job, atlas, gltf_from_world(cameras, how.upright_within_deg))
        step()
    job.note(
        faces=len(mesh.faces),
        side_px=side,
        used=round(len(texels) / side**2, 3),
        seen=round(float(atlas.seen.mean()), 4),
    )


def _gathered(
    job: Job[TextureSettings],
    mesh: ChartedMesh,
    texels: Texels,
    cameras: list[Camera],
    step: Callable[[], None],
) -> Atlas:
    """Average over the views in two passes, the second robust; complete what none shows."""
    import numpy as np

    from stages.scene.cameras import smallest_footprints
    from stages.texturing.completion import completed
    from stages.texturing.gathering import CONFIDENCE, MAPS, NORMAL, SHADING, Sums, gather

    how = job.settings
    origin = mesh.vertices.mean(axis=0)
    points = texels.interpolated(mesh, mesh.vertices - origin)
    normals = texels.interpolated(mesh, mesh.normals)
    footprints = smallest_footprints(mesh.vertices, cameras)
    typical = float(np.median(footprints[np.isfinite(footprints)]))
    reference, bright = np.zeros((0, 3), np.float32), 1.0
    for robust in (False, True):
        sums = Sums.none(len(texels), MAPS if robust else 0)
        for view in _views(job.inputs, cameras, how):
            gather(points, normals, view, reference, (typical, bright), origin, how.gathering, sums)
            step()
        albedo, further = sums.means()
        if robust:
            albedo = np.where(sums.weight[:, None] > 0, albedo, reference)  # no two views agree
        else:
            reference, seen = albedo, sums.weight > 0
            bright = float(np.quantile(albedo[seen], how.gathering.bright_quantile)) if seen.any() else 1.0
    return Atlas(
        mesh,
        texels,
        seen,
        completed(texels, mesh, albedo, seen, how.completion),
        completed(texels, mesh, further[:, SHADING], seen, how.completion),
        further[:, NORMAL].copy(),  # without the rest
        further[:, CONFIDENCE].copy(),
    )


def _views(inputs: Mapping[str, Path], cameras: list[Camera], how: TextureSettings) -> Iterator[ViewMaps]:
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


def _write(job: Job[TextureSettings], atlas: Atlas, gltf_from_world: np.ndarray) -> None:
    """Write textures, GLB and OBJ."""
    import numpy as np

    from stages.formats.artefacts.light_npz import read_light
    from stages.formats.images.exr import write_exr
    from stages.formats.images.photos import encode_srgb8, write_png8
    from stages.formats.meshes.textured_models import TexturedModel, write_glb, write_obj
    from stages.texturing.completion import Gutters
    from stages.texturing.normal_map import tangent_space, tangents_of

    folder, texels, mesh = job.outputs["textured_model"], atlas.texels, atlas.mesh
    gutters = Gutters(texels.image(np.ones(len(texels), bool), False))
    white = json.loads(job.inputs["scales"].read_text(encoding="utf-8"))["png_white"]["albedo"]
    write_exr(folder / "albedo.exr", gutters.fill(texels.image(atlas.albedo)))
    write_exr(folder / "shading.exr", gutters.fill(texels.image(atlas.shading)))
    write_exr(folder / "confidence.exr", texels.image(atlas.confidence))
    parts = np.array_split(atlas.albedo, PARTS)
    base_colour = gutters.fill(texels.image(np.concatenate([encode_srgb8(part / white) for part in parts])))
    write_png8(folder / BASE_COLOUR, base_colour)
    tangents = tangents_of(mesh)
    directions = tangent_space(texels, mesh, tangents, atlas.normals)
    normal_map = gutters.fill(texels.image(np.rint(127.5 * (directions + 1)).astype(np.uint8)))
    write_png8(folder / NORMALS, normal_map)
    roughness = read_light(job.inputs["found_light"]).specular_roughness if "found_light" in job.inputs else 0
    model = TexturedModel(
        mesh.vertices,
        mesh.normals,
        tangents,
        mesh.faces,
        mesh.uv,
        base_colour,
        normal_map,
        float(np.sqrt(roughness)) if roughness else 1.0,
    )
    write_glb(folder / "model.glb", model, gltf_from_world)
    write_obj(folder / "model.obj", model, BASE_COLOUR, NORMALS)


TEXTURE = Stage(
    name="texture",
    version=1,
    about="A textured model: mesh, atlas of the albedo, GLB and OBJ.",
    settings=TextureSettings,
    takes=("mesh", "cameras", "mask", "depth", "normal", "albedo", "shading", "scales"),
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
        "trimesh",
        "xatlas",
        "fast-simplification",
        *OPEN3D,
        *PICTURES,
    ),
    saves_memory="lower texture.charts.most_px",
)
FINER = ("confidence", "found_light", "albedo_full")  # what it takes besides, where a dataflow has it
