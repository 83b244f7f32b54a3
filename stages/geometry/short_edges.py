"""A mesh whose edges are short enough for what is known at vertices only, as shadows are."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from stages.scene.meshes import Surface

STEP = np.sqrt(2)  # a cut across the longest edge halves a face, and shortens its edges by this


@dataclass(frozen=True, eq=False)
class Cut:
    """Faces that were cut in two, all at once, from the middle of their longest edge.

    Attributes
    ----------
    new_face : ndarray, shape (F,), int32
        Of each face the half that got a new number, −1 where it is whole.
    longest : ndarray, shape (F,), int8
        Corner that its longest edge begins at.
    """

    new_face: np.ndarray
    longest: np.ndarray

    def carried(self, faces: np.ndarray, shares: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Points by face, (n,), and shares of its corners, (n, 3), on the faces after the cut."""
        at = np.flatnonzero(self.new_face[faces] >= 0)
        if not len(at):
            return faces, shares
        cut = faces[at]
        a, b, c = np.take_along_axis(shares[at], _corners_from(self.longest[cut]), axis=1).T
        beyond = b > a
        faces, shares = faces.copy(), shares.copy()
        faces[at[beyond]] = self.new_face[cut[beyond]]
        ends, middle = np.abs(a - b), 2 * np.minimum(a, b)
        shares[at] = np.where(beyond, [c, middle, ends], [c, ends, middle]).T
        return faces, shares


@dataclass(frozen=True, eq=False)
class ShortEdged:
    """A mesh with short edges in place of another, and the way from one to the other.

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
        """Points on the other mesh, on this one.

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
        views = [self._carried(*view) for view in zip(faces, barycentric, strict=True)]
        return [view[0] for view in views], [view[1] for view in views]

    def _carried(self, faces: np.ndarray, uv: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        shares = np.column_stack([1 - uv.sum(axis=1), uv])
        for cut in self.cuts:
            faces, shares = cut.carried(faces, shares)
        return faces, shares[:, 1:]


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
        For a mesh that has fewer.

    Returns
    -------
    ShortEdged
    """
    allowed = max(float(_edges(surface).max(initial=0)), longest)
    found = ShortEdged(surface, allowed, ())
    while allowed > longest:
        allowed = max(allowed / STEP, longest)
        finer = _cut_down(found, allowed)
        if len(finer.surface.vertices) > most_vertices:
            break
        found = finer
    return found


def _cut_down(found: ShortEdged, allowed: float) -> ShortEdged:
    """The same with all faces cut until no edge is longer."""
    surface, cuts, middles = found.surface, list(found.cuts), _Middles(len(found.surface.vertices))
    while (_edges(surface) > allowed).any():
        surface, cut = _cut_once(surface, allowed, middles)
        cuts.append(cut)
    return ShortEdged(surface, allowed, tuple(cuts))


def _cut_once(surface: Surface, allowed: float, middles: _Middles) -> tuple[Surface, Cut]:
    """Every face with too long an edge cut in two: (c, a, m) in its place and (c, m, b) after all others."""
    lengths = _edges(surface)
    longest, faces = np.argmax(lengths, axis=1), surface.faces.copy()
    cut = np.flatnonzero(lengths.max(axis=1) > allowed)
    a, b, c = np.take_along_axis(faces[cut], _corners_from(longest[cut]), axis=1).T
    m, fresh = middles.of(a, b)
    new_face = np.full(len(faces), -1, np.int32)
    new_face[cut] = len(faces) + np.arange(len(cut))
    faces[cut] = np.stack([c, a, m], axis=1)
    vertices = np.concatenate([surface.vertices, surface.vertices[fresh].mean(axis=1)])
    faces = np.concatenate([faces, np.stack([c, m, b], axis=1).astype(np.int32)])
    return Surface(vertices, faces), Cut(new_face, longest.astype(np.int8))


class _Middles:
    """Numbers of the vertices in the middle of edges: the second face of an edge meets the first one's."""

    def __init__(self, first: int) -> None:
        self._first, self._ends = first, np.zeros(0, np.int64)

    def of(self, a: np.ndarray, b: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """The middles' numbers, (n,), and the ends of those that are new, (k, 2)."""
        ends = np.minimum(a, b).astype(np.int64) << 32 | np.maximum(a, b)
        fresh = np.setdiff1d(ends, self._ends)
        self._ends = np.concatenate([self._ends, fresh])
        order = np.argsort(self._ends)
        number = self._first + order[np.searchsorted(self._ends, ends, sorter=order)]
        return number, np.stack([fresh >> 32, fresh & 0xFFFFFFFF], axis=1)


def _edges(surface: Surface) -> np.ndarray:
    """Lengths of the faces' edges, (F, 3), each by the corner that it begins at."""
    corners = surface.vertices[surface.faces]
    return np.linalg.norm(np.roll(corners, -1, axis=1) - corners, axis=2)


def _corners_from(first: np.ndarray) -> np.ndarray:
    """Three corners in turn from the first of each, (n, 3)."""
    return (first[:, None] + np.arange(3)) % 3
