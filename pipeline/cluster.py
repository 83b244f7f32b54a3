"""Dask clusters: local workers that a run starts, or a scheduler that runs already."""

from __future__ import annotations

import logging
import os
import shutil
import tempfile
from collections.abc import Callable, Iterable, Iterator, Sequence
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Any, TypeVar

from pipeline.cache.key import tool_version
from pipeline.errors import MachineError, UserError
from pipeline.process.library_messages import library_messages_in

if TYPE_CHECKING:
    from distributed import Client

Item = TypeVar("Item")
Made = TypeVar("Made")
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
    """

    wanted: ClusterRequest | None
    threads: int
    tools: Sequence[str]
    workspace: Path
    sources: Sequence[Path] = ()
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
        logging.getLogger("distributed").setLevel(logging.ERROR)
        workers, scheduler = self.wanted.workers, self.wanted.scheduler
        client = self._join(scheduler) if scheduler is not None else self._start(workers or 1)
        _check_versions(client, self.tools)
        _check_folders(client, self.workspace, self.sources)
        self._tasks = DaskTasks(client, max(1, self.threads // (workers or 1)))
        return self._tasks

    def _start(self, workers: int) -> Client:
        """Start local workers of one task each, reached with keys that only this run has."""
        distributed = _dask()
        import dask

        self._open.callback(clear_up_workers, self.workspace)
        logs = self.workspace / "logs"
        logs.mkdir(parents=True, exist_ok=True)
        # Dask's own variables stay in this process, and make the system clear the pages of arrays each time.
        as_here = dask.config.set({"distributed.nanny.pre-spawn-environ": {}})
        messages = library_messages_in(logs / "workers.txt")  # workers inherit the streams
        with messages, as_here, _failed_start_explained():
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
        except (OSError, TimeoutError, ValueError) as error:
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
        It is not installed.
    """
    try:
        import distributed
    except ImportError as error:
        raise UserError(
            "--workers and --scheduler need Dask, which is not installed; expected unshade[cluster]. "
            "Install it: pip install 'distributed' 'cryptography', or '.[cluster]' in the checkout."
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


@dataclass(frozen=True)
class DaskTasks:
    """Tasks on the workers of a cluster. Those of a lost worker are done again by others.

    Attributes
    ----------
    client : Client
    threads : int
        Of a large task.
    """

    client: Client
    threads: int

    def small(self, work: Callable[..., Made], items: Iterable[Item], *shared: Any) -> Iterator[Made]:
        """Run tasks on the workers, as many at a time as they have threads."""
        from distributed import KilledWorker

        # As tasks of their own, they are sent once, and again where the worker that held them is lost.
        common = [self.client.submit(_same, one, pure=False) for one in shared]
        futures: list[Any] = [self.client.submit(work, item, *common, pure=False) for item in items]
        try:
            for number, future in enumerate(futures):
                futures[number] = None  # its result need not be kept
                yield future.result()
        except KilledWorker as error:
            raise MachineError(
                f"A task ended several workers one after the other ({error}); expected workers that survive "
                "it. Most likely their memory was full: take fewer workers, or less memory with --memory."
            ) from error
        finally:
            self.client.cancel([future for future in futures if future is not None])

    def large(
        self, work: Callable[..., Made], items: Iterable[Item], *shared: Any, at_a_time: int = 1
    ) -> Iterator[Made]:
        """Run tasks on the workers, as many at a time as they have threads."""
        return self.small(work, items, *shared, self.threads)


def _same(value: Made) -> Made:
    return value


def _check_versions(client: Client, tools: Sequence[str]) -> None:
    """Refuse workers that would give other results.

    Raises
    ------
    UserError
        Some have other versions of the tools.
    """
    own = _versions(tools)
    for address, versions in client.run(_versions, list(tools)).items():
        other = [f"{name} {versions[name]} (here {own[name]})" for name in own if versions[name] != own[name]]
        if other:
            raise UserError(
                f"The worker {address} has {', '.join(other)}; expected the same versions as here, for "
                "results depend on them. Install the same lock file there."
            )


def _check_folders(client: Client, workspace: Path, sources: Sequence[Path]) -> None:
    """Refuse workers that do not see what they are to read, or the folder where results are sought.

    Raises
    ------
    UserError
        Something that is here is not there.
    """
    handle, token = tempfile.mkstemp(prefix=".seen-by-workers-", dir=workspace)
    os.close(handle)
    try:
        _check_seen(client, token, workspace, "Choose one with --workspace DIR.")
        for source in sources:
            if source.exists():
                _check_seen(client, str(source), source, "Move it to one.")
    finally:
        Path(token).unlink(missing_ok=True)


def _check_seen(client: Client, path: str, shown: Path, cure: str) -> None:
    blind = [address for address, there in client.run(os.path.exists, path).items() if not there]
    if blind:
        raise UserError(
            f"The worker {blind[0]} does not see {shown}; expected a folder that all machines share "
            f"under the same path. {cure}"
        )


def _versions(tools: Sequence[str]) -> dict[str, str]:
    return {tool: tool_version(tool) for tool in ("unshade", *tools)}
