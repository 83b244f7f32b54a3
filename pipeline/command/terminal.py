"""Terminal output: a line per stage and a progress bar while it runs; no bars in pipes; JSON on demand."""

from __future__ import annotations

import os
import sys
import traceback
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from io import StringIO
from typing import Any, TextIO

from rich.console import Console
from rich.markup import escape
from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeElapsedColumn
from rich.table import Table

from pipeline.cache.record import Record
from pipeline.command.streams import Messages
from pipeline.errors import UserError
from pipeline.files.json_text import json_text
from pipeline.plan import Action, Decision

COLOURS = {Action.REUSE: "green", Action.RUN: "yellow", Action.WAIT: "yellow", Action.LEAVE: "dim"}
PIPE_WIDTH = 200  # columns of a table where there is no terminal


class Terminal:
    """A listener that writes to the error stream; the output stream is reserved for answers and `--json`."""

    def __init__(self, json_wanted: bool = False) -> None:
        self._console = Console(file=Messages(), highlight=False, soft_wrap=True)  # type: ignore[arg-type]
        self._json_wanted = json_wanted
        self._bars = Progress(
            TextColumn("  {task.description}"),
            BarColumn(),
            MofNCompleteColumn(),
            TimeElapsedColumn(),
            console=self._console,
            transient=True,
            disable=not self._console.is_terminal,
        )
        self._tasks: list[Any] = []

    def begin(self, label: str, total: int | None) -> None:
        """Show a bar."""
        if not self._tasks:
            self._bars.start()
        self._tasks.append(self._bars.add_task(label, total=total))

    def advance(self, steps: int = 1) -> None:
        """Move the innermost bar."""
        if self._tasks:
            self._bars.advance(self._tasks[-1], steps)

    def end(self) -> None:
        """Remove the innermost bar."""
        self._bars.remove_task(self._tasks.pop())
        if not self._tasks:
            self._bars.stop()

    def deciding(self, decision: Decision) -> None:
        """Print the action planned for a stage, its reason, and the number of warnings reused with it."""
        colour, verb = COLOURS[decision.action], decision.action.value
        name = f"[bold]{decision.stage.name:<15}[/bold]"
        reason = decision.reason
        if decision.record is not None and decision.record.warnings:
            number = len(decision.record.warnings)
            reason += f"; {number} warning(s), see `unshade show … --stage {decision.stage.name}`"
        self._console.print(f"{name} [{colour}]{verb:<6}[/{colour}] {escape(reason)}")

    def finished(self, decision: Decision, record: Record) -> None:
        """Print the cost of a stage that ran."""
        if decision.action is Action.RUN:
            cost = (
                f"{record.seconds:.1f} s, {record.cpu_seconds:.1f} CPU-s, peak {megabytes(record.peak_bytes)}"
            )
            self._console.print(f"{'':<15} [dim]done in {cost}[/dim]")

    def say(self, sentence: str) -> None:
        """Print a sentence to the user."""
        self._console.print(f"{'':<15} [magenta]{escape(sentence)}[/magenta]")

    def fail(self, sentence: str) -> None:
        """Print the error that ends the command."""
        self._console.print(
            f"[red]unshade:[/red] {escape(sentence)}" if not self._json_wanted else escape(sentence)
        )

    def fault(self, error: Exception) -> None:
        """Print an error that nobody foresaw, with its traceback."""
        self._console.file.write(traceback.format_exc())
        self.fail(f"{type(error).__name__}: {error}. This is a fault of unshade; earlier results are kept.")

    def restore(self) -> None:
        """Leave the bars of a process that was killed while it drew them."""
        if self._console.is_terminal:
            self._console.show_cursor(True)
            self._console.print()

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
