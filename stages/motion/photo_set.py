"""Photos for structure from motion: upright sizes, focal priors, and shared cameras."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path, PurePosixPath

import numpy as np
import pycolmap

from pipeline import UserError
from pipeline.cache.digest import digest_file
from stages.formats.decoders.pictures import exif_of
from stages.formats.images.masked_photos import read_kept
from stages.formats.images.photo_folder import LINEAR
from stages.formats.images.photos import photo_size, read_photo
from stages.motion.features import write_reduced, write_reduced_mask
from stages.motion.positions import Position, position_of

EXIF_DETAILS, FOCAL_LENGTH_35_MM = 0x8769, 0xA405  # a directory of EXIF, and a tag in it
FILM_MM = 35.0  # as COLMAP has it; a frame is 36 mm wide


@dataclass(frozen=True)
class Photo:
    """A readable photo.

    Attributes
    ----------
    name : str
        Path below the image folder, with extension.
    width, height : int
        Upright size, pixels.
    copy : Path
        The reduced 8-bit copy in which features are sought.
    focal_prior_px : float or None
        Focal length that its EXIF data imply.
    linear_sample : ndarray or None
        Values of a linear (EXR, HDR) photo, for the exposure of the set.
    position : Position or None
        Where it was taken, by its EXIF data.
    """

    name: str
    width: int
    height: int
    copy: Path
    focal_prior_px: float | None
    linear_sample: np.ndarray | None = None
    position: Position | None = None


def survey(named: tuple[str, Path], folder: Path, max_size_px: int, samples: int) -> Photo | str:
    """Decode a photo, which shows whether it is whole, and write the reduced copy for feature detection.

    `named`: its name and the path of the copy. Returns the sentence that says what is wrong if it cannot be
    read: it runs in a worker, and a sentence travels better than an exception. A linear photo's copy has to
    wait for the exposure of the set, which about so many `samples` of each are enough for:
    `write_linear_copy`.
    """
    name, copy = named
    path = folder / name
    try:
        linear = read_photo(path)
    except UserError as error:
        return str(error)
    height, width = linear.shape[:2]
    if path.suffix.lower() not in LINEAR:
        write_reduced(linear, copy, max_size_px)
        return Photo(name, width, height, copy, focal_prior(path), position=position_of(path))
    values = linear.ravel()
    sample = values[:: max(1, len(values) // samples)].copy()
    return Photo(name, width, height, copy, None, sample)


def write_linear_copy(photo: Photo, folder: Path, max_size_px: int, exposure: float) -> None:
    """Write the reduced copy of an EXR or HDR photo, brought into [0, 1] by `exposure`."""
    write_reduced(
        np.nan_to_num(read_photo(folder / photo.name) * np.float32(exposure)), photo.copy, max_size_px
    )


def write_mask_of_copy(
    masked: tuple[Photo, Path | None], folder: Path, masks: Path, max_size_px: int, with_alpha: bool
) -> float:
    """Write where features of a photo's copy may lie; returns the share of it. White without a mask.

    Parameters
    ----------
    masked : (Photo, Path or None)
        The photo and its mask; white = keep.
    folder : Path
        Of the photos.
    masks : Path
        Folder of the masks of copies.
    max_size_px : int
        Of the copies.
    with_alpha : bool
        Whether an alpha channel is a mask, too.

    Raises
    ------
    UserError
        As `read_kept`.
    """
    photo, mask = masked
    kept = read_kept(folder / photo.name, mask, (photo.width, photo.height), False, with_alpha)
    write_reduced_mask(kept, photo.copy, masks, max_size_px)
    return float(kept.mean())


def focal_prior(path: Path) -> float | None:
    """Read the focal length, px, from EXIF: 35 mm equivalent, or COLMAP's table of sensors; else None."""
    try:
        camera = pycolmap.infer_camera_from_image(path)
    except (RuntimeError, ValueError):  # a file that COLMAP's reader does not know
        return _from_35_mm(path)
    return float(camera.mean_focal_length()) if camera.has_prior_focal_length else None


def _from_35_mm(path: Path) -> float | None:
    """Convert the 35 mm equivalent as COLMAP does, by the longest side."""
    equivalent = exif_of(path).get_ifd(EXIF_DETAILS).get(FOCAL_LENGTH_35_MM)
    if not isinstance(equivalent, int) or equivalent <= 0:
        return None
    return equivalent / FILM_MM * max(photo_size(path))


def exposure_for_matching(photos: Sequence[Photo], percentile: float) -> float:
    """Find one factor that brings the linear photos of a set into [0, 1], for features only.

    SIFT sees 8-bit sRGB, but rendered or merged images have no set white. A high percentile goes to 1: a lamp
    or a glint may clip, surfaces do not. One factor for all, so that their relative exposure survives.
    """
    samples = [photo.linear_sample for photo in photos if photo.linear_sample is not None]
    values = np.concatenate(samples) if samples else np.zeros(0, np.float32)
    values = values[np.isfinite(values)]
    white = float(np.percentile(values, percentile)) if len(values) else 0.0
    return 1 / white if white > 0 else 1.0


def copies_among(photos: Sequence[Photo]) -> dict[str, str]:
    """Find photos whose size and reduced copy are those of one before: its name, by the copy's name.

    A copy adds nothing, and costs as many comparisons as a photo.
    """
    first: dict[tuple[int, int, str], str] = {}
    copies = {}
    for photo in photos:
        content = photo.width, photo.height, digest_file(photo.copy)
        if content in first:
            copies[photo.name] = first[content]
        else:
            first[content] = photo.name
    return copies


def camera_groups(photos: Sequence[Photo], sharing: str) -> list[int]:
    """Assign photos to cameras: each photo's index, counted from 0 in order of first use.

    Photos share a camera (``"shared"``: all of them, ``"per_folder"``, ``"per_image"``: none) only if size,
    orientation and EXIF focal length agree: a zoom or a turned camera is another camera.
    """
    keys: dict[tuple[int, int, int | None, str], int] = {}
    groups = []
    for photo in photos:
        prior = round(photo.focal_prior_px) if photo.focal_prior_px else None
        where = {"shared": "", "per_folder": str(PurePosixPath(photo.name).parent), "per_image": photo.name}
        groups.append(keys.setdefault((photo.width, photo.height, prior, where[sharing]), len(keys)))
    return groups


def initial_cameras(
    photos: Sequence[Photo],
    groups: Sequence[int],
    model: str,
    params: Sequence[float] | None,
    focal_factor: float,
) -> list[pycolmap.Camera]:
    """Create the COLMAP cameras to start from, one per group, ids from 1.

    `params`, as many as the model takes, if given, else the EXIF focal length, else `focal_factor` × the
    longest side.

    Raises
    ------
    UserError
        There are `params`, and the photos have several sizes.
    """
    if params is not None and len({(photo.width, photo.height) for photo in photos}) > 1:
        raise UserError(
            "camera_params hold for one image size, but the photos have several; leave camera_params out, or "
            "run each size by itself."
        )
    cameras = []
    for group in range(max(groups) + 1):
        photo = photos[groups.index(group)]
        focal = photo.focal_prior_px or focal_factor * max(photo.width, photo.height)
        camera = pycolmap.Camera.create_from_model_name(group + 1, model, focal, photo.width, photo.height)
        camera.has_prior_focal_length = photo.focal_prior_px is not None or params is not None
        if params is not None:
            camera.params = list(params)
        cameras.append(camera)
    return cameras
