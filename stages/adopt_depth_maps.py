"""Fuse depth maps that COLMAP's stereo has left, instead of computing them again (`--points FOLDER`)."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from pipeline import Artefact, Job, Settings, Stage, UserError, setting
from stages.scene.distributions import PYCOLMAP


class AdoptDepthMapsSettings(Settings):
    """Settings of the `adopt_depth_maps` stage: of COLMAP's fusion, with its own defaults."""

    fusion_views: int = setting(
        5, "Views that must agree on a fused point, itself included (COLMAP's min_num_pixels).", ge=1, le=100
    )
    cache_gb: float = setting(
        4.0, "Maps that COLMAP holds in memory; more are read again when they are needed.", unit="GB", gt=0
    )


def run(job: Job[AdoptDepthMapsSettings]) -> None:
    """Fuse the maps of a dense workspace, and save the points."""
    from stages.formats.meshes.point_clouds import write_points
    from stages.stereo.stored_depth_maps import fused_points, views_with_maps

    folder = job.inputs["dense_folder"]
    names, lacking = views_with_maps(folder)
    if lacking:
        first = ", ".join(lacking[:3]) + (" …" if len(lacking) > 3 else "")
        job.warn(
            f"{len(lacking)} of the {len(names) + len(lacking)} views of {folder} have no depth map or no "
            f"normal map ({first}) and are left out. Where that leaves holes, run COLMAP's "
            "patch_match_stereo to its end."
        )
    with job.progress("COLMAP fusion"):
        x_in_world, normals, colours = fused_points(
            folder, names, job.scratch, job.settings.fusion_views, job.settings.cache_gb
        )
    fewest = min(job.settings.fusion_views, len(names))
    if not len(x_in_world):
        raise UserError(
            f"The depth maps of {folder} agree nowhere in {fewest} views; expected some surface that they "
            "share. Lower adopt_depth_maps.fusion_views, or leave out --points."
        )
    write_points(job.outputs["fused"], x_in_world, normals, colours)
    job.note(views=len(names), points=len(x_in_world))


def in_words(facts: Mapping[str, Any]) -> str:
    """Tell in a few words what was found."""
    return f"{facts['points']:,} points from the depth maps of {facts['views']} views"


ADOPT_DEPTH_MAPS = Stage(
    name="adopt_depth_maps",
    version=3,
    about="Points fused from the depth maps of a COLMAP workspace.",
    settings=AdoptDepthMapsSettings,
    takes=("dense_folder",),
    gives=(Artefact("fused", "fused points with normals and colours, world axes", file="fused.ply"),),
    run=run,
    tools=(*PYCOLMAP, "numpy"),
    saves_memory="lower adopt_depth_maps.cache_gb",
    found=in_words,
)
