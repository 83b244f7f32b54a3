"""Fuzz the readers of files: `python -m tests.faults.fuzz --minutes 60 --seed 1`.

Sound files are damaged at random, and read. What comes of it is a value or a `UserError`; all else is a
failure: another exception, a crash of native code, a hang, memory far beyond the file. A case has a number,
from which it can be made again: `--case 1234`.
"""

from __future__ import annotations

import argparse
import resource
import shutil
import signal
import subprocess
import sys
import tempfile
import time
import traceback
from collections import Counter
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field
from io import BytesIO
from pathlib import Path

import numpy as np

from pipeline import UserError
from tests.faults.program import ROOT

ADDRESS_SPACE = 6 << 30  # bytes
MOST_GROWN_MB = 500  # by a case: its files have some kilobytes
SLOWEST_S = 20
BATCH = 500  # cases of one process
NUMBERS = [0, 1, -1, 127, 255, 256, 32768, 65535, 2**31 - 1, 2**31, 2**32 - 1, 2**40, 2**62, 2**63 - 1]
WORDS = [
    b"nan",
    b"inf",
    b"1e300",
    b"-1",
    b"",
    b"99999999999999999999",
    b"0x10",
    b"1_0",
    b"\xff",
    b"#",
    b"[" * 40,
]
Reader = Callable[[Path], object]


@dataclass
class Outcome:
    """What the cases of a run came to.

    Attributes
    ----------
    counts : Counter
        By "KIND read" and "KIND refused".
    failures : list of str
        "case N (KIND): what".
    """

    counts: Counter[str] = field(default_factory=Counter)
    failures: list[str] = field(default_factory=list)


def sound_files() -> dict[str, tuple[str, bytes, Reader]]:
    """Provide, by kind, a file's name, its bytes and its reader."""
    from pipeline.files.yaml_text import parse_yaml, read_yaml_text
    from stages.formats.colmap.depth_maps import read_map, write_map
    from stages.formats.images.alpha import read_alpha
    from stages.formats.images.photo_remarks import remarks_on
    from stages.formats.images.photos import read_mask, read_photo
    from stages.formats.meshes.mesh_files import read_mesh_file
    from tests.faults.test_hostile_images import encoded, hdr
    from tests.faults.test_hostile_meshes import binary_ply, far_corner, glb, text_ply

    def photo(path: Path) -> None:
        read_photo(path)
        read_alpha(path)
        remarks_on(path, True, False)

    def configuration(path: Path) -> None:
        import yaml

        try:
            parse_yaml(read_yaml_text(path))
        except yaml.YAMLError:
            raise UserError("not YAML") from None

    with tempfile.TemporaryDirectory() as folder:
        write_map(Path(folder) / "a.bin", np.ones((8, 6), np.float32))
        depth = (Path(folder) / "a.bin").read_bytes()
    triangle = far_corner("1.5")
    small = np.arange(8 * 6 * 3, dtype=np.uint8).reshape(8, 6, 3)
    meshes = {
        "text PLY": ("a.ply", text_ply("4 0 1 2 3\n3 0 1 2\n", faces=2)),
        "binary PLY": ("a.ply", binary_ply(b"\4" + np.arange(4, dtype="<i4").tobytes())),
        "GLB": ("a.glb", glb()),
        "binary STL": ("a.stl", bytes(80) + b"\1\0\0\0" + np.arange(12, dtype="<f4").tobytes() + b"\0\0"),
    } | {f"text {suffix}": (f"a.{suffix}", triangle[suffix]) for suffix in ("obj", "off", "stl")}
    photos = {
        "EXR": ("a.exr", _small_exr()),
        "JPEG": (
            "a.jpg",
            encoded("JPEG", exif=b"Exif\0\0MM\0*\0\0\0\x08\0\1\x01\x12\0\3\0\0\0\1\0\6\0\0\0\0\0\0"),
        ),
        "PNG": ("a.png", _picture(small, "PNG")),
        "16-bit PNG": ("a.png", _deep(small, ".png")),
        "TIFF": ("a.tif", _picture(small, "TIFF")),
        "16-bit TIFF": ("a.tif", _deep(small, ".tif")),
        "HDR": ("a.hdr", hdr(6, 8)[:60] + bytes(6 * 8 * 4)),
        "WebP": ("a.webp", _picture(small, "WEBP")),
        "AVIF": ("a.avif", _picture(small, "AVIF")),
        "HEIF": ("a.heic", _small_heif()),
        "camera raw": ("a.dng", _small_dng()),
    }
    return (
        {kind: (name, data, read_mesh_file) for kind, (name, data) in meshes.items()}
        | {kind: (name, data, photo) for kind, (name, data) in photos.items()}
        | {
            "mask": ("a.png", _picture(small[..., 0], "PNG"), read_mask),
            "depth map": ("a.bin", depth, read_map),
            "configuration": ("a.yaml", (ROOT / "configs/sample.yaml").read_bytes(), configuration),
        }
        | {f"model, {part}.bin": (f"{part}.bin", data, _model) for part, data in _model_files(".bin").items()}
        | {f"model, {part}.txt": (f"{part}.txt", data, _model) for part, data in _model_files(".txt").items()}
    )


