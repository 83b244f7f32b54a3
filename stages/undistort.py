"""From photos and lens to pinhole images at working size, in linear light (Eq. 7 holds from here on)."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Literal

from pydantic import Field

from pipeline import Artefact, Job, Settings, Stage, UserError, counted, group, json_text, setting
from stages.formats.images.photo_settings import MOST_TIMES_BRIGHT, FireflySettings
from stages.geometry.working_size import (
    MEGA,
    AutoSizeSettings,
    affordable_size,
    expected_minutes,
    working_size,
)
from stages.scene.distributions import PICTURES, PYCOLMAP
from stages.scene.memory_of_views import BYTES_OF_LIBRARIES, BYTES_PER_PIXEL_OF_CLUSTER
from stages.scene.wording import listed, sizes_in_words

if TYPE_CHECKING:
    import pycolmap

    from stages.geometry.lenses import Lens
    from stages.scene.cameras import Camera

PIXELS_OF_A_CLUSTER = 3  # that take part in one of a single view, over its own
Longest = Annotated[int, Field(ge=32, le=16384)]


class UndistortSettings(Settings):
    """Settings of the `undistort` stage."""

    max_size_px: Longest | Literal["auto"] | None = setting(
        "auto",
        "Longest side of the images that everything after works on. auto: as fine as the time in `auto` "
        "allows; none: the photos' own size.",
        unit="px",
    )
    auto: AutoSizeSettings = group(AutoSizeSettings, "The size chosen by `max_size_px: auto`.")
    blank_pixels: float = setting(
        0.0,
        "Share of pixels that may look past the photo's border: 0 crops, 1 keeps the whole photo.",
        ge=0,
        le=1,
    )
    alpha: bool = setting(
        True,
        "Pixels that an alpha channel says are less than half opaque are masked, as by a mask that is given.",
    )
    exif_exposure: bool = setting(
        True,
        "Exposures in the EXIF data (time, f-number, ISO), where all photos have them and they differ, are "
        "the gains of views that correspondences say nothing about. Switch off if the photos were brought to "
        "one brightness afterwards.",
    )
    most_times_bright: float = MOST_TIMES_BRIGHT
    fireflies: FireflySettings = group(FireflySettings, "What `most_times_bright` is a multiple of.")


@dataclass(frozen=True)
class View:
    """One view's work: photo, mask and lens, the pinhole camera wanted, and where the results go."""

    photo: Path
    mask: Path | None
    lens: Lens
    camera: Camera
    as_stored: bool
    with_alpha: bool
    most_times_bright: float
    fireflies: FireflySettings
    image: Path
    linear: Path
    kept: Path


def run(job: Job[UndistortSettings]) -> None:
    """Choose the pinhole cameras, resample view by view, write the workspace."""
    from stages.formats.colmap.dense_workspace import write_stereo_settings
    from stages.formats.colmap.model import pinhole_model, read_model, registered, write_model
    from stages.formats.images.photo_turns import read_as_stored
    from stages.geometry.lenses import lens_of

    model = read_model(job.inputs["model"])
    workspace = job.outputs["workspace"]
    cameras = _at_working_size(job, _pinhole_cameras(model, job.settings.blank_pixels))
    images = registered(model)
    masks = _find_masks(job, [image.name for image in images])
    as_stored = read_as_stored(job.inputs["model"])
    views = [
        View(
            photo=job.inputs["images"] / image.name,
            mask=masks.get(image.name),
            lens=lens_of(model.cameras[image.camera_id]),
            camera=camera,
            as_stored=image.name in as_stored,
            with_alpha=job.settings.alpha,
            most_times_bright=job.settings.most_times_bright,
            fireflies=job.settings.fireflies,
            image=workspace / "images" / f"{camera.name}.png",
            linear=job.outputs["linear"] / f"{camera.name}.exr",
            kept=job.outputs["kept"] / f"{camera.name}.png",
        )
        for image, camera in zip(images, cameras, strict=True)
    ]
    with job.progress("undistorting", len(views)) as step:
        found = list(counted(job.tasks.small(undistort_view, views), step))
    _tell_what_is_left_out(job, [image.name for image in images], found)
    _write_exposures(job, {camera.name: one.exposure for camera, one in zip(cameras, found, strict=True)})
    write_model(pinhole_model(cameras, points_from=model), workspace / "sparse")
    write_stereo_settings(workspace, [f"{camera.name}.png" for camera in cameras])
    job.note(
        views=len(views),
        resampled=sum(one.resampled for one in found),
        sizes_px=sorted({f"{camera.width}x{camera.height}" for camera in cameras}),
        masks=len(masks),
    )


