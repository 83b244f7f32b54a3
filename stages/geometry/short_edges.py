"""A mesh with edges short enough for what is known at vertices only, as shadows are."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from stages.formats.meshes.triangle_meshes import Surface

STEP = np.sqrt(2)  # a cut across the longest edge halves a face; its edges get so much shorter on average


@dataclass(frozen=True, eq=False)
class Cut:
    """Faces that were cut in two, all at once, from the middle of their longest edge.

    Attributes
    ----------
    before : int
        How many faces there were; the k-th cut has made number ``before + k``.
    faces : ndarray, shape (n,)
        Those that were cut, sorted.
    longest : ndarray, shape (n,)
        Corners that their longest edges begin at.
    """

    before: int
    faces: np.ndarray
    longest: np.ndarray

    def carried(self, faces: np.ndarray, shares: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Carry points, by face, (n,), and barycentric shares, (n, 3), to the faces after the cut."""
        index = np.full(self.before, -1, np.int32)
        index[self.faces] = np.arange(len(self.faces))
        at = np.flatnonzero(index[faces] >= 0)
        cut = index[faces[at]]
        a, b, c = np.take_along_axis(shares[at], _corners_from(self.longest[cut]), axis=1).T
        beyond = b > a
        faces, shares = faces.copy(), shares.copy()
        faces[at[beyond]] = self.before + cut[beyond]
        ends, middle = np.abs(a - b), 2 * np.minimum(a, b)
        shares[at] = np.where(beyond, [c, middle, ends], [c, ends, middle]).T
        return faces, shares


@dataclass(frozen=True, eq=False)
class ShortEdged:
    """A mesh with short edges in place of another, and the map from one to the other.

    Attributes
    ----------
    surface : Surface
        The other itself where none of its edges was too long.
    longest : float
        No edge is longer, model units. `with_short_edges` makes the same mesh of it again.
    cuts : tuple of Cut
    """

    surface: Surface
    longest: float
    cuts: tuple[Cut, ...]

    def carried(
        self, faces: Sequence[np.ndarray], barycentric: Sequence[np.ndarray]
    ) -> tuple[list[np.ndarray], list[np.ndarray]]:
        """Carry points from the other mesh to this one.

        Parameters
        ----------
        faces : sequence of ndarray, shape (N_i,)
            View by view.
        barycentric : sequence of ndarray, shape (N_i, 2)
            (u, v): the point is (1 − u − v) a + u b + v c.

        Returns
        -------
        tuple of two lists of ndarray
            The same of this mesh.
        """
        if not self.cuts:
            return list(faces), list(barycentric)
        every, uv = np.concatenate(faces), np.concatenate(barycentric)
        shares = np.column_stack([1 - uv.sum(axis=1), uv])
        for cut in self.cuts:
            every, shares = cut.carried(every, shares)
        ends = np.cumsum([len(view) for view in faces])[:-1]
        return np.split(every, ends), np.split(shares[:, 1:], ends)


def with_short_edges(surface: Surface, longest: float, most_vertices: float = np.inf) -> ShortEdged:
    """Cut faces in two, from the middle of the longest edge, while that is longer than allowed.

    An edge is cut in its middle or not at all, by its length alone, so both of its faces agree and no crack
    opens (longest-edge bisection: Rivara, 1984). The longest edges of all come first: where there would be
    too many vertices, all edges stay longer than asked for, not some.

    Parameters
    ----------
    surface : Surface
    longest : float
        Model units.
    most_vertices : float
        Edges stay longer where there would be more.

    Returns
    -------
    ShortEdged
    """
    lengths = _edges(surface.vertices, surface.faces).max(axis=1)
    allowed = max(float(lengths.max(initial=0)), longest)
    found = ShortEdged(surface, allowed, ())
    while allowed > longest:
        allowed = max(allowed / STEP, longest)
        finer, lengths = _cut_down(found, lengths, allowed)
        if len(finer.surface.vertices) > most_vertices:
            break
        found = finer
    return found


def _cut_down(found: ShortEdged, lengths: np.ndarray, allowed: float) -> tuple[ShortEdged, np.ndarray]:
    """The same with faces cut until no edge is longer; and every face's longest edge, (F,)."""
    surface, cuts, middles = found.surface, list(found.cuts), _Middles(len(found.surface.vertices))
    while len(faces := np.flatnonzero(lengths > allowed)):
        own = _edges(surface.vertices, surface.faces[faces])
        cut = Cut(len(surface.faces), faces, np.argmax(own, axis=1))
        surface = _cut_once(surface, cut, middles)
        halves = np.concatenate([faces, np.arange(cut.before, len(surface.faces))])
        lengths = np.concatenate([lengths, np.empty(len(faces))])
        lengths[halves] = _edges(surface.vertices, surface.faces[halves]).max(axis=1)
        cuts.append(cut)
    return ShortEdged(surface, allowed, tuple(cuts)), lengths


def _cut_once(surface: Surface, cut: Cut, middles: _Middles) -> Surface:
    """With (c, a, m) in place of a cut face (a, b, c), m between a and b, and with (c, m, b) at the end."""
    faces = surface.faces.copy()
    a, b, c = np.take_along_axis(faces[cut.faces], _corners_from(cut.longest), axis=1).T
    m, fresh = middles.of(a, b)
    faces[cut.faces] = np.stack([c, a, m], axis=1)
    faces = np.concatenate([faces, np.stack([c, m, b], axis=1).astype(np.int32)])
    return Surface(np.concatenate([surface.vertices, surface.vertices[fresh].mean(axis=1)]), faces)


class _Middles:
    """Numbers of the vertices in the middle of edges: the second face of an edge meets the first one's."""

    def __init__(self, first: int) -> None:
        self._first, self._ends = first, np.zeros(0, np.int64)

    def of(self, a: np.ndarray, b: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Number the middles of edges, (n,), and list the ends of those that are new, (k, 2)."""
        ends = np.minimum(a, b).astype(np.int64) << 32 | np.maximum(a, b)
        fresh = np.setdiff1d(ends, self._ends)
        self._ends = np.concatenate([self._ends, fresh])
        order = np.argsort(self._ends)
        number = self._first + order[np.searchsorted(self._ends, ends, sorter=order)]
        return number, np.stack([fresh >> 32, fresh & 0xFFFFFFFF], axis=1)


def _edges(vertices: np.ndarray, faces: np.ndarray) -> np.ndarray:
    """Lengths of faces' edges, (n, 3), each by the corner that it begins at."""
    lengths = np.empty(faces.shape)
    for corner in range(3):  # one after the other: large meshes have tens of millions
        along = vertices[faces[:, (corner + 1) % 3]]
        along -= vertices[faces[:, corner]]
        lengths[:, corner] = np.sqrt(np.einsum("nk,nk->n", along, along))
    return lengths


def _corners_from(first: np.ndarray) -> np.ndarray:
    """Three corners in turn from the first of each, (n, 3)."""
    return (first[:, None] + np.arange(3)) % 3
