"""Dask clusters: local workers that a run starts, or a scheduler that runs already."""

from __future__ import annotations

import logging
import shutil
from collections.abc import Iterator, Sequence
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Any

from pipeline.cluster.dask_tasks import DaskTasks
from pipeline.errors import MachineError, UserError
from pipeline.files.boundary import check_own_folder
from pipeline.process.installation import install_extra
from pipeline.process.library_messages import library_messages_in

if TYPE_CHECKING:
    from distributed import Client

PATIENCE_S = 60  # until a worker of a scheduler that runs already has come
WORKERS = "cache/.workers"  # below the workspace: scratch folders of local workers


@dataclass(frozen=True)
class ClusterRequest:
    """The cluster that a user asks for: `workers` local processes, or a scheduler's address."""

    workers: int | None = None
    scheduler: str | None = None


def clear_up_workers(workspace: Path) -> None:
    """Delete what local workers left. Only under the workspace's lock."""
    shutil.rmtree(workspace / WORKERS, ignore_errors=True)


@dataclass
class ClusterOnDemand:
    """A cluster that starts with the first stage that runs, and is left at the end.

    Attributes
    ----------
    wanted : ClusterRequest or None
        None: there is none.
    threads : int
        Of this machine, shared by local workers.
    tools : sequence of str
        Distributions whose versions workers must share.
    workspace : Path
        Folder that workers must see.
    sources : sequence of Path
        Files and folders that they must see, as far as they are there.
    room : int or None
        Memory that local workers share, bytes; None: not bounded.
    """

    wanted: ClusterRequest | None
    threads: int
    tools: Sequence[str]
    workspace: Path
    sources: Sequence[Path] = ()
    room: int | None = None
    _tasks: DaskTasks | None = None
    _open: ExitStack = field(default_factory=ExitStack)

    def __enter__(self) -> ClusterOnDemand:
        return self

    def __exit__(self, *error: object) -> None:
        self._open.close()

    def tasks(self) -> DaskTasks | None:
        """Start or join the cluster, unless that was done; None where none is wanted.

        Raises
        ------
        UserError
            Dask is not installed; the scheduler cannot be reached, or has no workers; or workers have other
            versions of the tools, or do not see the workspace.
        """
        if self.wanted is None or self._tasks is not None:
            return self._tasks
        from pipeline.cluster.worker_checks import check_workers  # reads all sources: not without a cluster

        logging.getLogger("distributed").setLevel(logging.ERROR)
        workers, scheduler = self.wanted.workers, self.wanted.scheduler
        client = self._join(scheduler) if scheduler is not None else self._start(workers or 1)
        check_workers(client, self.tools, self.workspace, self.sources)
        self._tasks = DaskTasks(client, max(1, self.threads // (workers or 1)), workers, self.room)
        return self._tasks

    def _start(self, workers: int) -> Client:
        """Start local workers of one task each, reached with keys that only this run has."""
        distributed = _dask()
        import dask

        self._open.callback(clear_up_workers, self.workspace)
        logs = self.workspace / "logs"
        check_own_folder(logs, self.workspace)
        logs.mkdir(parents=True, exist_ok=True)
        changed: dict[str, Any] = {
            # They stay in this process, and make the system clear the pages of arrays each time.
            "distributed.nanny.pre-spawn-environ": {},
            # No status pages: they would answer anyone on this machine.
            "distributed.scheduler.http.routes": [],
            "distributed.worker.http.routes": [],
        }
        messages = library_messages_in(logs / "workers.txt")  # workers inherit the streams
        with messages, dask.config.set(changed), _failed_start_explained():
            cluster = distributed.LocalCluster(
                n_workers=workers,
                threads_per_worker=1,
                memory_limit=None,  # the stages bound their own
                local_directory=str(self.workspace / WORKERS),
                dashboard_address=None,
                silence_logs=logging.ERROR,
                security=True,
            )
        self._open.callback(cluster.close)
        return self._open.enter_context(distributed.Client(cluster))

    def _join(self, address: str) -> Client:
        """Join a scheduler, and wait for a worker."""
        distributed = _dask()
        try:
            client = self._open.enter_context(distributed.Client(address, timeout=PATIENCE_S))
            client.wait_for_workers(1, timeout=PATIENCE_S)
        except (
            OSError,
            RuntimeError,
            TimeoutError,
            TypeError,
            ValueError,
        ) as error:  # Dask's own are of each
            raise UserError(
                f"The scheduler {address} was not reached, or had no worker within {PATIENCE_S} s "
                f"({error}); expected the address that `dask scheduler` prints, as in tcp://host:8786, and "
                f"workers of it (`dask worker {address}`). Start them, or run without --scheduler."
            ) from error
        return client


def _dask() -> Any:
    """Import `distributed`.

    Raises
    ------
    UserError
        It is not installed, or what makes its keys is not.
    """
    try:
        import cryptography  # noqa: F401
        import distributed
    except ImportError as error:
        raise UserError(
            "--workers and --scheduler need Dask, which is not installed; expected the extra `cluster`. "
            f"Install it: {install_extra('cluster')}"
        ) from error
    return distributed


@contextmanager
def _failed_start_explained() -> Iterator[None]:
    """Turn the failure of a worker's start into a sentence.

    Raises
    ------
    MachineError
        A worker did not start.
    """
    try:
        yield
    except (OSError, RuntimeError, TimeoutError) as error:
        raise MachineError(
            f"The local workers did not start ({error}); expected room for as many processes. Take fewer "
            "with --workers, or none. Earlier results are kept."
        ) from error
