"""Texels of a texture on the surface: which faces each lies in, and where."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numba import njit, prange

import stages.solvers.kernels.threading_layer  # noqa: F401 -- chooses the threads below
from stages.formats.meshes.triangle_meshes import Surface
from stages.geometry.rays import face_normals
from stages.scene.cameras import Camera, smallest_footprints
from stages.texturing.settings import ChartSettings
from stages.texturing.unwrapping import ChartedMesh

INSIDE = 1e-3  # barycentric coordinates of what is clearly inside a face, whatever rounding says


@dataclass(frozen=True, eq=False)
class Texels:
    """Places on the surface that texels show: one for each face in which the centre of a texel lies.

    Attributes
    ----------
    side : int
        Of the texture.
    place : ndarray, shape (T,), int64
        row · side + column, ascending; several times where faces overlap in the texture, or share an edge.
    face : ndarray, shape (T,), int32
    corners : ndarray, shape (T, 2), float32
        Barycentric coordinates of the face's second and third corner.
    """

    side: int
    place: np.ndarray
    face: np.ndarray
    corners: np.ndarray

    def __len__(self) -> int:
        return len(self.place)

    def at(self, chosen: np.ndarray | slice) -> Texels:
        """Select some of the texels."""
        return Texels(self.side, self.place[chosen], self.face[chosen], self.corners[chosen])

    def weights(self) -> np.ndarray:
        """Compute barycentric coordinates of all three corners, (T, 3), float32."""
        return np.concatenate([1 - self.corners.sum(axis=1, keepdims=True), self.corners], axis=1)

    def interpolated(self, mesh: ChartedMesh, of_vertices: np.ndarray) -> np.ndarray:
        """Interpolate values of vertices, (V, c), to the texels, (T, c), float32."""
        weights, corners = self.weights(), mesh.faces[self.face]
        values = of_vertices.astype(np.float32)
        return sum(weights[:, k, None] * values[corners[:, k]] for k in range(3))

    @property
    def covered(self) -> int:
        """Number of texels."""
        return int((np.diff(self.place, prepend=-1) != 0).sum())

    def overlap(self) -> float:
        """Measure the share of texels whose centres lie clearly inside of two faces or more."""
        inside = self.place[self.weights().min(axis=1) > INSIDE]
        shared = np.unique(inside[1:][inside[1:] == inside[:-1]])
        return len(shared) / max(self.covered, 1)

    def means(self, weight: np.ndarray, values: list[np.ndarray]) -> tuple[Texels, list[np.ndarray]]:
        """Average values over the places of each texel.

        Parameters
        ----------
        weight : ndarray, shape (T,)
            Of each place; where all of a texel weigh nothing, they weigh the same.
        values : list of ndarray, shape (T, c), float32

        Returns
        -------
        Texels
            Each with its first place.
        list of ndarray, shape (t, c), float32
        """
        first = np.concatenate([[True], self.place[1:] != self.place[:-1]])[: len(self)]
        if first.all():
            return self, values
        texel = np.cumsum(first) - 1
        known = np.bincount(texel, weight)[texel] > 0
        weight = np.where(known, weight, 1)
        total = np.bincount(texel, weight)
        alone = Texels(self.side, self.place[first], self.face[first], self.corners[first])
        return alone, [
            np.stack([np.bincount(texel, weight * channel) / total for channel in of.T], axis=1).astype("f4")
            for of in values
        ]

    def image(self, values: np.ndarray, background: float = 0) -> np.ndarray:
        """Arrange values of texels, (T, …), as an image (side, side, …)."""
        filled = np.full((self.side**2, *values.shape[1:]), background, values.dtype)
        filled[self.place] = values
        return filled.reshape(self.side, self.side, *values.shape[1:])


def side_of_atlas(surface: Surface, cameras: list[Camera], how: ChartSettings) -> int:
    """Choose the side of the atlas: a power of two with texels as small as the nearest view's pixels.

    Parameters
    ----------
    surface : Surface
    cameras : list of Camera
        At the size of the maps that the texture is made from.
    how : ChartSettings
    """
    return _side(_texels_of_faces(surface, cameras, how).sum() / how.expected_use, how)


def side_of_charts(mesh: ChartedMesh, cameras: list[Camera], how: ChartSettings) -> int:
    """Choose the side of a texture whose charts are given: as `side_of_atlas`, by the share that they cover.

    Parameters
    ----------
    mesh : ChartedMesh
    cameras : list of Camera
    how : ChartSettings
    """
    wanted = _texels_of_faces(Surface(mesh.vertices, mesh.faces), cameras, how)
    covered = np.abs(areas_in_texture(mesh.uv[mesh.faces]))
    seen = (wanted > 0) & (covered > 0)
    return _side(wanted[seen].sum() / covered[seen].sum() if seen.any() else 0, how)


def areas_in_texture(uv: np.ndarray) -> np.ndarray:
    """Compute areas of faces, (f, 3, 2), in a texture, shape (f,): negative where they are mirrored."""
    one, other = uv[:, 1] - uv[:, 0], uv[:, 2] - uv[:, 0]
    return (one[:, 0] * other[:, 1] - one[:, 1] * other[:, 0]) / 2


def texels_of(mesh: ChartedMesh, side: int) -> Texels:
    """Find the faces under the centre of every texel; beyond its borders a texture is repeated."""
    corners = np.ascontiguousarray(mesh.uv[mesh.faces] * side - 0.5)
    counts = np.zeros(len(corners), np.int64)
    _count(corners, counts)
    ends = np.cumsum(counts)
    total = int(ends[-1]) if len(ends) else 0
    place, within = np.empty(total, np.int64), np.empty((total, 2), np.float32)
    _lay(corners, ends - counts, side, place, within)
    face = np.repeat(np.arange(len(corners), dtype=np.int32), counts)
    order = np.argsort(place, kind="stable")
    return Texels(side, place[order], face[order], within[order])


def _texels_of_faces(surface: Surface, cameras: list[Camera], how: ChartSettings) -> np.ndarray:
    """Count the texels that each face is worth, shape (f,): its pixels in the nearest view; 0 if unseen.

    A face is where its middle is; a large one, of which no photo may show the middle, is in many places.
    """
    corners = surface.vertices[surface.faces]
    areas = np.linalg.norm(face_normals(surface.vertices, surface.faces), axis=1) / 2
    smallest = smallest_footprints(corners.mean(axis=1), cameras)
    large = np.flatnonzero(areas > how.large_face * areas.sum())
    if len(large):
        places = np.einsum("pc,fcx->fpx", _places_in_a_face(how.places_along), corners[large])
        nearest = smallest_footprints(places.reshape(-1, 3), cameras).reshape(len(large), -1).min(axis=1)
        smallest[large] = np.minimum(smallest[large], nearest)
    texel = smallest / how.texels_per_pixel
    return np.where(np.isfinite(texel), areas / texel**2, 0)


def _places_in_a_face(along: int) -> np.ndarray:
    """Lay an even grid of so many places along a side, as barycentric coordinates, (p, 3)."""
    second, third = np.indices((along, along)).reshape(2, -1)
    inside = second + third < along
    coordinates = np.stack([along - 1 - second - third, second, third], axis=1)
    return coordinates[inside] / (along - 1)


def _side(texels: float, how: ChartSettings) -> int:
    side = 2 ** int(np.ceil(np.log2(max(np.sqrt(texels), 1))))
    return int(np.clip(side, how.least_px, how.most_px))


@njit(parallel=True, cache=True, nogil=True)
def _count(corners, counts):
    """Count the texels in each face; texel centres are whole numbers here."""
    for f in prange(len(corners)):
        left, top, right, bottom = _box(corners[f])
        for row in range(top, bottom + 1):
            for column in range(left, right + 1):
                inside, _, _ = _barycentric(corners[f], column, row)
                counts[f] += inside


@njit(parallel=True, cache=True, nogil=True)
def _lay(corners, starts, side, place, within):
    """Write the texels in each face and their barycentric coordinates, from its place in the list on."""
    for f in prange(len(corners)):
        left, top, right, bottom = _box(corners[f])
        k = starts[f]
        for row in range(top, bottom + 1):
            for column in range(left, right + 1):
                inside, second, third = _barycentric(corners[f], column, row)
                if inside:
                    place[k] = (row % side) * side + column % side
                    within[k, 0], within[k, 1] = second, third
                    k += 1


@njit(inline="always")
def _box(corners):
    left, right = corners[:, 0].min(), corners[:, 0].max()
    top, bottom = corners[:, 1].min(), corners[:, 1].max()
    return int(np.ceil(left)), int(np.ceil(top)), int(np.floor(right)), int(np.floor(bottom))


@njit(inline="always")
def _barycentric(corners, x, y):
    """Tell whether a point is inside, its borders with it; and its share of the second and third corner."""
    x1, y1 = corners[1, 0] - corners[0, 0], corners[1, 1] - corners[0, 1]
    x2, y2 = corners[2, 0] - corners[0, 0], corners[2, 1] - corners[0, 1]
    area = x1 * y2 - x2 * y1
    if area == 0:
        return False, 0.0, 0.0
    dx, dy = x - corners[0, 0], y - corners[0, 1]
    second, third = (dx * y2 - dy * x2) / area, (dy * x1 - dx * y1) / area
    return second >= 0 and third >= 0 and second + third <= 1, second, third
