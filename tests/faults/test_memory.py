"""Too little memory: said in a sentence with the settings that lower it, before or after; nothing is lost."""

from __future__ import annotations

import re
import shutil
import subprocess
import sys
from dataclasses import replace
from pathlib import Path

import pytest

import pipeline.process.memory_limits as limits
from pipeline import MachineError, UserError
from pipeline.cache.store import Store
from pipeline.inspect import find_record
from pipeline.plan import ExpectedMemory, plan, read_sources
from pipeline.run import run
from stages import ALL_STAGES
from tests.faults.program import LINEAR, PROGRAM, ROOT
from tests.faults.small_runs import do, leftovers, one_line, published, results
from tests.test_architecture import all_settings
from tests.toy_flow import COUNT, JOIN, REPORT, Witness, request, run_toy, write_words

GIVEN = ["--colmap", str(LINEAR), "--images", str(LINEAR / "images")]
GIVEN += ["--mesh", str(ROOT / "sample_data/truth/mesh.ply")]
QUICK = ["undistort.max_size_px=96", "transfer.max_vertices=2000"]
SHORT = (("undistort", 400), ("raycast", 400), ("correspondence", 120))  # stage, MiB of address space
LONG = [
    (stage, mib)
    for stage in ("adopt_model", "undistort", "adopt_mesh", "raycast", "correspondence")
    for mib in range(100, 1000, 150)
]
LONG_SFM = range(400, 1500, 100)  # its threads are COLMAP's own: some of its ends are native
needs_limits = pytest.mark.skipif(not sys.platform.startswith("linux"), reason="limits address space")


def limited(mib: int, *words: str | Path) -> subprocess.CompletedProcess[str]:
    """Run the program with so much address space."""
    line = [*PROGRAM, "run", *map(str, words)]
    return do(["sh", "-c", f'ulimit -c 0; ulimit -v {mib * 1024}; exec "$@"', "sh", *line])


def settings(*assignments: str) -> list[str]:
    return [word for one in assignments for word in ("--set", one)]


def sentence_of(done: subprocess.CompletedProcess[str], stage: str) -> str:
    """Check that a run ended well, or with exit code 1 and the advice of its stage."""
    said = one_line(done.stderr)
    assert "Traceback" not in said and "fault of unshade;" not in said, said
    if done.returncode == 0:
        return "had enough"
    advice = next(one for one in ALL_STAGES if one.name == stage).saves_memory
    assert done.returncode == 1, said
    assert "memory" in said and one_line(advice) in said, said
    return "native code ended it, told with advice" if "Native code" in said else "told with advice"


@pytest.fixture(scope="module")
def prepared(tmp_path_factory) -> Path:
    """A workspace up to the transfer, from given cameras and mesh."""
    workspace = tmp_path_factory.mktemp("memory") / "workspace"
    line = [*PROGRAM, "run", *GIVEN, "--workspace", str(workspace)]
    done = do([*line, *settings(*QUICK), "--to", "correspondence"])
    assert done.returncode == 0, done.stderr
    return workspace


def attack(prepared: Path, tmp_path: Path, stage: str, mib: int, tried) -> str:
    """Run one stage anew with too little memory: whatever happens, what was finished is as it was."""
    workspace = Path(shutil.copytree(prepared, tmp_path / f"{stage}-{mib}"))
    before = results(workspace)
    words = ("--workspace", workspace, *settings(*QUICK), "--only", stage, "--force")
    outcome = sentence_of(limited(mib, *GIVEN, *words), stage)
    assert results(workspace) == before
    assert not leftovers(workspace)
    assert published(workspace)
    tried(f"memory: address space limited in {stage}", outcome)
    return outcome


@needs_limits
def test_a_stage_that_runs_out_of_memory_names_the_settings_that_lower_it(prepared, tmp_path, tried):
    outcomes = [attack(prepared, tmp_path, stage, mib, tried) for stage, mib in SHORT]
    assert all("told with advice" in outcome for outcome in outcomes), outcomes


@needs_limits
@pytest.mark.slow
def test_whatever_the_limit_a_stage_ends_well_or_with_advice(prepared, tmp_path, tried):
    outcomes = {attack(prepared, tmp_path, stage, mib, tried) for stage, mib in LONG}
    assert {"told with advice", "had enough"} <= outcomes


@needs_limits
@pytest.mark.slow
def test_native_threads_that_run_out_of_memory_are_told_by_the_process_above(tmp_path, tried):
    for mib in LONG_SFM:
        words = ("--images", ROOT / "sample_data/photos", "--workspace", tmp_path / str(mib), "--to", "sfm")
        tried("memory: address space limited in sfm", sentence_of(limited(mib, *words), "sfm"))
        assert not leftovers(tmp_path / str(mib))


def run_out(*_) -> None:
    raise MemoryError("Unable to allocate 1.00 PiB")


FRUGAL = {"saves_memory": "set count.times=1"}


@pytest.mark.parametrize(
    "error",
    [
        MemoryError(),
        RuntimeError("std::bad_alloc"),
        RuntimeError("can't start new thread"),
        RuntimeError("Resource temporarily unavailable"),
        ImportError("lib.so: failed to map segment from shared object"),
        OSError(12, "Cannot allocate memory"),
    ],
    ids=lambda error: str(error)[:20] or type(error).__name__,
)
def test_every_way_to_say_it_is_one_sentence_and_earlier_results_stay(tmp_path, error, tried):
    write_words(tmp_path, a="apple")

    def fail(job) -> None:
        raise error

    short = replace(COUNT, run=fail, **FRUGAL)
    with pytest.raises(MachineError, match=r"count ran out of memory.*For less memory, set count\.times=1"):
        run_toy(tmp_path, flow=(JOIN, short, REPORT))
    assert run_toy(tmp_path).ran == ["count", "report"]
    tried("memory: error of a library", "told with advice")


