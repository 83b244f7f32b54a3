"""Albedo, shading and light of every view (Eq. 1–4, 9–18), channel by channel: the core of the paper."""

from __future__ import annotations

import json
from dataclasses import replace
from typing import TYPE_CHECKING, Literal

from pipeline import Artefact, Job, Settings, Stage, UserError, setting

if TYPE_CHECKING:
    import numpy as np

    from stages.photometry.alternation import AlternationSettings
    from stages.photometry.fast_alternation import FastSettings
    from stages.photometry.pixel_transfer import PixelTransfer
    from stages.photometry.solutions import Solved
    from stages.photometry.stack import StackedViews
    from stages.photometry.transfer_alternation import TransferAlternation
    from stages.scene.cameras import Camera

CHANNELS = ("red", "green", "blue")
GAPS = {"paper": 0.03, "transfer": 0.08}  # where none is set


class DecompositionSettings(Settings):
    """Settings of the `decomposition` stage."""

    mode: Literal["paper", "transfer"] = setting(
        "paper",
        "paper: nine harmonics of the normal per view and channel, channels apart, as the paper has it. "
        "transfer: the same energy, but every point knows what of the sky it sees, and what other surface "
        "sends on to it.",
    )
    solver: Literal["paper", "fast"] | None = setting(
        None,
        "paper: assembled normal equations, conjugate gradients, Jacobi as the only preconditioner. fast: "
        "the same energy by a primal-dual scheme on the graph of pixels, lower and sooner. none: paper in "
        "`mode: paper`, else fast.",
    )
    degree: int | None = setting(
        None,
        "`mode: transfer`: the light's harmonics up to this degree l; none: all that `transfer` has.",
        ge=1,
        le=6,
    )
    bounces: int = setting(
        4,
        "`mode: transfer`: how often light is passed on between surfaces; 0: not at all.",
        ge=0,
        le=100,
    )
    brightest: float = setting(
        0.8,
        "`mode: transfer`: what the brightest material is taken to reflect, since images do not tell; it "
        "says how much light bounces.",
        gt=0,
        le=0.95,
    )
    lambda_: float = setting(
        1.0,
        "Weight of the albedo's smoothness (λ of Eq. 2). More takes shading out of the albedo, then paint: "
        "on a bust in four uniform colours 5 beats 2 a little, on a speckled one 1 erases speckles already. "
        "Provisional: to be replaced by the best of a grid on the scene of Fig. 3.",
        name="lambda",
        ge=0,
        le=1e6,
    )
    mu: float = setting(
        1.0,
        "Weight of the agreement between views (μ of Eq. 2). Provisional, as `lambda` is.",
        ge=0,
        le=1e6,
    )
    delta: float = setting(
        1e-4,
        "Residuals below this count as fitted (δ of Eq. 12, the paper's value).",
        unit="of the images' 99th percentile",
        gt=0,
        le=1,
    )
    cg_tolerance: float = setting(
        1e-6,
        "Relative residual at which the albedo's linear system counts as solved. The paper names none; at "
        "1e-2 the energy stands still far too high and passes for converged.",
        gt=0,
        lt=1,
    )
    cg_max_steps: int = setting(
        1000, "Steps of conjugate gradients at most; some hundreds are usual.", unit="steps", ge=1
    )
    max_alternations: int = setting(
        50, "Alternations of light and albedo at most, as in the paper.", unit="alternations", ge=1
    )
    energy_tolerance: float = setting(
        1e-3, "Relative change of the energy to stop at, as in the paper.", ge=0, lt=1
    )
    fast_tolerance: float = setting(
        1e-3,
        "Relative energy that `solver: fast` may still gain to be done, estimated from what the last two "
        "doublings of its iterations have gained.",
        ge=0,
        lt=1,
    )
    fast_gap: float | None = setting(
        None,
        "And how far, relative to the energy, the albedo may then be from the best one of its range under "
        "its light: a bound from the dual problem, several times what is really missing. none: 0.03, or 0.08 "
        "in `mode: transfer`, whose light leaves more pixels nearly dark and the bound looser.",
        gt=0,
        le=1,
    )
    fast_max_rounds: int = setting(
        100, "Rounds of `solver: fast` at most; some ten to twenty are usual.", unit="rounds", ge=1
    )


