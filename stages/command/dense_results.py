"""Results of COLMAP's own dense reconstruction, found beside the model that was given."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path

from pipeline.files.file_kinds import is_folder

MODEL = "sparse"  # a dense workspace has its model there, so that it can be given without the results
MESH, OTHER_MESH = "meshed-poisson.ply", "meshed-delaunay.ply"  # by COLMAP's meshers
CLOUD = "fused.ply"
FLAGS = {MESH: "mesh", OTHER_MESH: "mesh", CLOUD: "points"}  # which take them; the first that is there
DEPTH_MAPS = "stereo/depth_maps"
BELOW = ("dense", "dense/0")  # where a project has its dense workspaces


def dense_results(sources: Mapping[str, Path]) -> tuple[dict[str, Path], tuple[str, ...]]:
    """Find the mesh, or else the fused points, of the COLMAP workspace that was given as cameras.

    Parameters
    ----------
    sources : mapping of str to Path
        What the user gave; geometry among it goes before whatever lies in the workspace.

    Returns
    -------
    found : dict of str to Path
        `mesh_file` or `points_file`; empty where there is neither.
    remarks : tuple of str
        What is used, and how to do without it; or what is not, and how to use it.
    """
    folder = sources.get("colmap")
    if folder is None or {"mesh_file", "points_file"} & sources.keys() or not is_folder(folder / MODEL):
        return {}, ()
    name = _first_in(folder)
    if name is not None:
        kind, what = ("points_file", "cloud") if name == CLOUD else ("mesh_file", "mesh")
        return {kind: folder / name}, (
            f"Uses the {what} {folder / name}, as COLMAP made it. To make one anew, give "
            f"--colmap {folder / MODEL} --images {sources.get('images', folder / 'images')}.",
        )
    if next((folder / DEPTH_MAPS).rglob("*.geometric.bin"), None) is not None:
        return {}, (
            f"{folder} holds depth maps of COLMAP but no {CLOUD}, and they are computed anew. To use them, "
            f"first run: colmap stereo_fusion --workspace_path {folder} --output_path {folder / CLOUD}",
        )
    usable = [
        f"--{FLAGS[name]} {folder / below / name}"
        for below in BELOW
        if (name := _first_in(folder / below)) is not None
    ]
    if usable:
        return {}, (f"Dense results of COLMAP are there and not used; to take them, add {usable[0]}.",)
    return {}, ()


def _first_in(folder: Path) -> str | None:
    """Name the result in a folder that is best used."""
    return next((name for name in FLAGS if (folder / name).is_file()), None)
