"""Multi-view stereo ("MVS" in the paper): depth and normals per view, and a fused cloud."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

from pipeline import Artefact, Job, Stage, UserError
from stages.scene.distributions import PICTURES, PYCOLMAP
from stages.stereo.mvs_settings import MvsSettings

if TYPE_CHECKING:
    from stages.stereo.depth.fusion import FusedPoints
    from stages.stereo.workspace import Workspace

BYTES_PER_GB = 10**9


def engine_of(settings: MvsSettings) -> Mapping[str, str]:
    """Choose the engine that computes depth: part of the key."""
    return {"engine": "cpu" if settings.engine == "auto" else settings.engine}


def run(job: Job[MvsSettings]) -> None:
    """Open the workspace, let the chosen engine work, save depth maps and the fused cloud."""
    from stages.formats.meshes.point_clouds import write_points
    from stages.stereo import sparse_points
    from stages.stereo.workspace import open_workspace

    settings, engine = job.settings, job.machine["engine"]
    workspace = open_workspace(job.inputs["workspace"], _masks(job), job.inputs.get("sparse_points"))
    if len(workspace.cameras) < 2:
        raise UserError(
            f"The workspace holds {len(workspace.cameras)} posed view(s); stereo needs at least 2. "
            "Add photos that overlap with the others."
        )
    cloud = compute_with(engine)(job, workspace)
    if settings.engine == "auto" and len(cloud.x_in_world) < settings.fewest_points:
        job.warn(
            f"Dense stereo agreed on {len(cloud.x_in_world)} points only, fewer than mvs.fewest_points = "
            f"{settings.fewest_points}: falling back to the sparse points. Add photos with more "
            "overlap, or give a mesh (--mesh)."
        )
        engine, cloud = "sparse", sparse_points.compute(job, workspace)
    write_points(job.outputs["fused"], cloud.x_in_world, cloud.normals, cloud.colours, cloud.pixel_sizes)
    job.note(engine=engine, fused_points=len(cloud.x_in_world))


def _masks(job: Job[MvsSettings]) -> Path | None:
    """The folder of masks to keep within, if that is set."""
    if not job.settings.within_masks:
        return None
    folder = job.inputs["kept"]
    if next(folder.rglob("*.png"), None) is None:
        raise UserError(
            "mvs.within_masks is set, but no view has a mask; expected --masks DIR, or photos with alpha "
            "channels. Give them, or leave the setting out."
        )
    return folder


def compute_with(engine: str) -> Callable[[Job[MvsSettings], Workspace], FusedPoints]:
    """Look up the engine's function of a job and its opened workspace: writes maps, returns the cloud."""
    if engine == "cuda":
        from stages.stereo import colmap_stereo

        return colmap_stereo.compute
    if engine == "sparse":
        from stages.stereo import sparse_points

        return sparse_points.compute
    from stages.stereo import own_stereo

    return own_stereo.compute


def in_words(facts: Mapping[str, Any]) -> str:
    """Tell in a few words what was found."""
    shares, points = facts.get("coverage", {}).values(), f"{facts['fused_points']:,} points"
    return f"{points}; depth at {sum(shares) / len(shares):.0%} of the pixels" if shares else points


def within(settings: MvsSettings, memory: int) -> MvsSettings:
    """Let COLMAP's cache have half of the memory, bytes, at most."""
    cache_gb = min(settings.colmap.cache_gb, memory / BYTES_PER_GB / 2)
    return settings.model_copy(update={"colmap": settings.colmap.model_copy(update={"cache_gb": cache_gb})})


MVS = Stage(
    name="mvs",
    version=9,
    about="Depth and normals per view by multi-view stereo, fused into one oriented cloud.",
    settings=MvsSettings,
    takes=("workspace",),
    gives=(
        Artefact("depth_maps", "depth and normal maps in COLMAP's stereo layout"),
        Artefact("background", "pixels of even background, which has no depth; the CPU's stereo tells"),
        Artefact("fused", "fused points with normals and colours, world axes", file="fused.ply"),
    ),
    run=run,
    tools=("numpy", "scipy", "numba", *PYCOLMAP, *PICTURES),
    within=within,
    saves_memory="lower undistort.max_size_px",
    machine=engine_of,
    found=in_words,
)
MVS_OF_GIVEN_CAMERAS = replace(MVS, takes=(*MVS.takes, "sparse_points"))  # which came without points, perhaps
