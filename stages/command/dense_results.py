"""Results of COLMAP's own dense reconstruction, found beside the model that was given."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path

from pipeline.files.file_kinds import is_file, is_folder

MODEL = "sparse"  # a dense workspace has its model there, so that it can be given without the results
MESH, OTHER_MESH = "meshed-poisson.ply", "meshed-delaunay.ply"  # by COLMAP's meshers
CLOUD = "fused.ply"
FLAGS = {MESH: "mesh", OTHER_MESH: "mesh", CLOUD: "points"}  # which take them; the first that is there
DEPTH_MAPS = "stereo/depth_maps"
GEOMETRY = {"mesh_file", "points_file", "dense_folder"}  # sources
BELOW = ("dense", "dense/0")  # where a project has its dense workspaces


def dense_results(sources: Mapping[str, Path]) -> tuple[dict[str, Path], tuple[str, ...]]:
    """Find the mesh, or else the points or depth maps, of the COLMAP workspace that was given as cameras.

    Parameters
    ----------
    sources : mapping of str to Path
        What the user gave; geometry among it goes before whatever lies in the workspace.

    Returns
    -------
    found : dict of str to Path
        `mesh_file`, `points_file` or `dense_folder`; empty where there is none.
    remarks : tuple of str
        What is used, and how to do without it; or what is not, and how to use it.
    """
    folder = sources.get("colmap")
    if folder is None or GEOMETRY & sources.keys() or not is_folder(folder / MODEL):
        return {}, ()
    images = sources.get("images", folder / "images")
    anew = f"To make one anew, give --colmap {folder / MODEL} --images {images}."
    if (name := _first_in(folder)) is not None:
        kind, what = ("points_file", "cloud") if name == CLOUD else ("mesh_file", "mesh")
        return {kind: folder / name}, (f"Uses the {what} {folder / name}, as COLMAP made it. {anew}",)
    if _has_depth_maps(folder):
        return {"dense_folder": folder}, (f"Uses the depth maps of {folder}, as COLMAP made them. {anew}",)
    usable = [
        f"--{FLAGS[name]} {folder / below / name}"
        for below in BELOW
        if (name := _first_in(folder / below)) is not None
    ]
    usable += [f"--points {folder / below}" for below in BELOW if _has_depth_maps(folder / below)]
    if usable:
        return {}, (f"Dense results of COLMAP are there and not used; to take them, add {usable[0]}.",)
    return {}, ()


def _has_depth_maps(folder: Path) -> bool:
    return next((folder / DEPTH_MAPS).rglob("*.geometric.bin"), None) is not None


def _first_in(folder: Path) -> str | None:
    """Name the result in a folder that is best used."""
    return next((name for name in FLAGS if is_file(folder / name)), None)
