"""Alpha channels of photos, as masks."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from stages.formats.images.exr import read_exr_alpha
from stages.formats.images.photos import (
    DECODING_FAILED,
    opened,
    orientation_of,
    photo_size,
    turned_back,
    unreadable,
    upright,
)

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
    if suffix == ".hdr":
        return None
    if suffix == ".exr":
        alpha = read_exr_alpha(path)
        opaque = None if alpha is None else alpha >= OPAQUE
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
    opaque = alpha >= OPAQUE * np.iinfo(alpha.dtype).max
    return opaque if is_tiff else upright(opaque, orientation_of(path))
