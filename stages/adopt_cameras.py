"""Instead of `sfm`: cameras that another program found, checked against the photos (`--cameras FILE`)."""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING, Any

from pipeline import Artefact, Job, Settings, Stage, UserError, setting
from stages.scene.adoption_settings import SIZE_TOLERANCE_PX, TURNED_PHOTOS, TurnedPhotos
from stages.scene.distributions import PICTURES, PYCOLMAP
from stages.scene.wording import listed

if TYPE_CHECKING:
    from stages.formats.cameras.posed_photos import PosedPhoto


class AdoptCamerasSettings(Settings):
    """Settings of the `adopt_cameras` stage."""

    size_tolerance_px: float = SIZE_TOLERANCE_PX
    turned_photos: TurnedPhotos = TURNED_PHOTOS
    first_pixel_px: float = setting(
        0.0,
        "Coordinates of the centre of the first pixel in files of plain matrices: 0 as OpenCV has them, 0.5 "
        "as COLMAP, 1 as Matlab. The other formats say it themselves.",
        unit="px",
        ge=0,
        le=1,
    )
    dropped_terms_px: float = setting(
        0.3,
        "No lens model of COLMAP has skew, which is dropped, or radial terms of the eighth power, which a "
        "ratio of polynomials stands for. A lens that is off by more than this anywhere in the photo is "
        "refused: calibrations of drones have a skew of 0.2.",
        unit="px",
        ge=0,
        le=10,
    )


def run(job: Job[AdoptCamerasSettings]) -> None:
    """Read the cameras, match them with the photos, save them as a COLMAP model without points."""
    from stages.formats.cameras.camera_files import read_posed_photos
    from stages.formats.cameras.colmap_model import model_of_posed_photos
    from stages.formats.colmap.adoption import adopt_images, save_adopted
    from stages.formats.images.photo_folder import find_photos
    from stages.formats.images.photos import photo_size

    settings, source, folder = job.settings, job.inputs["camera_file"], job.inputs["images"]
    as_stored, photos = settings.turned_photos == "as_stored", find_photos(folder)
    posed = read_posed_photos(source, photos, job.inputs.get("photo_list"), settings.first_pixel_px)
    model = model_of_posed_photos(
        posed,
        _photo_of_each(job, posed, photos),
        lambda photo: photo_size(folder / photo, as_stored),
        settings.dropped_terms_px,
        source,
    )
    names = {image.name: image.name for image in model.images.values()}
    adopted = adopt_images(model, names, folder, settings.size_tolerance_px, as_stored)
    save_adopted(job, adopted, points_from=model)


def _photo_of_each(
    job: Job[AdoptCamerasSettings], posed: list[PosedPhoto], photos: list[str]
) -> dict[str, str]:
    """The photo of every pose; a warning of those without."""
    from stages.formats.cameras.photo_paths import photo_of_each_path
    from stages.formats.colmap.adoption import warn_of_missing

    source, paths = job.inputs["camera_file"], [one.path for one in posed]
    found = photo_of_each_path(paths, photos, source)
    missing = [path for path in paths if path not in found]
    if not found:
        raise UserError(
            f"No photo in {job.inputs['images']} belongs to the cameras in {source}: expected "
            f"{listed(missing)}. Give the folder of the photos that these cameras took."
        )
    warn_of_missing(job, missing, len(paths))
    return found


def in_words(facts: Mapping[str, Any]) -> str:
    """Tell in a few words what was found."""
    return f"{facts['registered']} cameras ({', '.join(facts['camera_models'])}), {facts['points']:,} points"


ADOPT_CAMERAS = Stage(
    name="adopt_cameras",
    version=1,
    about="Cameras that another program found, checked against the photos.",
    settings=AdoptCamerasSettings,
    takes=("camera_file", "images"),
    may_take=("photo_list",),
    gives=(Artefact("model", "COLMAP model without points, at the photos' own size"),),
    run=run,
    tools=("numpy", *PYCOLMAP, *PICTURES),
    saves_memory="give a file of cameras without points",
    found=in_words,
)
