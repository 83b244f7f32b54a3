"""Bundler's `bundle.out`, version 0.3, with its list of photos."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import islice
from pathlib import Path

import numpy as np

from pipeline import UserError
from stages.formats.cameras.documents import damaged, number, pose
from stages.formats.cameras.posed_photos import Lens, PosedPhoto, distorted
from stages.scene.poses import with_flipped_camera_axes

HEADER = "# Bundle file v0.3"
LINES = 5  # of a camera: f k1 k2, three rows of R, t
MOST_CAMERAS = 10**6


def photos_of_list(text: str) -> list[str]:
    """List the photos of a `list.txt`: the first word of each line; others tell their focal lengths."""
    return [line.split()[0] for line in text.splitlines() if line.strip()]


def posed_photos_of_bundle(text: str, photos: Sequence[str], source: Path) -> list[PosedPhoto]:
    """Read the cameras of a bundle: its i-th is of the i-th photo; those of focal length 0 have no pose.

    x = −P / P_z with P = R X + t, and p = f (1 + k₁ |x|² + k₂ |x|⁴) x from the middle of the image, y up.

    Parameters
    ----------
    text : str
    photos : sequence of str
        Of the list beside it, or all photos in order of their names.
    source : Path
        For messages.

    Raises
    ------
    UserError
        It is cut off or damaged, or of another number of photos.
    """
    lines = [line for line in text.splitlines() if line.strip()]
    if not lines or not lines[0].startswith(HEADER):
        raise damaged(source, f"it begins with {lines[0][:80] if lines else ''!r}, expected {HEADER!r}")
    count = number((lines[1].split() or [""])[0] if len(lines) > 1 else "", "the number of cameras", source)
    if count != int(count) or not 0 <= count <= MOST_CAMERAS:
        raise damaged(source, f"it promises {count:g} cameras")
    if int(count) != len(photos):
        raise UserError(
            f"{source} has {count:g} cameras, but there are {len(photos)} photos; expected a list of them, "
            "list.txt, beside it or in the folder above, or a folder with these photos alone."
        )
    rows = [line.split() for line in islice(lines, 2, 2 + LINES * int(count))]
    if len(rows) < LINES * int(count):
        raise damaged(source, f"it promises {count:g} cameras and ends after {len(rows) // LINES}")
    blocks = (rows[first : first + LINES] for first in range(0, len(rows), LINES))
    posed = (_posed(block, photo, source) for block, photo in zip(blocks, photos, strict=True))
    return [one for one in posed if one is not None]


def _posed(rows: Sequence[Sequence[str]], photo: str, source: Path) -> PosedPhoto | None:
    """One camera; None where it has no pose."""
    what = f"a camera (of {photo})"
    if any(len(row) != 3 for row in rows):
        raise damaged(source, f"{what} has other than five rows of three numbers")
    values = np.array([[number(word, what, source) for word in row] for row in rows])
    focal, k1, k2 = map(float, values[0])
    if focal == 0:
        return None
    model, distortion, _ = distorted((k1, k2, 0.0, 0.0), (0.0, 0.0))
    cam_from_world = with_flipped_camera_axes(pose(values[1:4], values[4], photo, source))
    return PosedPhoto(photo, Lens(model, distortion, focal_px=(focal, focal)), cam_from_world)
