"""The command `compare`: two results of the same photos side by side in one page."""

from __future__ import annotations

import os
from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING

from pipeline import UserError, finite_or_null
from pipeline.cache.key import tool_version
from pipeline.command.terminal import Terminal, table_of
from pipeline.errors import shown
from pipeline.files.file_kinds import is_folder
from pipeline.files.replacing import replace_text
from pipeline.process.library_messages import library_messages_in
from pipeline.process.processors import usable_processors
from stages.command.arguments import Compare
from stages.command.results import AddressedResults, addressed_results

if TYPE_CHECKING:
    from stages.reporting.comparison.comparison_page import Compared
    from stages.reporting.comparison.paired_views import Side

DEFAULT_PAGE = Path("comparison.html")


def compare_verb(command: Compare, terminal: Terminal) -> None:
    """Write the page of two results, and print where it is.

    Raises
    ------
    UserError
        One of the two is no result, they share no view, or the page cannot be written.
    """
    output = _checked_output(command.output or DEFAULT_PAGE)
    a = addressed_results("A", command.a, command.set_a)
    b = addressed_results("B", command.b, command.set_b)
    if a.name == b.name:
        a, b = (
            replace(one, name=" ".join((str(path), *given)))
            for one, path, given in ((a, command.a, command.set_a), (b, command.b, command.set_b))
        )
    with library_messages_in(Path(os.devnull)):
        compared = _compare(a, b, terminal)
        from stages.reporting.comparison.comparison_page import comparison_page

        text = comparison_page(compared)
    try:
        replace_text(output, text)
    except OSError as error:
        raise UserError(
            f"{output} cannot be written ({error.strerror}); expected a place for a few megabytes. Choose "
            "another with --output FILE."
        ) from error
    answer = finite_or_null({"written": str(output), **compared.as_json()})
    terminal.answer(answer, table_of([{"what": f"Comparison: {output}"}], {"": "what"}))


def _checked_output(path: Path) -> Path:
    """Refuse a name that is no page: what is there would be replaced."""
    if path.suffix.lower() not in (".html", ".htm") or is_folder(path):
        raise UserError(f"--output is {shown(str(path))}; expected a file named like comparison.html.")
    return path


def _compare(a: AddressedResults, b: AddressedResults, terminal: Terminal) -> Compared:
    """Read the views of both, and compare them.

    Raises
    ------
    UserError
        They share no view.
    """
    from stages.reporting.comparison.compared_views import compare_views
    from stages.reporting.comparison.comparison_page import Compared
    from stages.reporting.comparison.remarks import remarks
    from stages.reporting.settings import ComparisonSettings, PictureSettings

    how = ComparisonSettings()
    first, second = _side(a), _side(b)
    names = [name for name in first.cameras if name in second.cameras]
    if not names:
        raise UserError(
            f"A, {a.name}, and B, {b.name}, have no view of the same name; expected results of the same "
            "photos, under other settings."
        )
    terminal.begin("comparing", 2 * len(names))
    try:
        with ThreadPoolExecutor(usable_processors()) as executor:
            found = compare_views(first, second, names, executor, terminal.advance, PictureSettings(), how)
    finally:
        terminal.end()
    return Compared(
        names=(a.name, b.name),
        records=(a.records(), b.records()),
        views=found.views,
        only_in=(
            [name for name in first.cameras if name not in second.cameras],
            [name for name in second.cameras if name not in first.cameras],
        ),
        ratio=found.ratio,
        difference=found.difference,
        remarks=remarks(first, second, names, found.difference, how.most_shift_px),
        version=tool_version("unshade"),
    )


def _side(given: AddressedResults) -> Side:
    """Open one of the two results.

    Raises
    ------
    UserError
        Its cameras are gone or damaged.
    """
    from stages.formats.artefacts.camera_file import read_cameras
    from stages.reporting.comparison.paired_views import Side

    places = given.places()
    try:
        cameras = {camera.name: camera for camera in read_cameras(places["cameras"])}
    except (OSError, ValueError, LookupError, TypeError) as error:
        raise UserError(
            f"{given.label}, {given.name}, has a damaged result ({error}); expected it as it was made. "
            "`unshade run` makes it again."
        ) from error
    return Side(cameras, places)
