"""Runs of the program on streets of growing length: what each stage takes, and the error of the albedo."""

from __future__ import annotations

import json
import subprocess
import sys
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from benchmarks.scale.albedo_error import AlbedoError, albedo_error
from benchmarks.scale.photo_set import PhotoSet

ROOT = Path(__file__).resolve().parent.parent.parent


@dataclass(frozen=True)
class Taken:
    """What a stage took: elapsed and processor seconds, peak of the process's memory in bytes."""

    seconds: float
    cpu_seconds: float
    peak_bytes: int


@dataclass(frozen=True)
class Grown:
    """One length of street.

    Attributes
    ----------
    views : int
    stages : dict of str to Taken
        In the order in which they ran.
    error : AlbedoError, or None
        None without an albedo.
    """

    views: int
    stages: dict[str, Taken]
    error: AlbedoError | None


def grow(photos: PhotoSet, arguments: Sequence[str], from_photos: bool) -> Grown:
    """Run the program on a street, every stage anew, and measure it.

    Parameters
    ----------
    photos : PhotoSet
    arguments : sequence of str
        Further arguments of `unshade run`.
    from_photos : bool
        Estimate cameras and mesh, as far as the refined mesh; else both are given, as far as the albedo.
    """
    workspace = photos.folder / ("workspace-photos" if from_photos else "workspace")
    geometry = ["--to", "refine"] if from_photos else with_geometry(photos, photos.mesh)
    records = run_program([*in_workspace(photos, workspace), *geometry, *arguments, "--force"])
    stages = {stage: _taken(record) for stage, record in records.items()}
    comparable = "export" in stages and not from_photos  # cameras that were found see other pixels
    error = albedo_error(photos, workspace / "output/albedo") if comparable else None
    return Grown(photos.views, stages, error)


def in_workspace(photos: PhotoSet, workspace: Path) -> list[str]:
    """List the arguments of a run on a street's photos, at their own size."""
    return [
        *("--images", str(photos.photos)),
        *("--workspace", str(workspace)),
        *("--set", "undistort.max_size_px=null"),
    ]


def with_geometry(photos: PhotoSet, mesh: Path) -> list[str]:
    """List the arguments that give a street's cameras and a mesh."""
    return ["--colmap", str(photos.model), "--mesh", str(mesh)]


def run_program(arguments: Sequence[str]) -> dict[str, dict[str, Any]]:
    """Run `unshade run` as a process of its own; the records of its stages, by name."""
    command = [sys.executable, "-m", "unshade", "run", "--json", *arguments]
    answer = subprocess.run(command, cwd=ROOT, check=True, stdout=subprocess.PIPE, text=True).stdout
    return {one["stage"]: one["record"] for one in json.loads(answer)["stages"]}


def own_and_further(argv: Sequence[str] | None) -> tuple[list[str], list[str]]:
    """Divide the command line, that of the process by default, at ``--``."""
    given = list(sys.argv[1:] if argv is None else argv)
    at = given.index("--") if "--" in given else len(given)
    return given[:at], given[at + 1 :]


def _taken(record: dict[str, Any]) -> Taken:
    return Taken(record["seconds"], record["cpu_seconds"], int(record["peak_bytes"]))
