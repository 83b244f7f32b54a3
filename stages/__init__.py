"""Albedo from photos. Every file here is a stage; every folder holds the functions that stages share.

`DATAFLOW` lists the stages in order: each takes outputs of earlier ones.
"""

from __future__ import annotations

# Before everything else: pycolmap exports a zlib of its own. Loaded first, it takes half of the calls that
# OpenCV's PNG writer means for the system's, and the mixture corrupts the heap (pycolmap 4.2 with OpenCV 5).
import zlib  # noqa: F401
from collections.abc import Callable, Collection, Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any

from pipeline import AnyStage, Flow, Job, Settings, Source, UserError, settings_of
from stages.adopt_cameras import ADOPT_CAMERAS
from stages.adopt_mesh import ADOPT_MESH
from stages.adopt_model import ADOPT_MODEL
from stages.adopt_points import ADOPT_POINTS
from stages.calibration import CALIBRATION
from stages.colour_space import COLOUR_SPACE, CONVERTED
from stages.correspondence import CORRESPONDENCE
from stages.decomposition import DECOMPOSITION, DECOMPOSITION_BY_TRANSFER
from stages.decomposition_under_light import DECOMPOSITION_UNDER_LIGHT
from stages.delit_photos import DELIT_PHOTOS
from stages.export import EXPORT
from stages.full_resolution import FULL_RESOLUTION
from stages.known_geometry import KNOWN_GEOMETRY
from stages.lighting import LIGHTING
from stages.mesh import MESH
from stages.mvs import MVS
from stages.photometry.decomposition_settings import check_mode
from stages.photometry.lighting.settings import check_known_light
from stages.raycast import RAYCAST
from stages.relight import RELIGHT, RELIGHT_AS_FOUND
from stages.render import RENDER
from stages.report import NEEDED, REPORT
from stages.sfm import SFM
from stages.solvers.kernels.loop_cache import name_loop_cache
from stages.texture import FINER, TEXTURE
from stages.transfer import TRANSFER
from stages.turntable import TURNTABLE
from stages.undistort import UNDISTORT

name_loop_cache(
    Path(__file__).parent
)  # before any stage imports numba, which is late, so that a plan answers at once

IMAGE_SUFFIXES = (  # those of `photo_folder.PHOTOS`
    *(".jpg", ".jpeg", ".png", ".tif", ".tiff", ".webp", ".avif", ".exr", ".hdr"),
    *(".heic", ".heif"),
    *(".dng", ".cr2", ".cr3", ".nef", ".nrw", ".arw", ".raf", ".orf", ".rw2", ".pef", ".srw", ".3fr", ".iiq"),
)
MODEL_FILES = (  # not *.bin: a dense workspace holds gigabytes of depth maps
    *(
        f"{part}.{form}"
        for part in ("cameras", "images", "points3D", "rigs", "frames")
        for form in ("bin", "txt")
    ),
    "as_stored.json",  # in models of our own, which photos they mean as stored
)

SOURCES = (
    Source("images", IMAGE_SUFFIXES),
    Source("colmap", MODEL_FILES),
    Source("camera_file", (".txt",)),  # of a folder, the files of single photos
    Source("photo_list"),
    Source("points_file"),
    Source("mesh_file"),
    Source("masks", IMAGE_SUFFIXES),
    Source("object"),
    Source("environment"),
    Source("known_light"),
    Source("light"),
)

