"""Estimation of the illumination of all views before the albedo: light, distance, gains, specular."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

from pipeline import Artefact, Job, Stage
from stages.photometry.lighting.settings import LightingSettings
from stages.scene.distributions import OPEN3D, PICTURES
from stages.scene.memory_of_views import BYTES_OF_LIBRARIES, FEWER_OR_SMALLER_VIEWS

if TYPE_CHECKING:
    import numpy as np

    from stages.formats.artefacts.transfer_file import StoredTransfer
    from stages.photometry.lighting.illumination import Illumination
    from stages.photometry.lighting.known_light import KnownLight
    from stages.photometry.stack import StackedViews
    from stages.photometry.transport.lit_scenes import LitScene
    from stages.photometry.transport.sky_visibility import VisibilityProbes
    from stages.scene.cameras import Camera


BYTES_AT_ANY_SIZE = 400_000_000  # of specular reflection and of the picture of the light
BYTES_PER_PIXEL = 400  # masked


@dataclass(frozen=True, eq=False)
class Opened:
    """Views read from disk: cameras, stacked pixels, images divided by a common scale.

    Attributes
    ----------
    cameras : list of Camera
    views : StackedViews
        Without a basis.
    images : list of 3 ndarray, shape (N,), float32
    scale : float
    normals : ndarray, shape (N, 3)
    unclipped : ndarray, shape (N,), bool
    """

    cameras: list[Camera]
    views: StackedViews
    images: list[np.ndarray]
    scale: float
    normals: np.ndarray
    unclipped: np.ndarray


def run(job: Job[LightingSettings]) -> None:
    """Read the views, estimate their light, and save it, the shading, and the pixels' data for the albedo."""
    import numpy as np

    from stages.formats.artefacts.transfer_file import read_transfer
    from stages.formats.artefacts.view_files import ways_to_cameras
    from stages.formats.images.photos import read_environment
    from stages.photometry.lighting.estimate_illumination import find_illumination
    from stages.photometry.lighting.illumination_by_known_light import illumination_by
    from stages.photometry.lighting.trusted_pixels import Viewing

    known = read_environment(job.inputs["known_light"]) if "known_light" in job.inputs else None
    opened, stored = _open(job), read_transfer(job.inputs["transfer"])
    towards = ways_to_cameras(opened.cameras, opened.views.masks)
    how = job.settings
    viewing = Viewing.of(opened.unclipped, opened.normals, towards, how.trusted_pixels)
    _warn_of_clipping(job, int(np.count_nonzero(~opened.unclipped)), len(opened.unclipped))
    if known is not None:
        stored = replace(stored, radii=stored.radii[:1], visible=stored.visible[:1])  # infinitely far away
    scenes = _scenes(job, opened, stored)
    seen = opened.views, opened.images
    if known is not None:
        light = _as_known(known, how, opened)
        with job.progress("steps", light.turns(how.known_light) + 1 + _tries(how)) as step:
            found = illumination_by(light, *seen, scenes[0], viewing, how, job.threads, step)
    else:
        with job.progress("steps", _steps(how, len(scenes))) as step:
            found = find_illumination(*seen, scenes, viewing, how, job.threads, step)
    _note(job, stored, found, viewing.trusted)
    _report(job, stored, found)
    _write(job, opened, stored, found, bool(viewing.trusted.any()))


def estimated_memory(job: Job[LightingSettings]) -> int:
    """Estimate the memory from masked pixels; measured values are up to a third off it."""
    from stages.formats.artefacts.view_files import masked_pixels

    pixels = masked_pixels(job.inputs)
    return BYTES_OF_LIBRARIES + BYTES_AT_ANY_SIZE + BYTES_PER_PIXEL * pixels


def _steps(how: LightingSettings, scenes: int) -> int:
    """Estimate the number of steps of the light estimation."""

    search = how.search
    return (
        len(search.scales) * (scenes + 1)
        + 2 * _tries(how)
        + how.specular.alternations
        + search.refined_scales
    )


def _tries(how: LightingSettings) -> int:
    """Estimate the number of reflectances that are tried."""
    return len(how.reflectance.tried) // 2 if how.reflectance_is_found else 0


