"""The pixels of a cluster, opened: its own, and those of the margin around it, of all views that see them."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
import scipy.sparse as sp

from stages.formats.artefacts.correspondence_files import CorrespondenceFiles
from stages.formats.artefacts.view_files import Each, read_arrays, read_maps
from stages.formats.images.exr import read_exr
from stages.formats.images.photos import read_mask
from stages.photometry.clusters.settings import ClusterSettings
from stages.photometry.clusters.surface_clusters import Cluster, SampledSurface, clusters_of
from stages.photometry.clusters.typical_views import ViewGraph
from stages.photometry.stack import StackedViews, crop_origin, cropped, stack_views
from stages.scene.cameras import Camera, back_project, footprint


@dataclass(frozen=True, eq=False)
class ClusterViews:
    """Opened pixels of a cluster.

    Attributes
    ----------
    numbers : list of int
        Of the views that have any, ascending.
    cameras : list of Camera
        Of these.
    masks : list of ndarray, shape (h_i, w_i), bool
        The pixels that take part, in each.
    kept : list of ndarray, shape (N_i,), bool
        Of the masked pixels of each, those that take part.
    stack : StackedViews
        Of the pixels that take part; its masks are cropped to them.
    own : ndarray, shape (N,), bool
        Which of these are the cluster's own, not of its margin.
    rim : ndarray, shape (N,), bool
        Which are beside the margin rather than in it: the neighbours, within views, of what is cut off.
    """

    numbers: list[int]
    cameras: list[Camera]
    masks: list[np.ndarray]
    kept: list[np.ndarray]
    stack: StackedViews
    own: np.ndarray
    rim: np.ndarray

    def maps(self, folder: Path, each: Each = map) -> np.ndarray:
        """Read an EXR per view; values of the pixels that take part, (N,) or (N, 3)."""
        return read_maps(folder, self.cameras, self.masks, each)

    def arrays(self, folder: Path, kinds: Sequence[str], each: Each = map) -> dict[str, np.ndarray]:
        """Read some kinds of what `write_arrays` wrote of all masked pixels, for those that take part."""
        return read_arrays(folder, self.cameras, kinds, each, self.kept)

    def places(self, graph: ViewGraph) -> np.ndarray:
        """Number its pixels, (N,), int64, among all masked pixels of all views: view by view, row by row."""
        first = graph.starts
        return np.concatenate(
            [first[view] + np.flatnonzero(kept) for view, kept in zip(self.numbers, self.kept, strict=True)]
        )

    @property
    def origins(self) -> np.ndarray:
        """Row and column where the stack's crop of each view begins, (n, 2), int64, if they are cropped."""
        return np.array([crop_origin(mask) for mask in self.masks], np.int64).reshape(-1, 2)

    @property
    def own_counts(self) -> np.ndarray:
        """Number of its own pixels in each of its views, (n,), int64."""
        return np.diff(np.concatenate([[0], np.cumsum(self.own)])[self.stack.starts])


def view_graph(paths: Mapping[str, Path], cameras: Sequence[Camera]) -> ViewGraph:
    """Count masked pixels and correspondences: the artefacts `mask` and `correspondences`."""
    masks = (read_mask(paths["mask"] / f"{camera.name}.png") for camera in cameras)
    pixels = np.array([np.count_nonzero(mask) for mask in masks], np.int64)
    side = float(np.mean([np.sqrt(camera.width * camera.height) for camera in cameras]))
    return ViewGraph(pixels, CorrespondenceFiles.of(paths["correspondences"], cameras).counts(), side)


