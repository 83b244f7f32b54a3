"""Death at random moments of every stage: nothing half-made is seen, nothing piles up, digests are the same.

The program is a parent that waits, a child that runs the stages, and a child of that for the stage at work.
Ctrl-C goes to all, SIGTERM to the parent or to all, SIGKILL to one of them or to all.
"""

from __future__ import annotations

import os
import random
import shutil
import signal
import subprocess
import time
from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path

import pytest

from pipeline.cache.digest import digest_file
from pipeline.cache.store import PARTIAL
from tests.faults import small_runs
from tests.faults.small_runs import STAGES, leftovers, one_line, published, results, words

LEAVES_WITHIN_S = 2.0
LONG_POISSON = ("--set", "mesh.depth=12")  # seconds within one call of open3d, which holds Python's lock
SHORT, LONG = 12, 120
NOTHING_BEGUN = "unshade: Interrupted before anything had begun."


@dataclass(frozen=True)
class Attack:
    """One way to end a run: the signal, and whom it reaches."""

    name: str
    number: signal.Signals
    whom: str  # parent, child, stage or all


ATTACKS = (
    Attack("Ctrl-C", signal.SIGINT, "all"),
    Attack("SIGTERM", signal.SIGTERM, "parent"),
    Attack("SIGTERM to the group", signal.SIGTERM, "all"),
    Attack("SIGKILL", signal.SIGKILL, "parent"),
    Attack("SIGKILL to the group", signal.SIGKILL, "all"),
    Attack("SIGKILL of the process that runs the stages", signal.SIGKILL, "child"),
    Attack("SIGKILL of the stage at work", signal.SIGKILL, "stage"),
)


@dataclass(frozen=True)
class Undisturbed:
    """A finished run: its workspace, digests of its files, seconds of each stage."""

    folder: Path
    workspace: Path
    results: dict[str, str]
    seconds: dict[str, float]


@pytest.fixture(autouse=True, scope="module")
def heeded_signals() -> Iterator[None]:
    """Undo what a shell does to jobs in the background: they, and their children, ignore Ctrl-C."""
    former = signal.signal(signal.SIGINT, signal.default_int_handler)
    yield
    signal.signal(signal.SIGINT, former)


@pytest.fixture(scope="module")
def undisturbed(tmp_path_factory) -> Undisturbed:
    folder = tmp_path_factory.mktemp("death")
    small_runs.link_photos(folder / "photos")
    workspace = folder / "undisturbed"
    done = small_runs.do(words("run", workspace))
    assert done.returncode == 0, done.stderr
    seconds = {record.stage: record.seconds for record in published(workspace)}
    return Undisturbed(folder, workspace, results(workspace), seconds)


@dataclass
class Running:
    """A run in a session of its own, whose temporary files have a folder of their own."""

    process: subprocess.Popen[str]
    workspace: Path
    of_earlier_runs: set[Path]

    @classmethod
    def begin(cls, workspace: Path, temporary: Path, *more: str) -> Running:
        temporary.mkdir(exist_ok=True)
        of_earlier_runs = set((workspace / "cache").glob(f"*/{PARTIAL}*"))
        process = subprocess.Popen(
            words("run", workspace, *more),
            cwd=small_runs.ROOT,
            env=small_runs.environment({"TMPDIR": str(temporary)}),
            stdout=subprocess.PIPE,
            stderr=subprocess.STDOUT,
            text=True,
            start_new_session=True,
        )
        return cls(process, workspace, of_earlier_runs)

    def await_stage(self, stage: str) -> None:
        """Wait until the stage is at work, or the run has ended."""
        folder = self.workspace / "cache" / stage
        while self.process.poll() is None and not set(folder.glob(f"{PARTIAL}*")) - self.of_earlier_runs:
            time.sleep(0.002)

    def child(self, generations: int) -> int | None:
        """The process that runs the stages (one generation on), or the stage at work (two)."""
        found = self.process.pid
        with suppress(OSError, StopIteration):
            for _ in range(generations):
                children = Path(f"/proc/{found}/task/{found}/children")
                found = next(iter(map(int, children.read_text().split())))
            return found
        return None

    def awaited_child(self, generations: int) -> int | None:
        """That process, as soon as there is one: between two stages none is at work."""
        while self.process.poll() is None:
            if (child := self.child(generations)) is not None:
                return child
            time.sleep(0.002)
        return None

    def attack(self, how: Attack) -> tuple[int, str, float]:
        """Send the signal; returns the exit code, the last line and the seconds until it had left."""
        begun = time.perf_counter()
        with suppress(ProcessLookupError):
            if how.whom == "all":
                os.killpg(self.process.pid, how.number)
            elif how.whom == "parent":
                self.process.send_signal(how.number)
            elif (child := self.awaited_child(1 if how.whom == "child" else 2)) is not None:
                os.kill(child, how.number)
        said, _ = self.process.communicate(timeout=60)  # to the end of all: children have the streams, too
        return (
            self.process.returncode,
            one_line(said.splitlines()[-1] if said else ""),
            time.perf_counter() - begun,
        )


