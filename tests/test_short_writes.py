"""A disk that takes only part of a file: every file of every stage is cut once, and nothing is published."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

from pipeline.cache.digest import DigestMemo
from pipeline.cache.store import PARTIAL
from stages.cli import main
from stages.formats.colmap.depth_maps import write_map
from stages.formats.images.exr import write_exr
from stages.formats.images.photos import write_mask, write_png_srgb16
from stages.formats.meshes.point_clouds import write_points
from stages.formats.meshes.triangle_meshes import write_mesh
from tests.faults.small_runs import SMALL, STAGES, link_photos
from tests.short_writes import no_file_longer_than
from tests.test_surface import SQUARE

ROOT = Path(__file__).parent.parent
SAMPLE = ROOT / "sample_data"
OWN = {"record.json", "log.txt"}  # the pipeline's


def words_for(workspace: Path, *more: str) -> list[str]:
    settings = [word for name, value in SMALL.items() for word in ("--set", f"{name}={value}")]
    return ["run", "--images", str(workspace / "photos"), "--workspace", str(workspace), *more, *settings]


@pytest.fixture(scope="module")
def finished(tmp_path_factory) -> Path:
    """The whole flow on five small photos."""
    workspace = tmp_path_factory.mktemp("short")
    link_photos(workspace / "photos")
    assert main(words_for(workspace)) == 0
    return workspace


def run_cut(most: int, words: list[str]) -> subprocess.CompletedProcess[str]:
    """The command in a process of its own, whose files cannot grow beyond so many bytes."""
    program = (
        "import sys\nfrom tests.short_writes import no_file_longer_than\nfrom stages.cli import main\n"
        f"with no_file_longer_than({most}):\n    code = main(sys.argv[1:])\nsys.exit(code)\n"
    )
    command = [sys.executable, "-c", program, *words]
    return subprocess.run(command, capture_output=True, text=True, cwd=ROOT, check=False)


def published(workspace: Path, stage: str) -> dict[str, str]:
    """Every file of the stage's results, by digest; not what a run that died has left to be swept."""
    folder = workspace / "cache" / stage
    memo = DigestMemo(folder / "none.json")
    files = [path for path in folder.rglob("*") if path.is_file()]
    return {
        str(path.relative_to(folder)): memo.file(path)
        for path in files
        if not path.relative_to(folder).parts[0].startswith(PARTIAL)
    }


def sizes(workspace: Path, stage: str) -> list[int]:
    """Of the largest file of each kind that the stage has written."""
    (entry,) = (workspace / "cache" / stage).iterdir()
    kinds: dict[tuple[str, str], int] = {}
    for path in entry.rglob("*"):
        if path.is_file() and path.name not in OWN:
            parts = path.relative_to(entry).parts
            kind = parts[0], path.name if path.suffix == ".bin" and len(parts) < 4 else path.suffix
            kinds[kind] = max(kinds.get(kind, 0), path.stat().st_size)
    return sorted(set(kinds.values()))


def check_cut(finished: Path, stage: str, most: int) -> None:
    """With the disk that takes so much, the stage fails with a sentence, and no result changes."""
    before = published(finished, stage)
    done = run_cut(most, words_for(finished, "--only", stage, "--force"))
    said = " ".join(done.stderr.split())
    assert published(finished, stage) == before, (most, said)
    assert done.returncode == 2 and "Traceback" not in said, (most, said)
    assert "earlier results are kept" in said


@pytest.mark.parametrize("stage", STAGES)
def test_nothing_that_was_cut_is_published(finished, stage):
    """Real stages, real libraries: the largest of their files is one byte too large for the disk.

    The limit holds for all files at once; each kind by itself: below, and in test_colmap_damage.
    """
    check_cut(finished, stage, sizes(finished, stage)[-1] - 1)


@pytest.mark.slow
@pytest.mark.parametrize("stage", STAGES)
def test_no_cut_of_any_file_is_published(finished, stage):
    """Each kind of file that a stage writes, cut at its last byte and in the middle."""
    before = published(finished, stage)
    for size in sizes(finished, stage):
        for most in {size - 1, size // 2}:
            check_cut(finished, stage, most)
    assert main(words_for(finished, "--to", stage)) == 0
    assert published(finished, stage) == before


WRITERS = {
    "mesh": lambda path: write_mesh(path, SQUARE),
    "points": lambda path: write_points(path, np.ones((50, 3)), np.ones((50, 3)), np.ones((50, 3))),
    "exr": lambda path: write_exr(path, np.random.default_rng(0).random((40, 30, 3))),
    "png": lambda path: write_png_srgb16(path, np.random.default_rng(0).random((40, 30, 3))),
    "mask": lambda path: write_mask(path, np.random.default_rng(0).random((40, 30)) > 0.5),
    "depth map": lambda path: write_map(path, np.ones((40, 30), np.float32)),
}


@pytest.mark.parametrize("kind", WRITERS)
def test_no_writer_takes_a_part_for_the_whole(tmp_path, kind):
    WRITERS[kind](tmp_path / "whole")
    size = (tmp_path / "whole").stat().st_size
    for most in sorted({*range(0, size, max(1, size // 25)), size - 1}):
        with no_file_longer_than(most), pytest.raises(OSError):
            WRITERS[kind](tmp_path / "cut")
    with no_file_longer_than(size):
        WRITERS[kind](tmp_path / "cut")
    assert (tmp_path / "cut").read_bytes() == (tmp_path / "whole").read_bytes()
