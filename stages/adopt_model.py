"""Instead of `sfm`: a COLMAP model that exists already, checked against the photos."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Literal

from pipeline import Artefact, Job, Settings, Stage, UserError, setting
from stages.scene.distributions import PICTURES, PYCOLMAP
from stages.scene.wording import listed

if TYPE_CHECKING:
    import pycolmap

    from stages.formats.colmap.assembly import PosedImage


class AdoptModelSettings(Settings):
    """Settings of the `adopt_model` stage."""

    size_tolerance_px: float = setting(
        1.0,
        "Photos at another size than the model's are accepted if their aspect agrees to this many pixels.",
        unit="px",
        ge=0,
        le=16,
    )
    turned_photos: Literal["as_stored", "upright"] = setting(
        "as_stored",
        "How the model means photos that their header turns, where sizes leave both possible (180°, "
        "mirrored, squares). as_stored: as COLMAP takes them, which passes over that tag. upright: the model "
        "comes from a program that obeys it.",
    )


def run(job: Job[AdoptModelSettings]) -> None:
    """Find the model, match it with the photos, save it in binary under the photos' names."""
    from stages.formats.colmap.assembly import assemble
    from stages.formats.colmap.model import find_model, read_model, registered, write_model
    from stages.formats.images.photo_turns import read_as_stored, says_which, write_as_stored

    folder = find_model(job.inputs["colmap"])
    model = read_model(folder)
    photos = _photo_of_each(job, [image.name for image in registered(model)], folder)
    posed, rescaled, as_stored = [], [], []
    listed_as_stored = read_as_stored(folder) if says_which(folder) else None
    for image in registered(model):
        if image.name not in photos:
            continue
        path = job.inputs["images"] / photos[image.name]
        camera = model.cameras[image.camera_id]
        size, turned = _size_in_model(path, photos[image.name], camera, job.settings, listed_as_stored)
        as_stored += [photos[image.name]] * turned
        if size != (camera.width, camera.height):
            rescaled.append(photos[image.name])
        posed.append(_at_size(image, photos[image.name], camera, size))
    if rescaled:
        job.warn(
            f"{len(rescaled)} photos have another size than in the model; their cameras were rescaled: "
            f"{listed(rescaled)}."
        )
    adopted = assemble(posed, points_from=model)
    write_model(adopted, job.outputs["model"])
    write_as_stored(job.outputs["model"], as_stored)
    job.note(
        registered=len(posed),
        points=adopted.num_points3D(),
        camera_models=sorted({camera.model_name for camera in adopted.cameras.values()}),
        rescaled=len(rescaled),
        as_stored=len(as_stored),
    )


def _photo_of_each(job: Job[AdoptModelSettings], names: list[str], source: Path) -> dict[str, str]:
    """The photo of every image of the model: the same name, or the same but for the extension."""
    from stages.formats.images.photo_folder import find_photos
    from stages.scene.cameras import view_name

    by_view = {view_name(photo): photo for photo in find_photos(job.inputs["images"])}
    found = {name: by_view[view_name(name)] for name in names if view_name(name) in by_view}
    missing = [name for name in names if name not in found]
    if not found:
        expected = f"expected {listed(missing)}" if missing else "the model has no image with a pose"
        raise UserError(
            f"No photo in {job.inputs['images']} belongs to the COLMAP model in {source}: {expected}. "
            "Give the image folder that COLMAP was given."
        )
    if missing:
        job.warn(
            f"{len(missing)} of the {len(names)} images of the model have no photo in "
            f"{job.inputs['images']} and are left out: {listed(missing)}."
        )
    return found


def _size_in_model(
    path: Path,
    name: str,
    camera: pycolmap.Camera,
    settings: AdoptModelSettings,
    listed_as_stored: frozenset[str] | None,
) -> tuple[tuple[int, int], bool]:
    """Width and height of a photo as the model means it; whether that is as stored, though tagged as turned.

    `listed_as_stored` are the names of those that a model of our own means as stored, if it says so.
    """
    from stages.formats.images.photos import orientation_of, photo_size

    upright, stored = photo_size(path), photo_size(path, as_stored=True)
    fits = [_off_px(size, camera) <= settings.size_tolerance_px for size in (stored, upright)]
    if listed_as_stored is not None:
        fits = [fits[0] and name in listed_as_stored, fits[1] and name not in listed_as_stored]
    elif all(fits):
        fits[0] = settings.turned_photos == "as_stored"
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
    import numpy as np
    import pycolmap

    from stages.formats.colmap.assembly import PosedImage, points2d_of

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


ADOPT_MODEL = Stage(
    name="adopt_model",
    version=3,
    about="A COLMAP model that exists already, checked against the photos.",
    settings=AdoptModelSettings,
    takes=("colmap", "images"),
    gives=(Artefact("model", "COLMAP sparse model at the photos' own size"),),
    run=run,
    tools=("numpy", *PYCOLMAP, *PICTURES),
    saves_memory="give a model of fewer points",
)
