"""Terminal output: the plan, a bar while a stage runs, then a line; no bars in pipes; JSON on demand."""

from __future__ import annotations

import os
import sys
import traceback
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager, suppress
from io import StringIO
from typing import Any, TextIO

from rich.console import Console
from rich.live import Live
from rich.markup import escape
from rich.table import Table
from rich.text import Text

from pipeline.cache.record import Record
from pipeline.command.at_work import AtWork
from pipeline.command.durations import spent
from pipeline.command.events import Events
from pipeline.command.plan_lines import plan_lines
from pipeline.command.streams import Messages
from pipeline.errors import UserError
from pipeline.files.json_text import json_text
from pipeline.plan import Action, Decision

COLOURS = {Action.REUSE.value: "green", Action.RUN.value: "yellow", "then": "yellow"}
PIPE_WIDTH = 200  # columns of a table where there is no terminal
NAME_WIDTH = 15  # columns of the names of stages
NARROW = 60  # columns, below which names have a line of their own
OFTEN_PER_S = 5  # the bar is drawn anew
CLEAR_LINE = "\r\x1b[2K"


class Terminal:
    """A listener that writes to the error stream; the output stream is reserved for answers.

    Parameters
    ----------
    json_wanted : bool
        Answer in JSON, and write events as lines of JSON.
    words : sequence of str
        The command line, as it is repeated to a user who is to give it again.
    """

    def __init__(self, json_wanted: bool = False, words: Sequence[str] = ()) -> None:
        self.words = tuple(words)
        self._console = Console(file=Messages(), highlight=False, soft_wrap=True)  # type: ignore[arg-type]
        self._json_wanted = json_wanted
        self._events = Events(Messages()) if json_wanted else None  # type: ignore[arg-type]
        self._at_work = AtWork()
        self._live: Live | None = None

    def planned(self, decisions: Sequence[Decision], earlier: Mapping[str, Record]) -> None:
        """Print the plan of a run."""
        self._at_work.planned(decisions, earlier)
        if self._events:
            self._events.planned(decisions, earlier)
            return
        for action, text in plan_lines(decisions, earlier):
            self._row(action, text, COLOURS.get(action, "dim"), "" if action else "dim")

    def begin(self, label: str, total: int | None, at_most: bool = False) -> None:
        """Show a task."""
        self._at_work.timed.begin(label, total, at_most)
        if self._events:
            self._events.progress(self._at_work, begins=True)
        self._show_bar()

    def advance(self, steps: int = 1) -> None:
        """Count steps of the task."""
        self._at_work.timed.advance(steps)
        if self._events:
            self._events.progress(self._at_work)

    def end(self) -> None:
        """End the task; outside of a stage, take the bar away."""
        self._at_work.timed.end()
        if not self._at_work.stage and not self._at_work.timed.moment().at_work:
            self._hide_bar()

    def deciding(self, decision: Decision) -> None:
        """Print what was decided for a stage, as far as the plan did not; show its bar."""
        name, action = decision.stage.name, decision.action.value
        if self._events:
            self._events.deciding(decision)
        elif not self._at_work.is_told(decision):
            self._decided(decision, decision.reason)
        elif decision.action is Action.RUN and not self._has_bars():
            self._decided(decision, "")  # nothing else would say what is at work
        if action == Action.RUN.value:
            self._at_work.begin_stage(name)
            self._show_bar()

    def finished(self, decision: Decision, record: Record) -> None:
        """Print what a stage that ran has found, and its time."""
        self._hide_bar()
        if self._events:
            self._events.finished(decision, record)
        elif decision.action is Action.RUN:
            found = decision.stage.found(record.facts)
            done = f"done in {spent(record.seconds)}"
            self._row(record.stage, f"{found}; {done}" if found else done)
        if decision.action is Action.RUN:
            self._at_work.end_stage(record)

    def say(self, sentence: str) -> None:
        """Print a sentence to the user."""
        if self._events:
            self._events.write("say", stage=self._at_work.stage or None, sentence=sentence)
        else:
            self._row("", sentence, style="magenta")

    def done(self, **values: Any) -> None:
        """End a run that has succeeded; what there is to print, `answer` does."""
        if self._events:
            self._events.write("done", **values)
        elif self._has_bars():
            self._console.print()

    def fail(self, sentence: str) -> None:
        """Print the error that ends the command."""
        self._hide_bar()
        if self._events:
            self._events.write("error", stage=self._at_work.stage or None, sentence=sentence)
        else:
            self._console.print(f"[red]unshade:[/red] {escape(sentence)}")

    def fault(self, error: Exception) -> None:
        """Print an error that nobody foresaw, with its traceback."""
        self._hide_bar()
        if self._events:
            self._events.write("traceback", text=traceback.format_exc())
        else:
            self._console.file.write(traceback.format_exc())
        self.fail(f"{type(error).__name__}: {error}. This is a fault of unshade; earlier results are kept.")

    def restore(self) -> None:
        """Take away the bar of a process that was killed while it drew it."""
        if self._has_bars():
            self._console.file.write(CLEAR_LINE)
            self._console.show_cursor(True)

    def _decided(self, decision: Decision, reason: str) -> None:
        action = decision.action.value
        text = Text.assemble((f"{action:<6} " if reason else action, COLOURS.get(action, "")), reason)
        warnings = decision.record.warnings if decision.record else ()
        if warnings:
            text.append(f"; {len(warnings)} warning(s), see `unshade show … --stage {decision.stage.name}`")
        self._row(decision.stage.name, text)

    def _row(self, name: str, text: str | Text, name_style: str = "bold", style: str = "") -> None:
        """Print a name and a text beside it: in one line, but on a terminal in its width, word by word."""
        body = text if isinstance(text, Text) else Text(text, style=style)
        head = Text(f"{name:<{NAME_WIDTH}} ", style=name_style)
        if not self._is_screen():
            self._console.print(head.append_text(body))
            return
        if self._console.width < NARROW:
            if name:
                self._console.print(Text(name, style=name_style))
            head = Text("  ")
        indent = head.cell_len
        for line in body.wrap(self._console, max(self._console.width - indent, 1)):
            self._console.print(head.append_text(line))
            head = Text(" " * indent)

    def _is_screen(self) -> bool:
        """Check for a terminal; colours that are forced on a pipe make none of it."""
        return self._console.is_terminal and Messages().isatty()

    def _has_bars(self) -> bool:
        """Check for a terminal that can draw over a line."""
        return self._is_screen() and not self._json_wanted and not self._console.is_dumb_terminal

    def _show_bar(self) -> None:
        if self._live is None and self._has_bars():
            self._live = Live(
                get_renderable=self._bar,
                console=self._console,
                transient=True,
                refresh_per_second=OFTEN_PER_S,
            )
            self._live.start()

    def _hide_bar(self) -> None:
        if self._live is not None:
            self._live.stop()
            self._live = None

    def _bar(self) -> Text:
        """Lay out the bar of this moment; the refreshing thread asks for it."""
        return self._at_work.bar().line(self._console.width, self._console.options.ascii_only)

    def answer(self, value: Any, table: Table | None = None) -> None:
        """Write the result of a command to the output stream: as JSON if wanted, else as the table."""
        with output_stream() as stream:
            if self._json_wanted:
                stream.write(json_text(value, indent=1) + "\n")
            elif table is not None:
                stream.write(_text_of(table, stream))


