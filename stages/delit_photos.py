"""Photos without their light: the albedo in the photos' own pixels, files and names, for other programs."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal

from pipeline import Artefact, Job, Settings, Stage, counted, group, setting
from stages.photometry.full_resolution_settings import FullResolutionSettings
from stages.scene.distributions import PICTURES, PYCOLMAP
from stages.scene.wording import listed

if TYPE_CHECKING:
    import numpy as np

    from stages.geometry.lenses import PhotoAndAlbedo

IMAGES, SPARSE = "images", "sparse"  # as in COLMAP's workspaces


class DelitPhotosSettings(Settings):
    """Settings of the `delit_photos` stage."""

    geometry: Literal["original", "undistorted"] = setting(
        "original",
        "original: pixel by pixel as the photos, distortion and orientation included, to take their place in "
        "another program's project. undistorted: pinhole images, with their COLMAP model.",
    )
    without_albedo: Literal["photo", "black", "alpha"] = setting(
        "photo",
        "What stands where there is no albedo, behind the surface or outside the masks: the photo itself, on "
        "the same scale, black, or nothing by an alpha channel (JPEG becomes PNG then).",
    )
    quality: int = setting(95, "Quality of JPEG and WebP; colours are not subsampled.", ge=1, le=100)
    detail: FullResolutionSettings = group(
        FullResolutionSettings, "Detail finer than a working pixel, as in the stage `full_resolution`."
    )


@dataclass(frozen=True)
class View:
    """Work on one view: its photo and albedo, and the picture to write."""

    of: PhotoAndAlbedo
    picture: Path
    white: float
    settings: DelitPhotosSettings


def run(job: Job[DelitPhotosSettings]) -> None:
    """Write all views in parallel. Memory per worker: some 100 B per pixel of a photo."""
    from stages.formats.artefacts.camera_file import read_cameras
    from stages.formats.artefacts.png_scale import png_whites
    from stages.formats.images.photo_copies import name_of_copy
    from stages.geometry.lenses import photos_and_albedos

    white = png_whites(job.inputs["scales"])["albedo"]
    found = photos_and_albedos(job.inputs, read_cameras(job.inputs["cameras"]))
    photos = {one.camera.name: one.name for one in found}
    written = {
        view: name_of_copy(name, job.settings.without_albedo == "alpha") for view, name in photos.items()
    }
    views = [
        View(
            of=one,
            picture=job.outputs["delit"] / IMAGES / written[one.camera.name],
            white=white,
            settings=job.settings,
        )
        for one in found
    ]
    with job.progress("views", len(views)) as step:
        shares = list(counted(job.tasks.small(write_view, views), step))
    if job.settings.geometry == "undistorted":
        _write_model(job, found, written)
    _tell_other_kinds(job, photos, written)
    job.note(
        views=len(views),
        with_albedo={one.camera.name: round(share, 4) for one, share in zip(found, shares, strict=True)},
    )


def write_view(view: View) -> float:
    """Write one view's picture; returns the share of its pixels that have an albedo."""
    import numpy as np

    from stages.formats.images.photo_copies import as_stored, is_linear, write_like

    how, photo = view.settings, view.of.photo
    opened = view.of.read(how.detail.most_times_bright, how.detail.fireflies)
    undistorted = how.geometry == "undistorted"
    fine, known, linear = (_pinhole if undistorted else _own)(view, *opened)
    picture = np.where(known[..., None], fine, linear if how.without_albedo == "photo" else np.float32(0))
    if not is_linear(view.picture.name):
        picture /= np.float32(view.white)
    alpha = known if how.without_albedo == "alpha" else None
    if not undistorted and not view.of.as_stored:
        picture = as_stored(picture, photo)
        alpha = alpha if alpha is None else as_stored(alpha, photo)
    write_like(photo, view.picture, picture, alpha, how.quality, undistorted)
    return float(known.mean())


def _own(
    view: View, linear: np.ndarray, kept: np.ndarray, albedo: np.ndarray, mask: np.ndarray
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Bring the albedo to the photo's own pixels, which are never resampled: albedo, known, photo."""
    import numpy as np

    from stages.geometry.lenses import pinhole_from_photo, through_pinhole
    from stages.geometry.undistortion import bilinear
    from stages.photometry.full_resolution import with_detail_of

    if not mask.any():
        return np.zeros_like(linear), np.zeros(kept.shape, bool), linear
    coarse, _, _ = through_pinhole(linear, kept, view.of.lens, view.of.camera)
    place = pinhole_from_photo(view.of.lens, view.of.camera)
    fine, known = with_detail_of(
        linear, kept, albedo, mask, coarse, lambda image: bilinear(image, place), view.settings.detail
    )
    return fine, known, linear


def _pinhole(
    view: View, linear: np.ndarray, kept: np.ndarray, albedo: np.ndarray, mask: np.ndarray
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Bring albedo and photo to a pinhole image of the photo's resolution: albedo, known, photo."""
    from stages.geometry.lenses import at_photos_size, through_pinhole
    from stages.photometry.full_resolution import at_full_resolution

    linear, kept, _ = through_pinhole(
        linear, kept, view.of.lens, at_photos_size(view.of.camera, view.of.lens)
    )
    return *at_full_resolution(albedo, mask, linear, kept, view.settings.detail), linear


def _write_model(job: Job[DelitPhotosSettings], views: list[PhotoAndAlbedo], written: dict[str, str]) -> None:
    """Write the pinhole model of the pictures."""
    from stages.formats.colmap.model import pinhole_model, read_model, write_model
    from stages.geometry.lenses import at_photos_size

    cameras = [at_photos_size(view.camera, view.lens) for view in views]
    extensions = {view: name.removeprefix(view) for view, name in written.items()}
    model = pinhole_model(cameras, read_model(job.inputs["model"]), extensions)
    write_model(model, job.outputs["delit"] / SPARSE)


def _tell_other_kinds(job: Job[DelitPhotosSettings], photos: dict[str, str], written: dict[str, str]) -> None:
    """Warn of photos whose kind cannot be written: programs find pictures by their names."""
    other = [f"{name} as {written[view]}" for view, name in photos.items() if written[view] != name]
    if other:
        job.warn(
            f"{len(other)} of {len(photos)} pictures have the name of another kind than their photos: "
            f"{listed(other, 3)}. Replace the photos in the other program's project accordingly."
        )


def in_words(facts: Mapping[str, Any]) -> str:
    """Tell in a few words what was found."""
    shares = facts["with_albedo"].values()
    return f"{facts['views']} photos, {sum(shares) / max(len(shares), 1):.0%} of their pixels with albedo"


DELIT_PHOTOS = Stage(
    name="delit_photos",
    version=2,
    about="The photos without their light, under their own names, for other programs.",
    settings=DelitPhotosSettings,
    takes=("images", "model", "cameras", "albedo", "mask", "scales"),
    gives=(
        Artefact(
            "delit",
            "the photos without their light, of their size and kind; undistorted, with a COLMAP model",
            output="delit",
        ),
    ),
    run=run,
    tools=("numpy", "scipy", *PYCOLMAP, *PICTURES),
    saves_memory="give --threads 1: one photo at a time",
    found=in_words,
)
