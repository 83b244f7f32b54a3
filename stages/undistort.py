"""From photos and lens to pinhole images at working size, in linear light (Eq. 7 holds from here on)."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

from pipeline import Artefact, Job, Settings, Stage, UserError, setting
from stages.scene.wording import listed

if TYPE_CHECKING:
    import pycolmap

    from stages.scene.cameras import Camera


class UndistortSettings(Settings):
    """Settings of the `undistort` stage."""

    max_size_px: int | None = setting(
        768,
        "Longest side of the images that everything after works on; none: the photos' own size.",
        unit="px",
        ge=32,
        le=16384,
    )
    blank_pixels: float = setting(
        0.0,
        "Share of pixels that may look past the photo's border: 0 crops, 1 keeps the whole photo.",
        ge=0,
        le=1,
    )


@dataclass(frozen=True)
class View:
    """One view's work, in values that a worker can be sent.

    Attributes
    ----------
    photo, mask : Path
        The mask may be missing.
    lens : dict
        COLMAP camera of the photo, as keywords.
    camera : Camera
        The pinhole camera wanted.
    image, linear, kept : Path
        Where the results go.
    """

    photo: Path
    mask: Path | None
    lens: dict[str, Any]
    camera: Camera
    image: Path
    linear: Path
    kept: Path


def run(job: Job) -> None:
    """Choose the pinhole cameras, resample view by view, write the workspace."""
    from stages.scene.colmap_model import pinhole_model, read_model, registered
    from stages.scene.dense_workspace import write_stereo_settings

    model = read_model(job.inputs["model"])
    workspace = job.outputs["workspace"]
    cameras = _pinhole_cameras(model, job.settings)
    images = registered(model)
    masks = _find_masks(job, [image.name for image in images])
    views = [
        View(
            photo=job.inputs["images"] / image.name,
            mask=masks.get(image.name),
            lens=_lens(model.cameras[image.camera_id]),
            camera=camera,
            image=workspace / "images" / f"{camera.name}.png",
            linear=job.outputs["linear"] / f"{camera.name}.exr",
            kept=job.outputs["kept"] / f"{camera.name}.png",
        )
        for image, camera in zip(images, cameras, strict=True)
    ]
    with job.progress("undistorting", len(views)) as step:
        resampled = 0
        for touched in job.executor.map(undistort_view, views):
            resampled += touched
            step()
    (workspace / "sparse").mkdir()
    pinhole_model(cameras, points_from=model).write(workspace / "sparse")
    write_stereo_settings(workspace, [f"{camera.name}.png" for camera in cameras])
    job.note(
        views=len(views),
        resampled=resampled,
        sizes_px=sorted({f"{camera.width}x{camera.height}" for camera in cameras}),
        masks=len(masks),
    )


def undistort_view(view: View) -> bool:
    """Write one view's linear image, 8-bit image and mask; whether it had to be resampled."""
    import numpy as np

    from stages.geometry.undistortion import oversampling, resample
    from stages.scene.exr import write_exr
    from stages.scene.photos import read_mask, read_photo, write_mask, write_png_srgb8

    linear = read_photo(view.photo)
    lens = _camera(view.lens)
    height, width = linear.shape[:2]
    if (width, height) != (lens.width, lens.height):
        raise UserError(
            f"{view.photo} is {width} × {height} pixels, but its camera in the model is {lens.width} × "
            f"{lens.height}; give the photos that the model was made from."
        )
    kept = np.ones((height, width), bool)
    if view.mask is not None:
        kept = read_mask(view.mask)
        if kept.shape != (height, width):
            raise UserError(
                f"The mask {view.mask} is {kept.shape[1]} × {kept.shape[0]} pixels, its photo {width} × "
                f"{height}; masks must have their photo's size."
            )
    finite = np.isfinite(linear).all(axis=2)  # renderers and merging tools leave NaN and infinity behind
    if not finite.all():
        linear, kept = np.where(finite[..., None], linear, np.float32(0)), kept & finite
    exact = _same_camera(lens, view.camera)
    if not exact:
        linear, kept = resample(
            linear,
            kept,
            (view.camera.width, view.camera.height),
            lambda xy: _source_from_target(lens, view.camera, xy),
            oversampling(lens.mean_focal_length(), view.camera.focal_px),
        )
    write_exr(view.linear, linear)
    write_png_srgb8(view.image, linear)
    if view.mask is not None or not kept.all():
        write_mask(view.kept, kept)
    return not exact


