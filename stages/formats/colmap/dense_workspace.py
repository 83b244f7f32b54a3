"""COLMAP's dense workspace around images and a sparse model: what its stereo and fusion expect to find."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import cv2
import numpy as np

from pipeline import UserError


def write_stereo_settings(workspace: Path, image_names: Sequence[str], source_images: int = 20) -> None:
    """Write ``stereo/`` as COLMAP's undistorter does: two lists of images, three folders for maps.

    Parameters
    ----------
    workspace : Path
        Holds (or will hold) ``images/`` and ``sparse/``.
    image_names : sequence of str
        Names in the model, sub-folders included.
    source_images : int
        How many neighbours COLMAP's own patch-match picks per image.
    """
    stereo = workspace / "stereo"
    for maps in ("depth_maps", "normal_maps", "consistency_graphs"):
        for name in image_names:
            (stereo / maps / name).parent.mkdir(parents=True, exist_ok=True)
    matched = "".join(f"{name}\n__auto__, {source_images}\n" for name in image_names)
    (stereo / "patch-match.cfg").write_text(matched, encoding="utf-8")
    (stereo / "fusion.cfg").write_text("".join(f"{name}\n" for name in image_names), encoding="utf-8")


def read_posed_image(path: Path) -> np.ndarray:
    """Read an image that the model of a workspace has a pose for, as it is stored: (h, w, 3), uint8, RGB.

    Raises
    ------
    UserError
        It is missing or unreadable.
    """
    data = np.fromfile(path, np.uint8) if path.is_file() else np.zeros(0, np.uint8)
    image = cv2.imdecode(data, cv2.IMREAD_COLOR | cv2.IMREAD_IGNORE_ORIENTATION) if data.size else None
    if image is None:
        raise UserError(f"{path} is missing or unreadable, though the model in sparse/ has a pose for it.")
    return np.ascontiguousarray(image[..., ::-1])
