"""Tasks on the workers of a Dask cluster: the same bytes as on threads, also where workers are lost."""

from __future__ import annotations

import gc
import json
import os
import subprocess
import sys
import time
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path

import numpy as np
import psutil
import pytest

from pipeline import UserError
from pipeline.cluster import on_demand, worker_checks
from pipeline.cluster.on_demand import ClusterOnDemand, ClusterRequest
from pipeline.cluster.tasks import LocalTasks
from pipeline.cluster.worker_checks import check_workers
from pipeline.errors import MachineError
from pipeline.stage_work import on_workers
from stages.command.arguments import Run
from stages.command.machine import cluster_of
from stages.transfer import TRANSFER as TRANSFER_STAGE
from tests.faults import small_runs
from tests.faults.small_runs import one_line, results, words
from tests.pseudo_terminal import run_in_terminal

BEFORE = dict(os.environ)
DISTRIBUTED = ("sfm", "undistort", "mvs", "correspondence", "lighting", "decomposition")
AT_WORK_S = 0.3  # from when a stage begins until its tasks run
TRANSFER = (  # eight views in clusters, so that every stage has tasks
    "--set", "decomposition.mode=transfer", "--set", "decomposition.clusters.pixels=10000",
    "--set", "lighting.pixels=10000", "--set", "lighting.clusters.pixels=10000",
    "--set", "lighting.lights=shared", "--set", "lighting.samples=4000",
    "--set", "transfer.max_vertices=3000", "--set", "correspondence.all_up_to=2",
    "--set", "correspondence.neighbours=2",
)  # fmt: skip


def divided(number: int, by: int, threads: int) -> float:
    if by == 0:
        raise UserError(f"{number} cannot be divided by 0")
    return number / by


def worker_number(_: int, folder: Path) -> int:
    """End the first worker that comes here."""
    first = folder / "came"
    if not first.exists():
        first.touch()
        os._exit(1)
    return os.getpid()


def fails_or_writes(late: str | Path) -> None:
    """Fail while the other task runs, which writes long after."""
    if late == "fails":
        time.sleep(0.3)
        raise UserError("no such number")
    time.sleep(1.0)
    Path(late).touch()


def beside_others(item: int, folder: Path, threads: int) -> tuple[int, int]:
    """Count the tasks that run, this one included; with its threads."""
    own = folder / str(item)
    own.touch()
    time.sleep(0.3)
    running = len(list(folder.iterdir()))
    own.unlink()
    return running, threads


def worker_of(_: int, shared: np.ndarray) -> int:
    time.sleep(0.5)
    return os.getpid()


@pytest.fixture(autouse=True)
def no_client_left():
    """Collect clients that joined nothing: where another begins meanwhile, Dask's locks would block both."""
    yield
    gc.collect()


@pytest.fixture(scope="module")
def two_workers(tmp_path_factory):
    with ClusterOnDemand(ClusterRequest(2), 2, ["numpy"], tmp_path_factory.mktemp("two")) as there:
        yield there.tasks()


def test_tasks_give_the_same_in_order_wherever_they_run(two_workers):
    here = LocalTasks(None, 2)  # type: ignore[arg-type]  # large tasks take no executor
    for tasks in (here, two_workers):
        assert list(tasks.large(divided, range(20), 4)) == [number / 4 for number in range(20)]
        with pytest.raises(UserError, match="3 cannot be divided"):
            list(tasks.large(divided, [3, 4], 0))


def test_tasks_of_a_lost_worker_are_done_again(two_workers, tmp_path):
    done = list(two_workers.small(worker_number, range(6), tmp_path))
    assert len(done) == 6 and os.getpid() not in done


def test_workers_and_this_process_have_the_variables_that_were_there(two_workers):
    """Dask would limit threads here as well, and the memory that the C library keeps."""
    for there in two_workers.client.run(lambda: dict(os.environ)).values():
        for name in ("OMP_NUM_THREADS", "MALLOC_TRIM_THRESHOLD_"):
            assert there.get(name) == os.environ.get(name) == BEFORE.get(name)


def test_two_processes_share_the_threads_of_the_machine(two_workers):
    assert two_workers.threads == 1


def test_a_failure_waits_for_the_tasks_that_run(two_workers, tmp_path):
    """They would write into a folder that the run removes."""
    with pytest.raises(UserError, match="no such number"):
        list(two_workers.small(fails_or_writes, ["fails", tmp_path / "late"]))
    assert (tmp_path / "late").exists()


def test_few_tasks_run_beside_one_another(two_workers):
    shared = np.zeros(10**6)  # as long as moving it costs more than waiting, one worker would do both
    assert len(set(two_workers.small(worker_of, range(2), shared))) == 2


