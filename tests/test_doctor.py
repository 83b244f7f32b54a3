"""`unshade doctor`: what the machine has and lacks, and what a run is expected to take."""

from __future__ import annotations

import json
import re
import sys
from pathlib import Path

import numpy as np
import pytest

try:
    import tomllib
except ImportError:  # Python 3.10
    tomllib = None  # type: ignore[assignment]

from pipeline.process import processors
from stages.cli import main
from stages.command.arguments import Doctor, Run
from stages.command.doctor import settings_for, sizes_for
from stages.command.machine import threads_of
from stages.diagnosis import advice, findings
from stages.diagnosis.expectation import Expectation, expected, of_megapixels
from stages.diagnosis.extras import EXTRAS
from stages.diagnosis.findings import Findings, find_photos_cost, find_room
from stages.diagnosis.libraries import NEEDED, SYSTEM_LIBRARIES, Library, check_libraries, what_to_do
from stages.formats.images.photos import write_png_srgb8
from stages.geometry.working_size import AutoSizeSettings, affordable_size
from stages.photometry.clusters.settings import ClusterSettings
from stages.scene.memory_of_views import BYTES_OF_ALBEDO, BYTES_TO_SPARE

ROOT = Path(__file__).parent.parent
FOUNTAIN = [(768, 512)] * 11
OF_THE_COMMAND = {"filelock", "pooch", "pydantic", "pyyaml", "rich", "tyro"}  # or there would be no doctor
BROKEN = {
    "prints": "print('hello')",
    "ends_itself": "import os, signal; os.kill(os.getpid(), signal.SIGILL)",
    "lacks_usb": "raise ImportError('libusb-1.0.so.0: cannot open shared object file: No such file')",
    "leaves": "import os; os._exit(3)",
    "sound": "",
}


@pytest.fixture
def broken_libraries(tmp_path, monkeypatch) -> None:
    """Modules on the path of child processes that do not load, each in its way."""
    for name, text in BROKEN.items():
        (tmp_path / f"{name}.py").write_text(text, encoding="utf-8")
    monkeypatch.setenv("PYTHONPATH", str(tmp_path))


def test_a_library_that_ends_its_process_hides_no_other(broken_libraries):
    found = check_libraries({name: (name,) for name in (*BROKEN, "nowhere")})
    faults = {one.module: one.fault for one in found}
    assert faults == {
        "prints": None,
        "ends_itself": "loading it ends the process (SIGILL)",
        "lacks_usb": f"ImportError: {BROKEN['lacks_usb'][19:-2]}",
        "leaves": "loading it ends the process (exit code 3)",
        "sound": None,
        "nowhere": "ModuleNotFoundError: No module named 'nowhere'",
    }


@pytest.mark.parametrize(
    ("module", "fault", "told"),
    [
        ("open3d", "ImportError: libusb-1.0.so.0: cannot open shared object file", "libusb-1.0-0"),
        ("open3d", "OSError: libfoo.so.1: cannot open shared object file", "holds libfoo.so.1"),
        ("pycolmap", "loading it ends the process (SIGILL)", "newer processor"),
        ("cv2", "ModuleNotFoundError: No module named 'cv2'", "pip install opencv-python-headless"),
        ("cv2", "ImportError: it is torn", "pip install --force-reinstall opencv-python-headless"),
    ],
)
def test_each_fault_comes_with_what_to_do(module, fault, told):
    assert told in what_to_do(Library(module, "1.0", fault))


@pytest.mark.whole
def test_this_machine_can_run_and_a_screen_says_so(tmp_path, capsys):
    assert main(["doctor", str(ROOT / "sample_data/photos"), "--workspace", str(tmp_path / "new")]) == 0
    lines = capsys.readouterr().out.splitlines()
    assert len(lines) <= 24
    topics = [re.match(r"[\w ]*?(?=  |$)", line)[0] for line in lines]
    assert {"processors", "memory", "pycolmap", "loops", "disk", "photos", "a run", "result"} <= set(topics)
    assert not (tmp_path / "new").exists()


def test_a_machine_without_a_library_cannot_run_and_says_which(tmp_path, monkeypatch, capsys):
    (tmp_path / "xatlas.py").write_text("raise ImportError('it is torn')", encoding="utf-8")
    monkeypatch.setenv("PYTHONPATH", str(tmp_path))
    few = {name: NEEDED[name] for name in ("numba", "pycolmap", "xatlas")}  # the others take seconds
    monkeypatch.setattr(findings, "NEEDED", few)
    monkeypatch.setattr(findings, "EXTRAS", ())
    assert main(["doctor", "--json"]) == 1
    told = json.loads(capsys.readouterr().out)
    (problem,) = told["problems"]
    again = f"{sys.executable} -m pip install --force-reinstall xatlas"
    assert problem.startswith(f"xatlas does not load: ImportError: it is torn. Install it: {again}")
    assert told["libraries"]["pycolmap"]["fault"] is None


def expected_for(command: Doctor) -> tuple[Expectation, dict]:
    """What a run is expected to take, and what is said of it."""
    found = Findings()
    sizes, remark = sizes_for(command)
    return find_photos_cost(found, sizes, remark, settings_for(command), 2), found.facts["photos"]


