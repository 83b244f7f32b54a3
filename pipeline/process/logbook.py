"""The log of a stage: its settings, warnings and facts, messages of libraries, traceback of a failure."""

from __future__ import annotations

import logging
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path

from pipeline.errors import UserError
from pipeline.files.boundary import check_own_folder
from pipeline.files.replacing import FRESH, replace_copy
from pipeline.job import Job
from pipeline.process.library_messages import library_messages_in
from pipeline.settings import Settings, settings_that_matter
from pipeline.stage import AnyStage


class _FileOfALog(logging.FileHandler):
    """A log file that a full disk truncates; the stage's own output reports the full disk."""

    def handleError(self, record: logging.LogRecord) -> None:  # noqa: N802 - the library's own name
        """Ignore the error."""

    def close(self) -> None:
        """Close the file; content for which there is no room is lost."""
        with suppress(OSError):
            super().close()


@contextmanager
def logged(stage: AnyStage, job: Job[Settings], path: Path, failures: Path) -> Iterator[None]:
    """Log a block into `path`; if it fails, keep a copy as `failures/STAGE.txt`."""
    handler = _FileOfALog(path, encoding="utf-8")
    handler.setFormatter(logging.Formatter("%(asctime)s %(levelname)s %(name)s: %(message)s"))
    root = logging.getLogger()
    level = root.level
    root.addHandler(handler)
    root.setLevel(logging.INFO)
    log = logging.getLogger(stage.name)
    try:
        log.info("version %s, settings %s", stage.version, settings_that_matter(job.settings, stage.ignores))
        with library_messages_in(path):
            yield
        for sentence in job.warnings:
            log.warning(sentence)
        log.info("facts %s", job.facts)
    except BaseException:
        log.exception("failed")
        with suppress(OSError, UserError):  # the stage's own error takes precedence
            handler.flush()
            check_own_folder(failures, failures.parent)
            failures.mkdir(parents=True, exist_ok=True)
            replace_copy(path, failures / f"{stage.name}.txt", failures / FRESH)
        raise
    finally:
        root.removeHandler(handler)
        root.setLevel(level)
        handler.close()
