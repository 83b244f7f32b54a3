"""Geometry that is only roughly known: details smoothed away, as in the paper's Fig. 2-b."""

from __future__ import annotations

from stages.formats.meshes.triangle_meshes import Surface, from_open3d, joined, to_open3d


def laplacian_smoothing(surface: Surface, steps: int) -> Surface:
    """Move every vertex to the mean of its neighbours and itself, `steps` times; faces stay as they are.

    Vertices that lie on one another move as one: faces that share none would each shrink to a point.
    """
    if steps == 0:
        return surface
    whole, number = joined(surface)
    smoothed = to_open3d(whole).filter_smooth_simple(number_of_iterations=steps)
    return Surface(from_open3d(smoothed).vertices[number], surface.faces)