def check_mode(settings: DecompositionSettings) -> None:
    """Refuse a solver that does not know the mode's light.

    Raises
    ------
    UserError
        It does not.
    """
    if settings.mode == "transfer" and settings.solver == "paper":
        raise UserError(
            "decomposition.solver is paper and decomposition.mode transfer; the paper's solver knows the "
            "paper's light only. Leave the solver out, or set the mode to paper."
        )


def run(job: Job) -> None:
    """Open the views, decompose the channels side by side, save albedo, shading, light and history.

    Memory: `solver: fast` some 550 B per masked pixel, all channels together, and 800 B more in
    `mode: transfer`; `solver: paper` about 500 B for what the channels share, 500 B more for each at work.
    """
    import numpy as np

    from stages.photometry.stack import stack_views
    from stages.scene.camera_file import read_cameras
    from stages.scene.link_files import numbered_links
    from stages.scene.view_files import read_views, scaled_channels

    settings: DecompositionSettings = job.settings
    cameras = read_cameras(job.inputs["cameras"])
    masks, normals, pixels = [], [], []
    with job.progress("views", len(cameras)) as step:
        for mask, normal, linear in read_views(job.inputs, cameras):
            masks.append(mask)
            normals.append(normal)
            pixels.append(linear)
            step()
    views = stack_views(masks, normals, numbered_links(job.inputs["correspondences"], cameras))
    by_transfer = settings.mode == "transfer"
    transfer = _pixel_transfer(job, settings, cameras, masks, normals) if by_transfer else None
    del normals  # the stack has its own
    images, scale = scaled_channels(np.concatenate(pixels))
    del pixels
    solved = _solve(job, settings, views, images, transfer)
    _write_maps(job, cameras, masks, solved, scale)
    _write_history(job, settings, solved)


def _solve(
    job: Job,
    settings: DecompositionSettings,
    views: StackedViews,
    images: list[np.ndarray],
    transfer: PixelTransfer | None,
) -> Solved:
    """By the mode and the solver that were asked for."""
    from stages.photometry import solutions

    if transfer is not None:
        with job.progress("rounds", settings.fast_max_rounds) as step:
            return solutions.by_transfer(
                views, images, transfer, _transfer_alternation(settings), job.threads, step
            )
    if settings.solver == "fast":
        with job.progress("rounds", settings.fast_max_rounds) as step:
            return solutions.fast(views, images, _fast(settings), job.threads, step)
    with job.progress("alternations", 3 * settings.max_alternations) as step:
        return solutions.as_the_paper(views, images, _alternation(settings), job.executor, step)


def _pixel_transfer(
    job: Job,
    settings: DecompositionSettings,
    cameras: list[Camera],
    masks: list[np.ndarray],
    normals: list[np.ndarray],
) -> PixelTransfer:
    """What the masked pixels see, from the transfer of the mesh."""
    import numpy as np

    from stages.photometry.pixel_transfer import PixelTransfer, blend_of_pixels
    from stages.photometry.transfer import Occlusion
    from stages.scene.meshes import read_mesh
    from stages.scene.transfer_file import read_transfer
    from stages.scene.view_files import read_surface_points

    stored, faces = read_transfer(job.inputs["transfer"]), read_mesh(job.inputs["mesh"]).faces
    known = int(stored.blocked.shape[1] ** 0.5) - 1
    degree = known if settings.degree is None else settings.degree
    if degree > known:
        raise UserError(
            f"decomposition.degree is {degree}, but the transfer vectors end at {known}; raise "
            "transfer.degree or lower decomposition.degree."
        )
    points = read_surface_points(job.inputs, cameras, masks)
    blend = blend_of_pixels(*points, faces, stored.corners, stored.weights, len(stored.blocked))
    seen = Occlusion(stored.blocked, stored.form_factors, stored.behind)
    own = np.concatenate([image[mask] for image, mask in zip(normals, masks, strict=True)])
    transfer, opposed = PixelTransfer.of(own, blend, seen, stored.normals, degree)
    job.note(opposed_pixels=opposed)
    if 2 * opposed > len(own):
        job.warn(
            f"{opposed} of {len(own)} pixels see the back of the mesh; they count as seeing the whole sky. "
            "Turn the mesh's faces outwards if it is inside out."
        )
    return transfer