DATAFLOW: Flow = (
    SFM,  #             Eq. 7: K, R, t
    UNDISTORT,  #       pinhole images, linear light
    MVS,  #             depth maps, fused points
    MESH,  #            the surface
    RAYCAST,  #         n^i, Ω^i, π⁻¹
    CORRESPONDENCE,  #  Eq. 5, 6, 8: C_ij
    TRANSFER,  #        ν with visibility and interreflection; not in mode: paper
    LIGHTING,  #        σ, estimated before ρ; not in mode: paper
    DECOMPOSITION_UNDER_LIGHT,  # Eq. 1–4, 9–18: ρ
    EXPORT,  #         PNG files, a COLMAP workspace
)
ENTRY_POINTS: Flow = (ADOPT_MODEL, ADOPT_CAMERAS, ADOPT_POINTS, ADOPT_MESH)
EXPERIMENT: Flow = (RENDER, KNOWN_GEOMETRY)  # instead of photos: rendered scenes of known truth
AFTERWARDS: Flow = (  # on demand
    *(CALIBRATION, FULL_RESOLUTION, TEXTURE, DELIT_PHOTOS, RELIGHT, TURNTABLE, COLOUR_SPACE),
)
LAST: Flow = (REPORT,)  # of every dataflow, whatever it has
ALL_STAGES = (*DATAFLOW, *ENTRY_POINTS, *EXPERIMENT, *AFTERWARDS, *LAST)
IN_ORDER = (
    *EXPERIMENT,
    *ENTRY_POINTS,
    *DATAFLOW,
    *AFTERWARDS,
    *LAST,
)  # each after all stages whose outputs it can take


def dataflow(given: Collection[str], light: str = "directions") -> Flow:
    """Select the stages for photos, from the names of the sources given and the kind of light.

    Raises
    ------
    UserError
        There are no photos, there is an object or environment but no `render` section, or as
        `cameras_and_surface`.
    """
    if "object" in given or "environment" in given:
        raise UserError(
            "An object or an environment was given, but nothing is rendered; expected settings of `render`, "
            "as in --set render.views=13."
        )
    if "images" not in given:
        raise UserError(
            "No photos were given; expected --images DIR, or `images` under `sources` in a configuration."
        )
    cameras, surface = cameras_and_surface(given)
    return (cameras, UNDISTORT, *surface, RAYCAST, CORRESPONDENCE, *light_and_albedo(light), EXPORT)


def cameras_and_surface(given: Collection[str]) -> tuple[AnyStage, Flow]:
    """Select the stage that gives the cameras, and those that give the surface, from the sources given.

    Raises
    ------
    UserError
        There are two kinds of cameras or of geometry, or geometry without the cameras in whose frame it is.
    """
    cameras: dict[str, AnyStage] = {"colmap": ADOPT_MODEL, "camera_file": ADOPT_CAMERAS}
    surfaces: dict[str, Flow] = {"mesh_file": (ADOPT_MESH,), "points_file": (ADOPT_POINTS, MESH)}
    for kinds, flags in ((cameras, "--colmap and --cameras"), (surfaces, "--mesh and --points")):
        if kinds.keys() <= set(given):
            raise UserError(f"{flags} were given; expected one of the two. Leave out the other.")
    if surfaces.keys() & set(given) and not cameras.keys() & set(given):
        flag = "--mesh" if "mesh_file" in given else "--points"
        raise UserError(
            f"{flag} was given without --colmap or --cameras: it has a meaning only in the frame of its "
            "cameras. Give the COLMAP model, or the file of cameras, that it belongs to."
        )
    adopted = next((stage for name, stage in cameras.items() if name in given), SFM)
    return adopted, next((flow for name, flow in surfaces.items() if name in given), (MVS, MESH))


def experiment(given: Collection[str], light: str = "directions") -> Flow:
    """Select the stages for a rendered scene, from the names of the sources given and the kind of light.

    Raises
    ------
    UserError
        There are photos as well.
    """
    if unwanted := sorted(set(given) - {"object", "environment", "light", "known_light"}):
        raise UserError(
            f"The settings of `render` ask for a rendered scene, but {', '.join(unwanted)} was given too; "
            "give one of the two."
        )
    return (RENDER, UNDISTORT, KNOWN_GEOMETRY, RAYCAST, CORRESPONDENCE, *light_and_albedo(light), EXPORT)


def keeping_within_masks(flow: Flow, settings: Mapping[str, Settings]) -> Flow:
    """Let the stages take masks that are set to keep within them; the results of others ignore masks."""
    taken: dict[str, AnyStage] = {}
    if settings_of(SFM, settings).within_masks:
        taken[SFM.name] = replace(SFM, may_take=("masks",))
    if settings_of(MVS, settings).within_masks:
        taken[MVS.name] = replace(MVS, takes=(*MVS.takes, "kept"))
    return tuple(taken.get(stage.name, stage) for stage in flow)