@pytest.mark.parametrize(
    ("needed", "at_once", "threads"), [(None, 2, 1), (4 * 10**9, 2, 1), (6 * 10**9, 1, 2), (10**12, 1, 2)]
)
def test_as_many_large_tasks_run_at_once_as_have_room(two_workers, tmp_path, needed, at_once, threads):
    """Two workers would take twice the memory that a run may; the threads of one that waits are not idle."""
    tasks = replace(two_workers, room=11 * 10**9).with_room(needed)
    done = list(tasks.large(beside_others, range(4), tmp_path))
    assert max(running for running, _ in done) == at_once
    assert {used for _, used in done} == {threads}


def test_workers_that_have_no_room_are_told(two_workers, make_job, tmp_path):
    told: list[str] = []
    job = replace(make_job(tmp_path, TRANSFER_STAGE), say=told.append)
    tasks = replace(two_workers, room=11 * 10**9)
    assert on_workers(job, tasks.with_room(4 * 10**9)).tasks.threads == 1 and not told
    assert on_workers(job, tasks.with_room(6 * 10**9)).tasks.threads == 2
    assert told == ["1 of 2 workers at a time solve what takes much memory: together they have 11.0 GB."]


@pytest.mark.parametrize("changed", ["tool_version", "LOADED"])
def test_workers_of_other_versions_are_refused(two_workers, tmp_path, monkeypatch, changed):
    other = (lambda name: "0.0") if changed == "tool_version" else "0.0"
    monkeypatch.setattr(worker_checks, changed, other)  # here, not in the workers
    what = r"numpy \d" if changed == "tool_version" else "the program's code [0-9a-f]"
    with pytest.raises(UserError, match=rf"{what}.* \(here 0\.0\).*the same as here"):
        check_workers(two_workers.client, ["numpy"], tmp_path, [])


def test_workers_that_do_not_see_a_folder_are_refused(two_workers, tmp_path, monkeypatch):
    check_workers(two_workers.client, [], tmp_path, [tmp_path / "fetched later"])
    elsewhere = str(tmp_path / "on another machine")
    monkeypatch.setattr(worker_checks.tempfile, "mkstemp", lambda prefix, dir: (os.dup(0), elsewhere))
    with pytest.raises(UserError, match="does not see"):
        check_workers(two_workers.client, [], tmp_path, [])


def dask(command: str, *words: str, blocked: str = "") -> subprocess.Popen[bytes]:
    """Start a scheduler or a worker as users do; it cannot import the packages that are blocked."""
    code = (
        f"import sys; sys.modules.update(dict.fromkeys({blocked.split()})); "
        f"from distributed.cli.dask_{command} import main; main(sys.argv[1:])"
    )
    quiet = {"stdout": subprocess.DEVNULL, "stderr": subprocess.DEVNULL}
    return subprocess.Popen([sys.executable, "-c", code, *words, "--no-dashboard"], **quiet)


@pytest.fixture
def scheduler(tmp_path):
    """Start a scheduler; yields its process and its address."""
    there = tmp_path / "scheduler.json"
    running = dask("scheduler", "--host", "127.0.0.1", "--port", "0", "--scheduler-file", str(there))
    while not there.exists() or not there.read_text():
        assert running.poll() is None
        time.sleep(0.05)
    yield running, json.loads(there.read_text())["address"]
    running.kill()
    running.wait()


@contextmanager
def joined_by_a_worker(address: str, workspace: Path, blocked: str = "") -> Iterator[ClusterOnDemand]:
    worker = dask("worker", address, "--no-nanny", "--nthreads", "1", blocked=blocked)
    try:
        with ClusterOnDemand(ClusterRequest(scheduler=address), 2, ["numpy"], workspace) as joined:
            yield joined
    finally:
        worker.kill()
        worker.wait()


def test_a_scheduler_that_is_lost_is_told(scheduler, tmp_path):
    running, address = scheduler
    with joined_by_a_worker(address, tmp_path) as joined:
        tasks = joined.tasks()
        assert list(tasks.small(divided, range(3), 4, 1)) == [0, 0.25, 0.5]
        running.kill()
        with pytest.raises(MachineError, match="scheduler was lost"):
            list(tasks.small(divided, range(3), 4, 1))


def test_a_scheduler_that_wants_certificates_is_told(tmp_path):
    request = ClusterRequest(scheduler="tls://127.0.0.1:9")
    with (
        ClusterOnDemand(request, 2, [], tmp_path) as nobody,
        pytest.raises(UserError, match="was not reached"),
    ):
        nobody.tasks()


