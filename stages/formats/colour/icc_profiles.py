"""Embedded ICC profiles of three curves and a matrix, or of one curve (grey): from codes to linear sRGB.

Pillow converts 8 bits only, and clips; photos of 16 bits and wide gamuts need neither. Format: ICC.1:2022,
sections 7 (header, tags), 10.6 (curveType), 10.18 (parametricCurveType), 10.31 (XYZType).
"""

from __future__ import annotations

import struct
from dataclasses import dataclass
from functools import lru_cache

import numpy as np

HEADER_BYTES, ENTRY = 128, ">4sII"
MOST_TAGS, MOST_SAMPLES = 100, 1 << 16
FIXED_ONE = 65536.0  # of s15Fixed16Number
PARAMETERS = (1, 3, 4, 5, 7)  # of parametricCurveType, by kind
# Colorants of sRGB, adapted to D50 as in every profile (IEC 61966-2-1, Bradford).
SRGB_IN_D50 = np.array(
    [
        [0.43606567, 0.38514709, 0.14306641],
        [0.22248840, 0.71687317, 0.06060791],
        [0.01391602, 0.09707642, 0.71409607],
    ]
)
NEAR = 0.003  # of an entry of the matrix to linear sRGB, for profiles that mean sRGB


@dataclass(frozen=True, eq=False)
class Profile:
    """What codes mean.

    Attributes
    ----------
    curves : tuple of bytes
        Curve tags, of red, green, blue or of grey.
    to_srgb : ndarray, shape (3, 3), or None
        From linear values of the profile to linear sRGB; None for grey.
    """

    curves: tuple[bytes, ...]
    to_srgb: np.ndarray | None

    def linear(self, encoded: np.ndarray) -> np.ndarray:
        """Decode codes, (h, w, 3) or (h, w), uint8 or uint16, to linear sRGB, float32, (h, w, 3) or (h, w).

        Colours beyond the gamut of sRGB are above 1; what would be negative is 0.
        """
        greatest = np.iinfo(encoded.dtype).max
        tables = [_table(curve, greatest) for curve in self.curves]
        if encoded.ndim == 2:
            return tables[min(1, len(tables) - 1)][encoded]
        if self.to_srgb is None:
            return tables[0][encoded]
        decoded = np.stack([tables[c][encoded[..., c]] for c in range(3)], axis=-1)
        return np.maximum(decoded @ self.to_srgb.T.astype(np.float32), 0)


def read_profile(data: bytes) -> Profile | None:
    """Read a profile; None where it is of another kind (tables, CMYK, Lab), or damaged."""
    try:
        space, connection = data[16:20], data[20:24]
        tags = _tags(data)
        if b"A2B0" in tags or connection != b"XYZ ":
            return None
        if space == b"GRAY":
            return _checked(Profile((tags[b"kTRC"],), None))
        if space != b"RGB ":
            return None
        colorants = np.stack([_xyz(tags[name]) for name in (b"rXYZ", b"gXYZ", b"bXYZ")], axis=1)
        matrix = np.linalg.inv(SRGB_IN_D50) @ colorants
        matrix = np.eye(3) if np.abs(matrix - np.eye(3)).max() < NEAR else matrix
        return _checked(Profile((tags[b"rTRC"], tags[b"gTRC"], tags[b"bTRC"]), matrix))
    except (KeyError, ValueError, IndexError, struct.error):
        return None


def _checked(profile: Profile) -> Profile:
    """Make sure that every curve can be read.

    Raises
    ------
    ValueError
        One is of an unknown kind, falls, or leaves the numbers.
    """
    for curve in profile.curves:
        table = _table(curve, 255)
        if not np.isfinite(table).all() or (np.diff(table) < 0).any():
            raise ValueError("a curve falls")
    return profile


def _tags(data: bytes) -> dict[bytes, bytes]:
    (count,) = struct.unpack_from(">I", data, HEADER_BYTES)
    if count > MOST_TAGS:
        raise ValueError("too many tags")
    found = {}
    for number in range(count):
        entry = HEADER_BYTES + 4 + struct.calcsize(ENTRY) * number
        name, offset, size = struct.unpack_from(ENTRY, data, entry)
        if offset + size > len(data):
            raise ValueError("a tag lies beyond the end")
        found[name] = data[offset : offset + size]
    return found


def _xyz(tag: bytes) -> np.ndarray:
    if tag[:4] != b"XYZ ":
        raise ValueError("no XYZ")
    return np.array(struct.unpack_from(">3i", tag, 8)) / FIXED_ONE


@lru_cache(maxsize=16)
def _table(curve: bytes, greatest: int) -> np.ndarray:
    """Evaluate a curve at all codes from 0 to the greatest, float32."""
    x = np.arange(greatest + 1) / greatest
    if curve[:4] == b"curv":
        (count,) = struct.unpack_from(">I", curve, 8)
        if count == 0:
            return x.astype(np.float32)
        if count > MOST_SAMPLES:
            raise ValueError("a curve of too many samples")
        values = np.frombuffer(curve, ">u2", count, 12).astype(float)
        if count == 1:
            return (x ** (values[0] / 256)).astype(np.float32)
        return np.interp(x, np.linspace(0, 1, count), values / 65535).astype(np.float32)
    if curve[:4] != b"para":
        raise ValueError("an unknown kind of curve")
    (kind,) = struct.unpack_from(">H", curve, 8)
    given = np.array(struct.unpack_from(f">{PARAMETERS[kind]}i", curve, 12)) / FIXED_ONE
    return _parametric(x, kind, given).astype(np.float32)


def _parametric(x: np.ndarray, kind: int, given: np.ndarray) -> np.ndarray:
    """Evaluate Y = (aX + b)^g + e where X is at least d, else cX + f (table 68, all kinds as the last)."""
    g = given[0]
    a, b = (given[1], given[2]) if kind else (1.0, 0.0)
    c, d, e, f = 0.0, -np.inf, 0.0, 0.0
    if kind in (1, 2):
        d = -b / a
        e = f = given[3] if kind == 2 else 0.0
    elif kind >= 3:
        c, d = given[3], given[4]
        e, f = (given[5], given[6]) if kind == 4 else (0.0, 0.0)
    return np.where(x >= d, np.maximum(a * x + b, 0) ** g + e, c * x + f)