@dataclass(frozen=True)
class Undistorted:
    """Outcome of undistorting one view's photo.

    Attributes
    ----------
    resampled : bool
        Else it is the pinhole image already.
    black : bool
        Its mask keeps nothing.
    transparent : bool
        Its alpha channel keeps nothing.
    impossible : int
        Pixels that were not numbers, or too bright to be light from a surface.
    unlit : bool
        None of its values is above zero.
    nothing_left : bool
        And without them, there is no other.
    remarks : list of str
        What its header says and was not delivered.
    exposure : float or None
        By its EXIF data, in any unit; None where they do not say.
    """

    resampled: bool
    black: bool
    transparent: bool
    impossible: int
    unlit: bool
    nothing_left: bool
    remarks: list[str]
    exposure: float | None


def undistort_view(view: View) -> Undistorted:
    """Write one view's linear image, 8-bit image and mask."""
    from stages.formats.decoders.exif_exposure import exposure_of
    from stages.formats.images.exr import write_exr
    from stages.formats.images.masked_photos import read_masked_photo
    from stages.formats.images.photo_folder import LINEAR
    from stages.formats.images.photo_remarks import remarks_on
    from stages.formats.images.photos import write_mask, write_png_srgb8
    from stages.geometry.lenses import through_pinhole

    size = view.lens["width"], view.lens["height"]
    linear, kept, impossible = read_masked_photo(
        view.photo,
        view.mask,
        size,
        view.as_stored,
        view.with_alpha,
        view.most_times_bright,
        view.fireflies,
    )
    unlit = not (linear > 0).any()
    transparent = view.mask is None and not impossible and not kept.any()
    linear, kept, touched = through_pinhole(linear, kept, view.lens, view.camera)
    write_exr(view.linear, linear, has_white=not view.photo.name.lower().endswith(LINEAR))
    write_png_srgb8(view.image, linear)
    if view.mask is not None or not kept.all():
        write_mask(view.kept, kept)
    black = view.mask is not None and not kept.any()
    nothing_left = bool(impossible) and not kept.any()
    remarks = remarks_on(view.photo, view.as_stored, view.with_alpha)
    exposure = exposure_of(view.photo)
    return Undistorted(touched, black, transparent, impossible, unlit, nothing_left, remarks, exposure)


def _pinhole_cameras(model: pycolmap.Reconstruction, blank_pixels: float) -> list[Camera]:
    """The pinhole camera of every posed image at the photo's own size, sorted by image name."""
    import pycolmap

    from stages.formats.colmap.model import PINHOLES, camera_of, registered

    options = pycolmap.UndistortCameraOptions(blank_pixels=blank_pixels)
    pinholes = {}
    for image in registered(model):
        lens = model.cameras[image.camera_id]
        if image.camera_id not in pinholes:
            ideal = lens if lens.model_name in PINHOLES else pycolmap.undistort_camera(options, lens)
            pinholes[image.camera_id] = ideal
    return [camera_of(image, pinholes[image.camera_id]) for image in registered(model)]


def _at_working_size(job: Job[UndistortSettings], cameras: list[Camera]) -> list[Camera]:
    """Reduce cameras to the longest side that is set; where the size is automatic, choose it and say so."""
    longest, how = job.settings.max_size_px, job.settings.auto
    sizes = [(camera.width, camera.height) for camera in cameras]
    if longest == "auto":
        longest = affordable_size(sizes, how)
    reduced = [working_size(*size, longest) for size in sizes]
    if job.settings.max_size_px == "auto" and reduced != sizes:
        minutes = expected_minutes(reduced, how)
        job.note(longest_px=longest, expected_processor_minutes=round(minutes, 1))
        job.say(
            f"Works at {longest} px of {max(map(max, sizes))}, about {minutes:.0f} minutes of processor time "
            f"(undistort.auto.processor_minutes={how.processor_minutes:g})."
        )
    return [camera.scaled(*size) for camera, size in zip(cameras, reduced, strict=True)]


def _write_exposures(job: Job[UndistortSettings], exposures: Mapping[str, float | None]) -> None:
    """Write the views' relative exposures, or that there is nothing to say of them."""
    from stages.formats.decoders.exif_exposure import range_ev, relative_exposures

    relative = relative_exposures(exposures) if job.settings.exif_exposure else {}
    lacking = [name for name, exposure in exposures.items() if exposure is None]
    if job.settings.exif_exposure and 0 < len(lacking) < len(exposures):
        job.say(
            f"{len(lacking)} of {len(exposures)} photos have no exposure in their EXIF data "
            f"({listed(lacking, 3)}): those of the others are not used."
        )
    if relative:
        job.note(exposures_apart_ev=round(range_ev(relative), 2))
    job.outputs["exposures"].write_text(json_text(relative) + "\n", encoding="utf-8")


