"""Photos and masks that promise too much, are damaged, no files or no light: refused or left out."""

from __future__ import annotations

import os
import shutil
import stat
import struct
import zlib
from collections.abc import Callable
from io import BytesIO
from pathlib import Path

import numpy as np
import OpenEXR
import pytest
from PIL import Image

from stages.formats.images.exr import read_exr
from tests.faults.command_lines import Answer, answers_of, expect_refusal
from tests.faults.program import LINEAR, ROOT

SAMPLE = (LINEAR / "images/001.exr").read_bytes()
LIGHT = read_exr(LINEAR / "images/001.exr")
VIEWS = ("001", "003", "004", "009")
WIDE, OF_MODEL, AS_IMAGE, AS_EXR = "claims to be", "but its camera in the model", "as an image", "as OpenEXR"
FEW_BYTES = "claims to hold"
Maker = Callable[[Path], object]


def exr(values: np.ndarray) -> Maker:
    """A writer that takes any value, which the program's own refuses."""

    def write(place: Path) -> None:
        header = {"compression": OpenEXR.ZIP_COMPRESSION, "type": OpenEXR.scanlineimage}
        with OpenEXR.File(header, {"RGB": np.ascontiguousarray(values, np.float32)}) as file:
            file.write(str(place))

    return write


def of_bytes(data: bytes) -> Maker:
    return lambda place: place.write_bytes(data)


def exr_window(low: tuple[int, int], high: tuple[int, int]) -> Maker:
    """The sample with another size in its header."""
    data = bytearray(SAMPLE)
    for key in (b"dataWindow\0box2i\0", b"displayWindow\0box2i\0"):
        start = data.index(key) + len(key) + 4
        data[start : start + 16] = struct.pack("<4i", *low, *high)
    return of_bytes(bytes(data))


def png(width: int, height: int, depth: int = 8, before: bytes = b"") -> bytes:
    """A PNG of zeros as far as a megabyte goes."""
    header = _chunk(b"IHDR", struct.pack(">IIBBBBB", width, height, depth, 2, 0, 0, 0))
    pixels = _chunk(b"IDAT", zlib.compress(bytes(1_000_000)))
    return b"\x89PNG\r\n\x1a\n" + header + before + pixels + _chunk(b"IEND", b"")


def long_part(data: bytes) -> bytes:
    """The PNG with pixels that claim to have 4 GB, which OpenCV sets aside at once."""
    at = data.index(b"IDAT") - 4
    return data[:at] + b"\xff" + data[at + 1 :]


def _chunk(kind: bytes, data: bytes) -> bytes:
    return struct.pack(">I", len(data)) + kind + data + struct.pack(">I", zlib.crc32(kind + data))


def encoded(form: str, **options: object) -> bytes:
    """The sample as 8 bits."""
    stream = BytesIO()
    Image.fromarray((np.clip(LIGHT, 0, 1) ** (1 / 2.2) * 255).astype(np.uint8)).save(stream, form, **options)
    return stream.getvalue()


def jpeg(width: int, height: int) -> bytes:
    data = bytearray(encoded("JPEG"))
    start = data.index(b"\xff\xc0")
    data[start + 5 : start + 9] = struct.pack(">HH", height, width)
    return bytes(data)


def tiff(width: int, height: int) -> bytes:
    data = bytearray(encoded("TIFF"))
    (table,) = struct.unpack_from("<I", data, 4)
    (entries,) = struct.unpack_from("<H", data, table)
    for entry in range(table + 2, table + 2 + 12 * entries, 12):
        if (tag := struct.unpack_from("<H", data, entry)[0]) in (256, 257):
            struct.pack_into("<HHII", data, entry, tag, 4, 1, width if tag == 256 else height)
    return bytes(data)


def few_bytes() -> bytes:
    """A TIFF of a pixel that claims a hundred million."""
    stream = BytesIO()
    Image.new("RGB", (1, 1)).save(stream, "TIFF")
    data = stream.getvalue()
    return data.replace(struct.pack("<HHII", 257, 4, 1, 1), struct.pack("<HHII", 257, 4, 1, 10**8), 1)


