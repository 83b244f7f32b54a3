"""Posed images of a model that exists already, brought to the names and sizes of the photos."""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pycolmap

from pipeline import Job, Settings, UserError
from stages.formats.colmap.assembly import PosedImage, assemble, points2d_of
from stages.formats.colmap.model import registered, write_model
from stages.formats.images.photo_turns import write_as_stored
from stages.formats.images.photos import orientation_of, photo_size
from stages.scene.wording import listed


@dataclass(frozen=True, eq=False)
class AdoptedImages:
    """Posed images under the names and at the sizes of their photos.

    Attributes
    ----------
    posed : list of PosedImage
    rescaled : list of str
        Photos of another size than in the model.
    as_stored : list of str
        Photos that their header turns, and that the model means as they are stored.
    """

    posed: list[PosedImage]
    rescaled: list[str]
    as_stored: list[str]


def adopt_images(
    model: pycolmap.Reconstruction,
    photos: Mapping[str, str],
    folder: Path,
    tolerance_px: float,
    prefer_as_stored: bool,
    listed_as_stored: Collection[str] | None = None,
) -> AdoptedImages:
    """Bring the images of a model to the names and sizes of their photos.

    Parameters
    ----------
    model : pycolmap.Reconstruction
    photos : mapping of str to str
        Photo by image name; images that it lacks are left out.
    folder : Path
        Of the photos.
    tolerance_px : float
        By which their aspect may differ from the model's.
    prefer_as_stored : bool
        How photos that their header turns are meant, where sizes leave both possible.
    listed_as_stored : collection of str, optional
        Those that a model of our own means as stored, if it says so.

    Raises
    ------
    UserError
        A photo has another shape than its camera, or is a panorama.
    """
    adopted = AdoptedImages([], [], [])
    for image in registered(model):
        if image.name not in photos:
            continue
        name, camera = photos[image.name], model.cameras[image.camera_id]
        if not len(camera.focal_length_idxs()):
            raise UserError(
                f"{name} has a camera of the kind {camera.model_name} in the model, which sees all around; "
                "expected a perspective or fisheye lens. Cut the panoramas into pinhole views first."
            )
        said = None if listed_as_stored is None else name in listed_as_stored
        size, turned = _size_in_model(folder / name, camera, tolerance_px, prefer_as_stored, said)
        adopted.as_stored.extend([name] * turned)
        if size != (camera.width, camera.height):
            adopted.rescaled.append(name)
        adopted.posed.append(_at_size(image, name, camera, size))
    return adopted


def save_adopted(job: Job[Settings], adopted: AdoptedImages, points_from: pycolmap.Reconstruction) -> None:
    """Write adopted images as a model with its points, and record it; warn of what was rescaled."""
    if adopted.rescaled:
        job.warn(
            f"{len(adopted.rescaled)} photos have another size than in the model; their cameras were "
            f"rescaled: {listed(adopted.rescaled)}."
        )
    model = assemble(adopted.posed, points_from=points_from)
    write_model(model, job.outputs["model"])
    write_as_stored(job.outputs["model"], adopted.as_stored)
    job.note(
        registered=len(adopted.posed),
        points=model.num_points3D(),
        camera_models=sorted({camera.model_name for camera in model.cameras.values()}),
        rescaled=len(adopted.rescaled),
        as_stored=len(adopted.as_stored),
    )


def warn_of_missing(job: Job[Settings], missing: Sequence[str], count: int) -> None:
    """Warn of images that have a pose and no photo."""
    if missing:
        job.warn(
            f"{len(missing)} of the {count} images of the model have no photo in "
            f"{job.inputs['images']} and are left out: {listed(missing)}."
        )


def _size_in_model(
    path: Path, camera: pycolmap.Camera, tolerance_px: float, prefer_as_stored: bool, said: bool | None
) -> tuple[tuple[int, int], bool]:
    """Width and height of a photo as the model means it; whether as stored, though its header turns it.

    `said` is whether the model says that it is as stored, if it says so.
    """
    upright, stored = photo_size(path), photo_size(path, as_stored=True)
    fits = [_off_px(size, camera) <= tolerance_px for size in (stored, upright)]
    if said is not None:
        fits = [fits[0] and said, fits[1] and not said]
    elif all(fits):
        fits[0] = prefer_as_stored
    if fits[0] and orientation_of(path) != 1:
        return stored, True
    if fits[1]:
        return upright, False
    turned = upright[::-1] == (camera.width, camera.height)
    raise UserError(
        f"{path} is {upright[0]} × {upright[1]} pixels, but its camera in the model is {camera.width} × "
        f"{camera.height}; give the photos that the model was made from"
        + (": this one was turned since, as its EXIF tag had said, and the tag is gone." if turned else ".")
    )


def _off_px(size: tuple[int, int], camera: pycolmap.Camera) -> float:
    """How far one scale is from taking the camera's size to the photo's."""
    width, height = size
    scale = max(width / camera.width, height / camera.height)
    return max(abs(camera.width * scale - width), abs(camera.height * scale - height))


def _at_size(image: pycolmap.Image, name: str, camera: pycolmap.Camera, size: tuple[int, int]) -> PosedImage:
    """An image of the model under its photo's name, its camera and 2-D points at the photo's size."""
    scale = np.array(size) / (camera.width, camera.height)
    resized = pycolmap.Camera(camera.todict())
    if size != (camera.width, camera.height):
        resized.rescale(*size)
    return PosedImage(
        image_id=image.image_id,
        name=name,
        camera=resized,
        cam_from_world=image.cam_from_world(),
        xy=points2d_of(image) * scale,
    )
