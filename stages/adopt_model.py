"""Instead of `sfm`: a COLMAP model that exists already, checked against the photos."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

from pipeline import Artefact, Job, Settings, Stage, UserError, setting
from stages.scene.distributions import PICTURES, PYCOLMAP
from stages.scene.wording import listed

if TYPE_CHECKING:
    import pycolmap

    from stages.scene.colmap_assembly import PosedImage


class AdoptModelSettings(Settings):
    """Settings of the `adopt_model` stage."""

    size_tolerance_px: float = setting(
        1.0,
        "Photos at another size than the model's are accepted if their aspect agrees to this many pixels.",
        unit="px",
        ge=0,
        le=16,
    )


def run(job: Job) -> None:
    """Find the model, match it with the photos, save it in binary under the photos' names."""
    from stages.scene.colmap_assembly import assemble
    from stages.scene.colmap_model import find_model, read_model, registered
    from stages.scene.photos import photo_size

    folder = find_model(job.inputs["colmap"])
    model = read_model(folder)
    _check_numbers(model, folder)
    photos = _photo_of_each(job, [image.name for image in registered(model)], folder)
    posed, rescaled = [], []
    for image in registered(model):
        if image.name not in photos:
            continue
        path = job.inputs["images"] / photos[image.name]
        camera = model.cameras[image.camera_id]
        size = photo_size(path)
        if size != (camera.width, camera.height):
            _check_aspect(path, size, camera, job.settings.size_tolerance_px)
            rescaled.append(photos[image.name])
        posed.append(_at_size(image, photos[image.name], camera, size))
    if rescaled:
        job.warn(
            f"{len(rescaled)} photos have another size than in the model; their cameras were rescaled: "
            f"{listed(rescaled)}."
        )
    adopted = assemble(posed, points_from=model)
    adopted.write(job.outputs["model"])
    job.note(
        registered=len(posed),
        points=adopted.num_points3D(),
        camera_models=sorted({camera.model_name for camera in adopted.cameras.values()}),
        rescaled=len(rescaled),
    )


def _photo_of_each(job: Job, names: list[str], source: Path) -> dict[str, str]:
    """The photo of every image of the model: the same name, or the same but for the extension."""
    from stages.scene.cameras import view_name
    from stages.scene.photo_folder import find_photos

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


def _check_numbers(model: pycolmap.Reconstruction, source: Path) -> None:
    """Refuse cameras and poses that are not numbers before they spread."""
    import numpy as np

    from stages.scene.colmap_model import registered

    for image in registered(model):
        camera = model.cameras[image.camera_id]
        focal_px = camera.mean_focal_length()
        if not (np.isfinite(camera.params).all() and focal_px > 0 and min(camera.width, camera.height) > 0):
            raise UserError(
                f"Camera {image.camera_id} of the COLMAP model in {source} has impossible parameters "
                f"({camera.width} × {camera.height}, {camera.params_to_string()}); export the model again."
            )
        if not np.isfinite(image.cam_from_world().matrix()).all():
            raise UserError(f"{image.name} in the COLMAP model in {source} has a pose that is not a number.")


def _check_aspect(path: Path, size: tuple[int, int], camera: pycolmap.Camera, tolerance_px: float) -> None:
    """Whether one scale takes the camera's size to the photo's."""
    width, height = size
    scale = max(width / camera.width, height / camera.height)
    off_px = max(abs(camera.width * scale - width), abs(camera.height * scale - height))
    if off_px <= tolerance_px:
        return
    turned = (height, width) == (camera.width, camera.height)
    hint = (
        "it is rotated by its EXIF tag, which the model ignored: undistort in COLMAP first, or remove the tag"
        if turned
        else "give the photos that the model was made from"
    )
    raise UserError(
        f"{path} is {width} × {height} pixels, but its camera in the model is {camera.width} × "
        f"{camera.height}; {hint}."
    )


def _at_size(image: pycolmap.Image, name: str, camera: pycolmap.Camera, size: tuple[int, int]) -> PosedImage:
    """An image of the model under its photo's name, its camera and 2-D points at the photo's size."""
    import numpy as np
    import pycolmap

    from stages.scene.colmap_assembly import PosedImage, points2d_of

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
    version=2,
    about="A COLMAP model that exists already, checked against the photos.",
    settings=AdoptModelSettings,
    takes=("colmap", "images"),
    gives=(Artefact("model", "COLMAP sparse model at the photos' own size"),),
    run=run,
    tools=("numpy", *PYCOLMAP, *PICTURES),
)