def _pinhole_cameras(model: pycolmap.Reconstruction, settings: UndistortSettings) -> list[Camera]:
    """The pinhole camera of every posed image at working size, sorted by image name."""
    import pycolmap

    from stages.geometry.undistortion import working_size
    from stages.scene.colmap_model import PINHOLES, camera_of, registered

    options = pycolmap.UndistortCameraOptions(blank_pixels=settings.blank_pixels)
    pinholes = {}
    for image in registered(model):
        lens = model.cameras[image.camera_id]
        if image.camera_id not in pinholes:
            ideal = lens if lens.model_name in PINHOLES else pycolmap.undistort_camera(options, lens)
            pinholes[image.camera_id] = ideal
    cameras = [camera_of(image, pinholes[image.camera_id]) for image in registered(model)]
    return [c.scaled(*working_size(c.width, c.height, settings.max_size_px)) for c in cameras]


def _source_from_target(lens: pycolmap.Camera, camera: Camera, xy: Any) -> Any:
    """Pixels (n, 2) of the photo behind pixels of the pinhole image; NaN where the lens sees nothing."""
    import numpy as np

    K = camera.intrinsics
    rays = np.ones((len(xy), 3))
    rays[:, 0] = (xy[:, 0] - K[0, 2]) / K[0, 0]
    rays[:, 1] = (xy[:, 1] - K[1, 2]) / K[1, 1]
    return lens.img_from_cam(rays)


def _same_camera(lens: pycolmap.Camera, camera: Camera) -> bool:
    """Whether the photo is the pinhole image already, to the bit."""
    import numpy as np

    from stages.scene.colmap_model import PINHOLES

    return (
        lens.model_name in PINHOLES
        and (lens.width, lens.height) == (camera.width, camera.height)
        and np.array_equal(lens.calibration_matrix(), camera.intrinsics)
    )


def _lens(camera: pycolmap.Camera) -> dict[str, Any]:
    return {
        "model": camera.model_name,
        "width": camera.width,
        "height": camera.height,
        "params": list(camera.params),
    }


def _camera(lens: dict[str, Any]) -> pycolmap.Camera:
    import pycolmap

    return pycolmap.Camera(**lens)


def _find_masks(job: Job, names: list[str]) -> dict[str, Path]:
    """The mask of every photo that has one; photos without are named aloud."""
    from stages.scene.photos import find_mask

    folder = job.inputs.get("masks")
    if folder is None:
        return {}
    found = {name: mask for name in names if (mask := find_mask(folder, name)) is not None}
    if not found:
        raise UserError(
            f"No mask in {folder} belongs to a photo: expected names like {names[0]}, its stem with "
            f".png, or {names[0]}.png. Rename the masks."
        )
    missing = [name for name in names if name not in found]
    if missing:
        job.warn(f"{len(missing)} of {len(names)} photos have no mask and are used whole: {listed(missing)}.")
    return found


UNDISTORT = Stage(
    name="undistort",
    version=1,
    about="Pinhole images at working size, in linear light, as a COLMAP workspace.",
    settings=UndistortSettings,
    takes=("images", "model"),
    may_take=("masks",),
    gives=(
        Artefact("workspace", "COLMAP dense workspace: 8-bit images, PINHOLE model"),
        Artefact("linear", "the same images, linear RGB, EXR"),
        Artefact("kept", "masks of the views that have one, white = keep"),
    ),
    run=run,
    tools=("pycolmap",),
)
