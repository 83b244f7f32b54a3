"""The craft. Every file here is a step of the paper, every folder a vocabulary that the steps share.

`dataflow` is the whole program, read from top to bottom: each stage takes what stands above it.
"""

from __future__ import annotations

# Before everything else: pycolmap exports a zlib of its own. Loaded first, it takes half of the calls that
# OpenCV's PNG writer means for the system's, and the mixture corrupts the heap (pycolmap 4.2 with OpenCV 5).
import zlib  # noqa: F401
from collections.abc import Collection, Mapping
from pathlib import Path

from pipeline import AnyStage, Flow, Settings, Source, UserError, settings_of
from stages.adopt_mesh import ADOPT_MESH
from stages.adopt_model import ADOPT_MODEL
from stages.correspondence import CORRESPONDENCE
from stages.decomposition import DECOMPOSITION, DECOMPOSITION_BY_TRANSFER, DECOMPOSITION_UNDER_LIGHT
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
from stages.sfm import SFM
from stages.solvers.kernels.loop_cache import name_loop_cache
from stages.transfer import TRANSFER
from stages.undistort import UNDISTORT

name_loop_cache(Path(__file__).parent)  # no stage has imported numba yet: a plan must answer at once

IMAGE_SUFFIXES = (".jpg", ".jpeg", ".png", ".tif", ".tiff", ".exr", ".hdr")
MODEL_FILES = tuple(  # not *.bin: a dense workspace holds gigabytes of depth maps
    f"{part}.{form}"
    for part in ("cameras", "images", "points3D", "rigs", "frames")
    for form in ("bin", "txt")
)

SOURCES = (
    Source("images", IMAGE_SUFFIXES),
    Source("colmap", MODEL_FILES),
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
    TRANSFER,  #        ν that knows what it can see; not in mode: paper
    LIGHTING,  #        σ, known once; not in mode: paper
    DECOMPOSITION_UNDER_LIGHT,  # Eq. 1–4, 9–18: ρ
    EXPORT,  #         what people open
)
ENTRY_POINTS: Flow = (ADOPT_MODEL, ADOPT_MESH)
EXPERIMENT: Flow = (RENDER, KNOWN_GEOMETRY)  # instead of photos: scenes whose truth is known
AFTERWARDS: Flow = (FULL_RESOLUTION, RELIGHT)  # what is made of a result when one asks for it
ALL_STAGES = (*DATAFLOW, *ENTRY_POINTS, *EXPERIMENT, *AFTERWARDS)
IN_ORDER = (*EXPERIMENT, *ENTRY_POINTS, *DATAFLOW, *AFTERWARDS)  # each after all that it can take from


def dataflow(given: Collection[str], light: str = "directions") -> Flow:
    """The stages to go through, given the names of the sources at hand and the kind of light.

    Raises
    ------
    UserError
        There are no photos, something to render though nothing is, or a mesh without the cameras whose
        frame it is in.
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
    if "mesh_file" in given and "colmap" not in given:
        raise UserError(
            "--mesh was given without --colmap: a mesh has a meaning only in the frame of its cameras. "
            "Give the COLMAP model that it belongs to."
        )
    model = ADOPT_MODEL if "colmap" in given else SFM
    surface = (ADOPT_MESH,) if "mesh_file" in given else (MVS, MESH)
    return (model, UNDISTORT, *surface, RAYCAST, CORRESPONDENCE, *light_and_paint(light), EXPORT)


def experiment(given: Collection[str], light: str = "directions") -> Flow:
    """The stages of a rendered scene, given the names of the sources at hand and the kind of light.

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
    return (RENDER, UNDISTORT, KNOWN_GEOMETRY, RAYCAST, CORRESPONDENCE, *light_and_paint(light), EXPORT)


def kind_of_light(settings: Mapping[str, Settings], given: Collection[str] = ()) -> str:
    """The decomposition's kind of light, from the settings of all stages: paper, harmonics or directions.

    Raises
    ------
    UserError
        The solver that was asked for does not know that light, or the transfer not all of it; or a known
        light was given that these settings have no use for.
    """
    decomposition = settings_of(DECOMPOSITION, settings)
    check_mode(decomposition, settings_of(TRANSFER, settings).degree)
    kind = decomposition.kind_of_light
    if "known_light" in given:
        check_known_light(settings_of(LIGHTING, settings), kind)
    return kind


def light_and_paint(light: str) -> Flow:
    """The stages that find light and albedo: only light from directions is found before the albedo."""
    return {
        "paper": (DECOMPOSITION,),
        "harmonics": (TRANSFER, DECOMPOSITION_BY_TRANSFER),
        "directions": (TRANSFER, LIGHTING, DECOMPOSITION_UNDER_LIGHT),
    }[light]


def with_relighting(flow: Flow) -> Flow:
    """A dataflow that also shows the views under another light; `mode: paper` lacks the transfer for it."""
    transfer = () if TRANSFER in flow else (TRANSFER,)
    return (*flow, *transfer, RELIGHT_AS_FOUND if LIGHTING in flow else RELIGHT)


def with_full_resolution(flow: Flow) -> Flow:
    """A dataflow that also carries the albedo to the photos' own resolution."""
    return (*flow, FULL_RESOLUTION)


def kinds_of_sources(flow: Collection[AnyStage]) -> tuple[Source, ...]:
    """What the user may bring to a dataflow: a rendered scene makes its own photos."""
    made = {artefact.name for stage in flow for artefact in stage.gives}
    return tuple(source for source in SOURCES if source.name not in made)
