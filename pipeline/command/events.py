"""Events of a run as JSON lines: plan, begin, progress and end of each stage, sentences, and how it ended."""

from __future__ import annotations

import time
from collections.abc import Mapping, Sequence
from typing import Any, TextIO

from pipeline.cache.record import Record
from pipeline.command.at_work import AtWork
from pipeline.command.plan_lines import expected_seconds
from pipeline.files.json_text import json_text
from pipeline.plan import Action, Decision

OFTEN_S = 0.5  # between two events of progress of one task


class Events:
    """Writer of events, an object of JSON a line.

    Every event has `event` and, where it belongs to a stage, `stage`.
    """

    def __init__(self, stream: TextIO) -> None:
        self._stream = stream
        self._last_s = float("-inf")

    def write(self, event: str, **values: Any) -> None:
        """Write an event in one line, at once."""
        self._stream.write(json_text({"event": event, **values}) + "\n")
        self._stream.flush()

    def planned(self, decisions: Sequence[Decision], earlier: Mapping[str, Record]) -> None:
        """Write the plan; `seconds_earlier` is null where a stage has never run here, or none runs."""
        rows = [
            {key: one.as_json()[key] for key in ("stage", "action", "reason", "key")} for one in decisions
        ]
        self.write("plan", stages=rows, seconds_earlier=expected_seconds(decisions, earlier))

    def deciding(self, decision: Decision) -> None:
        """Write that a stage begins, or is reused."""
        values = decision.as_json()
        self.write("begin", **{key: values[key] for key in ("stage", "action", "reason", "key")})

    def progress(self, at_work: AtWork, begins: bool = False) -> None:
        """Write the progress of the task at work: as it begins, then now and then."""
        now = time.monotonic()
        bar = at_work.bar()
        task = bar.moment.spans[-1]
        if not begins and now - self._last_s < OFTEN_S and task.steps != task.total:
            return
        self._last_s = now
        known = bar.left is not None and not bar.left.of_task
        self.write(
            "progress",
            stage=bar.stage or None,
            task=task.label,
            steps=task.steps,
            total=task.total,
            seconds=round(bar.moment.elapsed_s, 3),
            seconds_left=round(bar.left.seconds, 1) if bar.left and known else None,
            seconds_left_of_task=round(bar.left.seconds, 1) if bar.left and not known else None,
        )

    def finished(self, decision: Decision, record: Record) -> None:
        """Write that a stage's result is there, with what it cost when it was made, and what a run found.

        Facts of a reused result may be those of an earlier version: its stage need not have words for them.
        """
        values = record.as_json()
        cost = {name: values[name] for name in ("seconds", "cpu_seconds", "peak_bytes", "finished")}
        told = {name: values[name] for name in ("facts", "warnings")}
        found = decision.stage.found(record.facts) if decision.action is Action.RUN else None
        action = decision.action.value
        self.write("end", stage=record.stage, action=action, key=record.key, **cost, found=found, **told)
