"""Checked requests from the arguments of the command line and the configuration that they name."""

from __future__ import annotations

from collections.abc import Callable, Collection, Sequence
from pathlib import Path

import stages
from pipeline import UserError, former_names, json_text
from pipeline.cache.store import Store
from pipeline.config import Config, check_settings, override
from pipeline.errors import shown
from pipeline.files.file_kinds import is_folder
from pipeline.files.workspace_lock import refusals_explained
from pipeline.inspect import connected_results
from pipeline.request import Pointer, Request, Selection, check_flow
from pipeline.stage import Flow, settings_of
from stages import additions
from stages.command.arguments import Given, Relight, Report, Run
from stages.command.dense_results import dense_results
from stages.command.machine import cluster_of, memory_of, memory_to_fit, threads_of
from stages.command.report import FILES, write_report
from stages.command.sources import absent_sources, check_apart, check_text, config_of, existing, sources_of
from stages.command.workspaces import workspace_of
from stages.reporting.document.page import HTML

FURTHER: dict[str, Callable[[Flow], Flow]] = {  # flags, called like the stage that they add, in order
    "full_resolution": additions.with_full_resolution,
    "texture": additions.with_texture,
    "delit_photos": additions.with_delit_photos,
}
OF_ALBEDO = "decomposition"  # whose result leads to all others
POINTERS = (  # after a run, what is worth opening first
    Pointer("report", HTML, "all of it, to look at in a browser"),
    Pointer("export", "albedo", "the albedo of each view"),
    Pointer("export", "contact_sheet.png", "photo, albedo, shading and normals of the views"),
    Pointer("export", "dense", "a COLMAP workspace whose images are the albedo maps"),
    Pointer("full_resolution", "albedo_full", "the albedo at the photos' own size"),
    Pointer("texture", "model/model.glb", "the textured model"),
    Pointer("delit_photos", "delit", "the photos without their light"),
    Pointer("relight", "relit", "the views under the other light"),
    Pointer("turntable", "turntable", "the model under that light, from all around"),
)


def request_of(command: Run) -> Request:
    """Build a checked request from a command.

    Raises
    ------
    UserError
        The command or its configuration has an error that the user can correct.
    """
    selection = Selection(command.only, command.first, command.last, command.force)
    config = config_of(command)
    added = [extend for flag, extend in FURTHER.items() if getattr(command, flag)]
    _check_selected([flag for flag in FURTHER if getattr(command, flag)], command)
    return _request(command, config, sources_of(command, config), selection, added)


def _check_selected(added: Sequence[str], command: Run) -> None:
    """Refuse flags that ask for a further stage beside one that excludes it.

    Raises
    ------
    UserError
        The run is to end before that stage, or with another.
    """
    for flag, stage in (("to", command.last), ("only", command.only)):
        if added and stage not in (None, added[-1], *(last.name for last in stages.LAST)):
            asked = added[-1].replace("_", "-")
            raise UserError(f"--{asked} and --{flag} {stage} were given: it comes last. Leave out one.")


def relighting_of(command: Relight) -> Request:
    """Build a checked request for `relight`: all stages that lead to the albedo, and the relighting.

    Raises
    ------
    UserError
        The command or its configuration has an error that the user can correct; no light was given.
    """
    config = config_of(command)
    if (command.light is None) == (command.sun is None):
        both = "Two lights were given" if command.light else "No light was given"
        raise UserError(
            f"{both}; expected --light FILE, a picture of all directions (EXR or HDR, twice as wide as "
            "high), or --sun AZIMUTH,ELEVATION in degrees, for a clear sky."
        )
    sources = sources_of(command, config)
    if command.light is not None:
        sources |= {"light": existing("light", command.light)}
    added, further = [additions.with_relighting], []
    if command.sun is not None:
        further.append(f"relight.sun={_sun_of(command.sun)}")
    if command.turntable is not None:
        added.append(additions.with_turntable)
        further.append(f"turntable.frames={command.turntable}")
    return _request(command, config, sources, Selection(), added, further)


def reporting_of(command: Report) -> Request:
    """Build a checked request for `report`: the stages whose results it shows, and the report.

    Raises
    ------
    UserError
        The command or its configuration has an error that the user can correct.
    """
    config = config_of(command)
    sources = sources_of(command, config)
    made = _made_in(workspace_of(command, config, sources))
    added = [
        extend for name, extend in (FURTHER | {"relight": additions.with_relighting}).items() if name in made
    ]
    refined = additions.REFINE.name in made
    further = [f"refine.refine={json_text(refined)}"] if made else []
    return _request(command, config, sources, Selection(), added, further)


def _made_in(workspace: Path) -> Collection[str]:
    """List the stages whose current results belong to the current albedo."""
    if not is_folder(workspace / "cache"):
        return ()
    with refusals_explained(workspace):
        return connected_results(Store(workspace), OF_ALBEDO)


def _sun_of(given: str) -> str:
    """Write azimuth and elevation as a list, as settings have it."""
    parts = given.split(",")
    try:
        azimuth, elevation = (float(part) for part in parts)
    except ValueError as error:
        raise UserError(
            f"--sun is {shown(given)}; expected azimuth and elevation in degrees, as in --sun 40,30."
        ) from error
    return f"[{azimuth:g}, {elevation:g}]"


def _settings_by_flags(command: Given) -> list[str]:
    """Write the flags that stand for settings as assignments."""
    references = {"white": list(command.white), "chart": list(command.chart)}
    found = [f"calibration.{name}={json_text(given)}" for name, given in references.items() if given]
    return found + ([f"colour_space.exr={command.colour_space}"] if command.colour_space else [])


def _request(
    command: Given,
    config: Config,
    sources: dict[str, Path],
    selection: Selection,
    added: Sequence[Callable[[Flow], Flow]],
    further: Sequence[str] = (),
) -> Request:
    given = override(config.settings, [*command.assignments, *_settings_by_flags(command), *further])
    declared = {stage.name: stage.settings for stage in stages.ALL_STAGES}
    settings = check_settings(declared, given, former_names(stages.ALL_STAGES))
    found, remarks = ({}, ()) if "render" in given else dense_results(sources)
    sources = sources | found
    flow_of = stages.experiment if "render" in given else stages.dataflow
    flow = flow_of(sources, stages.kind_of_light(settings, sources))
    flow = stages.keeping_within_masks(flow, settings)
    for extended in added:
        flow = extended(flow)
    asked = additions.unrefined_before(selection.last or selection.only, flow, settings)
    flow = additions.with_report(additions.as_asked_for(flow, asked))
    kinds = stages.kinds_of_sources(flow)
    check_flow(flow, kinds)
    memory = memory_of(command)
    room = memory_to_fit(memory)
    if room is not None:
        settings |= {stage.name: stage.within(settings_of(stage, settings), room) for stage in flow}
    workspace = workspace_of(command, config, sources)
    for path in (workspace, *sources.values()):
        check_text(path)
    check_apart(workspace, sources)
    cluster = cluster_of(command)
    if cluster is not None:  # whose workers may be in other folders
        workspace, sources = workspace.absolute(), {name: path.absolute() for name, path in sources.items()}
    return Request(
        flow=flow,
        settings=settings,
        sources=sources,
        kinds=kinds,
        workspace=workspace,
        threads=threads_of(command),
        cluster=cluster,
        memory=memory,
        room=room,
        selection=selection,
        absent=absent_sources(command, config),
        remarks=remarks,
        summary=lambda results: write_report(results, flow),
        summary_files=FILES,
        pointers=POINTERS,
    )
