"""Plain matrices: a line for each photo, or a file for each (Middlebury, PMVS, one's own calibration)."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path

import numpy as np

from pipeline import UserError
from stages.formats.cameras.documents import damaged, number, pose
from stages.formats.cameras.posed_photos import Lens, PosedPhoto
from stages.scene.cameras import intrinsics_from_first_pixel

APART, AS_ONE = 21, 12  # numbers of a photo: K, R and t, or P = K [R t], row by row
PMVS = "CONTOUR"  # the first line of a file of PMVS


def posed_photos_of_lines(text: str, first_pixel_px: float, source: Path) -> list[PosedPhoto]:
    """Read lines of a photo's name and its numbers; a line with the number of photos may come first.

    ``#`` after a space, or at the beginning of a line, begins a comment.

    Parameters
    ----------
    text : str
        Numbers of a photo: K, R and t row by row (21, as Middlebury has them), or P = K [R t] (12).
    first_pixel_px : float
        Coordinates of the first pixel's centre.
    source : Path
        For messages.

    Raises
    ------
    UserError
        A line has another number of numbers, or these are of no camera.
    """
    lines = [words for line in text.splitlines() if (words := f" {line}".partition(" #")[0].split())]
    if lines and len(lines[0]) == 1 and lines[0][0].isdecimal():
        promised, lines = int(lines[0][0]), lines[1:]
        if promised != len(lines):
            raise damaged(source, f"it promises {promised} photos and has {len(lines)}")
    return [_posed(line[0], line[1:], first_pixel_px, source) for line in lines]


def posed_photos_of_files(texts: Mapping[str, str], first_pixel_px: float, source: Path) -> list[PosedPhoto]:
    """Read a file for each photo, named like it, of 12 or 21 numbers; the first line may be PMVS's.

    Raises
    ------
    UserError
        A file has another number of numbers, or these are of no camera.
    """
    return [
        _posed(name, text.removeprefix(PMVS).split(), first_pixel_px, source) for name, text in texts.items()
    ]


def _posed(name: str, words: list[str], first_pixel_px: float, source: Path) -> PosedPhoto:
    if len(words) not in (APART, AS_ONE):
        raise UserError(
            f"{source} has {len(words)} numbers for {name[:80]}; expected {APART} (K, R and t, row by row) "
            f"or {AS_ONE} (P = K [R t])."
        )
    values = np.array([number(word, f"a number of {name[:80]}", source) for word in words])
    if len(values) == APART:
        intrinsics, rotation, t = values[:9].reshape(3, 3), values[9:18].reshape(3, 3), values[18:]
    else:
        intrinsics, rotation, t = _factors(values.reshape(3, 4), name, source)
    if abs(intrinsics[2, 2]) < np.finfo(float).tiny or intrinsics[1, 0] or intrinsics[2, :2].any():
        raise damaged(source, f"K of {name[:80]} is not upper triangular with a last entry")
    K = intrinsics_from_first_pixel(intrinsics / intrinsics[2, 2], first_pixel_px)
    lens = Lens(
        "PINHOLE",
        focal_px=(float(K[0, 0]), float(K[1, 1])),
        centre_px=(float(K[0, 2]), float(K[1, 2])),
        skew_px=float(K[0, 1]),
    )
    return PosedPhoto(name, lens, pose(rotation, t, name, source))


def _factors(P: np.ndarray, name: str, source: Path) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """K, R and t of P ~ K [R t], with positive focal lengths, whatever P's scale and sign."""
    largest = np.abs(P[:, :3]).max()
    P = P / largest if largest > 0 else P
    P = P if np.linalg.det(P[:, :3]) > 0 else -P
    if np.linalg.matrix_rank(P[:, :3]) < 3:
        raise damaged(source, f"P of {name[:80]} is of no camera with a place")
    # K R = M, so that M⁻¹ = Rᵀ K⁻¹: a rotation times an upper triangular matrix.
    turned, upper = np.linalg.qr(np.linalg.inv(P[:, :3]))
    signs = np.diag(np.sign(np.diag(upper)))
    K = np.triu(np.linalg.inv(signs @ upper))
    return K, (turned @ signs).T, np.linalg.solve(K, P[:, 3])
