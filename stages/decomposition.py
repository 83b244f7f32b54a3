"""Albedo, shading and light of every view (Eq. 1–4, 9–18): the core of the paper, and what goes past it."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

from pipeline import Artefact, Job, Stage, json_text
from stages.photometry.decomposition_settings import DecompositionSettings, given_or
from stages.photometry.solver_settings import as_alternation, as_fast, as_sky, as_transfer, weights_at
from stages.scene.distributions import OPEN3D, PICTURES

if TYPE_CHECKING:
    import numpy as np
    import scipy.sparse as sp

    from stages.photometry.energy import EnergyWeights
    from stages.photometry.pixel_transfer import PixelTransfer
    from stages.photometry.sky import Eyes
    from stages.photometry.sky_decomposition import SkySolution
    from stages.photometry.solutions import Solved
    from stages.photometry.stack import StackedViews
    from stages.scene.cameras import Camera
    from stages.scene.transfer_file import StoredTransfer

CHANNELS = ("red", "green", "blue")
GRAZING = 0.1  # cosine: more than 84° off its normal, surface shows mostly its neighbourhood
SATURATED = 0.98  # of white, linear: the photo shows less than there was


def run(job: Job) -> None:
    """Open the views, decompose, save albedo, shading, light and history.

    Memory, per masked pixel and all channels together: `solver: fast` some 550 B in `mode: paper`, 1100 B in
    `mode: transfer`, 1350 B there with `light: harmonics`; `solver: paper` about 500 B for what the channels
    share, 500 B more for each at work. Where sheen is looked for, 0.4 GB more at any size, and 0.2 GB for the
    light's picture: of 256 directions, and as many times as much of more.
    """
    import numpy as np

    from stages.photometry.stack import stack_views
    from stages.scene.camera_file import read_cameras
    from stages.scene.link_files import numbered_links
    from stages.scene.transfer_file import read_transfer
    from stages.scene.view_files import read_views, scaled_channels

    cameras = read_cameras(job.inputs["cameras"])
    masks, normals, pixels = [], [], []
    with job.progress("views", len(cameras)) as step:
        for mask, normal, linear in read_views(job.inputs, cameras, job.executor.map):
            masks.append(mask)
            normals.append(normal)
            pixels.append(linear)
            step()
    links = numbered_links(job.inputs["correspondences"], cameras)
    views = stack_views(masks, normals, links, job.executor.map)
    pixels = np.concatenate(pixels)
    images, scale = scaled_channels(pixels)
    if job.settings.mode == "transfer":
        own = np.concatenate([image[mask] for image, mask in zip(normals, masks, strict=True)])
        unclipped = np.concatenate([_unclipped(pixels[views.view(i)]) for i in range(len(cameras))])
        del normals, pixels
        stored = read_transfer(job.inputs["transfer"])
        solved = _by_transfer(job, cameras, masks, views, images, own, unclipped, stored)
        _write_what_transfer_knows(job, cameras, masks, solved, scale, stored)
    else:
        del normals, pixels  # the stack has its own
        solved = _as_the_paper(job, views, images)
    _write_maps(job, cameras, masks, solved, scale)
    _write_history(job, solved)


def _as_the_paper(job: Job, views: StackedViews, images: list[np.ndarray]) -> Solved:
    """`mode: paper`, by the solver that was asked for."""
    from stages.photometry import solutions

    settings: DecompositionSettings = job.settings
    weights = _weights(job, views)
    if settings.solver == "fast":
        with job.progress("rounds", settings.stopping.rounds) as step:
            return solutions.fast(views, images, as_fast(settings, weights), job.threads, step)
    with job.progress("alternations", 3 * settings.max_alternations) as step:
        return solutions.as_the_paper(views, images, as_alternation(settings, weights), job.executor, step)


def _by_transfer(
    job: Job,
    cameras: list[Camera],
    masks: list[np.ndarray],
    views: StackedViews,
    images: list[np.ndarray],
    normals: np.ndarray,
    unclipped: np.ndarray,
    stored: StoredTransfer,
) -> Solved:
    """`mode: transfer`, by either kind of light."""
    import numpy as np

    from stages.geometry.pixel_blends import pixels_on_proxy
    from stages.photometry import transfer_solutions
    from stages.photometry.light_search import REFINED
    from stages.photometry.sky_photos import TURNS, Looks
    from stages.photometry.sky_scenes import sky_scenes
    from stages.scene.meshes import read_mesh
    from stages.scene.view_files import read_surface_points, ways_to_cameras

    settings: DecompositionSettings = job.settings
    points = read_surface_points(job.inputs, cameras, masks)
    blend = pixels_on_proxy(stored, read_mesh(job.inputs["mesh"]), points)
    weights = _weights(job, views)
    towards = ways_to_cameras(cameras, masks)
    incidence = np.einsum("nk,nk->n", normals, towards)
    if settings.light == "harmonics":
        trusted = np.ones_like(unclipped)  # Eq. 2 as it stands: all data count
        transfer = _pixel_transfer(job, stored, blend, normals)
        with job.progress("rounds", settings.stopping.rounds) as step:
            solved = transfer_solutions.by_transfer(
                views, images, transfer, as_transfer(settings, weights), job.threads, step
            )
    else:
        trusted = unclipped & (incidence > GRAZING)
        _tell_clipped(job, int(np.count_nonzero(~unclipped)), len(unclipped))
        scenes, opposed = sky_scenes(stored, blend, normals, _eyes(job, stored))
        _tell_opposed(job, opposed, len(normals))
        looks = Looks(trusted, towards)
        how = as_sky(settings, weights, views.side)
        steps = len(how.light.scales) * len(scenes) + TURNS + REFINED + 2 * settings.stopping.rounds
        with job.progress("steps", steps) as step:
            solved = transfer_solutions.by_sky(views, images, scenes, looks, how, job.threads, step)
        _note_light(job, stored, solved.sky)
        trusted &= solved.sky.trusted  # where none was, all had to do: their albedo is a guess
    job.note(untrusted_pixels=int(np.count_nonzero(~trusted)))
    return solved.judged(views, images, incidence, trusted)


def _eyes(job: Job, stored: StoredTransfer) -> Eyes:
    """Of the proxy's vertices, and the proxy in their way."""
    from stages.geometry.occluders import Occluders
    from stages.photometry.sky import Eyes
    from stages.scene.meshes import Surface

    proxy = Occluders(Surface(stored.vertices, stored.faces), job.threads)
    return Eyes(stored.eyes - proxy.origin, stored.normals, proxy.blocked, proxy.origin, job.executor)


