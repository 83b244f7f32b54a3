"""Maps of all views out of clusters: each keeps the values of its own pixels, views take theirs."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from stages.formats.images.photos import read_mask
from stages.photometry.clusters.cluster_views import ClusterViews, surface_points
from stages.photometry.clusters.surface_clusters import Cluster
from stages.scene.cameras import Camera


@dataclass(frozen=True)
class Parts:
    """Values of pixels on disk, cluster by cluster.

    Attributes
    ----------
    folder : Path
        A private one.
    paths : mapping of str to Path
        The artefacts `mask` and `depth`.
    cameras : list of Camera
    clusters : list of Cluster
        All of them: every pixel is one's own.
    """

    folder: Path
    paths: Mapping[str, Path]
    cameras: Sequence[Camera]
    clusters: Sequence[Cluster]

    def keep(self, cluster: Cluster, opened: ClusterViews, values: Mapping[str, np.ndarray]) -> None:
        """Keep values of some kinds, (N, …) each, of the cluster's own pixels."""
        counts = np.zeros(len(self.cameras), np.int64)
        counts[opened.numbers] = opened.own_counts
        np.save(self._file(cluster, "counts"), counts)
        for kind, stacked in values.items():
            np.save(self._file(cluster, kind), stacked[opened.own])

    def of_view(self, view: int, kinds: Sequence[str]) -> tuple[np.ndarray, dict[str, np.ndarray]]:
        """Put a view together: its mask, and the values of each kind of its masked pixels, (N_i, …)."""
        mask = read_mask(self.paths["mask"] / f"{self.cameras[view].name}.png")
        shares = list(self._shares(view, mask))
        values = {}
        for kind in kinds:
            files = [np.load(self._file(one, kind), mmap_mode="r") for one, *_ in shares]
            values[kind] = np.zeros((np.count_nonzero(mask), *files[0].shape[1:]), files[0].dtype)
            for file, (_, own, begin) in zip(files, shares, strict=True):
                values[kind][own] = file[begin : begin + np.count_nonzero(own)]
        return mask, values

    def _shares(self, view: int, mask: np.ndarray) -> Iterator[tuple[Cluster, np.ndarray, int]]:
        """Find which pixels of a view are whose, and where each cluster keeps their values."""
        if len(self.clusters) == 1:
            points = np.empty((np.count_nonzero(mask), 3))
        else:
            points, _ = surface_points(self.paths, self.cameras[view], mask)
        for cluster in self.clusters:
            if view in cluster.views:
                counts = np.load(self._file(cluster, "counts"), allow_pickle=False)
                yield cluster, cluster.owns(points), int(counts[:view].sum())

    def _file(self, cluster: Cluster, kind: str) -> Path:
        return self.folder / f"{cluster.number}_{kind}.npy"
