"""Meshes that promise too much, name what is not there, or are no numbers: a sentence, in little memory."""

from __future__ import annotations

import json
import os
import struct
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from tests.faults.command_lines import Answer, answers_of, expect_refusal, obey
from tests.faults.program import LINEAR

SQUARE = [(0, 0, 0), (1, 0, 0), (1, 1, 0), (0, 1, 0)]
PROMISES, NO_VERTEX, NOT_FINITE = "promises", "that name vertices", "not finite numbers"
UNTYPED, TOO_FAR, UNSEEN = "not of the type that the header declares", "with a coordinate of", "No view sees"
HUGE = [10**9, 10**12, 2**63, 10**30]


def ply(
    form: str,
    body: bytes,
    vertices: object = 4,
    faces: object = 1,
    sizes: str = "uchar",
    corners: str = "int",
) -> bytes:
    lines = ["ply", f"format {form} 1.0", f"element vertex {vertices}"]
    lines += [f"property float {axis}" for axis in "xyz"]
    lines += [f"element face {faces}", f"property list {sizes} {corners} vertex_indices", "end_header", ""]
    return "\n".join(lines).encode() + body


def text_ply(face: str, **header: Any) -> bytes:
    return ply("ascii", "".join(f"{x} {y} {z}\n" for x, y, z in SQUARE).encode() + face.encode(), **header)


def binary_ply(body: bytes, **header: Any) -> bytes:
    return ply("binary_little_endian", np.array(SQUARE, "<f4").tobytes() + body, **header)


def far_corner(value: str) -> dict[str, bytes]:
    """Triangles with one coordinate of that value, in four formats."""
    rows = f"0 0 0\n1 0 0\n{value} 1 0\n"
    vertices = rows.splitlines()
    stl = "".join(f"vertex {row}\n" for row in vertices)
    return {
        "ply": ply("ascii", f"{rows}3 0 1 2\n".encode(), vertices=3),
        "obj": ("".join(f"v {row}\n" for row in vertices) + "f 1 2 3\n").encode(),
        "off": f"OFF\n3 1 0\n{rows}3 0 1 2\n".encode(),
        "stl": f"solid\nfacet normal 0 0 1\nouter loop\n{stl}endloop\nendfacet\nendsolid\n".encode(),
    }


BUFFER = np.array([0, 0, 0, 1, 0, 0, 0, 1, 0], "<f4").tobytes() + np.array([0, 1, 2, 0], "<u2").tobytes()
POSITIONS = {"bufferView": 0, "componentType": 5126, "count": 3, "type": "VEC3"}
INDICES = {"bufferView": 1, "componentType": 5123, "count": 3, "type": "SCALAR"}
VIEWS = [{"buffer": 0, "byteOffset": 0, "byteLength": 36}, {"buffer": 0, "byteOffset": 36, "byteLength": 6}]


def glb(buffer: bytes = BUFFER, **changed: Any) -> bytes:
    content = {
        "asset": {"version": "2.0"},
        "scene": 0,
        "scenes": [{"nodes": [0]}],
        "nodes": [{"mesh": 0}],
        "meshes": [{"primitives": [{"attributes": {"POSITION": 0}, "indices": 1}]}],
        "buffers": [{"byteLength": len(buffer)}],
        "bufferViews": VIEWS,
        "accessors": [POSITIONS, INDICES],
    } | changed
    return glb_of(json.dumps(content).encode(), buffer)


def glb_of(text: bytes, buffer: bytes = BUFFER) -> bytes:
    text += b" " * (-len(text) % 4)
    body = (
        struct.pack("<I4s", len(text), b"JSON") + text + struct.pack("<I4s", len(buffer), b"BIN\0") + buffer
    )
    return b"glTF" + struct.pack("<II", 2, 12 + len(body)) + body


