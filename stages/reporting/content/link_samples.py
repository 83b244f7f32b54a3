"""Agreement of views on the surface that they share: albedo against photos, on sampled correspondences."""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from stages.formats.artefacts.correspondence_files import CorrespondenceFiles
from stages.reporting.settings import FigureSettings


@dataclass(frozen=True, eq=False)
class LinkSample:
    """Corresponding pixels of two views.

    Attributes
    ----------
    i, j : int
        Numbers of the views.
    p, q : ndarray, shape (k,), int
        Pixels of Ω^i and Ω^j, row by row.
    """

    i: int
    j: int
    p: np.ndarray
    q: np.ndarray


def sampled_links(files: CorrespondenceFiles, how: FigureSettings) -> list[LinkSample]:
    """Open some pairs, evenly chosen, and choose some links of each, evenly; one matrix at a time."""
    pairs = files.pairs
    step = max(1, -(-len(pairs) // how.pairs))
    samples = []
    for i, j in pairs[::step]:
        p, q = files.read(i, j).tocoo().coords
        some = slice(None, None, max(1, len(p) // how.links))
        samples.append(LinkSample(i, j, p[some].copy(), q[some].copy()))
    return samples


class LinkValues:
    """Values of photo and albedo at the sampled pixels, view by view as they are opened."""

    def __init__(self, samples: Sequence[LinkSample]) -> None:
        self._samples = samples
        self._of_view: dict[int, list[tuple[int, int, np.ndarray]]] = defaultdict(list)
        for number, sample in enumerate(samples):
            self._of_view[sample.i].append((number, 0, sample.p))
            self._of_view[sample.j].append((number, 1, sample.q))
        self._values: dict[tuple[int, int, str], np.ndarray] = {}

    def add(self, view: int, kind: str, values: np.ndarray, inside: np.ndarray) -> None:
        """Keep the values of one kind of map of a view at its sampled pixels.

        Parameters
        ----------
        view : int
        kind : str
        values : ndarray, shape (h w, 3)
            Of all pixels.
        inside : ndarray, shape (N,), int
            Those of Ω among them, in order.
        """
        for number, side, pixels in self._of_view.get(view, ()):
            self._values[number, side, kind] = values[inside[pixels]].mean(axis=1, dtype=np.float64)

    def difference(self, kind: str) -> float | None:
        """Compute mean |a − b| of linked pixels over their mean, of the mean of the channels."""
        gaps, means = [], []
        for number in range(len(self._samples)):
            one, other = (self._values.get((number, side, kind)) for side in (0, 1))
            if one is not None and other is not None:
                gaps.append(np.abs(one - other))
                means.append((one + other) / 2)
        if not gaps or (mean := float(np.concatenate(means).mean())) <= 0:
            return None
        return float(np.concatenate(gaps).mean()) / mean


def graph_as_json(files: CorrespondenceFiles) -> list[dict[str, Any]]:
    """List the pairs of views that share surface, with the number of their links."""
    return [{"i": i, "j": j, "links": links} for (i, j), (_, links) in files.rows.items()]