def _open(job: Job[LightingSettings]) -> Opened:
    import numpy as np

    from stages.formats.artefacts.camera_file import read_cameras
    from stages.formats.artefacts.correspondence_files import numbered_correspondences
    from stages.formats.artefacts.view_files import read_views, scaled_channels
    from stages.photometry.lighting.trusted_pixels import unclipped
    from stages.photometry.stack import stack_views

    cameras = read_cameras(job.inputs["cameras"])
    masks, normals, pixels = [], [], []
    with job.progress("views", len(cameras)) as step:
        for mask, normal, linear in read_views(job.inputs, cameras, job.executor.map):
            masks.append(mask)
            normals.append(normal[mask])
            pixels.append(linear)
            step()
    views = stack_views(masks, None, numbered_correspondences(job.inputs["correspondences"], cameras))
    not_clipped = np.concatenate([unclipped(own, job.settings.trusted_pixels) for own in pixels])
    images, scale = scaled_channels(np.concatenate(pixels))
    return Opened(cameras, views, images, scale, np.concatenate(normals), not_clipped)


def _scenes(job: Job[LightingSettings], opened: Opened, stored: StoredTransfer) -> list[LitScene]:
    """Build the scene for each distance of the light; surface points and blends are released."""
    from stages.formats.artefacts.view_files import read_surface_points
    from stages.formats.meshes.triangle_meshes import read_mesh
    from stages.geometry.vertex_interpolation import pixels_on_proxy
    from stages.photometry.transport.lit_scenes import scenes_by_distance
    from stages.scene.wording import tell_seen_from_behind

    points = read_surface_points(job.inputs, opened.cameras, opened.views.masks)
    blend = pixels_on_proxy(stored, read_mesh(job.inputs["mesh"]), points)
    scenes, opposed = scenes_by_distance(stored, blend, opened.normals, _probes(job, stored))
    tell_seen_from_behind(job, opposed, len(opened.normals))
    return scenes


def _as_known(picture: np.ndarray, settings: LightingSettings, opened: Opened) -> KnownLight:
    """Convert an environment map to a known light in the scale of the photos."""
    from stages.photometry.lighting.known_light import KnownLight
    from stages.scene.upright import upright_from_world

    scale = 1 / opened.scale if settings.known_scale == "fixed" else None
    upright = upright_from_world(opened.cameras, settings.upright_within_deg)
    return KnownLight.of(picture, upright, settings.known_turn_deg, scale, settings.environment_map)


def _probes(job: Job[LightingSettings], stored: StoredTransfer) -> VisibilityProbes:
    """Build visibility probes at the proxy's vertices, with the proxy as occluder."""
    from stages.formats.meshes.triangle_meshes import Surface
    from stages.geometry.occluders import Occluders
    from stages.photometry.transport.sky_visibility import VisibilityProbes

    proxy = Occluders(Surface(stored.vertices, stored.faces), job.threads)
    return VisibilityProbes(
        stored.probes - proxy.origin,
        stored.normals,
        proxy.blocked,
        proxy.origin,
        job.settings.visibility,
        job.executor,
    )


def _warn_of_clipping(job: Job[LightingSettings], clipped: int, pixels: int) -> None:
    if 2 * clipped > pixels:
        white = job.settings.trusted_pixels.saturation
        job.warn(
            f"{clipped} of {pixels} pixels are white in a channel of their photo (from {white:.0%} on); "
            "expected few: their albedo is a guess. Develop the photos darker, or give them as EXR."
        )


def _note(
    job: Job[LightingSettings], stored: StoredTransfer, found: Illumination, trusted: np.ndarray
) -> None:
    """Record the estimated light and the figures that it was decided by."""
    import numpy as np

    if found.turn_deg is not None:
        job.note(known_light_turned_by_deg=found.turn_deg)
    distance = stored.radii[found.scene]
    job.note(
        light_distance=float(distance) if np.isfinite(distance) else "infinitely far",
        disagreement=dict(zip(map(str, stored.radii.tolist()), found.disagreements, strict=True)),
        directions=len(found.directions),
        lights=int(found.light_of_view.max()) + 1,
        lights_apart=round(found.apart, 3),
        spread_between_views=round(found.gains.spread, 4),
        brightening_between_views=round(found.brightening, 3),
        specular=[found.specular.as_json()] if found.specular else [],
        **({} if found.reflectance is None else {"brightest": found.reflectance.as_json()}),
        untrusted_pixels=int(np.count_nonzero(~(trusted & found.observations.trusted))),
    )


