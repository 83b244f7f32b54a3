"""The report: what writes it at the end of a run, and the request that makes it anew from what is there."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path

from pipeline import Flow, UserError, settings_that_matter
from pipeline.cache.key import tool_version
from pipeline.cache.store import Store
from pipeline.command.terminal import Terminal, table_of
from pipeline.request import Request, Result
from pipeline.run import summarise
from pipeline.summary import consistent_results, outputs_of
from stages import additions
from stages.reporting.document.page import HTML, JSON, summary

FILES = (HTML, JSON)  # in output/, besides the artefacts of stages


def write_report(results: Mapping[str, Result], flow: Flow) -> dict[str, str]:
    """Write the report of a dataflow's results: texts by file name."""
    defaults = {stage.name: settings_that_matter(stage.settings()) for stage in flow}
    return summary(results, defaults, tool_version("unshade"))


def on_what_is_there(request: Request) -> Request:
    """Let the report of a request show only what its workspace holds.

    Raises
    ------
    UserError
        There is no view yet.
    """
    flow = request.flow[:-1]
    made = outputs_of(flow, consistent_results(flow, Store(request.workspace))).keys()
    if missing := sorted({"linear", "cameras"} - made):
        raise UserError(
            f"{request.workspace} holds no views that belong together yet ({' and '.join(missing)} missing); "
            "expected results of the stages up to raycast. `unshade run` makes them, and the report."
        )
    return replace(request, flow=additions.reporting_on(request.flow, made))


def report_verb(request: Request, terminal: Terminal) -> None:
    """Make the report anew from the results that are there, and print where it is."""
    written = summarise(on_what_is_there(request), terminal)
    place = next((path for path in written if path.name == HTML), Path(HTML))
    terminal.answer(
        {"written": list(map(str, written))}, table_of([{"what": f"Report: {place}"}], {"": "what"})
    )