def test_a_worker_without_the_program_is_told(scheduler, tmp_path):
    with (
        joined_by_a_worker(scheduler[1], tmp_path, blocked="pipeline stages") as joined,
        pytest.raises(UserError, match="cannot load the program"),
    ):
        joined.tasks()


def test_a_scheduler_that_does_not_answer_is_told(tmp_path, monkeypatch):
    monkeypatch.setattr(on_demand, "PATIENCE_S", 1)
    request = ClusterRequest(scheduler="tcp://127.0.0.1:9")
    with (
        ClusterOnDemand(request, 2, [], tmp_path) as nobody,
        pytest.raises(UserError, match="was not reached"),
    ):
        nobody.tasks()


@pytest.mark.parametrize(
    "given", [Run(workers=0), Run(workers=2000), Run(workers=2, scheduler="tcp://here:8786")]
)
def test_an_impossible_cluster_is_refused(given):
    with pytest.raises(UserError, match="expected"):
        cluster_of(given)


@pytest.fixture(scope="module")
def on_threads(tmp_path_factory) -> Path:
    """A workspace made on threads of one process."""
    folder = tmp_path_factory.mktemp("workers")
    small_runs.link_photos(folder / "photos", 8)
    done = small_runs.do(words("run", folder / "threads", *TRANSFER))
    assert done.returncode == 0, done.stderr
    assert "clusters." in one_line(done.stderr), done.stderr  # there is more than one
    return folder / "threads"


def test_workers_give_the_same_digests_as_threads(on_threads):
    there = on_threads.parent / "two"
    done = small_runs.do(words("run", there, *TRANSFER, "--workers", "2"))
    assert done.returncode == 0, done.stderr
    assert results(there) == results(on_threads)
    assert small_runs.leftovers(there) == []


@pytest.mark.slow
@pytest.mark.parametrize("workers", ["1", "4"])
def test_any_number_of_workers_gives_the_same_digests(on_threads, workers):
    there = on_threads.parent / f"workers_{workers}"
    done = small_runs.do(words("run", there, *TRANSFER, "--workers", workers))
    assert done.returncode == 0, done.stderr
    assert results(there) == results(on_threads)


@pytest.mark.slow
@pytest.mark.parametrize("stage", DISTRIBUTED)
def test_a_worker_killed_in_a_stage_changes_nothing(on_threads, stage):
    there = on_threads.parent / f"killed_in_{stage}"
    before = () if stage == DISTRIBUTED[0] else ("--to", DISTRIBUTED[DISTRIBUTED.index(stage) - 1])
    if before:
        assert small_runs.do(words("run", there, *TRANSFER, *before)).returncode == 0
    running = subprocess.Popen(
        words("run", there, *TRANSFER, "--workers", "2", "--to", stage),
        cwd=small_runs.ROOT, env=small_runs.environment(), stderr=subprocess.PIPE, text=True,
    )  # fmt: skip
    while not list((there / "cache" / stage).glob(".partial-*/log.txt")):  # its workers are there
        assert running.poll() is None, one_line(running.communicate()[1])
        time.sleep(0.01)
    time.sleep(AT_WORK_S)
    killed = kill_a_worker(running.pid)
    stderr = running.communicate()[1]
    assert running.returncode == 0, stderr
    assert killed, "no worker was found"
    assert small_runs.do(words("run", there, *TRANSFER)).returncode == 0
    assert results(there) == results(on_threads)


@pytest.mark.slow
def test_ctrl_c_ends_the_workers_too_and_the_run_goes_on_from_there(on_threads):
    there, mark = on_threads.parent / "interrupted", str(on_threads.parent)
    environment = small_runs.environment({"UNSHADE_INTERRUPTED": mark})
    command = [os.fsdecode(word) for word in words("run", there, *TRANSFER, "--workers", "2")]
    ended = run_in_terminal(command, 100, small_runs.ROOT, environment, interrupt_at="depth maps 0/")
    said = one_line(ended.screen.text)
    assert ended.code == 130 and "unshade: Interrupted during mvs." in said, said
    assert "Traceback" not in ended.raw and "distributed" not in ended.raw, ended.raw
    alive = [one.info["environ"] or {} for one in psutil.process_iter(["environ"])]  # None: somebody else's
    assert not [environ for environ in alive if mark in environ.values()]
    assert small_runs.leftovers(there) == []
    assert small_runs.do(words("run", there, *TRANSFER)).returncode == 0
    assert results(there) == results(on_threads)


def kill_a_worker(run: int) -> bool:
    """Kill one of the workers of a run."""
    for child in psutil.Process(run).children(recursive=True):
        if "spawn_main" in " ".join(child.cmdline()):
            child.kill()
            return True
    return False
