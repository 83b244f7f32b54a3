"""What the estimation of light leaves: the light, its pictures, the pixels' data, notes and a report."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

from pipeline import Job
from stages.photometry.lighting.settings import LightingSettings

if TYPE_CHECKING:
    import numpy as np

    from stages.formats.artefacts.transfer_file import StoredTransfer
    from stages.photometry.albedo_data import AlbedoData
    from stages.photometry.clusters.parts import Parts
    from stages.photometry.lighting.illumination import Illumination
    from stages.scene.cameras import Camera


@dataclass(frozen=True, eq=False)
class AllViews:
    """What all views have, beside the views that the light was estimated from.

    Attributes
    ----------
    cameras : list of Camera
    light_of_view : ndarray, shape (n,), int64
    gains : ndarray, shape (n, 3)
    trusted : bool
        Whether any pixel is trusted.
    """

    cameras: list[Camera]
    light_of_view: np.ndarray
    gains: np.ndarray
    trusted: bool


def note_light(
    job: Job[LightingSettings],
    stored: StoredTransfer,
    found: Illumination,
    untrusted_pixels: int,
    shadowed_pixels: int,
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
        suns=_suns(found),
        lights=int(found.light_of_view.max()) + 1,
        lights_apart=round(found.apart, 3),
        spread_between_views=round(found.gains.spread, 4),
        brightening_between_views=round(found.brightening, 3),
        specular=[found.specular.as_json()] if found.specular else [],
        **({} if job.settings.brightest else _brightest(found)),
        untrusted_pixels=untrusted_pixels,
        shadowed_pixels=shadowed_pixels,
    )


def _brightest(found: Illumination) -> dict[str, Any]:
    """Tell what the brightest material reflects, where that was found, and how those tried disagree."""
    if found.reflectance is not None:
        return {"brightest": found.reflectance.as_json()}
    return {"brightest": {"reflects": round(found.brightest, 3)}} if found.brightest else {}


def _suns(found: Illumination) -> list[dict[str, Any]]:
    """List the direction of every sun, and its share of all light from everywhere."""
    flux = (found.light.radiance[0] * found.cells[:, None]).sum(axis=1)
    suns = found.explained.scene.suns
    return [
        {"direction": direction.tolist(), "share_of_light": round(float(own / flux.sum()), 4)}
        for direction, own in zip(suns, flux[len(flux) - len(suns) :], strict=True)
    ]


def report_light(job: Job[LightingSettings], stored: StoredTransfer, found: Illumination) -> None:
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


def warn_of_clipping(job: Job[LightingSettings], clipped: int, pixels: int) -> None:
    """Warn where most pixels are white."""
    if 2 * clipped > pixels:
        white = job.settings.trusted_pixels.saturation
        job.warn(
            f"{clipped} of {pixels} pixels are white in a channel of their photo (from {white:.0%} on); "
            "expected few: their albedo is a guess. Develop the photos darker, or give them as EXR."
        )


def write_pixels(
    job: Job[LightingSettings],
    cameras: list[Camera],
    masks: list[np.ndarray],
    shading: np.ndarray,
    observed: AlbedoData,
) -> None:
    """Write the shading of all views, and their pixels' data for the albedo."""
    from stages.formats.artefacts.view_files import write_arrays, write_maps

    write_maps(job.outputs["shading"], cameras, masks, shading, job.executor.map)
    write_arrays(job.outputs["observations"], cameras, masks, observed.by_pixel(), job.executor.map)


def write_view(view: int, parts: Parts, shading: Path, observations: Path) -> None:
    """Write the same of one view into their folders, out of clusters. Picklable."""
    from stages.formats.artefacts.view_files import write_arrays, write_maps
    from stages.photometry.albedo_data import BY_PIXEL

    mask, values = parts.of_view(view, ("shading", *BY_PIXEL))
    of_one = [parts.cameras[view]], [mask]
    write_maps(shading, *of_one, values.pop("shading"))
    write_arrays(observations, *of_one, values)


def write_light_of(
    job: Job[LightingSettings],
    stored: StoredTransfer,
    found: Illumination,
    every: AllViews,
    image_scale: float,
) -> None:
    """Write the light as numbers and environment maps."""
    import numpy as np

    from stages.formats.artefacts.light_npz import StoredLight, write_light
    from stages.formats.artefacts.lighting_json import LightAround, write_light_around
    from stages.formats.artefacts.view_files import write_pictures_of_light
    from stages.photometry.transport.environment import picture_of_light
    from stages.scene.upright import upright_from_world

    directions, lights = found.directions, found.light.radiance
    sphere = stored.centre, float(stored.radii[found.scene])
    around = LightAround(directions, found.cells, lights, every.light_of_view, every.gains, *sphere)
    absolute = found.turn_deg is not None and job.settings.known_scale == "fixed"
    write_light_around(job.outputs["lighting"], every.cameras, around, image_scale, absolute)
    mean = found.light.shading.mean(axis=0, dtype=np.float64) if absolute else np.ones(3)
    stored_light = StoredLight(
        around=around,
        image_scale=image_scale,
        mean_shading=np.where(mean > 0, mean, 1),  # a lamp may lack a channel
        specular_strength=found.specular.strength if found.specular else np.zeros(3),
        specular_roughness=found.specular.roughness if found.specular else 0.0,
        glossy=found.observations.glossy,
        trusted=every.trusted,
        brightest=found.brightest,
    )
    write_light(job.outputs["found_light"], stored_light)
    names = [camera.name for camera in every.cameras] if len(lights) > 1 else ["shared"]
    upright = directions @ upright_from_world(every.cameras, job.settings.upright_within_deg).T
    suns = len(found.explained.scene.suns)
    pictures = {
        name: picture_of_light(upright, one, job.settings.light_pictures, found.cells, suns)
        for name, one in zip(names, lights, strict=True)
    }
    write_pictures_of_light(job.outputs["light_pictures"], pictures)
