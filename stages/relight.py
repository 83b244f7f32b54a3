"""Relighting of the views under another light: albedo × shading, with shadows and interreflection."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from typing import TYPE_CHECKING, Annotated, Any

from pydantic import Field

from pipeline import Artefact, Job, Settings, Stage, group, setting
from stages.photometry.transport.settings import EnvironmentMapSettings, ReflectanceScaleSettings
from stages.scene.distributions import OPEN3D, PICTURES
from stages.scene.memory_of_views import FEWER_PIXELS
from stages.scene.upright_settings import UPRIGHT_WITHIN_DEG

if TYPE_CHECKING:
    import numpy as np

Azimuth = Annotated[float, Field(ge=-360, le=360)]
Elevation = Annotated[float, Field(ge=1, le=90)]


class RelightSettings(Settings):
    """Settings of the `relight` stage."""

    sun: tuple[Azimuth, Elevation] | None = setting(
        None,
        "A clear sky with its sun at this azimuth and elevation, instead of an environment map. Azimuth 0 is "
        "the middle of an environment map; it grows counter-clockwise seen from above, as `turn_deg` does.",
        unit="°",
    )
    turn_deg: float = setting(
        0.0, "Yaw of the light (rotation about the vertical), counter-clockwise seen from above.", unit="°"
    )
    bounces: int = setting(4, "Number of interreflections between surfaces.", ge=0, le=100)
    brightest: float | None = setting(
        None,
        "Reflectance of the brightest material; it sets the scale of interreflection. none: that of a "
        "calibrated albedo, or the estimate of the stage `lighting`; without either, "
        "`reflectance_scale.usual_brightest`.",
        gt=0,
        le=0.95,
    )
    upright_within_deg: float = UPRIGHT_WITHIN_DEG
    reflectance_scale: ReflectanceScaleSettings = group(
        ReflectanceScaleSettings,
        "The absolute scale of an albedo known up to a factor; it sets the scale of interreflection.",
    )
    environment_map: EnvironmentMapSettings = group(
        EnvironmentMapSettings, "The environment map that the light is given as."
    )


def run(job: Job[RelightSettings]) -> None:
    """Read surface, albedo and light; shade; save. Memory: some 150 B per masked pixel."""
    import numpy as np

    from stages.formats.artefacts.camera_file import read_cameras
    from stages.formats.artefacts.surface_light_npz import StoredSurfaceLight, write_surface_light
    from stages.formats.artefacts.transfer_file import read_transfer
    from stages.formats.artefacts.view_files import read_maps, read_surface_points, write_maps, write_previews
    from stages.formats.images.photos import read_mask
    from stages.formats.meshes.triangle_meshes import read_mesh
    from stages.geometry.vertex_interpolation import pixels_on_proxy
    from stages.photometry.transport.environment import turned_light
    from stages.photometry.transport.lit_scenes import scenes_by_distance
    from stages.photometry.transport.pixel_transfer import Bounces
    from stages.photometry.transport.relighting import light_at, relit_points
    from stages.scene.upright import upright_from_world
    from stages.solvers.kernels.threading_layer import use_threads

    settings = job.settings
    picture = _picture(job)  # first: an invalid light is refused at once
    cameras = read_cameras(job.inputs["cameras"])
    masks = [read_mask(job.inputs["mask"] / f"{camera.name}.png") for camera in cameras]
    normals, albedo = (read_maps(job.inputs[kind], cameras, masks) for kind in ("normal", "albedo"))
    stored = read_transfer(job.inputs["transfer"])
    points = read_surface_points(job.inputs, cameras, masks)
    blend = pixels_on_proxy(stored, read_mesh(job.inputs["mesh"]), points)
    # visibility of light from infinity alone
    far = replace(stored, radii=stored.radii[:1], visible=stored.visible[:1])
    (scene,), opposed = scenes_by_distance(far, blend, normals)
    use_threads(job.threads)
    upright = upright_from_world(cameras, settings.upright_within_deg)
    light = turned_light(
        picture, settings.turn_deg, upright, scene.pixels.directions, settings.environment_map
    )
    bounces = Bounces(
        settings.bounces, _brightest(job, albedo), settings.reflectance_scale.brightest_quantile
    )
    lit_by = light_at(scene, albedo, light, bounces)
    radiance, shading = relit_points(scene.pixels, albedo, lit_by)
    write_maps(job.outputs["relit"], cameras, masks, radiance)
    white = write_previews(job.outputs["relit"], cameras, masks, radiance)
    write_surface_light(
        job.outputs["surface_light"],
        StoredSurfaceLight(lit_by.sky, lit_by.indirect, lit_by.to_absolute, white),
    )
    job.note(opposed_pixels=opposed, mean_shading=np.round(shading.mean(axis=0, dtype=float), 6).tolist())


def _picture(job: Job[RelightSettings]) -> np.ndarray:
    """Read the environment map that was given, or make that of a clear sky."""
    from stages.formats.images.photos import read_environment
    from stages.synthetic.lights import ClearSky, clear_sky_picture

    if job.settings.sun is None:
        return read_environment(job.inputs["light"])
    azimuth_deg, elevation_deg = job.settings.sun
    sky = ClearSky(sun_azimuth_deg=azimuth_deg, sun_elevation_deg=elevation_deg)
    return clear_sky_picture(sky, job.settings.environment_map.max_rows).radiance


def _brightest(job: Job[RelightSettings], albedo: np.ndarray) -> float:
    """Choose the brightest material's reflectance: given, calibrated, estimated with the light, or usual."""
    import numpy as np

    from stages.formats.artefacts.light_npz import read_light

    asked: float | None = job.settings.brightest
    if asked is None and "calibration" in job.inputs and albedo.size:
        asked = float(np.quantile(albedo, job.settings.reflectance_scale.brightest_quantile))
    if asked is None and "found_light" in job.inputs:
        asked = read_light(job.inputs["found_light"]).brightest
    return asked or job.settings.reflectance_scale.usual_brightest


def in_words(facts: Mapping[str, Any]) -> str:
    """Tell in a few words what was found."""
    return f"mean shading {', '.join(f'{value:.3g}' for value in facts['mean_shading'])}"


RELIGHT = Stage(
    name="relight",
    version=10,
    about="The views under another light, from their albedo.",
    settings=RelightSettings,
    takes=("albedo", "normal", "mask", "cameras", "mesh", "triangles", "transfer"),
    may_take=("light",),
    gives=(
        Artefact("relit", "the views under another light, EXR (linear) and PNG", output="relit"),
        Artefact("surface_light", "what lights the surface then", file="surface_light.npz"),
    ),
    run=run,
    tools=("numpy", "scipy", "numba", "llvmlite", *OPEN3D, *PICTURES),
    saves_memory=FEWER_PIXELS,
    found=in_words,
)

# The same after a stage that has estimated the light.
RELIGHT_AS_FOUND = replace(RELIGHT, takes=(*RELIGHT.takes, "found_light"))
