"""From fused points to a surface ("MVS" in the paper): Poisson, trimmed to what was seen."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any

from pipeline import Artefact, Job, Settings, Stage, UserError, group, setting
from stages.geometry.settings import SurfaceGapSettings
from stages.scene.distributions import OPEN3D, PICTURES, PYCOLMAP
from stages.scene.memory_of_views import BYTES_OF_LIBRARIES

if TYPE_CHECKING:
    import numpy as np

    from stages.formats.meshes.triangle_meshes import Surface
    from stages.geometry.surface import OrientedPoints
    from stages.scene.cameras import Camera

BYTES_PER_BYTE_OF_POINTS = 4.2  # of their file, 41 bytes a point
BYTES_PER_CELL = 1200  # of the octree, occupied
CELLS_PER_BYTE_OF_POINTS = 0.0104  # of their file, at the automatic depth: 0.4 for each point
LEAST_CELLS = 10_000


class MeshSettings(Settings):
    """Settings of the `mesh` stage."""

    fewest_points: int = setting(
        100, "With fewer fused points there is no mesh: Poisson has nothing to hold on to.", ge=4
    )
    depth: int | None = setting(
        None, "Octree depth of Poisson; none: from the scene's extent and the pixel footprint.", ge=5, le=14
    )
    cell_footprints: float = setting(
        1.5,
        "Width of an octree cell where the depth is not given. Finer cells follow the depth maps' noise.",
        unit="pixel footprints",
        gt=0,
    )
    shallowest: int = setting(
        5, "Bound of the automatic depth from below: 32 cells along the longest side.", ge=1, le=14
    )
    deepest: int = setting(
        12, "Bound of the automatic depth: each step costs four times the memory.", ge=5, le=14
    )
    most_cells: int = setting(
        8_000_000,
        "Octree cells that the points may occupy, at most; of more, the automatic depth is lowered. Memory "
        "is about 1.2 kB for each.",
        unit="cells",
        ge=1000,
    )
    trim_footprints: float = setting(
        6.0,
        "Surface farther from every fused point is dropped. Six closes gaps between depth maps and no more.",
        unit="footprints of the pixels that a point was found with",
        gt=0,
    )
    rim_footprints: float = setting(
        2.5,
        "So is surface farther than this where a view shows even background, from the border inwards: "
        "Poisson goes on beyond outlines.",
        unit="pixel footprints",
        gt=0,
    )
    gaps: SurfaceGapSettings = group(
        SurfaceGapSettings, "Gaps of the cloud that are closed, though no point is near."
    )
    crop_outliers: float = setting(
        0.002,
        "Share of points per side and axis that may lie outside the box that sets the extent.",
        ge=0,
        lt=0.5,
    )
    crop_margin: float = setting(0.2, "The box is widened by this share of its size.", ge=0)
    smallest_component: float = setting(
        0.01, "Components with fewer faces than this share of the largest are dropped as crumbs.", ge=0, le=1
    )
    smoothing_iterations: int = setting(0, "Taubin smoothing; off, for it rounds edges.", ge=0, le=1000)
    target_faces: int | None = setting(
        None, "Quadric decimation to so many faces; none: all are kept.", ge=100
    )


def run(job: Job[MeshSettings]) -> None:
    """Open the fused points and the cameras, reconstruct, save the mesh."""
    from stages.formats.colmap.model import cameras_of, read_model
    from stages.formats.meshes.triangle_meshes import write_mesh
    from stages.geometry import surface as s
    from stages.geometry.trimming import before_background, trim_to_points

    settings, background_of = job.settings, partial(_background, job)
    cameras = cameras_of(read_model(job.inputs["workspace"] / "sparse"))
    points = _points(job, cameras)
    depth = _octree_depth(job, points)
    with job.progress("mesh", 4) as step:
        surface = s.poisson(points, depth)
        step()
        surface = trim_to_points(
            surface,
            points,
            settings.trim_footprints,
            settings.rim_footprints,
            partial(before_background, cameras=cameras, background_of=background_of),
            _gap_closer(job, cameras, background_of),
            job.threads,
        )
        if not len(surface.faces):
            raise UserError(
                f"No surface lies within {settings.trim_footprints} footprints of a fused point; "
                "raise mesh.trim_footprints or mesh.depth."
            )
        step()
        surface = s.without_crumbs(surface, settings.smallest_component)
        step()
        surface = s.decimated(s.smoothed(surface, settings.smoothing_iterations), settings.target_faces)
        step()
    write_mesh(job.outputs["mesh"], surface)
    job.note(points=len(points), octree_depth=depth, vertices=len(surface.vertices), faces=len(surface.faces))


def _points(job: Job[MeshSettings], cameras: list[Camera]) -> OrientedPoints:
    """Read the fused points that a view holds, without what lies far outside."""
    from stages.formats.meshes.point_clouds import read_points
    from stages.geometry.surface import OrientedPoints, robust_crop
    from stages.scene.cameras import smallest_footprints

    settings = job.settings
    x_in_world, normals, pixel_sizes = read_points(job.inputs["fused"])
    points = OrientedPoints(x_in_world, normals, smallest_footprints(x_in_world, cameras), pixel_sizes)
    points = points.chosen(points.footprints < float("inf"))
    if len(points) < settings.fewest_points:
        raise UserError(
            f"Only {len(points)} fused points were found; expected at least {settings.fewest_points}. "
            "The photos overlap too little or show too little texture: add photos, "
            "or raise undistort.max_size_px."
        )
    return robust_crop(points, settings.crop_outliers, settings.crop_margin)


def _octree_depth(job: Job[MeshSettings], points: OrientedPoints) -> int:
    """Choose the depth of Poisson's octree: as given, or as footprints ask and the memory has room for."""
    from stages.geometry.surface import depth_within, octree_depth

    settings = job.settings
    if settings.depth:
        return settings.depth
    wished = octree_depth(points, settings.cell_footprints, settings.shallowest, settings.deepest)
    depth = depth_within(points, wished, settings.shallowest, settings.most_cells)
    if depth < wished:
        job.warn(
            f"The mesh has an octree depth of {depth} instead of {wished}, since the memory has room for "
            f"{settings.most_cells} cells (mesh.most_cells): its relief is {2 ** (wished - depth)} times as "
            "coarse as the photos would allow. Allow more memory with --memory."
        )
    return depth


