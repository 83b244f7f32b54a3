"""Instead of `sfm`: a COLMAP model that exists already, checked against the photos."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

from pipeline import Artefact, Job, Settings, Stage, UserError
from stages.scene.adoption_settings import SIZE_TOLERANCE_PX, TURNED_PHOTOS, TurnedPhotos
from stages.scene.distributions import PICTURES, PYCOLMAP
from stages.scene.wording import listed


class AdoptModelSettings(Settings):
    """Settings of the `adopt_model` stage."""

    size_tolerance_px: float = SIZE_TOLERANCE_PX
    turned_photos: TurnedPhotos = TURNED_PHOTOS


def run(job: Job[AdoptModelSettings]) -> None:
    """Find the model, match it with the photos, save it in binary under the photos' names."""
    from stages.formats.colmap.adoption import adopt_images, save_adopted
    from stages.formats.colmap.model import find_model, read_model, registered
    from stages.formats.images.photo_turns import read_as_stored, says_which

    folder = find_model(job.inputs["colmap"])
    model = read_model(folder)
    adopted = adopt_images(
        model,
        _photo_of_each(job, [image.name for image in registered(model)], folder),
        job.inputs["images"],
        job.settings.size_tolerance_px,
        job.settings.turned_photos == "as_stored",
        read_as_stored(folder) if says_which(folder) else None,
    )
    save_adopted(job, adopted, points_from=model)


def _photo_of_each(job: Job[AdoptModelSettings], names: list[str], source: Path) -> dict[str, str]:
    """The photo of every image of the model: the same name, or the same but for the extension."""
    from stages.formats.colmap.adoption import warn_of_missing
    from stages.formats.images.photo_folder import find_photos
    from stages.scene.image_names import view_as_typed

    by_view = {view_as_typed(photo): photo for photo in find_photos(job.inputs["images"])}
    found = {name: by_view[view_as_typed(name)] for name in names if view_as_typed(name) in by_view}
    missing = [name for name in names if name not in found]
    if not found:
        expected = f"expected {listed(missing)}" if missing else "the model has no image with a pose"
        raise UserError(
            f"No photo in {job.inputs['images']} belongs to the COLMAP model in {source}: {expected}. "
            "Give the image folder that COLMAP was given."
        )
    warn_of_missing(job, missing, len(names))
    return found


def in_words(facts: Mapping[str, Any]) -> str:
    """Tell in a few words what was found."""
    return f"{facts['registered']} cameras ({', '.join(facts['camera_models'])}), {facts['points']:,} points"


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
    found=in_words,
)
