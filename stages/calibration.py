"""Absolute scale and white balance from a grey card or a colour chart, after the decomposition.

Albedo times shading stays the photo: what the albedo is multiplied by, shading and light are divided by.
"""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any

from pipeline import Artefact, Job, Stage, json_text
from stages.photometry.calibration.settings import CalibrationSettings
from stages.scene.distributions import PICTURES, PYCOLMAP

if TYPE_CHECKING:
    import numpy as np

    from stages.geometry.lenses import Lens
    from stages.photometry.calibration.balance import Reading
    from stages.photometry.calibration.references import Reference
    from stages.scene.cameras import Camera

OF_ALBEDO, OF_LIGHT = ("albedo", "albedo_tv"), ("shading", "light_pictures")
BRIGHTEST = 0.99  # quantile of the albedo that is compared with 1, in a warning alone


def run(job: Job[CalibrationSettings]) -> None:
    """Read the references, and write maps and light on the scale that they give."""
    from stages.formats.artefacts.camera_file import read_cameras
    from stages.formats.artefacts.lighting_json import calibrated_lighting
    from stages.photometry.calibration.balance import common_factors

    cameras = read_cameras(job.inputs["cameras"])
    readings = _readings(job, cameras)
    factors = common_factors(readings)
    _report(job, readings, factors)
    for name in OF_ALBEDO + OF_LIGHT:
        if name in job.inputs:
            by = factors if name in OF_ALBEDO else 1 / factors
            _rescale(job, name, by)
    text = calibrated_lighting(job.inputs["lighting"].read_text(encoding="utf-8"), factors)
    job.outputs["lighting_calibrated"].write_text(text, encoding="utf-8")
    _warn_of_too_bright(job, cameras, factors)


def _readings(job: Job[CalibrationSettings], cameras: list[Camera]) -> list[Reading]:
    """Find every reference's view, and read its albedo there."""
    from stages.formats.colmap.model import read_model, registered
    from stages.formats.images.exr import read_exr
    from stages.formats.images.photos import read_mask
    from stages.geometry.lenses import lens_of
    from stages.photometry.calibration.balance import read_reference
    from stages.photometry.calibration.references import references_of, view_of
    from stages.scene.cameras import view_name

    by_name = {camera.name: camera for camera in cameras}
    model = read_model(job.inputs["model"])
    images = {view_name(image.name): image for image in registered(model)}
    photos = [images[name].name for name in by_name]

    def reading_of(reference: Reference) -> Reading:
        view = view_of(reference, photos)
        image = images[view]
        xy = _places(job, image.name, lens_of(model.cameras[image.camera_id]), by_name[view])
        albedo = read_exr(job.inputs["albedo"] / f"{view}.exr")
        mask = read_mask(job.inputs["mask"] / f"{view}.png")
        if "confidence" in job.inputs:  # 0: no data of its own, as of a card that is clipped
            mask &= read_exr(job.inputs["confidence"] / f"{view}.exr") > 0
        return read_reference(reference, view, albedo, mask, xy, job.settings.fewest_pixels)

    return [reading_of(reference) for reference in references_of(job.settings)]


def _places(job: Job[CalibrationSettings], name: str, lens: Lens, camera: Camera) -> np.ndarray:
    """Compute where a view's pixels lie in its photo as it is shown, (h, w, 2)."""
    from stages.formats.decoders.pictures import upright_places
    from stages.formats.images.photo_turns import read_as_stored
    from stages.formats.images.photos import orientation_of
    from stages.geometry.lenses import photo_from_pinhole

    xy = photo_from_pinhole(lens, camera)
    if name not in read_as_stored(job.inputs["model"]):
        return xy
    return upright_places(xy, (lens["width"], lens["height"]), orientation_of(job.inputs["images"] / name))