def _picture(pixels: np.ndarray, form: str) -> bytes:
    from PIL import Image

    stream = BytesIO()
    Image.fromarray(pixels).save(stream, form)
    return stream.getvalue()


def _deep(pixels: np.ndarray, suffix: str) -> bytes:
    import cv2

    return cv2.imencode(suffix, pixels.astype(np.uint16) * 257)[1].tobytes()


def _small_exr() -> bytes:
    from stages.formats.images.exr import write_exr

    with tempfile.TemporaryDirectory() as folder:
        write_exr(Path(folder) / "a.exr", np.ones((20, 6, 3), np.float32))
        return (Path(folder) / "a.exr").read_bytes()


def _small_heif() -> bytes:
    import pillow_heif

    stream = BytesIO()
    pillow_heif.from_bytes("RGB", (64, 64), bytes(range(64)) * 192).save(stream)
    return stream.getvalue()


def _small_dng() -> bytes:
    from tests.written_dng import write_dng

    with tempfile.TemporaryDirectory() as folder:
        write_dng(Path(folder) / "a.dng", np.full((32, 40, 3), 0.4))
        return (Path(folder) / "a.dng").read_bytes()


def _model_files(form: str) -> dict[str, bytes]:
    from tests.test_colmap_model import distorted_model

    with tempfile.TemporaryDirectory() as folder:
        model = distorted_model(names=[f"photo_{index}.jpg" for index in range(4)])
        (model.write_text if form == ".txt" else model.write_binary)(folder)
        return {path.stem: path.read_bytes() for path in sorted(Path(folder).glob(f"*{form}"))}


def _model(path: Path) -> None:
    """Read the model that a damaged file belongs to."""
    from stages.formats.colmap.model import read_model

    for part, data in _model_files(path.suffix).items():
        if part != path.stem:
            (path.parent / f"{part}{path.suffix}").write_bytes(data)
    read_model(path.parent)


def damaged(data: bytes, rng: np.random.Generator) -> bytes:
    """Damage bytes in one place, or in a few."""
    for _ in range(int(rng.geometric(0.6))):
        at = int(rng.integers(0, len(data) + 1))
        length = int(rng.integers(1, 1 + min(16, max(1, len(data) - at))))
        number = NUMBERS[int(rng.integers(len(NUMBERS)))]
        word = WORDS[int(rng.integers(len(WORDS)))]
        order = "little" if rng.random() < 0.7 else "big"
        width = int(rng.choice([1, 2, 4, 8]))
        coded = (number % 2 ** (8 * width)).to_bytes(width, order)  # type: ignore[arg-type]
        match int(rng.integers(8)):
            case 0:
                data = data[:at]
            case 1:
                data = data[:at] + data[at + length :]
            case 2:
                data = data[:at] + data[at : at + length] * int(rng.integers(2, 50)) + data[at + length :]
            case 3:
                data = data[:at] + rng.bytes(length) + data[at + length :]
            case 4 | 5:
                data = data[:at] + coded + data[at + width :]
            case 6:
                data = data[:at] + str(number).encode() + data[at + length :]
            case _:
                data = data[:at] + word + data[at + length :]
    return data