def surface_points(
    paths: Mapping[str, Path], camera: Camera, mask: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Read where the masked pixels' surface is, (n, 3), and the length of a pixel there, z/f, (n,).

    A pixel of the mask without depth is taken to be at the camera.
    """
    depth = read_exr(paths["depth"] / f"{camera.name}.exr").astype(np.float64)
    return back_project(camera, depth)[mask], np.asarray(footprint(camera, depth[mask]))


def sampled_surface(
    paths: Mapping[str, Path], cameras: Sequence[Camera], step: int, each: Each = map
) -> SampledSurface:
    """Sample every so manieth masked pixel of all views: the artefacts `mask` and `depth`."""

    def sample(camera: Camera) -> tuple[np.ndarray, np.ndarray, float, np.ndarray, float]:
        mask = read_mask(paths["mask"] / f"{camera.name}.png")
        points, footprints = surface_points(paths, camera, mask)
        if not len(points):
            return points, footprints, 0.0, np.full((2, 3), np.nan), 0.0
        box = np.stack([points.min(axis=0), points.max(axis=0)])
        some = slice(min(step // 2, len(points) - 1), None, step)
        stands_for = len(points) / len(points[some])
        return points[some], footprints[some], stands_for, box, float(footprints.max())

    samples = list(each(sample, cameras))
    points, footprints, weights, boxes, reach = zip(*samples, strict=True)
    return SampledSurface(
        np.concatenate(points),
        np.concatenate(footprints),
        np.repeat(weights, [len(one) for one in points]),
        np.stack(boxes),
        np.array(reach),
    )


def divided_surface(
    paths: Mapping[str, Path],
    cameras: Sequence[Camera],
    graph: ViewGraph,
    how: ClusterSettings,
    each: Each = map,
) -> list[Cluster]:
    """Divide the surface that all views see into clusters; few pixels are not looked at, but are one."""
    pixels = int(graph.pixels.sum())
    if pixels <= how.pixels:
        return [Cluster.whole(range(len(cameras)), pixels)]
    step = max(1, -(-pixels // how.sample_pixels))
    return clusters_of(sampled_surface(paths, cameras, step, each), graph.side, how)


def open_cluster(
    paths: Mapping[str, Path],
    cameras: Sequence[Camera],
    cluster: Cluster,
    side: float,
    each: Each = map,
    rim: bool = False,
) -> ClusterViews:
    """Open masks and correspondences of a cluster, with or without a rim; `side`: that of all views."""

    def select(view: int) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
        mask = read_mask(paths["mask"] / f"{cameras[view].name}.png")
        if cluster.is_whole:
            everything = np.ones(int(np.count_nonzero(mask)), bool)
            return mask, everything, everything, ~everything
        points, footprints = surface_points(paths, cameras[view], mask)
        own = cluster.owns(points)
        near = own | cluster.reaches(points, footprints)
        beside = _beside(_with(mask, near))[mask] if rim else np.zeros_like(near)
        return mask, near | beside, own, beside

    selected = dict(zip(cluster.views, each(select, cluster.views), strict=True))
    numbers = [view for view in cluster.views if cluster.is_whole or selected[view][1].any()]
    kept, own, beside = ({view: selected[view][part] for view in numbers} for part in (1, 2, 3))
    masks = [_with(selected[view][0], kept[view]) for view in numbers]
    del selected
    files = CorrespondenceFiles.of(paths["correspondences"], cameras)
    place = {view: index for index, view in enumerate(numbers)}
    pairs = [(i, j) for i, j in files.pairs if i in place and j in place]

    def select_links(pair: tuple[int, int]) -> sp.csr_array:
        i, j = pair
        return _among(files.read(i, j), kept[i], kept[j])

    blocks = {
        (place[i], place[j]): block
        for (i, j), block in zip(pairs, each(select_links, pairs), strict=True)
        if block.nnz
    }
    crops = masks if cluster.is_whole else [cropped(mask) for mask in masks]
    return ClusterViews(
        numbers,
        [cameras[view] for view in numbers],
        masks,
        [kept[view] for view in numbers],
        replace(stack_views(crops, None, blocks), side_of_all=side),
        np.concatenate([own[view][kept[view]] for view in numbers]),
        np.concatenate([beside[view][kept[view]] for view in numbers]),
    )


def _among(block: sp.csr_array, rows: np.ndarray, columns: np.ndarray) -> sp.csr_array:
    """Select rows and columns of a matrix, by masks."""
    if rows.all() and columns.all():
        return block
    row = np.repeat(np.arange(block.shape[0]), np.diff(block.indptr))
    inside = rows[row] & columns[block.indices]
    places = (np.cumsum(rows) - 1)[row[inside]], (np.cumsum(columns) - 1)[block.indices[inside]]
    shape = int(np.count_nonzero(rows)), int(np.count_nonzero(columns))
    return sp.csr_array((block.data[inside], places), shape=shape)


def _beside(mask: np.ndarray) -> np.ndarray:
    """Select the pixels outside a mask that touch it, above, below, left or right."""
    touched = np.zeros_like(mask)
    touched[1:] |= mask[:-1]
    touched[:-1] |= mask[1:]
    touched[:, 1:] |= mask[:, :-1]
    touched[:, :-1] |= mask[:, 1:]
    return touched & ~mask


def _with(mask: np.ndarray, kept: np.ndarray) -> np.ndarray:
    """Reduce a mask to some of its pixels."""
    reduced = np.zeros_like(mask)
    reduced[mask] = kept
    return reduced
