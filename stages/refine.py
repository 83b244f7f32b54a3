"""The mesh refined until the photos of neighbouring views agree on it: relief that stereo smooths away."""

from __future__ import annotations

from collections.abc import Mapping
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any

from pipeline import Artefact, Job, Stage
from stages.scene.distributions import OPEN3D, PICTURES, PYCOLMAP
from stages.scene.memory_of_views import BYTES_OF_LIBRARIES, FEWER_OR_SMALLER_VIEWS
from stages.stereo.refinement.settings import RefineSettings

if TYPE_CHECKING:
    import numpy as np

    from stages.scene.cameras import Camera

BYTES_PER_PIXEL = 28  # of views, held
BYTES_PER_PIXEL_OF_VIEW = 260  # of one that is compared: as many at once as threads
BYTES_PER_VERTEX = 1200
DIVIDED = 1.6  # vertices over those of a mesh that is made here
OVERLAP = 2  # views, at least, that see a place of a coarse one
BYTES_OF_VERTEX_IN_FILE = 50  # with two faces
LEAST_VERTICES = 1000  # as the setting allows
FEW_KNOWN = 0.01  # of the vertices: a warning


def run(job: Job[RefineSettings]) -> None:
    """Open photos, cameras and mesh, refine it round by round, save it."""
    from stages.formats.colmap.model import cameras_of, read_model
    from stages.formats.meshes.triangle_meshes import read_mesh, write_mesh
    from stages.solvers.kernels.threading_layer import use_threads
    from stages.stereo.refinement.refined_surface import refine, remeshed, widest_relief
    from stages.stereo.refinement.view_pairs import sources_of_views

    use_threads(job.threads)
    settings = job.settings
    cameras = cameras_of(read_model(job.inputs["workspace"] / "sparse"))
    given = read_mesh(job.inputs["mesh"])
    surface = remeshed(given, cameras, settings)
    sources = sources_of_views(surface, cameras, settings.neighbours, settings.pairs, job.threads)
    widest = widest_relief(given, cameras, settings)
    read = partial(_radiance, dict(job.inputs), settings)
    noise = []
    with job.progress("rounds", len(settings.scales) * settings.rounds) as step:
        for last in refine(surface, widest, cameras, sources, read, settings, job.threads):
            noise.append(round(last.noise, 3))
            step()
    write_mesh(job.outputs["refined_mesh"], last.surface)
    if last.known < FEW_KNOWN:
        job.warn(
            f"The photos tell the height of only {last.known:.1%} of the mesh's vertices, so that it stays "
            "as it is: too few views see the same surface. Check that mesh and cameras belong together, and "
            "the masks."
        )
    job.note(
        vertices_given=len(given.vertices),
        vertices=len(last.surface.vertices),
        moved_footprints=round(last.moved, 3),
        known=round(last.known, 3),
        stiffness=round(last.stiffness, 2),
        noise=noise,
    )


def _radiance(paths: dict[str, Path], settings: RefineSettings, camera: Camera) -> np.ndarray:
    """Read a photo and its mask at the size of a camera: as `Photo.radiance`."""
    from stages.formats.images.exr import read_exr
    from stages.formats.images.masks import kept_at
    from stages.formats.images.resize import reduce_by_area
    from stages.stereo.refinement.compared_photos import radiance

    image = reduce_by_area(read_exr(paths["linear"] / f"{camera.name}.exr"), camera.shape)
    kept = kept_at(paths["kept"] / f"{camera.name}.png", camera.shape)
    return radiance(image, kept, settings.errors)


def estimated_memory(settings: RefineSettings, inputs: Mapping[str, Path], threads: int) -> int:
    """Estimate the memory from the mesh and the pixels of all views at the finest scale."""
    from stages.formats.colmap.model import cameras_of, read_model

    cameras = cameras_of(read_model(inputs["workspace"] / "sparse"))
    pixels = [camera.width * camera.height for camera in cameras]
    scale = settings.scales[-1] ** 2
    sizes = [one // scale for one in pixels]
    at_once = settings.photos_at_once(sizes, threads)
    together = at_once * (settings.neighbours + 1) * max(sizes, default=0)
    held = BYTES_PER_PIXEL * min(sum(sizes), max(settings.most_pixels, together))
    compared = BYTES_PER_PIXEL_OF_VIEW * at_once * max(sizes, default=0)
    given = inputs["mesh"].stat().st_size // BYTES_OF_VERTEX_IN_FILE
    divided = int(max(DIVIDED * given, sum(pixels) / settings.edge_px**2 / OVERLAP))
    vertices = max(given, min(divided, settings.most_vertices))
    return BYTES_OF_LIBRARIES + held + compared + BYTES_PER_VERTEX * vertices


def within(settings: RefineSettings, memory: int) -> RefineSettings:
    """Allow half of the memory, bytes, for vertices, a third for pixels of views, the rest for comparing."""
    room = max(memory - BYTES_OF_LIBRARIES, 0)
    vertices = max(room // 2 // BYTES_PER_VERTEX, LEAST_VERTICES)
    pixels = max(room // 3 // BYTES_PER_PIXEL, 1)
    compared = max(room // 6 // BYTES_PER_PIXEL_OF_VIEW, 1)
    update = {
        "most_vertices": min(settings.most_vertices, vertices),
        "most_pixels": min(settings.most_pixels, pixels),
        "most_compared_pixels": min(settings.most_compared_pixels, compared),
    }
    return settings.model_copy(update=update)


def in_words(facts: Mapping[str, Any]) -> str:
    """Tell in a few words what was found."""
    return (
        f"{facts['known']:.0%} of {facts['vertices']:,} vertices moved, by "
        f"{facts['moved_footprints']:.2f} px (root mean square)"
    )


REFINE = Stage(
    name="refine",
    version=7,
    about="The mesh moved until the photos of neighbouring views agree on it.",
    settings=RefineSettings,
    takes=("mesh", "linear", "workspace", "kept"),
    ignores=("refine",),  # whoever asked for it, it is the same
    gives=(
        Artefact("refined_mesh", "refined triangle mesh, world axes", file="mesh.ply", output="mesh.ply"),
    ),
    run=run,
    tools=("numpy", "scipy", "numba", *PYCOLMAP, *OPEN3D, *PICTURES),
    memory=estimated_memory,
    within=within,
    saves_memory=f"set refine.scales=[4,2], lower refine.most_vertices, or {FEWER_OR_SMALLER_VIEWS}",
    found=in_words,
)