MESHES: dict[str, tuple[bytes, str]] = {
    "quad to 2^40.ply": (text_ply(f"4 0 1 2 {2**40}\n"), UNTYPED),
    "quad to 2^32+1.ply": (text_ply(f"4 0 1 2 {2**32 + 1}\n"), UNTYPED),
    "quad to -1.ply": (text_ply("4 0 1 2 -1\n"), NO_VERTEX),
    "quad to 2^32-1.ply": (text_ply(f"4 0 1 2 {2**32 - 1}\n", corners="uint"), NO_VERTEX),
    "quad to 1e300.ply": (text_ply("4 0 1 2 1e300\n"), UNTYPED),
    "quad to nan.ply": (text_ply("4 0 1 2 nan\n"), UNTYPED),
    "corner 2.5.ply": (text_ply("4 0 1 2.5 3\n", corners="float"), "no whole numbers"),
    "259 corners.ply": (text_ply("259 " + "0 1 2 " * 86 + "0\n"), UNTYPED),
    "4 and 2^33.ply": (text_ply(f"4 0 1 2 3\n3 0 1 {2**33}\n", faces=2), UNTYPED),
    "list of 2^32.ply": (binary_ply(struct.pack("<I", 2**32 - 1) + bytes(12), sizes="uint"), PROMISES),
    "list of -5.ply": (binary_ply(struct.pack("<i", -5) + bytes(12), sizes="int"), PROMISES),
    "60000 properties.ply": (
        b"ply\nformat ascii 1.0\nelement vertex 1\n" + b"property char x\n" * 60000 + b"end_header\n",
        "more than 256 properties",
    ),
    "30000 elements.ply": (
        b"ply\nformat ascii 1.0\n" + b"element vertex 100000000000\n" * 30000 + b"end_header\n",
        "no vertices with x",
    ),
    "endless header.ply": (b"ply\n" + b"comment x\n" * 300_000, "no PLY header"),
    "one vertex.ply": (text_ply("3 0 0 0\n"), UNSEEN),
    "big index.obj": (b"v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 99999999999999999999\n", "names nothing"),
    "index 2^62.obj": (f"v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 {2**62}\n".encode(), NO_VERTEX),
    "index -99.obj": (b"v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 -99\n", "names nothing"),
    "index 0.obj": (b"v 0 0 0\nv 1 0 0\nv 0 1 0\nf 0 1 2\n", "names nothing"),
    "big index.off": (b"OFF\n3 1 0\n0 0 0\n1 0 0\n0 1 0\n3 0 1 99999999999999999999999\n", "as OFF"),
    "big face.off": (b"OFF\n3 1 0\n0 0 0\n1 0 0\n0 1 0\n99999999999999999999999 0 1 2\n", "as OFF"),
    "2^32 triangles.stl": (bytes(80) + struct.pack("<I", 2**32 - 1) + bytes(50), "as STL"),
    "nan.stl": (bytes(80) + struct.pack("<I", 1) + struct.pack("<12f", *[np.nan] * 12) + b"\0\0", NOT_FINITE),
    "zeros.glb": (glb(accessors=[{**POSITIONS, "count": 10**10}, INDICES]), PROMISES),
    "zeros without data.glb": (
        glb(accessors=[{"componentType": 5126, "count": 10**10, "type": "VEC3"}, INDICES]),
        PROMISES,
    ),
    "zeros unused.glb": (
        glb(accessors=[POSITIONS, INDICES, {"componentType": 5126, "count": 10**11, "type": "MAT4"}]),
        PROMISES,
    ),
    "many views.glb": (
        glb(BUFFER + bytes(200_000), bufferViews=VIEWS + [{"buffer": 0, "byteLength": 200_000}] * 2000),
        PROMISES,
    ),
    "many nodes.glb": (glb(scenes=[{"nodes": list(range(20_000))}], nodes=[{"mesh": 0}] * 20_000), "nodes"),
    "loop.glb": (glb(nodes=[{"mesh": 0, "children": [0]}]), "a node is there twice"),
    "nested.glb": (glb_of(b"[" * 100_000), "does not hold"),
    "count -3.glb": (glb(accessors=[{**POSITIONS, "count": -3}, INDICES]), PROMISES),
    "offset 2^62.glb": (glb(accessors=[{**POSITIONS, "byteOffset": 2**62}, INDICES]), "are not there"),
    "stride 2^62.glb": (glb(bufferViews=[{**VIEWS[0], "byteStride": 2**62}, VIEWS[1]]), "are not there"),
    "corner 60000.glb": (glb(BUFFER[:36] + np.array([0, 1, 60000, 0], "<u2").tobytes()), "vertex 60000 of 3"),
    "other file.glb": (glb(buffers=[{"byteLength": 44, "uri": "/etc/passwd"}]), "data in another file"),
    "address.glb": (glb(buffers=[{"byteLength": 44, "uri": "http://127.0.0.1:1/"}]), "data in another file"),
    "nan matrix.glb": (glb(nodes=[{"mesh": 0, "matrix": [np.nan] * 16}]), NOT_FINITE),
    "huge scale.glb": (glb(nodes=[{"mesh": 0, "scale": [1e300] * 3}]), TOO_FAR),
}
for number in HUGE:
    MESHES |= {
        f"{number} vertices.ply": (text_ply("3 0 1 2\n", vertices=number), PROMISES),
        f"{number} faces.ply": (text_ply("3 0 1 2\n", faces=number), PROMISES),
        f"{number} binary vertices.ply": (binary_ply(b"", vertices=number), PROMISES),
        f"{number} vertices.off": (f"OFF\n{number} 1 0\n0 0 0\n".encode(), PROMISES),
    }
