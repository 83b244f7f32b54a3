"""Environments that a program meets: clocks, locales, homes, closed and full streams, odd names.

The short form meets several of them at once.
"""

from __future__ import annotations

import json
import os
import shutil
import subprocess
from collections.abc import Iterable
from pathlib import Path
from typing import Any

import pytest

from tests.faults import small_runs
from tests.faults.small_runs import leftovers, one_line, published, results, words

TO = ("--to", "undistort")
AGAIN = ("--only", "undistort", "--force")
ASCII = {"LC_ALL": "C", "PYTHONUTF8": "0", "PYTHONCOERCECLOCALE": "0"}
ENVIRONMENTS: dict[str, dict[str, str | None]] = {
    "another time zone": {"TZ": "Pacific/Kiritimati"},
    "an ASCII locale, UTF-8 mode off": ASCII,
    "no HOME": {"HOME": None, "XDG_CACHE_HOME": None},
    "a HOME that cannot be written": {"HOME": "/dev/null", "XDG_CACHE_HOME": None},
    "TMPDIR that is missing": {"TMPDIR": "/nonexistent/tmp"},
}
TOGETHER = {name: value for one in ENVIRONMENTS.values() for name, value in one.items()}


def short_and_slow(short: Iterable[str], slow: Iterable[str]) -> list[Any]:
    return [*short, *(pytest.param(one, marks=pytest.mark.slow) for one in slow)]


# As libfaketime does for a whole process, here for Python's clocks.
CLOCK = """
import datetime, time
SHIFT, real, now = {seconds}, time.time, datetime.datetime
class Shifted(now):
    @classmethod
    def now(cls, tz=None):
        return now.now(tz) + datetime.timedelta(seconds=SHIFT)
datetime.datetime, time.time = Shifted, lambda: real() + SHIFT
"""


@pytest.fixture(scope="module")
def workspace(tmp_path_factory) -> Path:
    """A workspace with the results of two stages; photos and their folder have names beyond ASCII."""
    folder = tmp_path_factory.mktemp("environment")
    photos = small_runs.link_photos(folder / "photos")
    for photo in photos.iterdir():
        photo.rename(photos / f"näh {photo.name}")
    (photos / "straße").mkdir()
    (photos / "näh 001.jpg").rename(photos / "straße" / "ß 001.jpg")
    assert small_runs.do(words("run", folder / "wörk", *TO)).returncode == 0
    return folder / "wörk"


def test_results_are_the_same_in_all_of_them(workspace, tried):
    before = results(workspace)
    done = small_runs.do(words("run", workspace, *AGAIN), TOGETHER)
    assert done.returncode == 0, done.stderr
    assert "reuse           sfm" in done.stderr
    assert results(workspace) == before
    assert leftovers(workspace) == []
    tried(", ".join(ENVIRONMENTS), "same digests")


@pytest.mark.slow
@pytest.mark.parametrize("name", ENVIRONMENTS)
def test_results_of_all_stages_are_the_same_in(workspace, name, tried, tmp_path):
    whole = workspace.parent / "whole"
    assert small_runs.do(words("run", whole)).returncode == 0
    done = small_runs.do(words("run", tmp_path / "w", photos=workspace.parent / "photos"), ENVIRONMENTS[name])
    assert done.returncode == 0, done.stderr
    assert results(tmp_path / "w") == results(whole)
    tried(f"{name}, all stages", "same digests")


@pytest.mark.slow
def test_decimal_commas_change_nothing(workspace, tmp_path, tried):
    made = subprocess.run(
        ["localedef", "-i", "de_DE", "-f", "UTF-8", str(tmp_path / "de_DE.UTF-8")],
        capture_output=True, check=False,
    ) if shutil.which("localedef") else None  # fmt: skip
    if made is None or not (tmp_path / "de_DE.UTF-8").is_dir():
        pytest.skip("no locale with decimal commas can be made here")
    whole = workspace.parent / "whole"
    assert small_runs.do(words("run", whole)).returncode == 0
    german: dict[str, str | None] = {"LOCPATH": str(tmp_path), "LC_ALL": "de_DE.UTF-8"}
    done = small_runs.do(words("run", tmp_path / "w", photos=workspace.parent / "photos"), german)
    assert done.returncode == 0, done.stderr
    assert results(tmp_path / "w") == results(whole)
    tried("a locale with decimal commas, all stages", "same digests")


