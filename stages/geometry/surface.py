"""Surface reconstruction from oriented points: Poisson, its depth from extent and footprint."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
import open3d as o3d

from stages.formats.meshes.triangle_meshes import Surface, from_open3d, to_open3d


@dataclass(frozen=True)
class OrientedPoints:
    """Points with normals and the length that a pixel covers there.

    Attributes
    ----------
    x_in_world : ndarray, shape (n, 3), float64
    normals : ndarray, shape (n, 3), float64
        Unit, towards the cameras.
    footprints : ndarray, shape (n,), float64
        The smallest z/f over the views that hold the point in their image, model units.
    pixel_sizes : ndarray, shape (n,)
        Of the pixels that a point was found with, in pixels of the views.
    """

    x_in_world: np.ndarray
    normals: np.ndarray
    footprints: np.ndarray
    pixel_sizes: np.ndarray

    def __len__(self) -> int:
        return len(self.x_in_world)

    def chosen(self, keep: np.ndarray) -> OrientedPoints:
        """Choose the points of a boolean mask or index array."""
        kept = (self.x_in_world, self.normals, self.footprints, self.pixel_sizes)
        return OrientedPoints(*(values[keep] for values in kept))


def robust_crop(points: OrientedPoints, outliers: float, margin: float) -> OrientedPoints:
    """Drop points far outside the box that holds all but a share `outliers` of them per side and axis.

    The box is widened by `margin` of its size: a few stray points must not decide the octree's extent.
    """
    low, high = np.quantile(points.x_in_world, [outliers, 1 - outliers], axis=0)
    slack = margin * (high - low)
    inside = ((points.x_in_world >= low - slack) & (points.x_in_world <= high + slack)).all(axis=1)
    return points.chosen(inside)


def octree_depth(points: OrientedPoints, cell_footprints: float, shallowest: int, deepest: int) -> int:
    """Choose the depth at which an octree cell is about `cell_footprints` median pixel footprints wide."""
    extent = float(np.ptp(points.x_in_world, axis=0).max())
    cell = cell_footprints * float(np.median(points.footprints))
    return int(np.clip(np.ceil(np.log2(max(extent / cell, 1.0))), shallowest, deepest))


def depth_within(points: OrientedPoints, depth: int, shallowest: int, most_cells: int) -> int:
    """Lower a depth until the points occupy no more cells of the octree than allowed, or it is the lowest."""
    extent = float(np.ptp(points.x_in_world, axis=0).max())
    if len(points) <= most_cells or extent == 0:
        return depth
    cloud = o3d.geometry.PointCloud(o3d.utility.Vector3dVector(points.x_in_world))
    while depth > shallowest and len(cloud.voxel_down_sample(extent / 2**depth).points) > most_cells:
        depth -= 1
    return depth


def poisson(points: OrientedPoints, depth: int) -> Surface:
    """Reconstruct a screened Poisson surface; on one thread, since more move vertices from run to run.

    Around the points' mean: it computes in single precision.
    """
    middle = points.x_in_world.mean(axis=0)
    cloud = o3d.geometry.PointCloud(o3d.utility.Vector3dVector(points.x_in_world - middle))
    cloud.normals = o3d.utility.Vector3dVector(points.normals)
    mesh, _ = o3d.geometry.TriangleMesh.create_from_point_cloud_poisson(cloud, depth=depth, n_threads=1)
    return moved(from_open3d(mesh), middle)


def without_crumbs(surface: Surface, smallest_share: float) -> Surface:
    """Drop connected components with less than `smallest_share` of the largest one's faces."""
    mesh = to_open3d(surface)
    labels, counts = map(np.asarray, mesh.cluster_connected_triangles()[:2])
    return with_faces(surface, counts[labels] >= smallest_share * counts.max())


def smoothed(surface: Surface, iterations: int) -> Surface:
    """Smooth a surface by Taubin's filter, which does not shrink it."""
    if iterations == 0:
        return surface
    return from_open3d(to_open3d(surface).filter_smooth_taubin(number_of_iterations=iterations))


def decimated(surface: Surface, target_faces: int | None) -> Surface:
    """Decimate a surface to about `target_faces` by quadrics; None leaves it as it is."""
    if target_faces is None or len(surface.faces) <= target_faces:
        return surface
    middle = surface.vertices.mean(axis=0)  # quadrics lose their digits far from the origin
    near = to_open3d(moved(surface, -middle))
    return moved(from_open3d(near.simplify_quadric_decimation(target_faces)), middle)


def moved(surface: Surface, by: np.ndarray) -> Surface:
    """Translate a surface by a vector, (3,)."""
    return replace(surface, vertices=surface.vertices + by)


def with_faces(surface: Surface, keep: np.ndarray) -> Surface:
    """Keep the faces of a boolean mask, and only the vertices that they use."""
    faces = surface.faces[keep]
    used, renumbered = np.unique(faces, return_inverse=True)
    return Surface(surface.vertices[used], renumbered.reshape(faces.shape).astype(np.int32))


def mean_edge(surface: Surface) -> float:
    """Compute the mean length of the faces' first edges, model units."""
    ends = surface.vertices[surface.faces[:, :2]]
    return float(np.linalg.norm(ends[:, 1] - ends[:, 0], axis=1).mean())
