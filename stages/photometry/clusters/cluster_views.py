"""The views of a cluster, opened: its own pixels, and those of other views that correspond to them."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
import scipy.sparse as sp

from stages.formats.artefacts.correspondence_files import CorrespondenceFiles
from stages.formats.artefacts.view_files import Each, read_arrays, read_maps
from stages.formats.images.photos import read_mask
from stages.photometry.clusters.view_clusters import Cluster, ViewGraph
from stages.photometry.stack import StackedViews, stack_views
from stages.scene.cameras import Camera


@dataclass(frozen=True, eq=False)
class ClusterViews:
    """Opened views of a cluster.

    Attributes
    ----------
    cameras : list of Camera
        Of its own views and its halo, in the order of all views.
    kept : list of ndarray, shape (N_i,), bool
        Of the masked pixels of each, those that take part: all of its own views.
    stack : StackedViews
        Of the pixels that take part.
    own : ndarray, shape (N,), bool
        Which of these are of its own views.
    own_cameras : list of Camera
    own_masks : list of ndarray, shape (h_i, w_i), bool
    """

    cameras: list[Camera]
    kept: list[np.ndarray]
    stack: StackedViews
    own: np.ndarray
    own_cameras: list[Camera]
    own_masks: list[np.ndarray]

    def maps(self, folder: Path, each: Each = map) -> np.ndarray:
        """Read an EXR per view; values of the pixels that take part, (N,) or (N, 3)."""
        return read_maps(folder, self.cameras, self.stack.masks, each)

    def arrays(self, folder: Path, kinds: Sequence[str], each: Each = map) -> dict[str, np.ndarray]:
        """Read some kinds of what `write_arrays` wrote of all masked pixels, for those that take part."""
        everything = np.concatenate(self.kept)
        found = read_arrays(folder, self.cameras, kinds, each)
        return found if everything.all() else {kind: values[everything] for kind, values in found.items()}


def view_graph(paths: Mapping[str, Path], cameras: Sequence[Camera]) -> ViewGraph:
    """Count masked pixels and correspondences: the artefacts `mask` and `correspondences`."""
    masks = (read_mask(paths["mask"] / f"{camera.name}.png") for camera in cameras)
    pixels = np.array([np.count_nonzero(mask) for mask in masks], np.int64)
    side = float(np.mean([np.sqrt(camera.width * camera.height) for camera in cameras]))
    return ViewGraph(pixels, CorrespondenceFiles.of(paths["correspondences"], cameras).counts(), side)


def open_cluster(
    paths: Mapping[str, Path], cameras: Sequence[Camera], cluster: Cluster, side: float
) -> ClusterViews:
    """Open masks and correspondences of a cluster; `side`: that of all views."""
    chosen, own = sorted({*cluster.own, *cluster.halo}), set(cluster.own)
    masks = {view: read_mask(paths["mask"] / f"{cameras[view].name}.png") for view in chosen}
    files = CorrespondenceFiles.of(paths["correspondences"], cameras)
    kept = {view: np.full(int(np.count_nonzero(mask)), view in own) for view, mask in masks.items()}
    pairs = [pair for pair in files.pairs if pair[0] in masks and pair[1] in masks]
    for i, j in pairs:
        if (i in own) != (j in own):
            block = files.read(i, j)
            here, there = (i, j) if i in own else (j, i)
            kept[there] |= _linked_to(block if there == j else block.T, kept[here])
    number = {view: index for index, view in enumerate(chosen)}
    blocks = {
        (number[i], number[j]): block
        for i, j in pairs
        if (block := _among(files.read(i, j), kept[i], kept[j])).nnz
    }
    reduced = [_with(masks[view], kept[view]) for view in chosen]
    stack = replace(stack_views(reduced, None, blocks), side_of_all=side)
    of_pixel = np.concatenate([np.full(int(kept[view].sum()), view in own) for view in chosen])
    return ClusterViews(
        [cameras[view] for view in chosen],
        [kept[view] for view in chosen],
        stack,
        of_pixel,
        [cameras[view] for view in cluster.own],
        [masks[view] for view in cluster.own],
    )


def _linked_to(block: sp.csr_array | sp.csc_array, rows: np.ndarray) -> np.ndarray:
    """Find the columns that are linked to the chosen rows, (columns,), bool."""
    return (block.T @ rows.astype(np.float32)) > 0


def _among(block: sp.csr_array, rows: np.ndarray, columns: np.ndarray) -> sp.csr_array:
    """Select rows and columns of a matrix, by masks."""
    if rows.all() and columns.all():
        return block
    row = np.repeat(np.arange(block.shape[0]), np.diff(block.indptr))
    inside = rows[row] & columns[block.indices]
    places = (np.cumsum(rows) - 1)[row[inside]], (np.cumsum(columns) - 1)[block.indices[inside]]
    shape = int(np.count_nonzero(rows)), int(np.count_nonzero(columns))
    return sp.csr_array((block.data[inside], places), shape=shape)


def _with(mask: np.ndarray, kept: np.ndarray) -> np.ndarray:
    """Reduce a mask to some of its pixels."""
    reduced = np.zeros_like(mask)
    reduced[mask] = kept
    return reduced