@pytest.mark.parametrize("years", short_and_slow([12], [-12]))
def test_a_clock_that_was_wrong_costs_nothing(workspace, tmp_path, years, tried):
    """Results of a wrong time are reused, and the newest is the one that the last run made."""
    shutil.copytree(workspace, target := tmp_path / "workspace")
    (tmp_path / "clock").mkdir()
    (tmp_path / "clock" / "sitecustomize.py").write_text(CLOCK.format(seconds=years * 365 * 86400))
    wrong: dict[str, str | None] = {
        "PYTHONPATH": os.pathsep.join([str(tmp_path / "clock"), str(small_runs.ROOT)])
    }
    photos, other = workspace.parent / "photos", ("--set", "undistort.max_size_px=80")
    assert small_runs.do(words("run", target, *TO, *other, photos=photos), wrong).returncode == 0
    times = sorted(record.finished for record in published(target))
    assert int(times[-1][:4]) - int(times[0][:4]) >= 11  # the clock did differ
    done = small_runs.do(words("run", target, *TO, photos=photos))
    assert done.returncode == 0 and "reuse           sfm, undistort" in done.stderr
    found = small_runs.do(words("diff", target, "--stage", "undistort"))
    assert "setting max_size_px went from 80 to 96" in one_line(found.stdout)
    tried("a clock set back by years" if years > 0 else "a clock set forward by years", "reused; order kept")


def read_one_line(line: list[str | bytes], stream: str) -> tuple[int, str]:
    """Execute a command whose reader takes one line and goes; returns its exit code and its other stream."""
    other = "stderr" if stream == "stdout" else "stdout"
    process = subprocess.Popen(
        line, cwd=small_runs.ROOT, env=small_runs.environment(), text=True,
        **{stream: subprocess.PIPE, other: subprocess.PIPE},
    )  # fmt: skip
    pipes = {"stdout": process.stdout, "stderr": process.stderr}
    read, unread = pipes[stream], pipes[other]
    assert read is not None and unread is not None
    assert read.readline()
    read.close()
    said = unread.read()
    unread.close()
    return process.wait(), said


def test_a_reader_that_has_had_enough_is_no_error(workspace, tried):
    program = words("status", workspace)[:3]
    for line in (words("show", workspace, "--json", "--stage", "sfm"), [*program, "run", "--help"]):
        assert read_one_line(line, "stdout") == (0, ""), line
    before = results(workspace)
    code, said = read_one_line(words("run", workspace, *AGAIN), "stderr")
    assert code == 0 and "Up to date" in said
    assert results(workspace) == before
    tried("a reader that closes the pipe after one line", "no error; the run goes on", times=3)


@pytest.mark.parametrize("closed", short_and_slow(["<&- >&- 2>&-"], [">&-", "2>&-", "2>/dev/full"]))
def test_a_run_does_without_streams(workspace, closed, tried):
    before = results(workspace)
    line = words("run", workspace, *AGAIN)
    done = small_runs.do(["sh", "-c", f'exec "$@" {closed}', "sh", *line])
    assert done.returncode == 0, done.stderr
    assert "Traceback" not in done.stderr
    assert results(workspace) == before  # nothing that a library prints went into a file
    tried(f"a run with {closed}", "same digests")


def test_a_full_output_stream_is_named(workspace, tried):
    program = words("status", workspace)[:3]
    for line in (words("status", workspace), [*program, "--help"]):
        done = small_runs.do(["sh", "-c", 'exec "$@" >/dev/full', "sh", *line])
        assert done.returncode == 2
        assert "cannot be written to the output stream" in one_line(done.stderr)
        assert "Traceback" not in done.stderr
    tried("an answer to a full disk", "refused in a sentence", times=2)


@pytest.mark.parametrize("number", short_and_slow(["1000000000"], ["0", "-3"]))
def test_numbers_of_threads_have_bounds(workspace, number, tried):
    done = small_runs.do(words("run", workspace, "--threads", number))
    assert done.returncode == 2
    assert f"--threads is {number}; expected 1 to 1024" in one_line(done.stderr)
    tried(f"--threads {number}", "refused in a sentence")


@pytest.mark.slow
def test_as_many_threads_as_are_allowed_give_the_same(workspace, tmp_path, tried):
    whole = workspace.parent / "whole"
    assert small_runs.do(words("run", whole)).returncode == 0
    line = words("run", tmp_path / "w", "--threads", "1024", photos=workspace.parent / "photos")
    done = small_runs.do(line)
    assert done.returncode == 0, done.stderr
    assert results(tmp_path / "w") == results(whole)
    tried("--threads 1024", "same digests")


@pytest.mark.parametrize("flag", short_and_slow(["--workspace"], ["--images"]))
def test_a_path_that_is_not_utf8_is_refused(workspace, flag, tried):
    odd = os.fsencode(workspace.parent) + b"/w\xff"
    Path(os.fsdecode(odd)).mkdir(exist_ok=True)
    done = small_runs.do([*words("run", workspace), flag.encode(), odd])
    assert done.returncode == 2
    assert "is not UTF-8" in one_line(done.stderr) and "Traceback" not in done.stderr
    assert list(Path(os.fsdecode(odd)).iterdir()) == []
    tried(f"{flag} with a name that is not UTF-8", "refused in a sentence")


def test_answers_are_readable_in_an_ascii_locale(workspace, tried):
    done = small_runs.do(words("status", workspace, "--json"), {**ASCII, "PYTHONIOENCODING": "ascii"})
    assert done.returncode == 0, done.stderr
    assert [row["stage"] for row in json.loads(done.stdout)] == ["sfm", "undistort"]
    tried("answers in an ASCII locale", "readable")
