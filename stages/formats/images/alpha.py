"""Alpha channels of photos, as masks."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from stages.formats.decoders.heif import heif_alpha
from stages.formats.decoders.pictures import DECODING_FAILED, opened, turned_back, unreadable, upright
from stages.formats.images.exr import read_exr_alpha
from stages.formats.images.photos import orientation_of, photo_size
from stages.scene.image_names import CAMERA_RAW, HEIF

OPAQUE = 0.5  # from here on; as of masks


def read_alpha(path: Path, as_stored: bool = False) -> np.ndarray | None:
    """Read which pixels of a photo are opaque, at least by half: (h, w), bool, upright or as stored.

    None where the photo has no alpha channel, or one that is opaque everywhere.

    Raises
    ------
    UserError
        The photo is unreadable.
    """
    photo_size(path)
    suffix = path.suffix.lower()
    if suffix == ".hdr" or suffix in CAMERA_RAW:
        return None
    if suffix == ".exr":
        alpha = read_exr_alpha(path)
        opaque = None if alpha is None else alpha >= OPAQUE
    elif suffix in HEIF:
        codes = heif_alpha(path)
        opaque = None if codes is None else _at_least_half(codes)
    else:
        opaque = _opaque_by_pillow(path)
    if opaque is None or opaque.all():
        return None
    return turned_back(opaque, orientation_of(path)) if as_stored else opaque


def _opaque_by_pillow(path: Path) -> np.ndarray | None:
    """Decode the alpha of JPEG's kin; of palettes, their transparent colours."""
    with opened(path) as image:
        try:
            if not image.has_transparency_data:
                return None
            is_tiff = image.format == "TIFF"
            image.load()  # which turns TIFF upright
            alpha = np.asarray(image.convert("RGBA").getchannel("A"))
        except DECODING_FAILED as error:
            raise unreadable(path, error) from error
    opaque = _at_least_half(alpha)
    return opaque if is_tiff else upright(opaque, orientation_of(path))


def _at_least_half(alpha: np.ndarray) -> np.ndarray:
    return alpha >= OPAQUE * np.iinfo(alpha.dtype).max
