"""What may be added to a dataflow: stages on demand, a calibration, another colour space, the report.

What a later stage gives in a better form is taken by all after it, under the name that they know.
"""

from __future__ import annotations

from collections.abc import Callable, Collection, Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any

from pipeline import AnyStage, Flow, Job, Settings, settings_of
from stages.calibration import CALIBRATION
from stages.colour_space import COLOUR_SPACE, CONVERTED
from stages.decomposition import DECOMPOSITION
from stages.delit_photos import DELIT_PHOTOS
from stages.full_resolution import FULL_RESOLUTION
from stages.lighting import LIGHTING
from stages.mesh import MESH
from stages.raycast import RAYCAST
from stages.refine import REFINE
from stages.relight import RELIGHT, RELIGHT_AS_FOUND
from stages.render import RENDER
from stages.report import NEEDED, REPORT
from stages.shading_normals import SHADING_NORMALS
from stages.texture import FINER, TEXTURE
from stages.transfer import TRANSFER
from stages.turntable import TURNTABLE

CALIBRATED = {
    name: f"{name}_calibrated" for name in ("albedo", "shading", "lighting", "albedo_tv", "light_pictures")
}

SMOOTHED = {"normal": "shading_normal"}
REFINED = {"mesh": "refined_mesh"}


def asks_for_shading_normals(flow: Flow, settings: Mapping[str, Settings]) -> bool:
    """Tell whether relief of the mesh that the photos contradict is to be weakened."""
    return settings_of(SHADING_NORMALS, settings).weaken


def with_shading_normals(flow: Flow) -> Flow:
    """Put `shading_normals` before the stage `lighting`, where there is one; all behind take its normals."""
    if LIGHTING not in flow:
        return flow
    place = flow.index(LIGHTING)
    before = [_unshown(stage, SMOOTHED) for stage in flow[:place]]
    return (*before, SHADING_NORMALS, *(_of(stage, SMOOTHED) for stage in flow[place:]))


def asks_for_refinement(flow: Flow, settings: Mapping[str, Settings]) -> bool:
    """Tell whether the mesh is to be moved until the photos agree on it; unasked, one that is made here."""
    asked = settings_of(REFINE, settings).refine
    if asked != "auto":
        return asked
    return (
        MESH.name in {stage.name for stage in flow} and settings_of(DECOMPOSITION, settings).mode != "paper"
    )


def unrefined_before(
    last: str | None, flow: Flow, settings: Mapping[str, Settings]
) -> Mapping[str, Settings]:
    """Ask for no refinement where a run ends before it: it shows the mesh as it is."""
    names = [stage.name for stage in flow]
    if last not in names[: names.index(RAYCAST.name)]:
        return settings
    own = settings_of(REFINE, settings).model_copy(update={"refine": False})
    return {**settings, REFINE.name: own}


def with_refinement(flow: Flow) -> Flow:
    """Put `refine` before the stage `raycast`; all behind take its mesh, and none the file of a given one.

    Texture coordinates of that file are those of other faces.
    """
    place = next(k for k, stage in enumerate(flow) if stage.name == RAYCAST.name)
    before = [_unshown(stage, REFINED) for stage in flow[:place]]
    behind = [_without_files(_of(stage, REFINED), "mesh_file") for stage in flow[place:]]
    return (*before, REFINE, *behind)


def _without_files(stage: AnyStage, name: str) -> AnyStage:
    """Let a stage take no such source, even if it is given."""
    return replace(stage, may_take=tuple(one for one in stage.may_take if one != name))


def with_relighting(flow: Flow) -> Flow:
    """Add relighting to a dataflow, and the transfer that it needs, which `mode: paper` lacks."""
    transfer = () if TRANSFER in flow else (TRANSFER,)
    return (*flow, *transfer, RELIGHT_AS_FOUND if LIGHTING in flow else RELIGHT)


def with_full_resolution(flow: Flow) -> Flow:
    """Add the albedo at the photos' own resolution to a dataflow."""
    return (*flow, FULL_RESOLUTION)


def with_texture(flow: Flow) -> Flow:
    """Add the textured model, from the photos' own resolution where there are photos."""
    whole = flow if RENDER in flow or FULL_RESOLUTION in flow else (*flow, FULL_RESOLUTION)
    made = {artefact.name for stage in whole for artefact in stage.gives}
    return (*whole, replace(TEXTURE, takes=(*TEXTURE.takes, *(name for name in FINER if name in made))))


def with_turntable(flow: Flow) -> Flow:
    """Add pictures of the textured model from all around to a dataflow with relighting."""
    return (*with_texture(flow), TURNTABLE)


def with_delit_photos(flow: Flow) -> Flow:
    """Add the photos without their light to a dataflow."""
    return (*flow, DELIT_PHOTOS)


def asks_for_calibration(flow: Flow, settings: Mapping[str, Settings]) -> bool:
    """Tell whether a card or chart is given, and check how it is written.

    Raises
    ------
    UserError
        As `references_of`.
    """
    how = settings_of(CALIBRATION, settings)
    if not how.white and not how.chart:
        return False
    from stages.photometry.calibration.references import references_of  # numpy: only where it is needed

    return bool(references_of(how))


