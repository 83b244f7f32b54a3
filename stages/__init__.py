"""Albedo from photos. Every file here is a stage; every folder holds the functions that stages share.

`DATAFLOW` lists the stages in order: each takes outputs of earlier ones. What may be added to it is in
`additions`; the command line is `cli`.
"""

from __future__ import annotations

# Before everything else: pycolmap exports a zlib of its own. Loaded first, it takes half of the calls that
# OpenCV's PNG writer means for the system's, and the mixture corrupts the heap (pycolmap 4.2 with OpenCV 5).
import zlib  # noqa: F401
from collections.abc import Collection, Mapping
from dataclasses import replace
from pathlib import Path

from pipeline import AnyStage, Flow, Settings, Source, UserError, settings_of
from stages.adopt_cameras import ADOPT_CAMERAS
from stages.adopt_depth_maps import ADOPT_DEPTH_MAPS
from stages.adopt_mesh import ADOPT_MESH
from stages.adopt_model import ADOPT_MODEL
from stages.adopt_points import ADOPT_POINTS
from stages.calibration import CALIBRATION
from stages.colour_space import COLOUR_SPACE
from stages.correspondence import CORRESPONDENCE
from stages.decomposition import DECOMPOSITION, DECOMPOSITION_BY_TRANSFER
from stages.decomposition_under_light import DECOMPOSITION_UNDER_LIGHT
from stages.delit_photos import DELIT_PHOTOS
from stages.export import EXPORT
from stages.full_resolution import FULL_RESOLUTION
from stages.known_geometry import KNOWN_GEOMETRY
from stages.lighting import LIGHTING
from stages.mesh import MESH, MESH_OF_GIVEN_POINTS
from stages.mvs import MVS, MVS_OF_GIVEN_CAMERAS
from stages.photometry.decomposition_settings import check_mode
from stages.photometry.lighting.settings import check_known_light
from stages.raycast import RAYCAST, RAYCAST_OF_GIVEN_SURFACE
from stages.refine import REFINE
from stages.relight import RELIGHT
from stages.render import RENDER
from stages.report import REPORT
from stages.sfm import SFM
from stages.shading_normals import SHADING_NORMALS
from stages.solvers.kernels.loop_cache import name_loop_cache
from stages.texture import TEXTURE
from stages.transfer import TRANSFER
from stages.triangulate import TRIANGULATE
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
    Source("dense_folder", (".geometric.bin", *MODEL_FILES, *IMAGE_SUFFIXES)),
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
ENTRY_POINTS: Flow = (ADOPT_MODEL, ADOPT_CAMERAS, ADOPT_DEPTH_MAPS, ADOPT_POINTS, ADOPT_MESH)
BEFORE_STEREO: Flow = (TRIANGULATE,)  # where cameras were given, perhaps without points
EXPERIMENT: Flow = (RENDER, KNOWN_GEOMETRY)  # instead of photos: rendered scenes of known truth
AFTERWARDS: Flow = (  # on demand
    *(REFINE, SHADING_NORMALS, CALIBRATION, FULL_RESOLUTION, TEXTURE, DELIT_PHOTOS, RELIGHT, TURNTABLE),
    COLOUR_SPACE,
)
LAST: Flow = (REPORT,)  # of every dataflow, whatever it has
ALL_STAGES = (*DATAFLOW, *ENTRY_POINTS, *BEFORE_STEREO, *EXPERIMENT, *AFTERWARDS, *LAST)
IN_ORDER = (
    *EXPERIMENT,
    *ENTRY_POINTS,
    *DATAFLOW[: DATAFLOW.index(MVS)],
    *BEFORE_STEREO,
    *DATAFLOW[DATAFLOW.index(MVS) :],
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
    return (cameras, UNDISTORT, *surface, CORRESPONDENCE, *light_and_albedo(light), EXPORT)


def cameras_and_surface(given: Collection[str]) -> tuple[AnyStage, Flow]:
    """Select the stage that gives the cameras, and those that give the surface and what views see of it.

    Raises
    ------
    UserError
        There are two kinds of cameras or of geometry, or geometry without the cameras in whose frame it is.
    """
    cameras: dict[str, AnyStage] = {"colmap": ADOPT_MODEL, "camera_file": ADOPT_CAMERAS}
    surfaces: dict[str, Flow] = {
        "mesh_file": (ADOPT_MESH, RAYCAST_OF_GIVEN_SURFACE),
        "points_file": (ADOPT_POINTS, MESH_OF_GIVEN_POINTS, RAYCAST_OF_GIVEN_SURFACE),
        "dense_folder": (ADOPT_DEPTH_MAPS, MESH_OF_GIVEN_POINTS, RAYCAST_OF_GIVEN_SURFACE),
    }
    for kinds, flags in ((cameras, "--colmap and --cameras"), (surfaces, "--mesh and --points")):
        if len(kinds.keys() & set(given)) > 1:
            raise UserError(f"{flags} were given; expected one of the two. Leave out the other.")
    if surfaces.keys() & set(given) and not cameras.keys() & set(given):
        flag = "--mesh" if "mesh_file" in given else "--points"
        raise UserError(
            f"{flag} was given without --colmap or --cameras: it has a meaning only in the frame of its "
            "cameras. Give the COLMAP model, or the file of cameras, that it belongs to."
        )
    adopted = next((stage for name, stage in cameras.items() if name in given), None)
    by_stereo = (*BEFORE_STEREO, MVS_OF_GIVEN_CAMERAS) if adopted else (MVS,)
    return adopted or SFM, next(
        (flow for name, flow in surfaces.items() if name in given), (*by_stereo, MESH, RAYCAST)
    )


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
    rays = RAYCAST_OF_GIVEN_SURFACE
    return (RENDER, UNDISTORT, KNOWN_GEOMETRY, rays, CORRESPONDENCE, *light_and_albedo(light), EXPORT)


def keeping_within_masks(flow: Flow, settings: Mapping[str, Settings]) -> Flow:
    """Let the stages take masks that are set to keep within them; the results of others ignore masks."""

    def keeping_within(stage: AnyStage) -> AnyStage:
        if stage.name == SFM.name and settings_of(SFM, settings).within_masks:
            return replace(stage, may_take=("masks",))
        if stage.name == MVS.name and settings_of(MVS, settings).within_masks:
            return replace(stage, takes=(*stage.takes, "kept"))
        return stage

    return tuple(map(keeping_within, flow))


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


def kinds_of_sources(flow: Collection[AnyStage]) -> tuple[Source, ...]:
    """List the sources that a user may give to a dataflow: those that no stage of it makes."""
    made = {artefact.name for stage in flow for artefact in stage.gives}
    return tuple(source for source in SOURCES if source.name not in made)
