"""Work in a fork: its result, its error, what it tells, its memory, and its end, which is that of the run."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import threading
import traceback
from dataclasses import replace
from pathlib import Path

import pytest

from pipeline import UserError
from pipeline.errors import MachineError
from pipeline.process.forked import in_fork
from pipeline.process.meter import resident_bytes
from pipeline.run import run
from tests import toy_flow

ROOT = Path(__file__).parent.parent
LARGE = 300_000_000  # bytes


def unheard(*_: object) -> None:
    """Hear nothing."""


def test_the_result_comes_back_and_what_was_told_comes_in_order():
    heard = []

    def work(tell):
        for number in range(1000):
            tell("step", number)
        return os.getpid()

    assert in_fork(work, lambda *values: heard.append(values)) != os.getpid()
    assert heard == [("step", number) for number in range(1000)]


def test_threads_may_tell_at_the_same_time():
    heard = []

    def work(tell):
        threads = [
            threading.Thread(target=lambda: [tell("x" * 100_000) for _ in range(50)]) for _ in range(4)
        ]
        for one in threads:
            one.start()
        for one in threads:
            one.join()

    in_fork(work, heard.append)
    assert heard == ["x" * 100_000] * 200


def test_an_error_comes_back_with_the_place_where_it_was_raised():
    def fails(_):
        raise ValueError("no such number")

    with pytest.raises(ValueError, match="no such number") as caught:
        in_fork(fails, unheard)
    assert "raise ValueError" in "".join(traceback.format_exception(caught.value))


@pytest.mark.parametrize("kind", [UserError, MachineError])
def test_a_sentence_comes_back_as_it_is(kind):
    def fails(_):
        raise kind("The file is empty; expected a photo.")

    with pytest.raises(kind, match=r"^The file is empty; expected a photo\.$"):
        in_fork(fails, unheard)


class TwoWordsError(Exception):
    """An error that cannot be made again from its message, as those of some libraries.

    It says how it is pickled: where it did not, Dask, once a test has imported it, would know a way.
    """

    def __init__(self, first: str, second: str) -> None:
        super().__init__(f"{first} {second}")

    def __reduce__(self) -> tuple[type, tuple]:
        return TwoWordsError, self.args


class LockedError(Exception):
    """An error that cannot be pickled: it holds a lock, as those of libraries hold a connection."""

    def __init__(self, *words: str) -> None:
        super().__init__(" ".join(words))
        self.lock = threading.Lock()


@pytest.mark.parametrize("kind", [TwoWordsError, LockedError])
def test_an_error_that_cannot_be_sent_is_told_by_name(kind):
    def fails(_):
        raise kind("very", "bad")

    with pytest.raises(RuntimeError, match=rf"^{kind.__name__}: very bad$"):
        in_fork(fails, unheard)


def test_a_fork_that_leaves_without_a_word_is_an_error():
    with pytest.raises(MachineError, match="ended before its time .exit code 7."):
        in_fork(lambda _: os._exit(7), unheard)


def test_an_error_of_who_hears_ends_the_fork():
    told = []

    def work(tell):
        told.append(os.getpid())
        tell(os.getpid())
        signal.pause()

    def heard(fork):
        told.append(fork)
        raise KeyError(fork)

    with pytest.raises(KeyError):
        in_fork(work, heard)
    with pytest.raises(ProcessLookupError):
        os.kill(told[0], 0)


CRASH = """
import os, sys
from pipeline.process.forked import in_fork

in_fork(lambda _: os.kill(os.getpid(), int(sys.argv[1])), lambda: None)
"""


@pytest.mark.parametrize("how", [signal.SIGKILL, signal.SIGSEGV, signal.SIGABRT])
def test_a_crash_of_the_fork_ends_who_waits_for_it_alike(how, tmp_path):
    """So that who started the run can say how it ended: out of memory, or a fault of native code."""
    (tmp_path / "crash.py").write_text(CRASH, encoding="utf-8")
    environment = os.environ | {"PYTHONPATH": str(ROOT)}
    done = subprocess.run(
        [sys.executable, tmp_path / "crash.py", str(int(how))], env=environment, cwd=tmp_path
    )
    assert done.returncode == -how


@pytest.mark.skipif(not resident_bytes(), reason="the system does not say")
def test_memory_of_the_fork_is_free_after_it():
    def kept_for_good(_):
        before = resident_bytes()
        in_fork.kept = b"1" * LARGE  # as a library would
        return resident_bytes() - before

    before = resident_bytes()
    assert in_fork(kept_for_good, unheard) > LARGE // 2
    assert resident_bytes() < before + LARGE // 10


class Hearing(toy_flow.Witness):
    """A witness that remembers progress as well."""

    def begin(self, label, total, at_most=False):
        self.said.append(f"{label} of {total}")

    def advance(self, steps=1):
        self.said.append(f"and {steps}")

    def end(self):
        self.said.append("end")


def talkative(job):
    with job.progress("words", 2) as step:
        step()
        step()
    job.say("Joining is done.")
    job.warn("Some words are short.")
    toy_flow.join(job)


def run_of(root: Path, forks: bool) -> tuple[list[str], list[dict]]:
    """What is heard of a run, and the records of its results but for their cost."""
    toy_flow.write_words(root, one="tree", two="house")
    flow = (replace(toy_flow.JOIN, run=talkative), *toy_flow.FLOW[1:])
    hearing = Hearing()
    done = run(replace(toy_flow.request(root, flow=flow), forks=forks), hearing)
    cost = {"seconds", "cpu_seconds", "peak_bytes", "finished", "spans"}
    return hearing.said, [
        {name: value for name, value in one.record.as_json().items() if name not in cost} for one in done
    ]


def test_a_run_in_forks_says_and_gives_what_one_without_does(tmp_path):
    for name in ("forks", "none"):
        (tmp_path / name).mkdir()
    said, records = run_of(tmp_path / "forks", forks=True)
    assert (said, records) == run_of(tmp_path / "none", forks=False)
    assert said[-6:-1] == ["words of 2", "and 1", "and 1", "end", "Joining is done."]
    assert records[0]["facts"] == {"words": 2} and records[0]["warnings"] == ["Some words are short."]


def test_a_stage_that_fails_in_a_fork_leaves_its_log_and_nothing_else(tmp_path):
    toy_flow.write_words(tmp_path, one="poison")
    with pytest.raises(UserError, match=r"^A word is poison; expected an edible one\."):
        run(replace(toy_flow.request(tmp_path), forks=True), toy_flow.Witness())
    assert "A word is poison" in (tmp_path / "workspace" / "logs" / "join.txt").read_text()
    assert list((tmp_path / "workspace" / "cache" / "join").iterdir()) == []


SHARED = """
import os
os.environ["OPENBLAS_NUM_THREADS"] = "1"
from importlib import import_module
from stages.cli import SHARED
for name in SHARED:
    import_module(name)
print(len(os.listdir("/proc/self/task")))
"""


@pytest.mark.skipif(not sys.platform.startswith("linux"), reason="looks at /proc")
def test_what_is_imported_before_the_forks_begins_no_threads():
    """A fork would not have them: the library would wait for them without end."""
    environment = os.environ | {"PYTHONPATH": str(ROOT)}
    done = subprocess.run(
        [sys.executable, "-c", SHARED], env=environment, capture_output=True, text=True, check=True
    )
    assert done.stdout.strip() == "1"
