"""The pixels of all views, lit cluster by cluster, by a light that was found on some of them."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import scipy.sparse as sp

from stages.formats.artefacts.transfer_file import StoredTransfer
from stages.formats.artefacts.view_files import read_surface_points
from stages.geometry.short_edges import ShortEdged
from stages.geometry.vertex_interpolation import pixels_on_proxy_of
from stages.photometry.clusters.parts import Parts
from stages.photometry.clusters.surface_clusters import Cluster
from stages.photometry.clusters.typical_views import ViewGraph
from stages.photometry.lighting.further_views import further_pixels
from stages.photometry.lighting.illumination import Illumination
from stages.photometry.lighting.lighting_record import OBSERVATIONS
from stages.photometry.lighting.opened_views import Opened, ViewFiles
from stages.photometry.transport.pixel_transfer import without_opposed
from stages.scene.cameras import Camera
from stages.solvers.kernels.pixelwise import on_threads
from stages.solvers.kernels.threading_layer import use_threads


@dataclass(frozen=True, eq=False)
class Scene:
    """What is known of all views before their pixels are opened. Picklable.

    Attributes
    ----------
    cameras : list of Camera
    files : ViewFiles
    graph : ViewGraph
    stored : StoredTransfer
    short : ShortEdged
        The mesh, with edges as short as those of the transfer.
    """

    cameras: list[Camera]
    files: ViewFiles
    graph: ViewGraph
    stored: StoredTransfer
    short: ShortEdged

    def blend(self, opened: Opened) -> sp.csr_array:
        """Interpolate the proxy's vertices at the pixels, (N, P)."""
        points = read_surface_points(self.files.paths, opened.views.cameras, opened.views.masks)
        return pixels_on_proxy_of(self.short, self.stored, points)


@dataclass(frozen=True, eq=False)
class LightTask:
    """All that the pixels of clusters are lit from. Picklable.

    Attributes
    ----------
    scene : Scene
    parts : Parts
        Where shading and data of the pixels are kept, until they are put together view by view.
    found : Illumination
        Of some views, without their pixels.
    typical : float
        Median shading of these.
    gains : ndarray, shape (n, 3)
        Of all views.
    scale : float
        By which images are divided.
    """

    scene: Scene
    parts: Parts
    found: Illumination
    typical: float
    gains: np.ndarray
    scale: float


def light_cluster(cluster: Cluster, task: LightTask, threads: int) -> tuple[int, int, int]:
    """Light a cluster, and keep its own pixels; count clipped, untrusted, usable ones. Picklable."""
    use_threads(threads)
    scene = task.scene
    opened = scene.files.open(cluster, task.scale, on_threads)
    blend, _ = without_opposed(opened.normals, scene.blend(opened), scene.stored.normals)
    image = np.stack(opened.images, axis=1)
    shading, data = further_pixels(
        task.found,
        task.typical,
        opened.views.stack,
        image,
        opened.viewing,
        opened.normals,
        blend,
        task.gains[opened.views.numbers],
    )
    values = {"shading": shading, **{kind: getattr(data, kind) for kind in OBSERVATIONS}}
    task.parts.keep(cluster, opened.views, values)
    own, usable = opened.views.own, opened.viewing.trusted
    chosen = ~opened.unclipped & own, ~(usable & data.trusted) & own, usable & own
    clipped, untrusted, used = (int(np.count_nonzero(pixels)) for pixels in chosen)
    return clipped, untrusted, used