def with_calibration(flow: Flow) -> Flow:
    """Put the calibration behind the stage that gives the albedo; all after it take what it gives.

    What is before stays what it was, and in the cache: it is only no longer shown.
    """
    place = 1 + next(k for k, stage in enumerate(flow) if "albedo" in _given((stage,)))
    made = _given(flow[:place])
    lacking = {name for name in (*CALIBRATED, "confidence") if name not in made}
    calibration = replace(
        CALIBRATION,
        takes=tuple(name for name in CALIBRATION.takes if name not in lacking),
        gives=tuple(
            one for one in CALIBRATION.gives if one.name not in {CALIBRATED.get(name) for name in lacking}
        ),
    )
    before = [_unshown(stage, CALIBRATED) for stage in flow[:place]]
    return (*before, calibration, *(_of_calibrated(stage) for stage in flow[place:]))


def asks_for_colour_space(flow: Flow, settings: Mapping[str, Settings]) -> bool:
    """Tell whether the EXRs are to be in another colour space than that of the cache."""
    return settings_of(COLOUR_SPACE, settings).exr != "srgb-linear"


def with_colour_space(flow: Flow) -> Flow:
    """Put the conversion of colours at the end of a dataflow, and show what it gives instead of the rest."""
    taken = newest(CONVERTED, _given(flow))
    converted = {f"{name}_converted" for name in taken}
    conversion = replace(
        _under_their_names(COLOUR_SPACE, taken),
        takes=tuple(taken.values()),
        gives=tuple(one for one in COLOUR_SPACE.gives if one.name in converted),
    )
    return (*(_unshown(stage, taken.values()) for stage in flow), conversion)


def _unshown(stage: AnyStage, names: Collection[str]) -> AnyStage:
    """Keep out of `output/` what a later stage gives in another form."""
    gives = [replace(one, output=None) if one.name in names else one for one in stage.gives]
    return replace(stage, gives=tuple(gives))


def _of_calibrated(stage: AnyStage) -> AnyStage:
    """Let a stage take the calibrated maps under the names that it knows; relighting its scale as well."""
    taking = _of(stage, CALIBRATED)
    return replace(taking, takes=(*taking.takes, "calibration")) if stage.name == RELIGHT.name else taking


def _of(stage: AnyStage, newer: Mapping[str, str]) -> AnyStage:
    """Let a stage take newer artefacts under the names that it knows."""
    takes = tuple(newer.get(name, name) for name in stage.takes)
    return replace(_under_their_names(stage, newer), takes=takes)


def _under_their_names(stage: AnyStage, in_flow: Mapping[str, str]) -> AnyStage:
    """Let a stage find its inputs, by the names that it knows, under those that they have in the dataflow."""
    known = {name: own for own, name in in_flow.items()}

    def renamed(inputs: Mapping[str, Path]) -> dict[str, Path]:
        return {known.get(name, name): path for name, path in inputs.items()}

    def run(job: Job[Any]) -> None:
        stage.run(replace(job, inputs=renamed(job.inputs)))

    def memory(settings: Any, inputs: Mapping[str, Path], threads: int) -> int | None:
        return stage.memory(settings, renamed(inputs), threads)

    return replace(stage, run=run, memory=memory)


def _given(flow: Flow) -> set[str]:
    """List the artefacts that stages give."""
    return {artefact.name for stage in flow for artefact in stage.gives}


def with_report(flow: Flow) -> Flow:
    """Add the report to a dataflow, at its end: it shows what that makes."""
    return (*flow, _report_on(_given(flow)))


def reporting_on(flow: Flow, made: Collection[str]) -> Flow:
    """Let the report at the end of a dataflow show these artefacts alone."""
    return (*flow[:-1], _report_on(made))


def _report_on(made: Collection[str]) -> AnyStage:
    """Declare the report that shows these artefacts, in their newest form."""
    taken = newest(REPORT.takes, made) | {name: name for name in NEEDED}
    takes = tuple(taken[name] for name in REPORT.takes if name in taken)
    return replace(_under_their_names(REPORT, taken), takes=takes)


def newest(names: Collection[str], made: Collection[str]) -> dict[str, str]:
    """Look up what artefacts are called in a dataflow that makes some, perhaps calibrated ones."""
    newer = CALIBRATED | SMOOTHED | REFINED
    newest = {name: newer[name] if newer.get(name) in made else name for name in names}
    return {name: own for name, own in newest.items() if own in made}


ASKED_FOR: tuple[tuple[Callable[[Flow, Mapping[str, Settings]], bool], Callable[[Flow], Flow]], ...] = (
    (asks_for_shading_normals, with_shading_normals),
    (asks_for_refinement, with_refinement),
    (asks_for_calibration, with_calibration),
    (asks_for_colour_space, with_colour_space),
)  # in order: each takes what those before it give


def as_asked_for(flow: Flow, settings: Mapping[str, Settings]) -> Flow:
    """Add what the settings of all stages ask for to a dataflow."""
    for asked, extended in ASKED_FOR:
        if asked(flow, settings):
            flow = extended(flow)
    return flow
