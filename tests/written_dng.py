"""DNG files for tests: the mosaic of a sensor, as a camera would store it."""

from __future__ import annotations

import struct
from pathlib import Path

import numpy as np

SHORT, LONG, RATIONAL, BYTE, ASCII, SIGNED_RATIONAL = 3, 4, 5, 1, 2, 10
XYZ_TO_SRGB = np.array(
    [
        [3.2404542, -1.5371385, -0.4985314],
        [-0.9692660, 1.8760108, 0.0415560],
        [0.0556434, -0.2040259, 1.0572252],
    ]
)
NEUTRAL = np.array([0.5, 1.0, 0.7])  # what the sensor shows of daylight
OF = 10_000  # denominator of fractions


def write_dng(
    path: Path, linear: np.ndarray, orientation: int = 1, as_shot: np.ndarray = NEUTRAL, black: int = 512
) -> None:
    """Write linear sRGB, (h, w, 3), 0 to 1, as the mosaic (RGGB) of a sensor whose primaries are sRGB's."""
    seen = linear * NEUTRAL
    mosaic = seen[..., 1].copy()
    mosaic[0::2, 0::2], mosaic[1::2, 1::2] = seen[0::2, 0::2, 0], seen[1::2, 1::2, 2]
    codes = np.rint(black + mosaic * (65535 - black)).clip(0, 65535).astype("<u2")
    height, width = codes.shape
    matrix = np.diag(NEUTRAL) @ XYZ_TO_SRGB
    tags = [
        (254, LONG, [0]), (256, LONG, [width]), (257, LONG, [height]), (258, SHORT, [16]), (259, SHORT, [1]),
        (262, SHORT, [32803]), (271, ASCII, b"Unshade\0"), (272, ASCII, b"Test\0"), (273, LONG, [0]),
        (274, SHORT, [orientation]), (277, SHORT, [1]), (278, LONG, [height]), (279, LONG, [codes.nbytes]),
        (33421, SHORT, [2, 2]), (33422, BYTE, [0, 1, 1, 2]), (50706, BYTE, [1, 4, 0, 0]),
        (50707, BYTE, [1, 1, 0, 0]), (50708, ASCII, b"Unshade Test\0"), (50714, LONG, [black]),
        (50717, LONG, [65535]), (50721, SIGNED_RATIONAL, np.rint(OF * matrix.ravel()).astype(int).tolist()),
        (50728, RATIONAL, np.rint(OF * as_shot).astype(int).tolist()), (50778, SHORT, [21]),
    ]  # fmt: skip
    begin = 8 + 2 + 12 * len(tags) + 4
    longer = sum(len(data) + len(data) % 2 for data, _ in map(_packed, tags) if len(data) > 4)
    table = further = b""
    for tag, kind, values in tags:
        data, count = _packed((tag, kind, [begin + longer] if tag == 273 else values))
        if len(data) > 4:
            table += struct.pack("<HHII", tag, kind, count, begin + len(further))
            further += data + bytes(len(data) % 2)
        else:
            table += struct.pack("<HHI", tag, kind, count) + data.ljust(4, b"\0")
    header = struct.pack("<2sHIH", b"II", 42, 8, len(tags))
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_bytes(header + table + struct.pack("<I", 0) + further + codes.tobytes())


def _packed(tag: tuple) -> tuple[bytes, int]:
    _, kind, values = tag
    if kind == ASCII:
        return values, len(values)
    if kind in (RATIONAL, SIGNED_RATIONAL):
        return b"".join(struct.pack("<iI", value, OF) for value in values), len(values)
    return struct.pack(f"<{len(values)}{ {SHORT: 'H', LONG: 'I', BYTE: 'B'}[kind] }", *values), len(values)
