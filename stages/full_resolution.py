"""The albedo at the photos' own resolution, after the decomposition at working size."""

from __future__ import annotations

import json
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

from pipeline import Artefact, Job, Stage, counted
from stages.photometry.full_resolution_settings import FullResolutionSettings
from stages.scene.distributions import PICTURES, PYCOLMAP

if TYPE_CHECKING:
    from stages.geometry.lenses import Lens
    from stages.scene.cameras import Camera


@dataclass(frozen=True)
class View:
    """Work on one view: the photo, its camera and maps at working size, and the paths of the results."""

    photo: Path
    as_stored: bool
    lens: Lens
    camera: Camera
    albedo: Path
    mask: Path
    maps: Path
    pictures: Path
    white: float
    settings: FullResolutionSettings


def run(job: Job[FullResolutionSettings]) -> None:
    """Upsample the albedo of all views, in parallel. Memory per worker: some 70 B per pixel of a photo."""
    from stages.formats.artefacts.camera_file import read_cameras
    from stages.formats.colmap.model import read_model, registered
    from stages.formats.images.photo_turns import read_as_stored
    from stages.geometry.lenses import lens_of
    from stages.scene.cameras import view_name

    model = read_model(job.inputs["model"])
    images = {view_name(image.name): image for image in registered(model)}
    as_stored = read_as_stored(job.inputs["model"])
    white = json.loads(job.inputs["scales"].read_text(encoding="utf-8"))["png_white"]["albedo"]
    views = [
        View(
            photo=job.inputs["images"] / images[camera.name].name,
            as_stored=images[camera.name].name in as_stored,
            lens=lens_of(model.cameras[images[camera.name].camera_id]),
            camera=camera,
            albedo=job.inputs["albedo"] / f"{camera.name}.exr",
            mask=job.inputs["mask"] / f"{camera.name}.png",
            maps=job.outputs["albedo_full"] / f"{camera.name}.exr",
            pictures=job.outputs["albedo_full"] / f"{camera.name}.png",
            white=white,
            settings=job.settings,
        )
        for camera in read_cameras(job.inputs["cameras"])
    ]
    with job.progress("views", len(views)) as step:
        sizes = set(counted(job.tasks.small(write_view, views), step))
    job.note(views=len(views), sizes_px=sorted(sizes))


def write_view(view: View) -> str:
    """Write one view's albedo as EXR and PNG; returns its size, as in 3072x2048."""
    from stages.formats.images.exr import read_exr, write_exr
    from stages.formats.images.masked_photos import read_masked_photo
    from stages.formats.images.photos import read_mask, write_png_srgb16
    from stages.geometry.lenses import at_photos_size, through_pinhole
    from stages.photometry.full_resolution import at_full_resolution

    camera = at_photos_size(view.camera, view.lens)
    size, how = (view.lens["width"], view.lens["height"]), view.settings
    linear, kept, _ = read_masked_photo(
        view.photo, None, size, view.as_stored, False, how.most_times_bright, how.fireflies
    )
    linear, kept, _ = through_pinhole(linear, kept, view.lens, camera)
    known = read_exr(view.albedo), read_mask(view.mask)
    albedo, _ = at_full_resolution(*known, linear, kept, view.settings)
    write_exr(view.maps, albedo)
    write_png_srgb16(view.pictures, albedo / view.white)
    return f"{camera.width}x{camera.height}"


FULL_RESOLUTION = Stage(
    name="full_resolution",
    version=6,
    about="The albedo at the photos' own resolution.",
    settings=FullResolutionSettings,
    takes=("images", "model", "cameras", "albedo", "mask", "scales"),
    gives=(
        Artefact(
            "albedo_full",
            "the albedo at the photos' own size: EXR (linear), PNG (16-bit sRGB)",
            output="albedo_full",
        ),
    ),
    run=run,
    tools=("numpy", "scipy", *PYCOLMAP, *PICTURES),
    saves_memory="give --threads 1: one photo at a time",
)