def _report(job: Job[CalibrationSettings], readings: list[Reading], factors: np.ndarray) -> None:
    """Write, note and say the factors and what remains; warn where the references are no better."""
    import numpy as np

    from stages.photometry.calibration.balance import disagreement

    content = {
        "about": "albedo is reflectance: factors are what the albedo as found was multiplied by, and shading "
        "and light divided by, red, green and blue; rms: of the references' patches after it",
        "factors": factors.tolist(),
        "references": [reading.as_json(factors) for reading in readings],
    }
    job.outputs["calibration"].write_text(json_text(content, indent=1) + "\n", encoding="utf-8")
    spread = max(float(np.nanmax(reading.spread[reading.used])) for reading in readings)
    apart = disagreement(readings)
    residual = max(reading.residual(factors, False) for reading in readings)
    job.note(factors=np.round(factors, 5).tolist(), spread=round(spread, 4), rms=round(residual, 4))
    red, green, blue = factors
    job.say(
        f"Albedo is scaled by {red:.3g}, {green:.3g}, {blue:.3g} (red, green, blue) to reflectance; the "
        f"references remain {residual:.3f} off (RMS), and spread by {spread:.1%}."
    )
    if spread > job.settings.most_spread:
        job.warn(
            f"The albedo within a reference spreads by {spread:.0%} (calibration.most_spread is "
            f"{job.settings.most_spread:.0%}): the scale is known no better. Give a part of the card without "
            "shadow and gloss."
        )
    if apart > job.settings.most_spread:
        job.warn(
            f"The references differ by {apart:.0%} in the scale that they give; their mean is taken. Leave "
            "out the one that is wrong: calibration.json lists them."
        )


def _rescale(job: Job[CalibrationSettings], name: str, by: np.ndarray) -> None:
    """Multiply every EXR of an artefact by a factor per channel, in parallel; light gets its PNGs, too."""
    from stages.formats.artefacts.view_files import write_pictures_of_light
    from stages.formats.images.exr import read_exr, write_exr

    source, target = job.inputs[name], job.outputs[f"{name}_calibrated"]
    files = sorted(path.relative_to(source) for path in source.rglob("*.exr"))

    def scaled(file: Path) -> np.ndarray:
        return (read_exr(source / file) * by).astype("float32")

    if name == "light_pictures":
        write_pictures_of_light(target, {str(file.with_suffix("")): scaled(file) for file in files})
        return
    with job.progress(name, len(files)) as step:
        for _ in job.executor.map(lambda file: write_exr(target / file, scaled(file)), files):
            step()


def _warn_of_too_bright(job: Job[CalibrationSettings], cameras: list[Camera], factors: np.ndarray) -> None:
    """Warn where much of the albedo reflects more than it receives."""
    import numpy as np

    from stages.formats.images.exr import read_exr
    from stages.formats.images.photos import read_mask

    bright = []
    for camera in cameras:
        mask = read_mask(job.inputs["mask"] / f"{camera.name}.png")
        if mask.any():
            albedo = read_exr(job.inputs["albedo"] / f"{camera.name}.exr")[mask] * factors
            bright.append(float(np.quantile(albedo, BRIGHTEST)))
    if bright and np.median(bright) > 1:
        job.warn(
            f"By these references the brightest surface reflects {np.median(bright):.2f} of the light; "
            "expected 1 at most. Check the reflectance, or that no shadow lies on the card alone."
        )


def _calibrated(name: str, about: str, file: str | None = None, output: str | None = None) -> Artefact:
    return Artefact(f"{name}_calibrated", f"{about}, on the references' scale", file, output or name)


def in_words(facts: Mapping[str, Any]) -> str:
    """Tell in a few words what was found."""
    red, green, blue = facts["factors"]
    return f"albedo scaled by {red:.3g}, {green:.3g}, {blue:.3g}"


CALIBRATION = Stage(
    name="calibration",
    version=3,
    about="Absolute scale and white balance from a grey card or a colour chart, where one is given.",
    settings=CalibrationSettings,
    takes=(
        "images",
        "model",
        "cameras",
        "mask",
        "albedo",
        "shading",
        "lighting",
        "albedo_tv",
        "light_pictures",
        "confidence",  # where the stage before tells it
    ),
    gives=(
        Artefact(
            "calibration",
            "factors, and what remains of the references",
            file="calibration.json",
            output="calibration.json",
        ),
        _calibrated("albedo", "albedo per view, EXR"),
        _calibrated("shading", "shading per view, EXR"),
        _calibrated("lighting", "light per view and channel", "lighting.json", "lighting.json"),
        _calibrated("albedo_tv", "Eq. 2's own albedo, EXR"),
        _calibrated("light_pictures", "the light from all directions, EXR and PNG", output="environment"),
    ),
    run=run,
    tools=("numpy", *PYCOLMAP, *PICTURES),
    saves_memory="give --threads 1: one picture at a time",
    found=in_words,
)
