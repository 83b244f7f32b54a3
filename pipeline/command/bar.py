"""The bar of the stage at work: one line, which loses parts where the terminal is too narrow for all."""

from __future__ import annotations

from dataclasses import dataclass

from rich.text import Text

from pipeline.command.durations import about, on_a_clock
from pipeline.command.time_left import TimeLeft
from pipeline.process.spans import Moment

WIDEST, NARROWEST = 30, 8  # columns of the bar


@dataclass(frozen=True)
class Bar:
    """What there is to show of a stage at work.

    Attributes
    ----------
    stage : str
        Empty for what is done outside of a stage.
    moment : Moment
    left : TimeLeft or None
    then_s : float or None
        Expected seconds of the stages after it, where all are known.
    """

    stage: str
    moment: Moment
    left: TimeLeft | None = None
    then_s: float | None = None

    def line(self, width: int, ascii_only: bool = False) -> Text:
        """Lay it out in one line of at most `width` columns: the richest that fits."""
        task, short, full = self._task(), self._time(False), self._time(True)
        for parts, room in (
            ((task, full), NARROWEST),
            ((task, short), NARROWEST),
            ((task, short), 0),
            ((short,), 0),
        ):
            line = self._joined(parts, width, room, ascii_only)
            if line.cell_len < width:
                return line
        line.truncate(max(width - 1, 1))
        return line

    def _joined(self, parts: tuple[str, ...], width: int, room: int, ascii_only: bool) -> Text:
        words = [part for part in parts if part]
        line = Text.assemble((self.stage, "bold"), "  " * bool(self.stage), no_wrap=True, end="")
        rest = "  ".join(words)
        free = width - line.cell_len - Text(rest).cell_len - 3
        share = self._share()
        if room and share is not None:
            line.append_text(drawn(share, min(max(free, room), WIDEST), ascii_only))
            line.append("  ")
        line.append(rest)
        return line

    def _share(self) -> float | None:
        if self.left is not None:
            return self.left.share
        task = self.moment.spans[-1] if self.moment.at_work and self.moment.spans else None
        return min(task.steps / task.total, 1.0) if task and task.total else None

    def _task(self) -> str:
        """Name the task at work, its steps, and its time left where that of the stage is not known."""
        if not self.moment.at_work or not self.moment.spans:
            return ""
        task = self.moment.spans[-1]
        made = f"{task.label} {task.steps}" if task.steps else task.label
        words = f"{task.label} {task.steps}/{task.total}" if task.total else made
        if self.left is None or not self.left.of_task:
            return words
        return f"{words}: {about(self.left.seconds, 'at most' if self.left.at_most else 'about')}"

    def _time(self, full: bool) -> str:
        """Say the time that has gone, and what is known of the time left."""
        gone = on_a_clock(self.moment.elapsed_s)
        if self.left is None or self.left.of_task:
            return gone
        left = f"{gone}, {about(self.left.seconds)} left"
        if full and self.then_s:
            return f"{left}, {about(self.left.seconds + self.then_s)} in all"
        return left


def drawn(share: float, width: int, ascii_only: bool = False) -> Text:
    """Draw a bar.

    >>> drawn(0.25, 8, ascii_only=True).plain
    '##------'
    """
    full = round(min(max(share, 0.0), 1.0) * width)
    done, rest = ("#", "-") if ascii_only else ("━", "─")
    return Text.assemble((done * full, "green"), (rest * (width - full), "dim"))
