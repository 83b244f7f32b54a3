"""The pixels of some views as the estimation of light takes them, and the gains of all views."""

from __future__ import annotations

import json
from collections import OrderedDict
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

from pipeline import Job
from stages.photometry.lighting.settings import TrustedPixelSettings, ViewGainSettings

if TYPE_CHECKING:
    import numpy as np

    from stages.formats.artefacts.view_files import Each
    from stages.photometry.clusters.cluster_views import ClusterViews
    from stages.photometry.clusters.surface_clusters import Cluster
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


@dataclass(frozen=True)
class ViewFiles:
    """What views are opened from. Picklable.

    Attributes
    ----------
    paths : mapping of str to Path
        The artefacts `mask`, `depth`, `normal`, `linear` and `correspondences`.
    cameras : sequence of Camera
        Of all views.
    side : float
        Mean side of all views, taken as squares, px.
    how : TrustedPixelSettings
    """

    paths: Mapping[str, Path]
    cameras: Sequence[Camera]
    side: float
    how: TrustedPixelSettings

    def read(self, camera: Camera) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
        """Read a view: linear values, normals, ways to the camera, (N, 3) each; and what is not clipped."""
        from stages.formats.artefacts.view_files import read_views, ways_to_cameras
        from stages.formats.images.exr import says_white
        from stages.photometry.lighting.trusted_pixels import unclipped

        ((mask, normal, linear),) = read_views(self.paths, [camera])
        white = says_white(self.paths["linear"] / f"{camera.name}.exr")
        return linear, normal[mask], ways_to_cameras([camera], [mask]), unclipped(linear, self.how, white)

    def viewing(self, unclipped: np.ndarray, normals: np.ndarray, towards: np.ndarray) -> Viewing:
        """Tell which pixels count."""
        from stages.photometry.lighting.trusted_pixels import Viewing

        return Viewing.of(unclipped, normals, towards, self.how)

    def trusted(self, camera: Camera) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Read linear values and normals, (N, 3) each, of a view, and which of its pixels count, (N,)."""
        linear, normals, towards, unclipped = self.read(camera)
        return linear, normals, self.viewing(unclipped, normals, towards).trusted

    def open(self, cluster: Cluster, scale: float | None, each: Each = map) -> Opened:
        """Open the pixels of a cluster; without a scale, images are divided by their own."""
        import numpy as np

        from stages.formats.artefacts.view_files import scaled_channels
        from stages.photometry.clusters.cluster_views import open_cluster

        views = open_cluster(self.paths, self.cameras, cluster, self.side, each)
        parts = []
        for kept, view in zip(views.kept, each(self.read, views.cameras), strict=True):
            parts.append([values[kept] for values in view])
        pixels, normals, towards, unclipped = (np.concatenate(own) for own in zip(*parts, strict=True))
        del parts
        images, scale = scaled_channels(pixels, scale)
        viewing = self.viewing(unclipped, normals, towards)
        return Opened(views, images, scale, normals, viewing, unclipped)


def exposures_of(paths: Mapping[str, Path], cameras: Sequence[Camera]) -> np.ndarray | None:
    """Read the relative exposures of the views, (n,); None where nothing is said of them."""
    import numpy as np

    if "exposures" not in paths:
        return None
    known = json.loads(paths["exposures"].read_text(encoding="utf-8"))
    return np.array([known[camera.name] for camera in cameras]) if known else None


def gains_of_all(job: Job[Any], views: ViewFiles, scale: float, how: ViewGainSettings) -> np.ndarray:
    """Estimate the gains of all views, (n, 3), pair by pair; few views are in memory at a time."""
    import numpy as np

    from stages.formats.artefacts.correspondence_files import CorrespondenceFiles
    from stages.photometry.lighting.view_gains import LogView, PairRatio, log_gains

    held: OrderedDict[int, LogView] = OrderedDict()

    def log_view(number: int) -> LogView:
        if number not in held:
            linear, _, trusted = views.trusted(views.cameras[number])
            held[number] = LogView.of(linear / np.float32(scale), trusted, how)
            while len(held) > 2 and sum(len(one.logs) for one in held.values()) > PIXELS_HELD:
                held.popitem(last=False)
        held.move_to_end(number)
        return held[number]

    files, ratios = CorrespondenceFiles.of(job.inputs["correspondences"], views.cameras), []
    with job.progress("gains", len(files.pairs)) as step:
        for i, j in sorted(files.pairs):
            block = files.read(i, j)
            here, there = np.flatnonzero(np.diff(block.indptr)), block.indices
            pair = i, j, log_view(i), log_view(j), here, there
            ratios.append(PairRatio.of(*pair, how.fewest_correspondences))
            step()
    return np.exp(log_gains(len(views.cameras), ratios, exposures_of(job.inputs, views.cameras)))