for value, says in {"nan": NOT_FINITE, "inf": NOT_FINITE, "1e400": NOT_FINITE, "1e20": TOO_FAR}.items():
    MESHES |= {f"{value}.{suffix}": (data, says) for suffix, data in far_corner(value).items()}
MESHES |= {f"empty.{suffix}": (b"", "") for suffix in ("ply", "obj", "off", "stl", "glb")}
MESHES |= {f"noise.{suffix}": (bytes(range(256)) * 20, "") for suffix in ("ply", "obj", "off", "stl", "glb")}


def words(folder: Path, mesh: str | Path) -> list[str | Path]:
    start = ["run", "--colmap", LINEAR, "--images", LINEAR / "images", "--mesh", mesh]
    return [
        *start,
        "--workspace",
        folder / "workspace",
        "--to",
        "raycast",
        "--set",
        "undistort.max_size_px=64",
    ]


@pytest.fixture(scope="module")
def refusals(tmp_path_factory, tried) -> dict[str, tuple[Answer, str]]:
    """What every mesh came to, all in one workspace, and what is to be said of it."""
    folder = tmp_path_factory.mktemp("meshes")
    for name, (data, _) in MESHES.items():
        (folder / name).write_bytes(data)
    tried("hostile meshes", "refused in a sentence", len(MESHES))
    return answers_of({name: (words(folder, name), says) for name, (_, says) in MESHES.items()}, folder)


@pytest.mark.parametrize("name", MESHES)
def test_it_is_refused_in_a_sentence_at_once_and_in_little_memory(refusals, name):
    answer, says = refusals[name]
    expect_refusal(answer, says, most_mb=700)


def test_pipes_devices_and_folders_are_never_opened(tmp_path, tried):
    os.mkfifo(tmp_path / "pipe.ply")
    (tmp_path / "device.ply").symlink_to("/dev/zero")
    (tmp_path / "folder.ply").mkdir()
    says = {"pipe": "is a named pipe", "device": "is a device", "folder": "is a folder"}
    for answer, kind in zip(
        obey([words(tmp_path, f"{name}.ply") for name in says], tmp_path), says, strict=True
    ):
        expect_refusal(answer, says[kind], most_mb=300)
    tried("pipes, devices and folders as mesh", "refused in a sentence", len(says))
