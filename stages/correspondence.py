"""Correspondences between pixels of two views (Eq. 5, 6, 8): one sparse matrix per linked pair i < j."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any

from pipeline import Artefact, Job, Settings, Stage, counted, json_text, setting
from stages.scene.distributions import PICTURES
from stages.scene.memory_of_views import FEWER_PIXELS

if TYPE_CHECKING:
    import numpy as np

    from stages.geometry.covisibility.surface_points import SurfacePoints
    from stages.scene.cameras import Camera


class CorrespondenceSettings(Settings):
    """Settings of the `correspondence` stage."""

    epsilon: float = setting(
        3.0,
        "Two pixels show the same point if the points behind them are no farther apart (ε of Eq. 8). "
        "The distribution of distances has a gap between 3 and 10 footprints; beyond it points are occluded.",
        unit="pixel footprints",
        gt=0,
        le=100,
    )
    neighbours: int = setting(
        8,
        "Other views that each view is linked to: those that show its surface sharpest, all parts of it "
        "counted, and those that choose it; only of more than `all_up_to` views. 0: all are linked. Time "
        "and memory of all later stages grow with it; of 25 views, five, eight or twelve gave the same error "
        "as all.",
        unit="views",
        ge=0,
    )
    all_up_to: int = setting(
        13,
        "Up to so many views are all linked to each other, as in the paper, whose sets have 11 and 13.",
        unit="views",
        ge=0,
    )
    sample: int = setting(
        400,
        "Points of each view's surface at which the others' view of it is compared, to choose neighbours.",
        unit="pixels",
        ge=10,
    )


def surface_points(camera: Camera, paths: Mapping[str, Path], count: int) -> SurfacePoints:
    """Open a view and sample its surface. Picklable."""
    from stages.formats.images.exr import read_exr
    from stages.formats.images.photos import read_mask
    from stages.geometry.covisibility.surface_points import SurfacePoints

    depth, normals = (read_exr(paths[kind] / f"{camera.name}.exr") for kind in ("depth", "normal"))
    return SurfacePoints.sampled(
        camera, depth, normals, read_mask(paths["mask"] / f"{camera.name}.png"), count
    )


def sharpness_in_view(
    camera: Camera, points: SurfacePoints, paths: Mapping[str, Path], epsilon: float
) -> tuple[np.ndarray, np.ndarray]:
    """Open a view and measure how sharply it shows points. Picklable."""
    from stages.formats.images.exr import read_exr
    from stages.formats.images.photos import read_mask

    depth = read_exr(paths["depth"] / f"{camera.name}.exr")
    return points.sharpness_in(camera, depth, read_mask(paths["mask"] / f"{camera.name}.png"), epsilon)


def linked_pairs(job: Job[CorrespondenceSettings], cameras: list[Camera]) -> list[tuple[int, int]]:
    """Choose the pairs of views to link."""
    import numpy as np
    import scipy.sparse as sp

    from stages.geometry.covisibility.surface_points import SurfacePoints
    from stages.geometry.covisibility.view_graph import best_pairs
    from stages.scene.pairs import all_pairs

    settings, views, every = job.settings, range(len(cameras)), all_pairs(len(cameras))
    if not settings.neighbours or len(cameras) <= max(settings.all_up_to, settings.neighbours + 1):
        return every
    paths = {kind: job.inputs[kind] for kind in ("depth", "normal", "mask")}
    own = list(job.tasks.small(surface_points, cameras, paths, settings.sample))
    points, view_of_point = SurfacePoints.together(own), np.repeat(views, [len(one.points) for one in own])
    rows, columns, found = [], [], []
    with job.progress("views compared", len(cameras)) as step:
        measured = job.tasks.small(sharpness_in_view, cameras, points, paths, settings.epsilon)
        for view, (seen, values) in zip(views, measured, strict=True):
            rows.append(seen)
            columns.append(np.full(len(seen), view))
            found.append(values)
            step()
    places = (np.concatenate(rows), np.concatenate(columns))
    sharpness = sp.csr_array((np.concatenate(found), places), shape=(len(view_of_point), len(cameras)))
    pairs = best_pairs(sharpness, view_of_point, settings.neighbours)
    job.note(pairs_of_all=len(pairs) / len(every))
    return pairs


def link_pair(pair: tuple[Camera, Camera, Path], depth: Path, mask: Path, epsilon: float) -> int:
    """Find, save and count the correspondences of a pair of views (Eq. 8).

    Picklable. Memory: 120 B per pixel of the two views.
    """
    from stages.formats.artefacts.correspondence_files import write_matrix
    from stages.formats.images.exr import read_exr
    from stages.formats.images.photos import read_mask
    from stages.geometry.covisibility.correspondences import find_correspondences

    def opened(camera: Camera) -> tuple[Camera, np.ndarray, np.ndarray]:
        return camera, read_exr(depth / f"{camera.name}.exr"), read_mask(mask / f"{camera.name}.png")

    camera_i, camera_j, file = pair
    correspondences = find_correspondences(*opened(camera_i), *opened(camera_j), epsilon=epsilon)
    write_matrix(file, correspondences)
    return int(correspondences.nnz)


def run(job: Job[CorrespondenceSettings]) -> None:
    """Open the cameras, choose the pairs, find the correspondences of each, write the index."""
    from stages.formats.artefacts.camera_file import read_cameras

    settings = job.settings
    cameras = read_cameras(job.inputs["cameras"])
    folder = job.outputs["correspondences"]
    pairs = [(cameras[i], cameras[j], folder / f"{i:04d}_{j:04d}.npz") for i, j in linked_pairs(job, cameras)]
    paths = job.inputs["depth"], job.inputs["mask"]
    with job.progress("correspondences", len(pairs)) as step:
        counts = list(counted(job.tasks.small(link_pair, pairs, *paths, settings.epsilon), step))
    rows = [
        {"i": one.name, "j": other.name, "file": file.name, "links": count}
        for (one, other, file), count in zip(pairs, counts, strict=True)
    ]
    (folder / "index.json").write_text(json_text(rows, indent=1) + "\n", encoding="utf-8")
    total = sum(counts)
    job.note(pairs=len(pairs), links=total, pairs_without_links=counts.count(0))
    if pairs and not total:
        job.warn(
            "No two views show a common surface point, so nothing ties their albedos together; "
            "choose views that overlap, or check that depths and cameras are in one frame."
        )


def in_words(facts: Mapping[str, Any]) -> str:
    """Tell in a few words what was found."""
    return f"{facts['links']:,} corresponding pixels in {facts['pairs']} pairs of views"


CORRESPONDENCE = Stage(
    name="correspondence",
    version=3,
    about="Which pixels of two views show the same surface point: one sparse matrix per pair.",
    settings=CorrespondenceSettings,
    takes=("depth", "normal", "mask", "cameras"),
    gives=(Artefact("correspondences", "one scipy sparse matrix per pair i < j, npz, and index.json"),),
    run=run,
    tools=("numpy", "scipy", "numba", *PICTURES),
    saves_memory=FEWER_PIXELS,
    found=in_words,
)