def _gap_closer(
    job: Job[MeshSettings], cameras: list[Camera], background_of: Callable[[Camera], np.ndarray | None]
) -> Callable[[Surface, np.ndarray, np.ndarray], np.ndarray]:
    """Provide what chooses the gaps to be closed: none where no depth maps tell what is seen through them."""
    import numpy as np

    from stages.formats.colmap.depth_maps import read_map
    from stages.geometry.trimming import gaps_not_seen_through, sightings

    if "depth_maps" not in job.inputs:
        return lambda surface, far, footprints: np.zeros_like(far)
    folder, how = job.inputs["depth_maps"] / "depth_maps", job.settings.gaps

    def depth_of(camera: Camera) -> np.ndarray:
        return read_map(folder / f"{camera.name}.png.geometric.bin")

    seen = partial(
        sightings, cameras=cameras, depth_of=depth_of, background_of=background_of, margin=how.margin
    )

    def closed(surface: Surface, far: np.ndarray, footprints: np.ndarray) -> np.ndarray:
        stay = gaps_not_seen_through(surface, far, footprints, seen, how)
        job.note(vertices_of_closed_gaps=int(stay.sum()))
        return stay

    return closed


def _background(job: Job[MeshSettings], camera: Camera) -> np.ndarray | None:
    """Read where a view shows even background; None where nobody said."""
    from stages.formats.images.photos import read_mask

    path = job.inputs["background"] / f"{camera.name}.png" if "background" in job.inputs else None
    return read_mask(path) if path is not None and path.is_file() else None


def estimated_memory(settings: MeshSettings, inputs: Mapping[str, Path], threads: int) -> int:
    """Estimate the memory of Poisson from the number of points."""
    points = inputs["fused"].stat().st_size
    cells = min(CELLS_PER_BYTE_OF_POINTS * points, settings.most_cells)
    return BYTES_OF_LIBRARIES + int(BYTES_PER_BYTE_OF_POINTS * points + BYTES_PER_CELL * cells)


def within(settings: MeshSettings, memory: int) -> MeshSettings:
    """Allow as many cells as the memory, bytes, has room for beside a third for the points."""
    cells = max((2 * memory // 3 - BYTES_OF_LIBRARIES) // BYTES_PER_CELL, LEAST_CELLS)
    return settings.model_copy(update={"most_cells": min(settings.most_cells, cells)})


def in_words(facts: Mapping[str, Any]) -> str:
    """Tell in a few words what was found."""
    return f"{facts['faces']:,} faces from {facts['points']:,} points"


MESH = Stage(
    name="mesh",
    version=8,
    about="Poisson surface of the fused points, trimmed to what was seen.",
    settings=MeshSettings,
    takes=("fused", "workspace", "background", "depth_maps"),
    gives=(Artefact("mesh", "triangle mesh, world axes", file="mesh.ply", output="mesh.ply"),),
    run=run,
    tools=("numpy", "scipy", *PYCOLMAP, *OPEN3D, *PICTURES),
    memory=estimated_memory,
    within=within,
    saves_memory="set mesh.depth: each step less takes a quarter of it",
    found=in_words,
)

MESH_OF_GIVEN_POINTS = replace(MESH, takes=("fused", "workspace"))  # nobody says where background is