def kind_of_light(settings: Mapping[str, Settings], given: Collection[str] = ()) -> str:
    """Derive the decomposition's kind of light from all stages' settings: paper, harmonics or directions.

    Raises
    ------
    UserError
        The chosen solver does not support that light, the transfer has too low a degree for it, or these
        settings cannot use the known light that was given.
    """
    decomposition = settings_of(DECOMPOSITION, settings)
    check_mode(decomposition, settings_of(TRANSFER, settings).degree)
    kind = decomposition.kind_of_light
    if "known_light" in given:
        check_known_light(settings_of(LIGHTING, settings), kind)
    return kind


def light_and_albedo(light: str) -> Flow:
    """Select the stages that estimate light and albedo; only directional light has a stage of its own."""
    return {
        "paper": (DECOMPOSITION,),
        "harmonics": (TRANSFER, DECOMPOSITION_BY_TRANSFER),
        "directions": (TRANSFER, LIGHTING, DECOMPOSITION_UNDER_LIGHT),
    }[light]


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


def asks_for_calibration(settings: Mapping[str, Settings]) -> bool:
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
    lacking = {name for name in CALIBRATED if name not in made}
    calibration = replace(
        CALIBRATION,
        takes=tuple(name for name in CALIBRATION.takes if name not in lacking),
        gives=tuple(
            one for one in CALIBRATION.gives if one.name not in {CALIBRATED[name] for name in lacking}
        ),
    )
    before = [_unshown(stage, CALIBRATED) for stage in flow[:place]]
    return (*before, calibration, *(_of_calibrated(stage) for stage in flow[place:]))


CALIBRATED = {
    name: f"{name}_calibrated" for name in ("albedo", "shading", "lighting", "albedo_tv", "light_pictures")
}


def asks_for_colour_space(settings: Mapping[str, Settings]) -> bool:
    """Tell whether the EXRs are to be in another colour space than that of the cache."""
    return settings_of(COLOUR_SPACE, settings).exr != "srgb-linear"


def with_colour_space(flow: Flow) -> Flow:
    """Put the conversion of colours at the end of a dataflow, and show what it gives instead of the rest."""
    taken = _newest(CONVERTED, _given(flow))
    converted = {f"{name}_converted" for name in taken}
    conversion = replace(
        COLOUR_SPACE,
        run=_under_their_names(COLOUR_SPACE, {own: name for name, own in taken.items()}),
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
    run = _under_their_names(stage, {calibrated: name for name, calibrated in CALIBRATED.items()})
    takes = tuple(CALIBRATED.get(name, name) for name in stage.takes)
    return replace(stage, run=run, takes=(*takes, *(["calibration"] if stage.name == RELIGHT.name else [])))


def _under_their_names(stage: AnyStage, names: Mapping[str, str]) -> Callable[[Job[Any]], None]:
    """Run a stage whose inputs have other names in the dataflow: names map these to its own."""

    def run(job: Job[Any]) -> None:
        stage.run(replace(job, inputs={names.get(name, name): path for name, path in job.inputs.items()}))

    return run


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
    """Declare the report that shows these artefacts, calibrated where they are."""
    taken = _newest(REPORT.takes, made) | {name: name for name in NEEDED}
    run = _under_their_names(REPORT, {own: name for name, own in taken.items()})
    return replace(REPORT, run=run, takes=tuple(taken[name] for name in REPORT.takes if name in taken))


def _newest(names: Collection[str], made: Collection[str]) -> dict[str, str]:
    """Look up what artefacts are called in a dataflow that makes some, perhaps calibrated ones."""
    newest = {name: CALIBRATED[name] if CALIBRATED.get(name) in made else name for name in names}
    return {name: own for name, own in newest.items() if own in made}


def kinds_of_sources(flow: Collection[AnyStage]) -> tuple[Source, ...]:
    """List the sources that a user may give to a dataflow: those that no stage of it makes."""
    made = {artefact.name for stage in flow for artefact in stage.gives}
    return tuple(source for source in SOURCES if source.name not in made)