def _text_of(table: Table, stream: TextIO) -> str:
    """Render a table as text for a stream: with colours and the width of the terminal if it is one."""
    terminal = stream.isatty()
    text = StringIO()
    width = None if terminal else PIPE_WIDTH
    Console(file=text, force_terminal=terminal, highlight=False, width=width).print(table)
    return text.getvalue()


@contextmanager
def output_stream() -> Iterator[TextIO]:
    """Give the output stream to write to; a reader that has had enough, such as `head`, is no error.

    Raises
    ------
    UserError
        It takes no more.
    """
    try:
        try:
            yield sys.stdout
        finally:
            sys.stdout.flush()
    except OSError as error:
        _drop_output_stream()
        if not isinstance(error, BrokenPipeError):
            raise UserError(
                f"The answer cannot be written to the output stream ({error.strerror}); expected one that "
                "takes it. All results are kept: give the output another place, and ask again."
            ) from error


def _drop_output_stream() -> None:
    """Lead the output stream to the null device, or the rest in its buffer would fail again at the end."""
    with suppress(OSError, ValueError):
        nowhere = os.open(os.devnull, os.O_WRONLY)
        os.dup2(nowhere, sys.stdout.fileno())
        os.close(nowhere)


def megabytes(size: int | None) -> str:
    """Format a size in MB."""
    return "–" if size is None else f"{size / 1e6:.0f} MB"


def table_of(rows: list[dict[str, Any]], columns: dict[str, str]) -> Table:
    """Build a plain table: `columns` maps headings (all blank: none are shown) to keys of the rows."""
    table = Table(box=None, pad_edge=False, show_header=any(map(str.strip, columns)))
    for heading in columns:
        table.add_column(heading, overflow="fold")
    for row in rows:
        table.add_row(*(escape(_cell(row.get(key))) for key in columns.values()))
    return table


def _cell(value: Any) -> str:
    if value is None:
        return "–"
    if isinstance(value, list | tuple):
        return ", ".join(map(_cell, value)) or "–"
    return number(value) if isinstance(value, float) else str(value)


def number(value: float) -> str:
    """Format a number with four significant digits, more where integer digits would be lost.

    >>> number(0.0195), number(12.3456), number(123456.7), number(1e-12)
    ('0.0195', '12.35', '123457', '1e-12')
    """
    return f"{value:.0f}" if 1000 <= abs(value) < 1e9 else f"{value:.4g}"