def check_left_behind(workspace: Path, expected: Undisturbed, swept: bool, temporary: Path) -> None:
    """What is visible is whole: every result has its record and its files, every file of output its bytes."""
    for record in published(workspace):
        entry = workspace / "cache" / record.stage / record.key
        for files in record.outputs.values():
            for name, digest in files.items():
                assert digest in {digest_file(path) for path in entry.rglob(Path(name).name)}, (entry, name)
    for name, digest in results(workspace).items():
        assert expected.results.get(name) == digest, f"{name} is half-made"
    if swept:
        assert leftovers(workspace) == []
    assert list(temporary.iterdir()) == []


def check_ending(how: Attack, code: int, line: str, seconds: float) -> bool:
    """The exit code and the line that a signal gives; False where the run had ended before it came."""
    if code == 0:
        return False
    if how.number == signal.SIGKILL and how.whom in ("parent", "all"):
        assert code == -signal.SIGKILL
        return True
    if code < 0:  # the interpreter was about to begin or to end: nothing runs yet, or no longer
        assert code == -how.number
        return True
    if line == NOTHING_BEGUN:  # it was being loaded
        return code == 128 + signal.SIGINT
    assert "To go on: unshade run " in line or "the same command continues there" in line, line
    assert code == (1 if how.whom in ("child", "stage") else 128 + how.number), line
    assert seconds < LEAVES_WITHIN_S
    return True


def moments(count: int, seconds: dict[str, float], chance: random.Random) -> Iterator[tuple[str, float]]:
    """Stages in turn, and a random moment in each; a moment later than its end falls into the next one."""
    first = chance.randrange(len(STAGES))
    for number in range(first, first + count):
        stage = STAGES[number % len(STAGES)]
        yield stage, chance.uniform(0, 1.1 * seconds[stage])


