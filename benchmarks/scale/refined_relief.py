"""Relief found again: ``python -m benchmarks.scale.refined_relief [--views 10] [--smoothing 10,20]``.

Smooths the exact mesh of a street by so many Laplacian steps, runs the program on it with and without the
stage `refine`, and prints the angles between the normals of the views and the true ones, and the error of the
albedo. What follows ``--`` is given to `unshade run`.
"""

from __future__ import annotations

import argparse
import os
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path

os.environ["OPENBLAS_NUM_THREADS"] = "1"  # before numpy: more threads sum in another order

import numpy as np  # noqa: E402

from benchmarks.refined_normals import angles_between, summary_of  # noqa: E402
from benchmarks.scale.albedo_error import albedo_error  # noqa: E402
from benchmarks.scale.growth import (  # noqa: E402
    in_workspace,
    own_and_further,
    run_program,
    with_geometry,
)
from benchmarks.scale.photo_set import PhotoSet, photo_set  # noqa: E402
from stages.formats.colmap.model import cameras_of, read_model  # noqa: E402
from stages.formats.images.exr import read_exr  # noqa: E402
from stages.formats.meshes.triangle_meshes import read_mesh, write_mesh  # noqa: E402
from stages.geometry.rays import RayCaster  # noqa: E402
from stages.synthetic.subjects.smoothing import laplacian_smoothing  # noqa: E402

ROOT = Path(__file__).resolve().parent.parent.parent


@dataclass(frozen=True)
class Found:
    """What one run has found.

    Attributes
    ----------
    name : str
    angles_deg : ndarray
        Between normals and the true ones, of all pixels: median, 90 %; then their mean.
    si_rmse : tuple of float
        Of the albedo, by channel.
    """

    name: str
    angles_deg: np.ndarray
    si_rmse: tuple[float, ...]


def main(argv: Sequence[str] | None = None) -> None:
    """Render, smooth, run, and print a line for each run."""
    own, further = own_and_further(argv)
    parser = argparse.ArgumentParser(description=__doc__.split("\n\n")[0])
    parser.add_argument("--views", type=int, default=10)
    parser.add_argument("--size", default="640x400", help="of a view, px")
    parser.add_argument("--smoothing", default="10,20", help="steps, comma-separated")
    parser.add_argument("--workspace", type=Path, default=ROOT / "workspaces" / "scale")
    given = parser.parse_args(own)
    width_px, height_px = map(int, given.size.split("x"))
    photos = photo_set(given.workspace / f"{given.views}-{given.size}", given.views, width_px, height_px)
    for found in runs(photos, list(map(int, given.smoothing.split(","))), further):
        angles = " ".join(f"{angle:6.2f}" for angle in found.angles_deg)
        errors = " ".join(f"{error:.4f}" for error in found.si_rmse)
        print(f"{found.name:24} normals off by (median, 90 %, mean) {angles}°   albedo's si-RMSE {errors}")


def runs(photos: PhotoSet, smoothing: Sequence[int], further: Sequence[str]) -> Iterator[Found]:
    """Run the program on the exact mesh, and on smoothed ones with and without refinement."""
    exact = read_mesh(photos.mesh)
    yield _run(photos, "exact mesh", photos.mesh, further)
    for steps in smoothing:
        path = photos.folder / f"mesh-{steps}.ply"
        write_mesh(path, laplacian_smoothing(exact, steps))
        yield _run(photos, f"{steps} steps", path, further)
        yield _run(photos, f"{steps} steps, refined", path, ["--set", "refine.refine=true", *further])


def _run(photos: PhotoSet, name: str, mesh: Path, further: Sequence[str]) -> Found:
    """Run the program on a mesh, and compare normals and albedo with the truth."""
    workspace = photos.folder / f"relief-{name.replace(', ', '-').replace(' ', '-')}"
    run_program([*in_workspace(photos, workspace), *with_geometry(photos, mesh), *further])
    summary = summary_of(_angles_deg(photos, workspace / "output" / "normal"))
    return Found(name, summary, tuple(albedo_error(photos, workspace / "output/albedo").si_rmse))


def _angles_deg(photos: PhotoSet, folder: Path) -> Iterator[np.ndarray]:
    """Measure the angles between normals and the true ones of each view, where both have surface."""
    caster = RayCaster(read_mesh(photos.mesh))
    for camera in cameras_of(read_model(photos.model)):
        seen, own = caster.see(camera), read_exr(folder / f"{camera.name}.exr")
        both = seen.mask & own.any(axis=2)
        yield angles_between(seen.normals[both], own[both])


if __name__ == "__main__":
    main()