def _transfer_alternation(settings: DecompositionSettings) -> TransferAlternation:
    from stages.photometry.pixel_transfer import Bounces
    from stages.photometry.transfer_alternation import TransferAlternation

    return TransferAlternation(_fast(settings), Bounces(settings.bounces, settings.brightest))


def _fast(settings: DecompositionSettings) -> FastSettings:
    from stages.photometry.energy import EnergyWeights
    from stages.photometry.fast_alternation import FastSettings

    return FastSettings(
        weights=EnergyWeights(settings.lambda_, settings.mu, settings.delta),
        tolerance=settings.fast_tolerance,
        gap_tolerance=settings.fast_gap or GAPS[settings.mode],
        max_rounds=settings.fast_max_rounds,
    )


def _alternation(settings: DecompositionSettings) -> AlternationSettings:
    from stages.photometry.alternation import AlternationSettings
    from stages.photometry.energy import EnergyWeights

    return AlternationSettings(
        weights=EnergyWeights(settings.lambda_, settings.mu, settings.delta),
        max_alternations=settings.max_alternations,
        energy_tolerance=settings.energy_tolerance,
        cg_tolerance=settings.cg_tolerance,
        cg_max_steps=settings.cg_max_steps,
    )


def _write_maps(
    job: Job,
    cameras: list[Camera],
    masks: list[np.ndarray],
    solved: Solved,
    scale: float,
) -> None:
    """Albedo in the images' own units, shading σ·ν as it is, and the light."""
    from stages.photometry.stack import unstack_pixels
    from stages.scene.exr import write_exr
    from stages.scene.lighting_file import write_lighting

    albedo, shading = solved.albedo * scale, solved.shading()
    for name, stacked in (("albedo", albedo), ("shading", shading)):
        for camera, image in zip(cameras, unstack_pixels(masks, stacked), strict=True):
            write_exr(job.outputs[name] / f"{camera.name}.exr", image)
    write_lighting(job.outputs["lighting"], cameras, solved.light, scale, job.settings.mode == "transfer")
    job.note(
        pixels=len(albedo),
        links=solved.views.link_count,
        negative_shading={c: int((shading[:, k] < 0).sum()) for k, c in enumerate(CHANNELS)},
        negative_albedo={c: int((albedo[:, k] < 0).sum()) for k, c in enumerate(CHANNELS)},
    )


def _write_history(job: Job, settings: DecompositionSettings, solved: Solved) -> None:
    """`energy.json`; what did not converge is said."""
    from stages.photometry.alternation import Outcome
    from stages.photometry.energy_history import LEGEND

    content = {
        "legend": LEGEND,
        "settings": settings.model_dump(by_alias=True),
        "channels": dict(zip(CHANNELS, solved.histories, strict=True)),
    }
    job.outputs["energy"].write_text(json.dumps(content, indent=1) + "\n", encoding="utf-8")
    steps = [history["alternations"] for history in solved.histories]
    job.note(
        energy=sum(history[-1]["energy"] for history in steps),
        alternations=[len(history) for history in steps],
        cg_steps=[sum(one.get("cg_steps", 0) for one in history) for history in steps],
        outcomes=[outcome.name.lower() for outcome in solved.outcomes],
    )
    for name, outcome in zip(CHANNELS, solved.outcomes, strict=True):
        if outcome is not Outcome.CONVERGED:
            job.warn(f"The {name} channel: {outcome.value}.")


DECOMPOSITION = Stage(
    name="decomposition",
    version=4,
    about="Albedo, shading and light of each view, from all views together.",
    settings=DecompositionSettings,
    takes=("linear", "normal", "mask", "cameras", "correspondences"),
    gives=(
        Artefact("albedo", "albedo per view, EXR, linear, 0 outside the mask", output="albedo"),
        Artefact("shading", "shading per view, EXR, linear: image = albedo × shading", output="shading"),
        Artefact("lighting", "light per view and channel", file="lighting.json", output="lighting.json"),
        Artefact("energy", "energy per alternation", file="energy.json", output="energy.json"),
    ),
    run=run,
    tools=("numpy", "scipy", "numba", "opencv-python-headless"),
)

# The same stage in `mode: transfer`: it takes what that mode stands on, which the paper does not need.
DECOMPOSITION_BY_TRANSFER = replace(
    DECOMPOSITION, takes=(*DECOMPOSITION.takes, "mesh", "triangles", "transfer")
)