def _report(job: Job[LightingSettings], stored: StoredTransfer, found: Illumination) -> None:
    """Report the decisions and their figures in one line."""
    import numpy as np

    count, distance = int(found.light_of_view.max()) + 1, stored.radii[found.scene]
    lights = "one light for all views" if count == 1 else f"{count} lights, one for each view"
    if 0 < found.apart < 1:
        lights += f", mixed by {found.apart:.2f} with one for all"
    far = f"{distance:.3g} from the middle" if np.isfinite(distance) else "infinitely far away"
    bright = f"; the brightest material reflects {found.brightest:.2f}" if found.brightest else ""
    job.say(
        f"Found {lights}, {far}: views differ by {found.gains.spread:.2f} "
        f"(still_light={job.settings.still_up_to:g}, moving_light={job.settings.moving_light:g}){bright}."
    )


def _write(
    job: Job[LightingSettings], opened: Opened, stored: StoredTransfer, found: Illumination, trusted: bool
) -> None:
    """Write the light as numbers and environment maps, the shading, and the pixels' observations."""
    import numpy as np

    from stages.formats.artefacts.light_npz import StoredLight, write_light
    from stages.formats.artefacts.lighting_json import LightAround, write_light_around
    from stages.formats.artefacts.view_files import write_arrays, write_maps, write_pictures_of_light
    from stages.photometry.transport.environment import picture_of_light
    from stages.scene.upright import upright_from_world

    views, directions, lights = (opened.cameras, opened.views.masks), found.directions, found.light.radiance
    write_maps(job.outputs["shading"], *views, found.light.shading, job.executor.map)
    observed = {kind: getattr(found.observations, kind) for kind in ("observed", "diffuse", "trusted")}
    write_arrays(job.outputs["observations"], *views, observed, job.executor.map)
    sphere = stored.centre, float(stored.radii[found.scene])
    around = LightAround(directions, found.cells, lights, found.light_of_view, found.gains.gains, *sphere)
    absolute = found.turn_deg is not None and job.settings.known_scale == "fixed"
    write_light_around(job.outputs["lighting"], opened.cameras, around, opened.scale, absolute)
    stored_light = StoredLight(
        around=around,
        image_scale=opened.scale,
        mean_shading=found.light.shading.mean(axis=0, dtype=np.float64) if absolute else np.ones(3),
        specular_strength=found.specular.strength if found.specular else np.zeros(3),
        specular_roughness=found.specular.roughness if found.specular else 0.0,
        glossy=found.observations.glossy,
        trusted=trusted,
        brightest=found.brightest,
    )
    write_light(job.outputs["found_light"], stored_light)
    names = [camera.name for camera in opened.cameras] if len(lights) > 1 else ["shared"]
    upright = directions @ upright_from_world(opened.cameras, job.settings.upright_within_deg).T
    pictures = {
        name: picture_of_light(upright, one, job.settings.light_pictures, found.cells)
        for name, one in zip(names, lights, strict=True)
    }
    write_pictures_of_light(job.outputs["light_pictures"], pictures)


LIGHTING = Stage(
    name="lighting",
    version=7,
    about="The light of all views, its distance, view gains and specular reflection.",
    settings=LightingSettings,
    takes=("linear", "normal", "mask", "cameras", "correspondences", "mesh", "triangles", "transfer"),
    may_take=("known_light",),
    gives=(
        Artefact("lighting", "light per view and channel", file="lighting.json", output="lighting.json"),
        Artefact("light_pictures", "the light from all directions, EXR and PNG", output="environment"),
        Artefact(
            "shading",
            "shading per view, EXR, linear: image = albedo × shading, except gloss",
            output="shading",
        ),
        Artefact("found_light", "the light, gains and gloss, npz", file="light.npz"),
        Artefact("observations", "per view: radiance with and without gloss, and trusted pixels, npz"),
    ),
    run=run,
    tools=("numpy", "scipy", "numba", "llvmlite", *OPEN3D, *PICTURES),
    memory=estimated_memory,
    saves_memory=FEWER_OR_SMALLER_VIEWS,
)
