"""Correspondences between pixels of two views (Eq. 5, 6, 8): one sparse matrix per pair i < j."""

from __future__ import annotations

from itertools import combinations
from pathlib import Path
from typing import TYPE_CHECKING

from pipeline import Artefact, Job, Settings, Stage, json_text, setting
from stages.scene.distributions import PICTURES
from stages.scene.memory_of_views import FEWER_PIXELS

if TYPE_CHECKING:
    import numpy as np

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


def link_pair(camera_i: Camera, camera_j: Camera, depth: Path, mask: Path, epsilon: float, file: Path) -> int:
    """Find, save and count the correspondences of a pair of views (Eq. 8).

    Picklable. Memory: 120 B per pixel of the two views.
    """
    import scipy.sparse as sp

    from stages.formats.images.exr import read_exr
    from stages.formats.images.photos import read_mask
    from stages.geometry.correspondences import find_correspondences

    def opened(camera: Camera) -> tuple[Camera, np.ndarray, np.ndarray]:
        return camera, read_exr(depth / f"{camera.name}.exr"), read_mask(mask / f"{camera.name}.png")

    correspondences = find_correspondences(*opened(camera_i), *opened(camera_j), epsilon=epsilon)
    sp.save_npz(file, correspondences)
    return int(correspondences.nnz)


def run(job: Job[CorrespondenceSettings]) -> None:
    """Open the cameras, find the correspondences of every pair, write the index."""
    from stages.formats.artefacts.camera_file import read_cameras

    settings = job.settings
    cameras = read_cameras(job.inputs["cameras"])
    folder = job.outputs["correspondences"]
    pairs, futures = [], []
    for (i, camera_i), (j, camera_j) in combinations(enumerate(cameras), 2):
        file = f"{i:04d}_{j:04d}.npz"
        pairs.append({"i": camera_i.name, "j": camera_j.name, "file": file})
        paths = (job.inputs["depth"], job.inputs["mask"])
        futures.append(
            job.executor.submit(link_pair, camera_i, camera_j, *paths, settings.epsilon, folder / file)
        )
    counts = []
    with job.progress("correspondences", len(pairs)) as step:
        for future in futures:
            counts.append(future.result())
            step()
    rows = [{**pair, "links": count} for pair, count in zip(pairs, counts, strict=True)]
    (folder / "index.json").write_text(json_text(rows, indent=1) + "\n", encoding="utf-8")
    total = sum(counts)
    job.note(pairs=len(pairs), links=total, pairs_without_links=counts.count(0))
    if pairs and not total:
        job.warn(
            "No two views show a common surface point, so nothing ties their albedos together; "
            "choose views that overlap, or check that depths and cameras are in one frame."
        )


CORRESPONDENCE = Stage(
    name="correspondence",
    version=1,
    about="Which pixels of two views show the same surface point: one sparse matrix per pair.",
    settings=CorrespondenceSettings,
    takes=("depth", "mask", "cameras"),
    gives=(Artefact("correspondences", "one scipy sparse matrix per pair i < j, npz, and index.json"),),
    run=run,
    tools=("numpy", "scipy", "numba", *PICTURES),
    saves_memory=FEWER_PIXELS,
)
