"""The albedo at the photos' own resolution, after the decomposition at working size."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

from pipeline import Artefact, Job, Stage, counted
from stages.photometry.full_resolution_settings import FullResolutionSettings
from stages.scene.distributions import PICTURES, PYCOLMAP
from stages.scene.wording import sizes_in_words

if TYPE_CHECKING:
    from stages.geometry.lenses import PhotoAndAlbedo


@dataclass(frozen=True)
class View:
    """Work on one view: its photo and albedo, and the paths of the results."""

    of: PhotoAndAlbedo
    maps: Path
    pictures: Path
    white: float
    settings: FullResolutionSettings


def run(job: Job[FullResolutionSettings]) -> None:
    """Upsample the albedo of all views, in parallel. Memory per worker: some 70 B per pixel of a photo."""
    from stages.formats.artefacts.camera_file import read_cameras
    from stages.formats.artefacts.png_scale import png_whites
    from stages.geometry.lenses import photos_and_albedos

    white = png_whites(job.inputs["scales"])["albedo"]
    views = [
        View(
            of=one,
            maps=job.outputs["albedo_full"] / f"{one.camera.name}.exr",
            pictures=job.outputs["albedo_full"] / f"{one.camera.name}.png",
            white=white,
            settings=job.settings,
        )
        for one in photos_and_albedos(job.inputs, read_cameras(job.inputs["cameras"]))
    ]
    with job.progress("views", len(views)) as step:
        sizes = set(counted(job.tasks.small(write_view, views), step))
    job.note(views=len(views), sizes_px=sorted(sizes))


def write_view(view: View) -> str:
    """Write one view's albedo as EXR and PNG; returns its size, as in 3072x2048."""
    from stages.formats.images.exr import write_exr
    from stages.formats.images.photos import write_png_srgb16
    from stages.geometry.lenses import at_photos_size, through_pinhole
    from stages.photometry.full_resolution import at_full_resolution

    lens, how = view.of.lens, view.settings
    camera = at_photos_size(view.of.camera, lens)
    linear, kept, albedo, mask = view.of.read(how.most_times_bright, how.fireflies)
    linear, kept, _ = through_pinhole(linear, kept, lens, camera)
    fine, _ = at_full_resolution(albedo, mask, linear, kept, how)
    write_exr(view.maps, fine)
    write_png_srgb16(view.pictures, fine / view.white)
    return f"{camera.width}x{camera.height}"


def in_words(facts: Mapping[str, Any]) -> str:
    """Tell in a few words what was found."""
    return f"{facts['views']} views, {sizes_in_words(facts['sizes_px'])}"


FULL_RESOLUTION = Stage(
    name="full_resolution",
    version=7,
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
    found=in_words,
)