def cases(seed: int, first: int) -> Iterator[tuple[int, str, str, bytes, Reader]]:
    """Make damaged files one after the other, kind by kind."""
    kinds = list(sound_files().items())
    number = first
    while True:
        kind, (name, data, read) = kinds[number % len(kinds)]
        yield number, kind, name, damaged(data, np.random.default_rng([seed, number])), read
        number += 1


def _work(seed: int, first: int, count: int) -> None:
    """Read the damaged files of a batch; a line for the beginning and the end of each."""
    resource.setrlimit(resource.RLIMIT_AS, (ADDRESS_SPACE, ADDRESS_SPACE))
    for number, kind, name, data, read in cases(seed, first):
        if number == first + count:
            return
        print("begin", number, kind, sep="\t", flush=True)
        print(number, "end", _outcome(name, data, read), sep="\t", flush=True)


def _outcome(name: str, data: bytes, read: Reader) -> str:
    Path("/proc/self/clear_refs").write_text("5")
    before = _peak_mb()
    signal.alarm(SLOWEST_S)
    folder = Path(tempfile.mkdtemp())
    try:
        (folder / name).write_bytes(data)
        read(folder / name)
        came = "read"
    except UserError:
        came = "refused"
    except Exception:
        came = " ".join(traceback.format_exc().split())[-400:]
    finally:
        signal.alarm(0)
        shutil.rmtree(folder)
    grown = _peak_mb() - before
    return came if grown < MOST_GROWN_MB else f"{came}, and took {grown:.0f} MB"


def _peak_mb() -> float:
    lines = Path("/proc/self/status").read_text().splitlines()
    return int(next(line for line in lines if line.startswith("VmHWM")).split()[1]) / 1e3


def fuzz(seed: int, first: int, count: int) -> Outcome:
    """Read `count` damaged files from number `first` on, in processes that may crash."""
    outcome = Outcome()
    end = first + count
    while first < end:
        done = subprocess.run(
            [sys.executable, "-m", "tests.faults.fuzz", "--seed", str(seed), "--worker", str(first)]
            + [str(min(BATCH, end - first))],
            capture_output=True,
            text=True,
            errors="replace",
            cwd=ROOT,
        )
        begun: dict[int, str] = {}
        for line in done.stdout.splitlines():
            match line.split("\t"):
                case ["begin", number, kind]:
                    begun[int(number)] = kind
                case [number, "end", came]:
                    kind = begun.pop(int(number))
                    if came not in ("read", "refused"):
                        outcome.failures.append(f"case {number} ({kind}): {came}")
                    outcome.counts[f"{kind}: {came if came in ('read', 'refused') else 'failed'}"] += 1
                    first = int(number) + 1
        if done.returncode:
            number, kind = next(iter(begun.items()), (first, "at the start"))
            outcome.failures.append(
                f"case {number} ({kind}): ended by {done.returncode}: {done.stderr[-300:]}"
            )
            outcome.counts[f"{kind}: ended the process"] += 1
            first = number + 1
    return outcome


def main() -> int:
    """Fuzz for so many minutes, and print what came of it."""
    arguments = argparse.ArgumentParser(description=__doc__)
    arguments.add_argument("--minutes", type=float, default=1)
    arguments.add_argument("--seed", type=int, default=0)
    arguments.add_argument("--case", type=int, help="make this case again, and read it here")
    arguments.add_argument("--worker", type=int, nargs=2, help=argparse.SUPPRESS)
    given = arguments.parse_args()
    if given.worker:
        _work(given.seed, *given.worker)
        return 0
    if given.case is not None:
        _, kind, name, data, read = next(cases(given.seed, given.case))
        print(kind, name, data)
        folder = Path(tempfile.mkdtemp())
        (folder / name).write_bytes(data)
        print(read(folder / name))
        return 0
    total, begun, number = Outcome(), time.monotonic(), 0
    while time.monotonic() - begun < 60 * given.minutes:
        found = fuzz(given.seed, number, BATCH)
        number += BATCH
        total.counts += found.counts
        total.failures += found.failures
        for failure in found.failures:
            print(failure, flush=True)
    for kind, count in sorted(total.counts.items()):
        print(f"{count:8} {kind}")
    print(f"{number} cases, {len(total.failures)} failures")
    return 1 if total.failures else 0


if __name__ == "__main__":
    sys.exit(main())
