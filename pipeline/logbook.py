"""The log of a stage: its settings, what it said, what libraries said, and the traceback if it failed."""

from __future__ import annotations

import logging
import shutil
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path

from pipeline.job import Job
from pipeline.settings import Settings, settings_that_matter
from pipeline.stage import AnyStage


class _FileOfALog(logging.FileHandler):
    """A log that a full disk cuts; that it does is for what the stage writes to say."""

    def handleError(self, record: logging.LogRecord) -> None:  # noqa: N802 - the library's own name
        """Pass over it."""

    def close(self) -> None:
        """Close the file, with as much in it as there is room for."""
        with suppress(OSError):
            super().close()


@contextmanager
def logged(stage: AnyStage, job: Job[Settings], path: Path, failures: Path) -> Iterator[None]:
    """Log a block into `path`; if it fails, keep a copy as `failures/STAGE.txt`, where it can be found."""
    handler = _FileOfALog(path, encoding="utf-8")
    handler.setFormatter(logging.Formatter("%(asctime)s %(levelname)s %(name)s: %(message)s"))
    root = logging.getLogger()
    level = root.level
    root.addHandler(handler)
    root.setLevel(logging.INFO)
    log = logging.getLogger(stage.name)
    try:
        log.info("version %s, settings %s", stage.version, settings_that_matter(job.settings, stage.ignores))
        yield
        for sentence in job.warnings:
            log.warning(sentence)
        log.info("facts %s", job.facts)
    except BaseException:
        log.exception("failed")
        with suppress(OSError):  # why the stage failed is what counts
            handler.flush()
            failures.mkdir(parents=True, exist_ok=True)
            shutil.copyfile(path, failures / f"{stage.name}.txt")
        raise
    finally:
        root.removeHandler(handler)
        root.setLevel(level)
        handler.close()
