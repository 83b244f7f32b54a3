"""What estimated geometry costs the albedo: ``python -m benchmarks.estimated_geometry [--street VIEWS]``.

The embedded sample, or the street of `benchmarks.scale`, is decomposed from the same 8-bit photos four times:
with exact cameras and mesh, with one of them, and from photos alone. Printed for each: si-RMSE of the albedo
of all views after one scale per channel, its ratio to that of exact geometry, the share of the surface that
has an albedo, and of the pixels with albedo that show background. What follows ``--`` is given to
`unshade run`. Workspaces are kept in ``workspaces/geometry-…``.

A found lens undistorts photos otherwise than the true one: the true albedo is resampled as the photo was.
"""

from __future__ import annotations

import argparse
import os
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path

os.environ["OPENBLAS_NUM_THREADS"] = "1"  # before numpy: more threads sum in another order

import numpy as np  # noqa: E402

from benchmarks.dense_truth import newest, undistorted_model  # noqa: E402
from benchmarks.paper.tables import markdown  # noqa: E402
from benchmarks.scale.albedo_error import error_of, moments  # noqa: E402
from benchmarks.scale.growth import own_and_further, run_program  # noqa: E402
from benchmarks.scale.photo_set import photo_set  # noqa: E402
from benchmarks.similarity import similarity  # noqa: E402
from stages.formats.colmap.model import cameras_of, read_model, registered  # noqa: E402
from stages.formats.images.exr import read_exr  # noqa: E402
from stages.formats.meshes.triangle_meshes import Surface, read_mesh, write_mesh  # noqa: E402
from stages.geometry.lenses import lens_of, through_pinhole  # noqa: E402

ROOT = Path(__file__).resolve().parent.parent
SAMPLE = ROOT / "sample_data"


@dataclass(frozen=True)
class Scene:
    """Photos, exact cameras (a COLMAP model), exact mesh, and the true albedo of a photo by its name."""

    name: str
    photos: Path
    model: Path
    mesh: Path
    true_albedo: Callable[[str], np.ndarray]

    @property
    def workspaces(self) -> Path:
        """Folder of the four runs."""
        return ROOT / "workspaces" / f"geometry-{self.name}"


def sample() -> Scene:
    """Describe the embedded sample."""
    truth = SAMPLE / "truth"
    return Scene(
        "sample",
        SAMPLE / "photos",
        truth / "sparse",
        truth / "mesh.ply",
        lambda name: read_exr(truth / "albedo" / f"{name}.exr"),
    )


def street(views: int, size: str) -> Scene:
    """Describe a street, rendered unless it is there."""
    photos = photo_set(ROOT / "workspaces" / "scale" / f"{views}-{size}", views, *map(int, size.split("x")))
    return Scene(f"street-{views}", photos.photos, photos.model, photos.mesh, photos.true_albedo)


def runs_of(scene: Scene, further: Sequence[str]) -> Iterator[tuple[str, Path, Path]]:
    """Run the four; yield what was estimated, the model whose lenses the photos have, and the workspace.

    The exact mesh is moved to the frame of the cameras that were found, by the similarity of their centres.
    """
    found = scene.workspaces / "cameras_and_mesh"
    run_on(scene, found, [], further)
    cameras = newest(found, "sfm") / "model"
    moved = scene.workspaces / "moved.ply"
    write_mesh(moved, in_frame_of(scene, undistorted_model(found)))
    given = {
        "nothing": ["--colmap", scene.model, "--mesh", scene.mesh],
        "mesh": ["--colmap", scene.model],
        "cameras": ["--colmap", cameras, "--mesh", moved],
    }
    for estimated, inputs in given.items():
        run_on(scene, scene.workspaces / estimated, inputs, further)
        yield estimated, cameras if estimated == "cameras" else scene.model, scene.workspaces / estimated
    yield "cameras and mesh", cameras, found


def run_on(scene: Scene, workspace: Path, inputs: Sequence[str | Path], further: Sequence[str]) -> None:
    """Decompose the scene's photos at their own size."""
    own = ["--images", scene.photos, *inputs, "--workspace", workspace, "--set", "undistort.max_size_px=null"]
    run_program([*map(str, own), *further])


def in_frame_of(scene: Scene, model: Path) -> Surface:
    """Move the exact mesh to where a model has the scene's cameras."""
    true, found = (
        {camera.name: camera.centre_in_world for camera in cameras_of(read_model(folder))}
        for folder in (scene.model, model)
    )
    fit = similarity(np.array([true[name] for name in found]), np.array(list(found.values())))
    mesh = read_mesh(scene.mesh)
    return Surface(fit.points(mesh.vertices), mesh.faces)


@dataclass(frozen=True)
class Judged:
    """Error of the albedo after one scale per channel, and shares of surface and background in the masks."""

    si_rmse: tuple[float, ...]
    surface_covered: float
    background_in_masks: float


def judged(scene: Scene, lenses: Path, workspace: Path) -> Judged:
    """Compare a run's albedo with the truth, in the pixels of the run."""
    model = read_model(lenses)
    lens = {Path(image.name).stem: lens_of(model.cameras[image.camera_id]) for image in registered(model)}
    views, counts = [], np.zeros(4)
    for camera in cameras_of(read_model(undistorted_model(workspace))):
        albedo = scene.true_albedo(camera.name).astype(np.float32)
        whole, touched = (albedo > 0).all(axis=2), (albedo > 0).any(axis=2)
        truth, kept, _ = through_pinhole(albedo, whole, lens[camera.name], camera)
        _, background, _ = through_pinhole(albedo, ~touched, lens[camera.name], camera)
        found = read_exr(workspace / "output" / "albedo" / f"{camera.name}.exr")
        masked = (found > 0).any(axis=2)
        views.append(moments(truth * kept[..., None], found))
        counts += (kept & masked).sum(), kept.sum(), (background & masked).sum(), masked.sum()
    return Judged(error_of(views).si_rmse, counts[0] / counts[1], counts[2] / counts[3])


def main(argv: Sequence[str] | None = None) -> None:
    """Run the four and print the table."""
    own, further = own_and_further(argv)
    parser = argparse.ArgumentParser(description=__doc__.split("\n\n")[0])
    parser.add_argument("--street", type=int, metavar="VIEWS", help="a street of that many views")
    parser.add_argument("--size", default="640x400", help="of the street's views")
    given = parser.parse_args(own)
    scene = street(given.street, given.size) if given.street else sample()
    results = {estimated: judged(scene, *paths) for estimated, *paths in runs_of(scene, further)}
    exact = np.array(results["nothing"].si_rmse)
    rows = [
        [
            estimated,
            " ".join(f"{value:.4f}" for value in one.si_rmse),
            " ".join(f"{value:.2f}" for value in np.array(one.si_rmse) / exact),
            f"{100 * one.surface_covered:.1f} %",
            f"{100 * one.background_in_masks:.2f} %",
        ]
        for estimated, one in results.items()
    ]
    heads = ["estimated", "si-RMSE (red green blue)", "over that of exact geometry"]
    print(markdown([*heads, "surface with albedo", "background in masks"], rows))


if __name__ == "__main__":
    main()