def _note_light(job: Job, stored: StoredTransfer, sky: SkySolution) -> None:
    """What was found out about the light, and by what."""
    import numpy as np

    distance = stored.radii[sky.scene]
    job.note(
        light_distance=float(distance) if np.isfinite(distance) else "infinitely far",
        disagreement=dict(zip(map(str, stored.radii.tolist()), sky.disagreements, strict=True)),
        directions=len(sky.directions),
        lights=int(sky.light_of_view.max()) + 1,
        spread_between_views=round(sky.gains.spread, 4),
        brightening_between_views=round(sky.brightening, 3),
        sheen=[sky.sheen.as_json()] if sky.sheen else [],
    )


def _weights(job: Job, views: StackedViews) -> EnergyWeights:
    """λ and μ at the size of the views, noted."""
    weights = weights_at(job.settings, views.side, views.links_per_pixel)
    job.note(weights={"lambda": weights.smoothness, "mu": weights.consistency})
    return weights


def _unclipped(pixels: np.ndarray) -> np.ndarray:
    """Pixels of a view that no channel of its photo has clipped; a linear image beyond 1 has no white."""
    import numpy as np

    if pixels.max(initial=0.0) > 1.0001:
        return np.ones(len(pixels), bool)
    return (pixels < SATURATED).all(axis=1)


def _pixel_transfer(
    job: Job, stored: StoredTransfer, blend: sp.csr_array, normals: np.ndarray
) -> PixelTransfer:
    """What the masked pixels see, in harmonics."""
    from stages.photometry.pixel_transfer import PixelTransfer
    from stages.photometry.sky_scenes import proxy_in

    degree = int(given_or(job.settings.degree, stored.blocked.shape[1] ** 0.5 - 1))
    transfer, opposed = PixelTransfer.of(normals, blend, proxy_in(stored), degree)
    _tell_opposed(job, opposed, len(normals))
    return transfer


def _tell_clipped(job: Job, clipped: int, pixels: int) -> None:
    if 2 * clipped > pixels:
        job.warn(
            f"{clipped} of {pixels} pixels are white in a channel of their photo (from {SATURATED:.0%} on); "
            "expected few: their albedo is a guess. Develop the photos darker, or give them as EXR."
        )


def _tell_opposed(job: Job, opposed: int, pixels: int) -> None:
    job.note(opposed_pixels=opposed)
    if 2 * opposed > pixels:
        job.warn(
            f"{opposed} of {pixels} pixels see the back of the mesh; they count as seeing the whole sky. "
            "Turn the mesh's faces outwards if it is inside out; if the cameras are inside it, its scale or "
            "frame is not theirs."
        )


