"""COLMAP models of posed photos: cameras and poses, without points."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from pathlib import Path

import numpy as np
import pycolmap

from pipeline import UserError
from stages.formats.cameras.posed_photos import Lens, PosedPhoto, Size
from stages.formats.colmap.assembly import PosedImage, assemble
from stages.formats.colmap.plausible_cameras import check_cameras


def model_of_posed_photos(
    posed: Sequence[PosedPhoto],
    photos: Mapping[str, str],
    size_of: Callable[[str], Size],
    most_dropped_px: float,
    source: Path,
) -> pycolmap.Reconstruction:
    """Build a model of the posed photos that are there, under their own names, in order of them.

    Parameters
    ----------
    posed : sequence of PosedPhoto
    photos : mapping of str to str
        Photo by the path that the file has.
    size_of : callable
        Width and height of a photo, px, of lenses that do not tell theirs.
    most_dropped_px : float
        By which terms of a lens that COLMAP lacks may move a pixel.
    source : Path
        For messages.

    Raises
    ------
    UserError
        A lens or pose is impossible, or has terms that COLMAP lacks.
    """
    there = sorted((photos[one.path], one) for one in posed if one.path in photos)
    images = []
    for index, (photo, one) in enumerate(there):
        size = one.lens.size or size_of(photo)
        lens = _lens_in_colmap(one.lens, size, photo, most_dropped_px, source)
        camera = pycolmap.Camera(
            model=lens.model,
            width=size[0],
            height=size[1],
            params=list(lens.parameters(size)),
            has_prior_focal_length=True,
        )
        pose = pycolmap.Rigid3d(one.cam_from_world)
        images.append(PosedImage(index + 1, photo, camera, pose, np.zeros((0, 2))))
    model = assemble(images)
    check_cameras(model, source)
    return model


def _lens_in_colmap(lens: Lens, size: Size, photo: str, most_px: float, source: Path) -> Lens:
    """Express a lens in COLMAP's models; one that these would change visibly is refused."""
    fx, fy = lens.parameters(size)[:2]
    if min(fx, fy) <= 0:
        raise UserError(
            f"The camera of {photo} in {source} has a focal length of {min(fx, fy):g} px; expected a "
            "positive one. Export the cameras again."
        )
    lens = lens.at(size)
    if not (off_px := lens.dropped_px(size)) <= most_px:
        raise UserError(
            f"The lens of {photo} in {source} has skew or a radial term of the eighth power, which move "
            f"pixels by up to {off_px:.3g} px and which COLMAP's lens models lack; expected at most "
            f"{most_px:g} px (adopt_cameras.dropped_terms_px). Calibrate without these terms, or undistort "
            "the photos first."
        )
    return lens