def test_other_errors_keep_their_words(tmp_path):
    """Such as of a damaged file whose reader asked for a terabyte."""
    write_words(tmp_path, a="apple")

    def fail(job) -> None:
        try:
            run_out()
        except MemoryError as error:
            raise UserError("The file is damaged; expected a smaller count.") from error

    with pytest.raises(UserError, match="damaged"):
        run_toy(tmp_path, flow=(replace(JOIN, run=fail), COUNT, REPORT))


def test_a_stage_that_needs_more_than_there_is_says_so_before_it_begins(tmp_path, monkeypatch, tried):
    write_words(tmp_path, a="apple")
    monkeypatch.setattr(limits, "free_bytes", lambda: 2_000_000_000)
    hungry = replace(COUNT, memory=lambda settings, inputs, threads: 3_000_000_000, **FRUGAL)
    witness = run_toy(tmp_path, flow=(JOIN, hungry, REPORT))
    assert witness.ran == ["join", "count", "report"]
    (said,) = witness.said
    assert said.startswith("count needs about 3.0 GB of memory, and 2.0 GB are free")
    assert said.endswith("For less memory, set count.times=1.")
    tried("memory: a stage needs more than is free", "said before it began")


def test_the_memory_of_a_stage_is_told_before_it_begins_and_in_the_plan(tmp_path, monkeypatch):
    """By its estimate where its inputs are there, else by what its latest result took."""
    write_words(tmp_path, a="apple")
    monkeypatch.setattr(limits, "free_bytes", lambda: 4_000_000_000)
    monkeypatch.setattr(limits, "resident_bytes", lambda: limits._AT_FIRST + 700_000_000)  # of libraries
    large = replace(COUNT, memory=lambda settings, inputs, threads: 1_000_000_000 * len(inputs))
    assert run_toy(tmp_path, flow=(JOIN, large, REPORT)).said == ["Will take about 1.7 GB of memory."]
    again = request(tmp_path, flow=(JOIN, replace(large, version=9), REPORT))
    store = Store(again.workspace)
    expected = [one.memory for one in plan(again, store, read_sources(again, store))]
    assert expected[0] is None  # it is reused
    assert expected[1] == ExpectedMemory(1_000_000_000, "an estimate")
    assert expected[2] == ExpectedMemory(store.latest("report").peak_bytes, "the latest result")
    (again.workspace / "cache/current.json").unlink()  # the inputs are those that it reuses
    store = Store(again.workspace)
    assert plan(again, store, read_sources(again, store))[1].memory == expected[1]


def test_what_the_process_holds_already_counts_as_allowed_memory(tmp_path, monkeypatch):
    write_words(tmp_path, a="apple")
    monkeypatch.setattr(limits, "resident_bytes", lambda: limits._AT_FIRST + 700_000_000)
    large = replace(COUNT, memory=lambda settings, inputs, threads: 1_000_000_000, **FRUGAL)
    witness = Witness()
    run(replace(request(tmp_path, flow=(JOIN, large, REPORT)), memory=1_500_000_000), witness)
    (said,) = witness.said
    assert said.startswith("count needs about 1.7 GB of memory, and --memory allows 1.5 GB")


def test_a_stage_that_needs_far_more_than_there_is_is_not_begun(tmp_path, monkeypatch, tried):
    write_words(tmp_path, a="apple")
    monkeypatch.setattr(limits, "free_bytes", lambda: 2_000_000_000)
    monstrous = replace(COUNT, run=run_out, memory=lambda settings, inputs, threads: 90_000_000_000, **FRUGAL)
    with pytest.raises(MachineError, match=r"count needs about 90\.0 GB .*it was not begun\. For less"):
        run_toy(tmp_path, flow=(JOIN, monstrous, REPORT))
    assert run_toy(tmp_path).ran == ["count", "report"]
    tried("memory: a stage needs far more than is free", "refused before it began")


def test_the_free_memory_is_measured_or_unknown():
    free = limits.free_bytes()
    assert free is None or 0 <= free < 2**50
    if sys.platform.startswith("linux"):
        assert free is not None


def test_the_peak_of_a_stage_is_not_that_of_the_one_before(tmp_path):
    """Neither through the counter of the system, nor through what the C library keeps of freed memory."""
    write_words(tmp_path, a="apple")

    def greedy(job) -> None:
        pieces = [bytes(20_000) for _ in range(20_000)]  # 400 MB in pieces that the C library keeps
        job.outputs["text"].write_text(str(len(pieces)))

    run_toy(tmp_path, flow=(replace(JOIN, run=greedy), COUNT, REPORT))
    store = Store(tmp_path / "workspace")
    peaks = [find_record(store, stage).peak_bytes for stage in ("join", "count")]
    assert peaks[0] - peaks[1] > 300e6


@pytest.mark.parametrize("stage", ALL_STAGES, ids=lambda stage: stage.name)
def test_every_stage_has_advice_and_it_names_settings_that_exist(stage):
    assert stage.saves_memory
    places = {f"{one.name}.{name}" for one in ALL_STAGES for name, _ in all_settings(one.settings)}
    assert set(re.findall(r"\b[a-z_]+\.[a-z_]+", stage.saves_memory)) <= places
