"""Results as they are addressed on the command line: by a workspace, or by a configuration."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

import stages
from pipeline import UserError
from pipeline.cache.record import Record
from pipeline.cache.store import Store
from pipeline.files.file_kinds import is_folder
from pipeline.files.workspace_lock import refusals_explained
from pipeline.inspect import connected_results
from pipeline.plan import plan, read_sources
from pipeline.request import Request, Result
from stages import additions
from stages.command.arguments import Run
from stages.command.request import OF_ALBEDO, request_of

SHOWN = ("linear", "cameras", "mask", "albedo", "shading", "confidence", "scales")
NEEDED = ("linear", "cameras", "albedo")


@dataclass(frozen=True)
class AddressedResults:
    """One of the two results, as it was given.

    Attributes
    ----------
    label : str
        A or B.
    name : str
        What the page calls it.
    results : mapping of str to Result
        By stage.
    """

    label: str
    name: str
    results: Mapping[str, Result]

    def records(self) -> dict[str, Record]:
        """List the records, by stage."""
        return {name: result.record for name, result in self.results.items()}

    def places(self) -> dict[str, Path]:
        """Locate the artefacts that are shown, calibrated where they are.

        Raises
        ------
        UserError
            One that is needed is missing.
        """
        declared = {artefact.name: artefact.path for stage in stages.ALL_STAGES for artefact in stage.gives}
        made = {
            name: result.folder / declared[name]
            for result in self.results.values()
            for name in result.record.outputs
            if name in declared
        }
        found = {name: made[own] for name, own in additions.newest(SHOWN, made).items()}
        if missing := [name for name in NEEDED if name not in found]:
            raise UserError(
                f"{self.label}, {self.name}, has no {' and no '.join(missing)} yet; expected the results of "
                "a whole run. `unshade run` makes them."
            )
        return found


def addressed_results(label: str, path: Path, assignments: tuple[str, ...]) -> AddressedResults:
    """Find the results that are meant: those of a configuration, or the current ones of a workspace.

    Raises
    ------
    UserError
        There are none, or settings were given for a workspace.
    """
    if not is_folder(path):
        request = request_of(Run(config=path, assignments=assignments))
        return AddressedResults(label, _name_of(path.stem, assignments), _planned(label, path, request))
    if assignments:
        raise UserError(
            f"{label} is the workspace {path}, and --set-{label.lower()} was given; expected a "
            "configuration, whose settings it changes. Give that, or leave the settings out."
        )
    if not is_folder(path / "cache"):
        raise UserError(
            f"{label} is the folder {path}, which holds no results; expected a workspace or a configuration. "
            "`unshade run` makes results, or check the path."
        )
    with refusals_explained(path):
        found = connected_results(Store(path), OF_ALBEDO)
    results = {stage.name: found[stage.name] for stage in stages.IN_ORDER if stage.name in found}
    if not results:
        raise UserError(f"{label}, {path}, has no albedo yet; `unshade run` makes it.")
    return AddressedResults(label, path.resolve().name, results)


def _planned(label: str, path: Path, request: Request) -> dict[str, Result]:
    """Find the results that a run of a request would reuse.

    Raises
    ------
    UserError
        The albedo is not among them.
    """
    with refusals_explained(request.workspace):
        store = Store(request.workspace)
        decisions = plan(request, store, read_sources(request, store)) if is_folder(store.root) else []
    found = {
        one.stage.name: Result(one.record, store.entry(one.stage.name, one.record.key))
        for one in decisions
        if one.record is not None
    }
    if OF_ALBEDO not in found:
        why = next(
            (f"{one.stage.name}: {one.reason}" for one in decisions if one.record is None), "nothing yet"
        )
        raise UserError(
            f"{label}, {path}, has no albedo of these settings in {request.workspace} ({why}). Run it first, "
            "with the same settings: `unshade run`; or give a workspace, for what is there."
        )
    return found


def _name_of(stem: str, assignments: tuple[str, ...]) -> str:
    """Name a configuration, with the settings that were given beside it."""
    return " ".join([stem, *assignments])
