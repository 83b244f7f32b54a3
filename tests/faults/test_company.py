"""Other processes at the same time: on one workspace, on one folder of photos, of the same compiled loops."""

from __future__ import annotations

import shutil
import signal
import subprocess
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import pytest

from tests.faults import small_runs
from tests.faults.small_runs import leftovers, one_line, results, words

SLOWLY = ("--set", "sfm.max_size_px=480", "--set", "sfm.max_features=20000", "--force")  # for several seconds


@pytest.fixture(scope="module")
def workspace(tmp_path_factory) -> Path:
    """One of two workspaces, `a` and `b`, that got the results of two stages at once from the same photos."""
    folder = tmp_path_factory.mktemp("company")
    small_runs.link_photos(folder / "photos")
    run_side_by_side(folder, ("a", "b"), "--to", "undistort")
    return folder / "a"


def run_side_by_side(folder: Path, names: tuple[str, ...], *more: str) -> list[dict[str, str]]:
    """Run workspaces at the same time on one folder of photos; returns the digests of each."""
    with ThreadPoolExecutor(len(names)) as executor:
        for done in executor.map(lambda name: small_runs.do(words("run", folder / name, *more)), names):
            assert done.returncode == 0, done.stderr
    return [results(folder / name) for name in names]


def test_two_workspaces_share_a_folder_of_photos(workspace, tried):
    assert results(workspace) == results(workspace.parent / "b")
    tried("two workspaces at once on one folder of photos", "same digests")


def test_during_a_run_others_read_or_are_refused_with_a_sentence(workspace, tried):
    photos = small_runs.link_photos(workspace.parent / "dozen", 12)
    before = results(workspace)
    former = signal.signal(signal.SIGINT, signal.default_int_handler)  # which a job in the background ignores
    first = subprocess.Popen(
        words("run", workspace, "--to", "sfm", *SLOWLY, photos=photos),
        cwd=small_runs.ROOT, env=small_runs.environment(), stderr=subprocess.PIPE, text=True,
    )  # fmt: skip
    signal.signal(signal.SIGINT, former)
    while not list((workspace / "cache" / "sfm").glob(".partial-*")):
        assert first.poll() is None, first.communicate()
    at_once = {
        "a second run": words("run", workspace, "--to", "sfm"),
        "clean": words("clean", workspace),
        "status": words("status", workspace, "--json"),
        "show": words("show", workspace, "--stage", "sfm"),
        "plan": words("plan", workspace, "--to", "undistort"),
    }
    with ThreadPoolExecutor(len(at_once)) as executor:
        done = dict(zip(at_once, executor.map(small_runs.do, at_once.values()), strict=True))
    assert first.poll() is None, "the first run ended before it was disturbed"
    for name in ("a second run", "clean"):
        assert done[name].returncode == 2, name
        assert "Another run is using the workspace" in one_line(done[name].stderr)
        tried(f"{name} during a run on the workspace", "refused in a sentence")
    for name in ("status", "show", "plan"):
        assert done[name].returncode == 0, done[name].stderr
        assert done[name].stdout
        tried(f"{name} during a run on the workspace", "answered")
    first.send_signal(signal.SIGINT)
    assert "during sfm. What was finished is kept. To go on: unshade run " in one_line(first.communicate()[1])
    assert results(workspace) == before and leftovers(workspace) == []


@pytest.mark.slow
def test_whole_runs_side_by_side_from_no_compiled_loops_are_equal(workspace, tried, tmp_path, monkeypatch):
    """All compile at once into one cache of loops."""
    monkeypatch.setenv("NUMBA_CACHE_DIR", str(tmp_path / "loops"))
    for attempt in range(2):
        first, *others = run_side_by_side(workspace.parent, ("c", "d", "e"))
        assert all(other == first for other in others)
        for name in ("c", "d", "e"):
            shutil.rmtree(workspace.parent / name)
        how = "with" if attempt else "without"
        tried(f"three whole runs at once, {how} compiled loops", "same digests", times=3)


@pytest.mark.slow
def test_questions_at_any_moment_of_a_run_are_answered(workspace, tried):
    """Results come, go and are replaced while they are listed and compared with their records."""
    shutil.copytree(workspace, target := workspace.parent / "asked")
    line = words("run", target, "--to", "undistort", "--force")
    asked = 0
    for _ in range(6):
        run = subprocess.Popen(
            line, cwd=small_runs.ROOT, env=small_runs.environment(), stderr=subprocess.DEVNULL
        )
        while run.poll() is None:
            for question in (("status",), ("show", "--stage", "undistort"), ("plan", "--to", "undistort")):
                done = small_runs.do(words(question[0], target, *question[1:]))
                assert done.returncode == 0, done.stderr
                asked += 1
        assert run.returncode == 0
    tried("status, show and plan at any moment of a run", "answered", times=asked)
