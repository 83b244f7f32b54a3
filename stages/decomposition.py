"""Albedo, shading and light of every view together (Eq. 1–4, 9–18): the core of the paper, and its extension.

The paper's light, or harmonics with transfer vectors. Under the light of the stage `lighting`, the stage is
`decomposition_under_light`.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

from pipeline import Artefact, Job, Stage
from stages.photometry.decomposition_record import ALBEDO, ENERGY, OF_TRANSFER, write_albedo, write_history
from stages.photometry.decomposition_settings import IGNORED, DecompositionSettings
from stages.photometry.joint.settings import given_or
from stages.photometry.lighting.settings import LightingSettings
from stages.photometry.solver_settings import weights_at
from stages.scene.distributions import OPEN3D, PICTURES
from stages.scene.memory_of_views import BYTES_OF_LIBRARIES, FEWER_OR_SMALLER_VIEWS

if TYPE_CHECKING:
    import numpy as np
    import scipy.sparse as sp

    from stages.formats.artefacts.transfer_file import StoredTransfer
    from stages.photometry.joint.fast_alternation import FastSolver
    from stages.photometry.paper.energy import EnergyWeights
    from stages.photometry.solutions import SolvedWithLight
    from stages.photometry.stack import StackedViews
    from stages.photometry.transport.pixel_transfer import PixelTransfer
    from stages.scene.cameras import Camera

BYTES_PER_LINK = 40
BYTES_PER_PIXEL = {"paper": 550, "harmonics": 1350}  # masked, all channels together
OF_PAPERS_SOLVER = 500  # bytes per pixel that the channels share, and as many for each at work


def estimated_memory(settings: DecompositionSettings, inputs: Mapping[str, Path], threads: int) -> int:
    """Estimate the memory from masked pixels and links; measured values are up to a third off it."""
    from stages.formats.artefacts.correspondence_files import link_count
    from stages.formats.artefacts.view_files import masked_pixels

    per_pixel = BYTES_PER_PIXEL[settings.kind_of_light]
    if settings.kind_of_light == "paper" and settings.solver == "paper":
        per_pixel = OF_PAPERS_SOLVER * (1 + min(threads, 3))
    links = link_count(inputs["correspondences"])
    return BYTES_OF_LIBRARIES + per_pixel * masked_pixels(inputs) + BYTES_PER_LINK * links


def run(job: Job[DecompositionSettings]) -> None:
    """Estimate light and albedo together: the paper's light, or harmonics with transfer vectors."""
    import numpy as np

    from stages.formats.artefacts.camera_file import read_cameras
    from stages.formats.artefacts.correspondence_files import numbered_correspondences
    from stages.formats.artefacts.lighting_json import write_lighting
    from stages.formats.artefacts.view_files import read_views, scaled_channels, write_maps
    from stages.photometry.stack import stack_views

    cameras = read_cameras(job.inputs["cameras"])
    masks, normals, pixels = [], [], []
    with job.progress("views", len(cameras)) as step:
        for mask, normal, linear in read_views(job.inputs, cameras, job.executor.map):
            masks.append(mask)
            normals.append(normal)
            pixels.append(linear)
            step()
    correspondences = numbered_correspondences(job.inputs["correspondences"], cameras)
    views = stack_views(masks, normals, correspondences, job.executor.map)
    images, scale = scaled_channels(np.concatenate(pixels))
    del pixels
    by_transfer = job.settings.mode == "transfer"
    if by_transfer:
        own = np.concatenate([image[mask] for image, mask in zip(normals, masks, strict=True)])
        del normals
        solved = _by_transfer(job, cameras, masks, views, images, own)
        _write_pictures(job, cameras, solved)
    else:
        del normals  # the stack has its own basis
        solved = _as_the_paper(job, views, images)
    write_albedo(job, cameras, masks, solved, scale)
    write_maps(job.outputs["shading"], cameras, masks, solved.shading, job.executor.map)
    write_lighting(job.outputs["lighting"], cameras, solved.light, scale, by_transfer)
    write_history(job, solved)


def _as_the_paper(
    job: Job[DecompositionSettings], views: StackedViews, images: list[np.ndarray]
) -> SolvedWithLight:
    """Solve `mode: paper` by the solver in the settings."""
    from stages.photometry import solutions

    settings = job.settings
    if settings.solver == "fast":
        with job.progress("rounds", settings.stopping.max_rounds, at_most=True) as step:
            return solutions.solve_jointly(views, images, _solver(job, views), job.threads, step)
    how = settings.paper
    with job.progress("alternations", 3 * how.max_alternations, at_most=True) as step:
        return solutions.solve_by_alternation(views, images, _weights(job, views), how, job.executor, step)


