"""The stage at work in a run: its tasks, and the time that it and later stages are expected to take."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

from pipeline.cache.record import Record
from pipeline.command.bar import Bar
from pipeline.command.plan_lines import expected_seconds
from pipeline.command.time_left import FIRM, time_left
from pipeline.job import Silence
from pipeline.plan import Action, Decision
from pipeline.process.spans import TimedProgress


@dataclass
class AtWork:
    """State of a run as its events tell it.

    Attributes
    ----------
    stage : str
        The stage at work; empty between stages.
    timed : TimedProgress
        Of the stage, or of what is done between stages.
    """

    stage: str = ""
    timed: TimedProgress = field(default_factory=lambda: TimedProgress(Silence()))
    _plan: dict[str, Decision] = field(default_factory=dict)
    _earlier: Mapping[str, Record] = field(default_factory=dict)
    _seconds: dict[str, float] = field(default_factory=dict)  # of the stages that ran

    def planned(self, decisions: Sequence[Decision], earlier: Mapping[str, Record]) -> None:
        """Begin a run."""
        self._plan = {one.stage.name: one for one in decisions}
        self._earlier = earlier

    def is_told(self, decision: Decision) -> bool:
        """Check whether the plan said what a decision says: the action and its reason."""
        planned = self._plan.get(decision.stage.name)
        if planned is None:
            return False
        for_the_first_time = planned.action is Action.WAIT and decision.stage.name not in self._earlier
        if planned.action is Action.WAIT and decision.action is Action.RUN:
            return for_the_first_time or planned.reason.startswith(decision.reason)
        return (planned.action, planned.reason) == (decision.action, decision.reason)

    def begin_stage(self, stage: str) -> None:
        """Begin a stage that runs."""
        self.stage, self.timed = stage, TimedProgress(Silence())

    def end_stage(self, record: Record) -> None:
        """End it."""
        self._seconds[record.stage] = record.seconds
        self.stage, self.timed = "", TimedProgress(Silence())

    def bar(self) -> Bar:
        """Describe this moment."""
        moment = self.timed.moment()
        return Bar(self.stage, moment, time_left(moment, self._earlier.get(self.stage)), self._then_s())

    def _then_s(self) -> float | None:
        """Sum what the stages after this one took earlier, at the pace of those of this run so far."""
        names = list(self._plan)
        if self.stage not in names:
            return None
        after = [self._plan[name] for name in names[names.index(self.stage) + 1 :]]
        expected = expected_seconds(after, self._earlier)
        if expected is None:
            return None
        compared = [name for name in self._seconds if name in self._earlier]
        firm = FIRM * expected
        now = sum(self._seconds[name] for name in compared) + firm
        then = sum(self._earlier[name].seconds for name in compared) + firm
        return expected * now / then if then else expected
