"""What the report takes: processor time, memory, bytes."""

from __future__ import annotations

import shutil
import time
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from pathlib import Path

from pipeline import Job, Silence
from pipeline.cache.record import Record
from pipeline.process.meter import peak_bytes
from pipeline.request import Result
from stages.report import REPORT
from stages.reporting.document.page import HTML, summary
from stages.reporting.parts import read_content


@dataclass(frozen=True)
class Taken:
    """What a report took.

    Attributes
    ----------
    views : int
    seconds, cpu_seconds : float
        Of the stage: elapsed, and of all its threads.
    page_seconds : float
        Of putting the page together.
    peak_bytes : int
        Of the process, all of its life.
    longest_side_px : int
        Of the pictures.
    page_bytes : int
    """

    views: int
    seconds: float
    cpu_seconds: float
    page_seconds: float
    peak_bytes: int
    longest_side_px: int
    page_bytes: int


def measured(places: dict[str, Path], folder: Path, threads: int) -> Taken:
    """Run the stage on results, and write the page, as a run of the program does."""
    result = folder / "cache" / "report" / "result"
    shutil.rmtree(result, ignore_errors=True)
    outputs = {artefact.name: result / artefact.path for artefact in REPORT.gives}
    for place in (*outputs.values(), result / "scratch"):
        place.mkdir(parents=True)
    with ThreadPoolExecutor(threads) as executor:
        job = Job(
            settings=REPORT.settings(),
            inputs={name: places[name] for name in REPORT.takes if name in places},
            outputs=outputs,
            scratch=result / "scratch",
            threads=threads,
            executor=executor,
            shown=Silence(),
            say=print,
            machine={},
        )
        began, busy = time.perf_counter(), time.process_time()
        REPORT.run(job)
        seconds, cpu_seconds = time.perf_counter() - began, time.process_time() - busy
    content = read_content(outputs["report_content"])
    record = Record("report", REPORT.version, "0" * 32, *({} for _ in range(5)))
    began = time.perf_counter()
    page = summary({"report": Result(record, result)}, {}, "benchmark")[HTML].encode()
    (folder / HTML).write_bytes(page)
    return Taken(
        len(content["views"]),
        seconds,
        cpu_seconds,
        time.perf_counter() - began,
        peak_bytes(),
        content["longest_side_px"],
        len(page),
    )


def sentence_of(taken: Taken) -> str:
    """Describe what was measured."""
    return (
        f"{taken.views} views: {taken.cpu_seconds:.0f} s of processor time in {taken.seconds:.0f} s, "
        f"{taken.peak_bytes / 1e9:.2f} GB; pictures of {taken.longest_side_px} pixels, a page of "
        f"{taken.page_bytes / 1e6:.1f} MB, put together in {taken.page_seconds:.1f} s."
    )