def _by_transfer(
    job: Job[DecompositionSettings],
    cameras: list[Camera],
    masks: list[np.ndarray],
    views: StackedViews,
    images: list[np.ndarray],
    normals: np.ndarray,
) -> SolvedWithLight:
    """Solve Eq. 2 with transfer vectors for ν (`light: harmonics`); all pixels have a data term."""
    import numpy as np

    from stages.formats.artefacts.transfer_file import read_transfer
    from stages.formats.artefacts.view_files import read_surface_points, ways_to_cameras
    from stages.formats.meshes.triangle_meshes import read_mesh
    from stages.geometry.vertex_interpolation import pixels_on_proxy
    from stages.photometry import solutions
    from stages.photometry.transport.pixel_transfer import Bounces

    settings = job.settings
    stored = read_transfer(job.inputs["transfer"])
    points = read_surface_points(job.inputs, cameras, masks)
    transfer = _pixel_transfer(
        job, stored, pixels_on_proxy(stored, read_mesh(job.inputs["mesh"]), points), normals
    )
    bounces = Bounces(
        int(given_or(settings.bounces, LightingSettings().bounces)),
        given_or(settings.brightest, settings.reflectance_scale.usual_brightest),
        settings.reflectance_scale.brightest_quantile,
    )
    with job.progress("rounds", settings.stopping.max_rounds, at_most=True) as step:
        solved = solutions.solve_by_transfer(
            views, images, transfer, _solver(job, views), bounces, settings.harmonics, job.threads, step
        )
    incidence = np.einsum("nk,nk->n", normals, ways_to_cameras(cameras, masks))
    everywhere = np.ones(len(normals), bool)
    return solved.judged(views, np.stack(images, axis=1), incidence, everywhere, settings.confidence)


def _solver(job: Job[DecompositionSettings], views: StackedViews) -> FastSolver:
    """Set up `solver: fast`."""
    from stages.photometry.joint.fast_alternation import FastSolver

    return FastSolver(_weights(job, views), job.settings.stopping, job.settings.fast)


def _weights(job: Job[DecompositionSettings], views: StackedViews) -> EnergyWeights:
    """Scale λ and μ to the size of the views, and note them."""
    weights = weights_at(job.settings, views.side, views.correspondences_per_pixel)
    job.note(weights={"lambda": weights.smoothness, "mu": weights.consistency})
    return weights


def _pixel_transfer(
    job: Job[DecompositionSettings], stored: StoredTransfer, blend: sp.csr_array, normals: np.ndarray
) -> PixelTransfer:
    """Compute the transfer vectors of the masked pixels, in harmonics."""
    from stages.photometry.transport.lit_scenes import proxy_in
    from stages.photometry.transport.pixel_transfer import PixelTransfer
    from stages.scene.wording import tell_seen_from_behind

    degree = int(given_or(job.settings.degree, stored.blocked.shape[1] ** 0.5 - 1))
    transfer, opposed = PixelTransfer.of(normals, blend, proxy_in(stored), degree)
    tell_seen_from_behind(job, opposed, len(normals))
    return transfer


def _write_pictures(job: Job[DecompositionSettings], cameras: list[Camera], solved: SolvedWithLight) -> None:
    """Write harmonic light as pictures of all directions."""
    from stages.formats.artefacts.view_files import write_pictures_of_light
    from stages.photometry.transport.environment import picture_of_light
    from stages.scene.upright import upright_from_world

    directions, lights = solved.sampled_light(job.settings.harmonics.picture_directions)
    upright = directions @ upright_from_world(cameras, job.settings.upright_within_deg).T
    names = [camera.name for camera in cameras]
    how = job.settings.light_pictures
    pictures = {name: picture_of_light(upright, one, how) for name, one in zip(names, lights, strict=True)}
    write_pictures_of_light(job.outputs["light_pictures"], pictures)


def in_words(facts: Mapping[str, Any]) -> str:
    """Tell in a few words what was found."""
    return f"albedo of {facts['pixels']:,} pixels, which {facts['links']:,} correspondences tie together"


DECOMPOSITION = Stage(
    name="decomposition",
    version=20,
    about="Albedo, shading and light of each view, from all views together.",
    settings=DecompositionSettings,
    takes=("linear", "normal", "mask", "cameras", "correspondences"),
    ignores=IGNORED["paper"],
    gives=(
        ALBEDO,
        Artefact("shading", "shading per view, EXR, linear: image = albedo × shading", output="shading"),
        Artefact("lighting", "light per view and channel", file="lighting.json", output="lighting.json"),
        ENERGY,
    ),
    run=run,
    tools=("numpy", "scipy", "numba", "llvmlite", *OPEN3D, *PICTURES),
    memory=estimated_memory,
    saves_memory=FEWER_OR_SMALLER_VIEWS,
    found=in_words,
)

# The same stage in `mode: transfer`. With `light: harmonics` it takes the inputs of that light.
DECOMPOSITION_BY_TRANSFER = replace(
    DECOMPOSITION,
    version=DECOMPOSITION.version + 20,  # ahead of it by the changes of this mode
    takes=(*DECOMPOSITION.takes, "mesh", "triangles", "transfer"),
    ignores=IGNORED["harmonics"],
    gives=(
        *DECOMPOSITION.gives,
        *OF_TRANSFER,
        Artefact("light_pictures", "the light from all directions, EXR and PNG", output="environment"),
    ),
)