def kill_often(undisturbed: Undisturbed, count: int, seed: int, tried) -> None:
    """Kill runs of two workspaces at a time again and again."""
    with ThreadPoolExecutor(2) as executor:
        for one in [
            executor.submit(kill_in_turn, undisturbed, count // 2, seed + i, tried) for i in range(2)
        ]:
            one.result()


def kill_in_turn(undisturbed: Undisturbed, count: int, seed: int, tried) -> None:
    """Kill runs of one workspace again and again; then let one end, and compare all digests."""
    chance, hits = random.Random(seed), 0
    workspace, temporary = undisturbed.folder / f"killed_{seed}", undisturbed.folder / f"tmp_{seed}"
    shutil.copytree(undisturbed.workspace, workspace)
    for number, (stage, delay) in enumerate(moments(count, undisturbed.seconds, chance)):
        how = ATTACKS[(number + seed) % len(ATTACKS)]
        running = Running.begin(workspace, temporary, "--from", stage, "--force")
        running.await_stage(stage)
        time.sleep(delay)
        code, line, seconds = running.attack(how)
        hit = check_ending(how, code, line, seconds)
        hits += hit
        check_left_behind(workspace, undisturbed, swept=how.number != signal.SIGKILL, temporary=temporary)
        if hit:
            tried(f"{how.name} at a random moment of a stage", "nothing half-made; the next run goes on")
    assert hits >= 0.7 * count, "most runs had ended before they were killed"
    done = small_runs.do(words("run", workspace))
    assert done.returncode == 0, done.stderr
    assert results(workspace) == undisturbed.results
    assert leftovers(workspace) == []
    tried("the run after the kills", "same digests")


def test_a_dozen_deaths_change_nothing(undisturbed, tried):
    kill_often(undisturbed, SHORT, seed=1, tried=tried)


@pytest.mark.slow
def test_a_hundred_deaths_change_nothing(undisturbed, tried):
    kill_often(undisturbed, LONG, seed=10, tried=tried)


@pytest.mark.slow
def test_a_run_from_nothing_survives_deaths_at_any_time(undisturbed, tried):
    """Without --force and from an empty workspace: what was finished before each kill is reused."""
    chance = random.Random(3)
    for number in range(3):
        workspace, temporary = undisturbed.folder / f"nothing_{number}", undisturbed.folder / f"tmp_{number}"
        for _ in range(30):
            how = chance.choice(ATTACKS)
            running = Running.begin(workspace, temporary)
            time.sleep(chance.uniform(0.3, 4))
            if not check_ending(how, *running.attack(how)):
                break
            check_left_behind(workspace, undisturbed, swept=False, temporary=temporary)
            tried(f"{how.name} of a run from an empty workspace", "nothing half-made; the next run goes on")
        assert small_runs.do(words("run", workspace)).returncode == 0
        assert results(workspace) == undisturbed.results
        assert leftovers(workspace) == []
        tried("the run after the kills", "same digests")


@pytest.mark.parametrize("how", ATTACKS[:2], ids=lambda how: how.name)
def test_a_signal_within_native_code_is_heeded_at_once(undisturbed, how, tried):
    """Open3d's Poisson holds Python's lock for seconds: no handler of Python could run."""
    workspace = undisturbed.folder / f"poisson_{how.number}"
    shutil.copytree(undisturbed.workspace, workspace)
    running = Running.begin(workspace, undisturbed.folder / "tmp", "--from", "mesh", *LONG_POISSON)
    running.await_stage("mesh")
    time.sleep(1.5)
    code, line, seconds = running.attack(how)
    assert code == 128 + how.number
    assert " during mesh. The results of the 3 stages before it are kept. To go on: unshade run " in line
    assert seconds < LEAVES_WITHIN_S
    assert leftovers(workspace) == []
    assert results(workspace) == undisturbed.results
    tried(f"{how.name} within Poisson (native code)", "left within two seconds with a line")


def test_ctrl_c_while_the_program_is_loaded_ends_it_in_a_line(tmp_path, tried):
    running = Running.begin(tmp_path / "workspace", tmp_path / "tmp")
    maps = Path(f"/proc/{running.process.pid}/maps")
    while running.process.poll() is None and "_pydantic_core" not in maps.read_text():
        time.sleep(0.001)
    code, line, seconds = running.attack(ATTACKS[0])
    assert (code, line) == (128 + signal.SIGINT, NOTHING_BEGUN)
    assert seconds < LEAVES_WITHIN_S and not (tmp_path / "workspace").exists()
    tried("Ctrl-C while the program is loaded", "left with a line")


def test_a_result_that_was_about_to_be_replaced_is_kept(undisturbed, tried):
    """A kill between the two renames of a publication: the old result is aside, the new one not yet there."""
    workspace = undisturbed.folder / "aside"
    shutil.copytree(undisturbed.workspace, workspace)
    (entry,) = (workspace / "cache" / "mvs").iterdir()
    (partial := entry.parent / f"{PARTIAL}0").mkdir()
    entry.rename(partial / entry.name)
    done = small_runs.do(words("run", workspace))
    assert done.returncode == 0 and "reuse           sfm, undistort, mvs" in done.stderr
    assert results(workspace) == undisturbed.results and leftovers(workspace) == []
    tried("SIGKILL between two renames of a publication", "the earlier result returns")


def test_a_killed_copy_to_output_leaves_no_temporary_file(undisturbed, tried):
    """What a kill between two lines would leave: a begun copy, a begun ledger, a begun result."""
    workspace = undisturbed.folder / "copies"
    shutil.copytree(undisturbed.workspace, workspace)
    (workspace / "output" / ".part").write_bytes(b"half")
    (workspace / "cache" / ".output.json.part").write_text("{")
    (workspace / "cache" / "relight" / f"{PARTIAL}0").mkdir(parents=True)
    done = small_runs.do(words("run", workspace))
    assert done.returncode == 0 and "run " not in done.stderr
    assert leftovers(workspace) == []
    tried("temporary files of a killed run", "swept by the next run", times=3)
