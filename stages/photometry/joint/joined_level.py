"""A coarse level of all views, added up from parts of their pixels (the coarse space of a two-level scheme).

A part finds its own fine levels, and what reaches further is found once, for all.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from stages.photometry.joint.pyramid import Level, coarser
from stages.solvers.kernels.pixelwise import EVERYWHERE, Chosen
from stages.solvers.primal_dual.half_edges import from_edges

VIEW, ROW = 40, 20  # bits of a place below its view, and below its row
SUMS = ("basis", "image", "share")


@dataclass(frozen=True, eq=False)
class PartOfLevel:
    """What some pixels contribute to a coarse level: sums over those in each group, and edges.

    Attributes
    ----------
    places : ndarray, shape (G,), int64
        Of the groups; see `places_of`. Ascending.
    basis, image, share : ndarray
        As of a `Level`.
    tail, head : ndarray, shape (E,), int32
        Groups, among these, that edges join; tail below head.
    weight : ndarray, shape (E,), float32
    """

    places: np.ndarray
    basis: np.ndarray
    image: np.ndarray
    share: np.ndarray
    tail: np.ndarray
    head: np.ndarray
    weight: np.ndarray

    @classmethod
    def of(cls, finest: Level, depth: int, views: Sequence[int], origins: np.ndarray) -> PartOfLevel:
        """Add up the finest level of some pixels, so many levels coarser.

        `views`: numbers of its views among all; `origins`, (n, 2): row and column where their crops begin.
        """
        level = finest
        for _ in range(depth):
            level = coarser(level)
        first, head = level.graph.first, level.graph.neighbour
        tail = np.repeat(np.arange(level.pixels, dtype=np.int32), np.diff(first))
        upwards = tail < head
        places = places_of(level, views, origins >> depth)
        sums = {name: getattr(level, name) for name in SUMS}
        return cls(places, **sums, tail=tail[upwards], head=head[upwards], weight=level.graph.weight[upwards])

    @classmethod
    def load(cls, path: Path) -> PartOfLevel:
        """Read what `save` wrote."""
        with np.load(path, allow_pickle=False) as arrays:
            return cls(**arrays)

    def save(self, path: Path) -> None:
        """Write an ``.npz``."""
        np.savez(path, **vars(self))


def places_of(
    level: Level, views: Sequence[int], origins: np.ndarray, depth: int = 0, some: Chosen = EVERYWHERE
) -> np.ndarray:
    """Number pixels of a level by view, row and column in the whole view, so many levels coarser.

    Parameters
    ----------
    level : Level
    views : sequence of int
        Numbers of its views among all.
    origins : ndarray, shape (n, 2), int64
        Row and column of the whole view where the crop of each begins, on the coarser level.
    depth : int
        Levels between the two.
    some : slice or ndarray, shape (m,), int64
        Which pixels.

    Returns
    -------
    ndarray, shape (m,), int64
        Ascending for all pixels of a level on that level itself.
    """
    view = level.view_of_pixel[some]
    row, column = ((level.positions[some] >> depth).astype(np.int64) + origins[view]).T
    return (np.asarray(views, np.int64)[view] << VIEW) + (row << ROW) + column


def joined(parts: Sequence[PartOfLevel], view_count: int) -> tuple[Level, np.ndarray]:
    """Add up parts to a level of all views; returns it and the places of its pixels, (N,)."""
    places = np.unique(np.concatenate([part.places for part in parts]))
    numbers = [np.searchsorted(places, part.places).astype(np.int32) for part in parts]
    sums = {name: np.zeros((len(places), *getattr(parts[0], name).shape[1:]), np.float32) for name in SUMS}
    for part, number in zip(parts, numbers, strict=True):
        for name in SUMS:
            sums[name][number] += getattr(part, name)  # a part has each place once
    pairs = list(zip(parts, numbers, strict=True))
    tail = np.concatenate([number[part.tail] for part, number in pairs])
    head = np.concatenate([number[part.head] for part, number in pairs])
    inside = (1 << ROW) - 1
    level = Level(
        starts=np.searchsorted(places, np.arange(view_count + 1) << VIEW).astype(np.int64),
        positions=np.stack([(places >> ROW) & inside, places & inside], axis=1).astype(np.int32),
        graph=from_edges(len(places), tail, head, np.concatenate([part.weight for part in parts])),
        gauge_of_view=np.zeros(view_count, np.int64),
        **sums,
    )
    return level, places