def hdr(width: int, height: int, before: bytes = b"") -> bytes:
    head = b"#?RADIANCE\n" + before + b"FORMAT=32-bit_rle_rgbe\n\n-Y %d +X %d\n"
    return head % (height, width) + b"\x02\x02" * 3000


TEXT_BOMB = _chunk(b"zTXt", b"x\0\0" + zlib.compress(bytes(300 << 20)))
EPS = b"%!PS-Adobe-3.0 EPSF-3.0\n%%BoundingBox: 0 0 180 240\n%%EndComments\nshowpage\n%%EOF\n"
KINDS: dict[str, tuple[Maker, str]] = {
    "named pipe": (os.mkfifo, "is a named pipe"),
    "device": (lambda place: place.symlink_to("/dev/zero"), "is a device"),
    "socket": (lambda place: os.mknod(place, stat.S_IFSOCK | 0o600), "is a socket"),
    "link to itself": (lambda place: place.symlink_to(place.name), "which is not there"),
}
LARGEST = 2**31 - 1
PHOTOS: dict[str, tuple[str, Maker, str]] = (
    {  # extension, how it is made, what is said
        "NaN in every photo": ("exr*", exr(LIGHT * np.nan), "holds a value that can be light"),
        "1e38 in every photo": ("exr*", exr(LIGHT * 0 + 3e38), "holds a value that can be light"),
        "black in every photo": ("exr*", exr(LIGHT * 0), "are black"),
        "negative in every photo": ("exr*", exr(-LIGHT), "are black"),
        "empty EXR": ("exr", of_bytes(b""), AS_EXR),
        "half an EXR": ("exr", of_bytes(SAMPLE[: len(SAMPLE) // 2]), AS_EXR),
        "head of an EXR": ("exr", of_bytes(SAMPLE[:200]), AS_EXR),
        "noise as EXR": ("exr", of_bytes(bytes(range(256)) * 20), AS_EXR),
        "EXR of 60000": ("exr", exr_window((0, 0), (59999, 59999)), WIDE),
        "EXR of 2^20": ("exr", exr_window((0, 0), (2**20 - 1, 2**20 - 1)), WIDE),
        "EXR of 2^31": ("exr", exr_window((0, 0), (LARGEST - 1, LARGEST - 1)), AS_EXR),
        "EXR of 2^32": ("exr", exr_window((-LARGEST, -LARGEST), (LARGEST, LARGEST)), AS_EXR),
        "EXR of 16000": ("exr", exr_window((0, 0), (15999, 15999)), OF_MODEL),
        "EXR of nothing": ("exr", exr_window((0, 0), (-1, -1)), AS_EXR),
        "another size": ("exr", exr(LIGHT[:200]), OF_MODEL),
        "PNG of 60000": ("png", of_bytes(png(60000, 60000)), WIDE),
        "PNG of 2^31": ("png", of_bytes(png(LARGEST, LARGEST)), WIDE),
        "PNG of nothing": ("png", of_bytes(png(0, 10)), AS_IMAGE),
        "PNG of 15000": ("png", of_bytes(png(15000, 15000, 16)), FEW_BYTES),
        "PNG cut": ("png", of_bytes(png(180, 240)[:80]), AS_IMAGE),
        "PNG with 300 MB of text": ("png", of_bytes(png(180, 240, before=TEXT_BOMB)), "too large"),
        "PNG with a part of 4 GB": ("png", of_bytes(long_part(png(180, 240, 16))), AS_IMAGE),
        "JPEG of 65535": ("jpg", of_bytes(jpeg(65535, 65535)), WIDE),
        "JPEG of 15000": ("jpg", of_bytes(jpeg(15000, 15000)), FEW_BYTES),
        "TIFF of 2^31": ("tif", of_bytes(tiff(2**31, 2**31)), WIDE),
        "TIFF of few bytes": ("tif", of_bytes(few_bytes()), FEW_BYTES),
        "TIFF of 15000": ("tif", of_bytes(tiff(15000, 15000)), OF_MODEL),
        "HDR of 60000": ("hdr", of_bytes(hdr(60000, 60000)), WIDE),
        "HDR of two sizes": ("hdr", of_bytes(hdr(30000, 30000, b"-Y 240 +X 180\n")), WIDE),
        "HDR of -1": ("hdr", of_bytes(hdr(-1, -1)), AS_IMAGE),
        "HDR cut": ("hdr", of_bytes(hdr(180, 240)), AS_IMAGE),
        "PostScript": ("jpg", of_bytes(EPS), AS_IMAGE),
        "PDF": ("jpg", of_bytes(b"%PDF-1.4\n"), AS_IMAGE),
        "SVG": ("png", of_bytes(b'<svg xmlns="http://www.w3.org/2000/svg"/>'), AS_IMAGE),
    }
    | {f"photo: {kind}": ("exr", make, says) for kind, (make, says) in KINDS.items()}
)

KEPT = np.full((240, 180), 255, np.uint8)
KEPT[:50] = 0


def mask(values: np.ndarray, form: str = "PNG") -> Maker:
    return lambda place: Image.fromarray(values).save(place, form)


MASKS: dict[str, tuple[str, Maker, str]] = {
    "black": ("{}.png", mask(KEPT * 0), "keeps a pixel"),
    "of 0 and 1": ("{}.png", mask(KEPT // 255), "multiplied by 255"),
    "of another size": ("{}.png", mask(KEPT[:100]), "must have their photo's size"),
    "of one pixel": ("{}.png", mask(KEPT[:1, :1]), "must have their photo's size"),
    "of 60000": ("{}.png", of_bytes(png(60000, 60000)), WIDE),
    "empty": ("{}.png", of_bytes(b""), AS_IMAGE),
    "PostScript": ("{}.png", of_bytes(EPS), AS_IMAGE),
    "folders": ("{}.png", lambda place: place.mkdir(), "belongs to a photo"),
    "of other names": ("x{}.png", mask(KEPT), "belongs to a photo"),
} | {kind: ("{}.png", make, says) for kind, (make, says) in KINDS.items()}
FINE_MASKS = {"{}.PNG": mask(KEPT), "{}.exr.PNG": mask(KEPT), "{}.exr.png": mask(KEPT)}
FINE_MASKS |= {"{}.png": mask(KEPT, "GIF")}

FAULTS = {
    b"a\nb.jpg": "cannot be shown",
    b"\x1b[2J.jpg": "cannot be shown",
    b"c:x.jpg": "A photo in",
    b"a\\b.jpg": "A photo in",
    b"x" * 240 + b".jpg": "longer than results have room for",
    b"\xe9.jpg": "UTF-8",
}


class Attacks:
    """Folders of photos and masks, with the command lines that take them and what they say."""

    def __init__(self, folder: Path) -> None:
        self.folder, self.rows = folder, dict[str, tuple[list[str | Path], str]]()

    def add(self, name: str, says: str, photos: Path = LINEAR / "images", masks: Path | None = None) -> None:
        words: list[str | Path] = ["run", "--colmap", LINEAR, "--images", photos]
        words += ["--masks", masks] if masks else []
        place = self.folder / f"w{len(self.rows)}"
        size = ["--set", "undistort.max_size_px=64"]
        self.rows[name] = [*words, "--workspace", place, "--to", "undistort", *size], says

    def photos(self, name: str, ending: str, make: Maker, says: str) -> None:
        """Replace the first photo, or with ``*`` every one."""
        place = self.folder / f"p{len(self.rows)}"
        shutil.copytree(LINEAR / "images", place)
        for view in VIEWS if ending.endswith("*") else VIEWS[:1]:
            (place / f"{view}.exr").unlink()
            make(place / f"{view}.{ending.rstrip('*')}")
        self.add(name, says, photos=place)

    def masks(self, name: str, pattern: str, make: Maker, says: str) -> None:
        place = self.folder / f"k{len(self.rows)}"
        place.mkdir()
        for view in VIEWS:
            make(place / pattern.format(view))
        self.add(name, says, masks=place)

    def named(self, name: bytes, says: str) -> None:
        place = self.folder / f"n{len(self.rows)}"
        place.mkdir()
        for target in (name, b"sound.jpg"):
            shutil.copy(ROOT / "sample_data/photos/000.jpg", os.path.join(os.fsencode(place), target))  # noqa: PTH118
        words = ["run", "--images", place, "--workspace", self.folder / f"w{len(self.rows)}", "--to", "sfm"]
        self.rows[f"name {name[:10]!r}"] = words, says

    def answers(self) -> dict[str, tuple[Answer, str]]:
        return answers_of(self.rows, self.folder)


@pytest.fixture(scope="module")
def refusals(tmp_path_factory, tried) -> dict[str, tuple[Answer, str]]:
    """What every attack came to, and what is to be said of it."""
    made = Attacks(tmp_path_factory.mktemp("images"))
    for name, (ending, make, says) in PHOTOS.items():
        made.photos(name, ending, make, says)
    for name, (pattern, make, says) in MASKS.items():
        made.masks(f"masks {name}", pattern, make, says)
    for image, says in FAULTS.items():
        made.named(image, says)
    tried("hostile photos, masks and their names", "refused in a sentence", len(made.rows))
    return made.answers()


@pytest.mark.parametrize(
    "name", [*PHOTOS, *(f"masks {one}" for one in MASKS), *(f"name {one[:10]!r}" for one in FAULTS)]
)
def test_it_is_refused_in_a_sentence_at_once_and_in_little_memory(refusals, name):
    answer, says = refusals[name]
    expect_refusal(answer, says, most_mb=700)


def test_what_is_left_out_is_counted_and_what_is_sound_is_taken(tmp_path, tried):
    made = Attacks(tmp_path)
    partly = LIGHT.copy()
    partly[:100], partly[100:110, :, 0] = np.nan, -5
    made.photos("NaN in one photo", "exr", exr(LIGHT * np.nan), "43200 pixels of 001.exr are masked")
    made.photos("NaN in part", "exr", exr(partly), "18000 pixels of 001.exr are masked")
    made.photos("infinite", "exr", exr(LIGHT + np.inf), "43200 pixels of 001.exr are masked")
    made.photos("black", "exr", exr(LIGHT * 0), "1 of 4 photos are black, no value above zero: 001.exr")
    made.photos("folder", "exr", lambda place: place.mkdir(), "1 of the 4 images of the model have no photo")
    counted = len(made.rows)
    made.photos("white", "exr*", exr(LIGHT * 0 + 1), "done in")
    for pattern, make in FINE_MASKS.items():
        made.masks(pattern, pattern, make, "done in")
    for name, (answer, says) in made.answers().items():
        assert answer.code == 0, name
        assert says in answer.said, answer
        assert "Traceback" not in answer.said and "Warning" not in answer.said, answer
    tried("photos with NaN, infinities, without light or none", "left out, named and counted", counted)


def test_what_libraries_complain_of_is_in_the_log_and_not_on_the_terminal(tmp_path):
    """OpenEXR and OpenCV write to the streams of the process."""
    made = Attacks(tmp_path)
    made.photos("half", "exr", of_bytes(SAMPLE[: len(SAMPLE) // 2]), "")
    made.photos("cut", "hdr", of_bytes(hdr(180, 240)), "")
    for answer, _ in made.answers().values():
        assert answer.said.count("unshade: ") == 1
        assert "ERR" not in answer.said and "imdecode" not in answer.said
    logs = "".join(path.read_text(errors="replace") for path in tmp_path.glob("w*/logs/undistort.txt"))
    assert "imdecode" in logs and "pixel data" in logs
