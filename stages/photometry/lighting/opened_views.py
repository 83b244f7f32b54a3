"""The pixels of some views as the estimation of light takes them, and the gains of all views."""

from __future__ import annotations

from collections import OrderedDict
from dataclasses import dataclass
from typing import TYPE_CHECKING

from pipeline import Job
from stages.photometry.lighting.settings import LightingSettings

if TYPE_CHECKING:
    import numpy as np

    from stages.photometry.clusters.cluster_views import ClusterViews
    from stages.photometry.clusters.view_clusters import Cluster
    from stages.photometry.lighting.trusted_pixels import Viewing
    from stages.photometry.lighting.view_gains import LogView
    from stages.scene.cameras import Camera

PIXELS_HELD = 8_000_000  # while pairs of views are compared: more save reading, fewer memory


@dataclass(frozen=True, eq=False)
class Opened:
    """Views read from disk: stacked pixels, images divided by a common scale.

    Attributes
    ----------
    views : ClusterViews
    images : list of 3 ndarray, shape (N,), float32
    scale : float
    normals : ndarray, shape (N, 3)
    viewing : Viewing
    unclipped : ndarray, shape (N,), bool
    """

    views: ClusterViews
    images: list[np.ndarray]
    scale: float
    normals: np.ndarray
    viewing: Viewing
    unclipped: np.ndarray


def _read_view(
    job: Job[LightingSettings], camera: Camera
) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """Read linear values, normals, ways to the camera, (N_i, 3) each, and unclipped pixels, of a view."""
    from stages.formats.artefacts.view_files import read_views, ways_to_cameras
    from stages.photometry.lighting.trusted_pixels import unclipped

    ((mask, normal, linear),) = read_views(job.inputs, [camera])
    towards = ways_to_cameras([camera], [mask])
    return linear, normal[mask], towards, unclipped(linear, job.settings.trusted_pixels)


def _viewing(
    job: Job[LightingSettings], unclipped: np.ndarray, normals: np.ndarray, towards: np.ndarray
) -> Viewing:
    from stages.photometry.lighting.trusted_pixels import Viewing

    return Viewing.of(unclipped, normals, towards, job.settings.trusted_pixels)


def open_views(
    job: Job[LightingSettings],
    cameras: list[Camera],
    side: float,
    cluster: Cluster,
    scale: float | None,
) -> Opened:
    """Open the views of a cluster; without a scale, images are divided by their own.

    `side`: mean side of all views, taken as squares, px.
    """
    import numpy as np

    from stages.formats.artefacts.view_files import scaled_channels
    from stages.photometry.clusters.cluster_views import open_cluster

    views = open_cluster(job.inputs, cameras, cluster, side)
    parts = []
    with job.progress("views", len(views.cameras)) as step:
        found = job.executor.map(lambda camera: _read_view(job, camera), views.cameras)
        for kept, view in zip(views.kept, found, strict=True):
            parts.append([values[kept] for values in view])
            step()
    pixels, normals, towards, unclipped = (np.concatenate(own) for own in zip(*parts, strict=True))
    del parts
    images, scale = scaled_channels(pixels, scale)
    viewing = _viewing(job, unclipped, normals, towards)
    return Opened(views, images, scale, normals, viewing, unclipped)


def gains_of_all(job: Job[LightingSettings], cameras: list[Camera], scale: float) -> np.ndarray:
    """Estimate the gains of all views, (n, 3), pair by pair; few views are in memory at a time."""
    import numpy as np

    from stages.formats.artefacts.correspondence_files import CorrespondenceFiles
    from stages.photometry.lighting.view_gains import LogView, PairRatio, log_gains

    held: OrderedDict[int, LogView] = OrderedDict()

    def log_view(number: int) -> LogView:
        if number not in held:
            linear, normals, towards, unclipped = _read_view(job, cameras[number])
            viewing = _viewing(job, unclipped, normals, towards)
            held[number] = LogView.of(linear / np.float32(scale), viewing.trusted, job.settings.gains)
            while len(held) > 2 and sum(len(one.logs) for one in held.values()) > PIXELS_HELD:
                held.popitem(last=False)
        held.move_to_end(number)
        return held[number]

    files, ratios = CorrespondenceFiles.of(job.inputs["correspondences"], cameras), []
    with job.progress("gains", len(files.pairs)) as step:
        for i, j in sorted(files.pairs):
            block = files.read(i, j)
            here, there = np.flatnonzero(np.diff(block.indptr)), block.indices
            fewest = job.settings.gains.fewest_correspondences
            ratios.append(PairRatio.of(i, j, log_view(i), log_view(j), here, there, fewest))
            step()
    return np.exp(log_gains(len(cameras), ratios))