def test_the_size_is_the_one_that_undistort_would_choose_under_the_same_settings(tmp_path):
    for number, (width, height) in enumerate([(1200, 900), (900, 1200)]):
        write_png_srgb8(tmp_path / f"{number}.png", np.zeros((height, width, 3), np.float32))
    (tmp_path / "torn.png").write_bytes(b"no picture")
    given = ("undistort.auto.processor_minutes=2",)
    found, told = expected_for(Doctor(tmp_path, assignments=given))
    auto = AutoSizeSettings(processor_minutes=2)
    assert found.longest_px == affordable_size([(1200, 900), (900, 1200)], auto) < 1200
    assert found.photos == 2
    assert "torn.png" in told["left_out"]
    assert "undistort.auto.processor_minutes=4" in told["advice"][0]


def test_memory_follows_from_the_clusters_that_memory_leaves_room_for():
    sizes = ("3GB", "8GB")
    found = [expected_for(Doctor(photos=60, megapixels=24, memory=size))[0] for size in sizes]
    held = (BYTES_OF_ALBEDO + BYTES_TO_SPARE) / 1e9  # for which clusters leave room
    assert [one.memory_bytes / 1e9 + held for one in found] == pytest.approx([3.0, 8.0], abs=0.05)


def test_what_is_expected_of_the_fountain_is_near_what_was_measured():
    """1.9 GB, 539 s of processor time (docs/performance.md), 848 MB in the cache."""
    found = expected(FOUNTAIN, None, AutoSizeSettings(), ClusterSettings())
    assert found.memory_bytes == pytest.approx(1.95e9, rel=0.25)
    assert found.processor_minutes == pytest.approx(539 / 60, rel=0.25)
    assert found.disk_bytes == pytest.approx(848e6, rel=0.05)


def test_photos_that_no_disk_and_no_memory_can_hold_are_problems(tmp_path):
    large = Expectation(10**6, 9000, 9000, 1e6, memory_bytes=10**16, disk_bytes=10**18)
    found = Findings()
    find_room(found, tmp_path / "new", large, 10**8)
    memory, disk = found.problems
    assert "give --memory" in memory
    assert "are needed; make room" in disk
    assert not (tmp_path / "new").exists()


def test_photos_of_so_many_megapixels_have_so_many():
    sizes = of_megapixels(3, 24)
    assert len(sizes) == 3
    assert [width * height / 1e6 for width, height in sizes] == pytest.approx([24] * 3, rel=1e-3)


@pytest.mark.parametrize(
    ("words", "told"),
    [
        (["--photos", "60"], "--photos and --megapixels go together"),
        (["--photos", "0", "--megapixels", "24"], "expected 1 to 100000 photos"),
        (["--photos", "9", "--megapixels", "nan"], "expected 1 to 100000 photos"),
        (["sample_data/photos", "--photos", "60"], "Leave out the other"),
        (["docs/paper"], "no photos"),
        (["nowhere"], "no folder of photos"),
        (["--set", "undistort.auto.minutes=3"], "minutes"),
        (["--memory", "much"], "--memory is much"),
    ],
)
def test_mistakes_are_answered_in_a_sentence(words, told, capsys, monkeypatch, tmp_path):
    monkeypatch.chdir(ROOT)
    if words == ["docs/paper"]:
        words = [str(tmp_path)]
    assert main(["doctor", *words]) == 2
    assert told in " ".join(capsys.readouterr().err.split())


@pytest.mark.parametrize(
    ("facts", "told"),
    [
        ({"cuda": False, "devices": 0}, "without CUDA; dense stereo is our own"),
        ({"cuda": False, "devices": 1}, "`pycolmap-cuda12` in place of `pycolmap`"),
        ({"cuda": True, "devices": 2}, "2 device(s): mvs.engine=cuda takes COLMAP's PatchMatch"),
        ({"cuda": True, "devices": 0}, "but no device: dense stereo is our own"),
    ],
)
def test_what_a_card_can_be_used_for_depends_on_library_and_device(facts, told):
    assert told in advice.on_stereo(Library("pycolmap", "4.0", None, facts))


@pytest.mark.parametrize(
    ("written", "threads"), [("150000 100000", 2), ("50000 100000", 1), ("max 100000", 6), ("", 6)]
)
def test_a_run_takes_no_more_threads_than_its_container_has_time_for(written, threads, tmp_path, monkeypatch):
    (tmp_path / "cpu.max").write_text(written, encoding="utf-8")
    monkeypatch.setattr(processors, "_QUOTA", tmp_path / "cpu.max")
    monkeypatch.setattr(processors, "affine_processors", lambda: 6)
    assert threads_of(Run()) == threads


def test_system_libraries_are_those_that_the_setup_installs():
    pairs = re.findall(
        r"(lib[\w.+-]+\.so\.\d+):(lib[\w.+-]+)", (ROOT / "setup.sh").read_text(encoding="utf-8")
    )
    assert dict(pairs) == SYSTEM_LIBRARIES


@pytest.mark.skipif(tomllib is None, reason="tomllib came with Python 3.11")
def test_libraries_and_extras_are_those_of_the_distribution():
    project = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"]

    def names(requirements: list[str]) -> set[str]:
        return {re.match(r"[\w-]+", one)[0].lower() for one in requirements}

    known = {name for names in NEEDED.values() for name in names} - {"pycolmap-cuda12"}
    assert known == names(project["dependencies"]) - OF_THE_COMMAND
    extras = {name: names(of) for name, of in project["optional-dependencies"].items()}
    told = {one.name: {name for names in one.modules.values() for name in names} for one in EXTRAS}
    assert told == {name: of for name, of in extras.items() if name not in ("test", "benchmarks")}