def _find_masks(job: Job[UndistortSettings], names: list[str]) -> dict[str, Path]:
    """The mask of every photo that has one; photos without are named aloud."""
    from stages.formats.images.photo_folder import find_masks

    folder = job.inputs.get("masks")
    if folder is None:
        return {}
    found = find_masks(folder, names)
    missing = [name for name in names if name not in found]
    if missing:
        job.warn(f"{len(missing)} of {len(names)} photos have no mask and are used whole: {listed(missing)}.")
    return found


def _tell_what_is_left_out(job: Job[UndistortSettings], names: list[str], found: list[Undistorted]) -> None:
    """Warn of photos and pixels that are not used; raise where nothing is left."""

    def those(flag: str) -> list[str]:
        return [name for name, one in zip(names, found, strict=True) if getattr(one, flag)]

    from stages.formats.images.masks import nothing_kept

    folder = job.inputs["images"]
    _tell_useless(
        job,
        those("black"),
        len(names),
        "masks keep no pixel of their photos",
        nothing_kept(f"No mask in {job.inputs.get('masks')}"),
    )
    _tell_useless(
        job,
        those("transparent"),
        len(names),
        "photos are transparent everywhere",
        f"The photos in {folder} are transparent everywhere by their alpha channels; expected what is opaque "
        "where the object is. Export them without, or set undistort.alpha=false.",
    )
    if all(one.nothing_left for one in found):
        raise UserError(
            f"No photo in {folder} holds a value that can be light: all are not numbers, or beyond 1e30; "
            "expected linear light. Export the photos again."
        )
    _tell_useless(
        job,
        those("unlit"),
        len(names),
        "photos are black, no value above zero",
        f"The photos in {folder} are black: no value is above zero; expected some light. Export them again.",
    )
    _tell_impossible(job, {name: one.impossible for name, one in zip(names, found, strict=True)})
    _tell_remarks(job, {name: one.remarks for name, one in zip(names, found, strict=True)})


def _tell_useless(
    job: Job[UndistortSettings], useless: list[str], views: int, what: str, refusal: str
) -> None:
    """Warn of photos of which nothing is left; raise where all are so: what follows would be for nothing."""
    if len(useless) == views:
        raise UserError(refusal)
    if useless:
        job.warn(f"{len(useless)} of {views} {what}: {listed(useless)}.")


def _tell_impossible(job: Job[UndistortSettings], counts: dict[str, int]) -> None:
    """What of the photos can be no light from a surface, photo by photo."""
    counts = {name: count for name, count in counts.items() if count}
    if counts:
        job.note(impossible_pixels=counts)
        job.warn(
            f"{sum(counts.values())} pixels of {listed(list(counts))} are masked: they are not numbers, or "
            f"more than {job.settings.most_times_bright:g} times as bright as all but a few of their photo."
        )


def _tell_remarks(job: Job[UndistortSettings], remarks: dict[str, list[str]]) -> None:
    """What the headers say and was not delivered: a line per remark on the terminal, photo by photo noted."""
    remarks = {name: own for name, own in remarks.items() if own}
    if not remarks:
        return
    job.note(headers={name: "; ".join(own) for name, own in remarks.items()})
    alike: dict[str, list[str]] = {}
    for name, own in remarks.items():
        alike.setdefault("; ".join(own), []).append(name)
    for remark, names in alike.items():
        job.warn(f"{listed(names)}: {remark}.")


def within(settings: UndistortSettings, memory: int) -> UndistortSettings:
    """Choose a size at which the memory, bytes, has room for a cluster of one view."""
    if settings.max_size_px != "auto":
        return settings
    room = (memory - BYTES_OF_LIBRARIES) / (BYTES_PER_PIXEL_OF_CLUSTER * PIXELS_OF_A_CLUSTER) / MEGA
    megapixels = min(settings.auto.view_megapixels, room)
    return settings.model_copy(
        update={"auto": settings.auto.model_copy(update={"view_megapixels": megapixels})}
    )


def in_words(facts: Mapping[str, Any]) -> str:
    """Tell in a few words what was found."""
    masks = f", {facts['masks']} masks" if facts["masks"] else ""
    return f"{facts['views']} views, {sizes_in_words(facts['sizes_px'])}{masks}"


UNDISTORT = Stage(
    name="undistort",
    version=7,
    about="Pinhole images at working size, in linear light, as a COLMAP workspace.",
    settings=UndistortSettings,
    takes=("images", "model"),
    may_take=("masks",),
    gives=(
        Artefact("workspace", "COLMAP dense workspace: 8-bit images, PINHOLE model"),
        Artefact("linear", "the same images, linear RGB, EXR"),
        Artefact("kept", "masks of the views that have one, white = keep"),
        Artefact("exposures", "relative exposures by EXIF data, where they differ", file="exposures.json"),
    ),
    run=run,
    tools=("numpy", *PYCOLMAP, *PICTURES),
    within=within,
    saves_memory="lower undistort.max_size_px, or give --threads 1",
    found=in_words,
)