def _write_maps(
    job: Job, cameras: list[Camera], masks: list[np.ndarray], solved: Solved, scale: float
) -> None:
    """Albedo in the images' own units, and the shading as it is; the light, where it is harmonics."""
    from stages.scene.lighting_file import write_lighting
    from stages.scene.view_files import write_maps

    albedo = solved.albedo * scale
    write_maps(job.outputs["albedo"], cameras, masks, albedo, job.executor.map)
    write_maps(job.outputs["shading"], cameras, masks, solved.shading, job.executor.map)
    if solved.sky is None:
        by_transfer = job.settings.mode == "transfer"
        write_lighting(job.outputs["lighting"], cameras, solved.light, scale, by_transfer)
    job.note(
        pixels=len(albedo),
        links=solved.views.link_count,
        negative_shading={c: int((solved.shading[:, k] < 0).sum()) for k, c in enumerate(CHANNELS)},
        negative_albedo={c: int((albedo[:, k] < 0).sum()) for k, c in enumerate(CHANNELS)},
    )


def _write_what_transfer_knows(
    job: Job,
    cameras: list[Camera],
    masks: list[np.ndarray],
    solved: Solved,
    scale: float,
    stored: StoredTransfer,
) -> None:
    """Eq. 2's own albedo, the confidence, and the light as pictures of all directions."""
    from stages.photometry.environment import picture_of_light
    from stages.scene.lighting_file import LightAround, write_light_around
    from stages.scene.upright import upright_from_world
    from stages.scene.view_files import write_maps, write_pictures_of_light

    write_maps(job.outputs["albedo_tv"], cameras, masks, solved.albedo_tv * scale, job.executor.map)
    write_maps(job.outputs["confidence"], cameras, masks, solved.confidence, job.executor.map)
    names = [camera.name for camera in cameras]
    if solved.sky is None:
        (directions, lights), cells = solved.sampled_light(), None
    else:
        sky = solved.sky
        directions, cells, lights = sky.directions, sky.cells, sky.light.radiance
        sphere = stored.centre, float(stored.radii[sky.scene])
        light = LightAround(directions, cells, lights, sky.light_of_view, sky.gains.gains, *sphere)
        write_light_around(job.outputs["lighting"], cameras, light, scale)
        names = names if len(lights) > 1 else ["shared"]
    upright = directions @ upright_from_world(cameras).T
    pictures = {name: picture_of_light(upright, one, cells) for name, one in zip(names, lights, strict=True)}
    write_pictures_of_light(job.outputs["light_pictures"], pictures)


def _write_history(job: Job, solved: Solved) -> None:
    """`energy.json`; what did not converge is said."""
    from stages.photometry.alternation import Outcome
    from stages.photometry.energy_history import LEGEND, UNDER_LIGHT

    content = {
        "legend": LEGEND if solved.sky is None else UNDER_LIGHT,
        "settings": job.settings.model_dump(by_alias=True),
        "channels": dict(zip(CHANNELS, solved.histories, strict=True)),
    }
    job.outputs["energy"].write_text(json_text(content, indent=1) + "\n", encoding="utf-8")
    steps = [history["alternations"] for history in solved.histories]
    job.note(
        energy=sum(history[-1]["energy"] for history in steps),
        alternations=[len(history) for history in steps],
        cg_steps=[sum(one.get("cg_steps", 0) for one in history) for history in steps],
        outcomes=[outcome.name.lower() for outcome in solved.outcomes],
    )
    if job.settings.mode == "transfer":  # its channels are solved together
        told = {"All channels": solved.outcomes[0]}
    else:
        told = {
            f"The {name} channel": outcome for name, outcome in zip(CHANNELS, solved.outcomes, strict=True)
        }
    for which, outcome in told.items():
        if outcome is not Outcome.CONVERGED:
            job.warn(f"{which}: {outcome.value}.")


DECOMPOSITION = Stage(
    name="decomposition",
    version=18,
    about="Albedo, shading and light of each view, from all views together.",
    settings=DecompositionSettings,
    takes=("linear", "normal", "mask", "cameras", "correspondences"),
    gives=(
        Artefact("albedo", "albedo per view, EXR, linear, 0 outside the mask", output="albedo"),
        Artefact(
            "shading",
            "shading per view, EXR, linear: image = albedo × shading, but for gloss",
            output="shading",
        ),
        Artefact("lighting", "light per view and channel", file="lighting.json", output="lighting.json"),
        Artefact("energy", "energy per alternation", file="energy.json", output="energy.json"),
    ),
    run=run,
    tools=("numpy", "scipy", "numba", "llvmlite", *OPEN3D, *PICTURES),
)

# The same stage in `mode: transfer`: it takes what that mode stands on, and gives what only that mode knows.
DECOMPOSITION_BY_TRANSFER = replace(
    DECOMPOSITION,
    version=DECOMPOSITION.version + 20,  # ahead of it by what only this mode has learned
    takes=(*DECOMPOSITION.takes, "mesh", "triangles", "transfer"),
    gives=(
        *DECOMPOSITION.gives,
        Artefact("albedo_tv", "Eq. 2's own albedo under the same light, EXR, linear", output="albedo_tv"),
        Artefact("confidence", "how well each pixel is known, 0 to 1, EXR", output="confidence"),
        Artefact("light_pictures", "the light from all directions, EXR and PNG", output="environment"),
    ),
)
