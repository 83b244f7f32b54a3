"""Albedo, shading and light of every view (Eq. 1–4, 9–18), channel by channel: the core of the paper."""

from __future__ import annotations

import json
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, Literal

from pipeline import Artefact, Job, Settings, Stage, setting

if TYPE_CHECKING:
    import numpy as np

    from stages.photometry.alternation import AlternationSettings, Outcome
    from stages.photometry.fast_alternation import FastSettings
    from stages.photometry.stack import StackedViews
    from stages.scene.cameras import Camera

CHANNELS = ("red", "green", "blue")


class DecompositionSettings(Settings):
    """Settings of the `decomposition` stage."""

    mode: Literal["paper"] = setting(
        "paper",
        "paper: nine harmonics of the normal per view and channel, channels apart, as the paper has it.",
    )
    solver: Literal["paper", "fast"] = setting(
        "paper",
        "paper: assembled normal equations, conjugate gradients, Jacobi as the only preconditioner. fast: "
        "the same energy by a primal-dual scheme on the graph of pixels, lower and sooner.",
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
        2e-3,
        "What the second half of its iterations may have gained of the energy for `solver: fast` to be done: "
        "more than further ones would, since its error falls at least as one over their number.",
        ge=0,
        lt=1,
    )
    fast_gap: float = setting(
        0.03,
        "And how far, relative to the energy, the albedo may then be from the best one under its light: a "
        "bound from the dual problem, several times what is really missing.",
        gt=0,
        le=1,
    )
    fast_max_rounds: int = setting(
        100, "Rounds of `solver: fast` at most; some ten to twenty are usual.", unit="rounds", ge=1
    )


def run(job: Job) -> None:
    """Open the views, decompose the channels side by side, save albedo, shading, light and history.

    Memory: `solver: fast` some 550 B per masked pixel, all channels together; `solver: paper` about 500 B for
    what the channels share, 500 B more for each one at work.
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
    del normals  # the stack has its own
    images, scale = scaled_channels(np.concatenate(pixels))
    del pixels
    solve = _solve_fast if settings.solver == "fast" else _solve_as_the_paper
    solved = solve(job, settings, views, images)
    _write_maps(job, cameras, masks, views, solved, scale)
    _write_history(job, settings, solved)


@dataclass(frozen=True, eq=False)
class Solved:
    """What a solver gives.

    Attributes
    ----------
    albedo : ndarray, shape (N, 3)
        In the unit of the scaled images.
    light : ndarray, shape (n, 3, 9)
    histories : list of dict
        Per channel, for `energy.json`.
    outcomes : list of Outcome
        Per channel.
    """

    albedo: np.ndarray
    light: np.ndarray
    histories: list[dict[str, Any]]
    outcomes: list[Outcome]


def _solve_fast(
    job: Job, settings: DecompositionSettings, views: StackedViews, images: list[np.ndarray]
) -> Solved:
    from stages.photometry.energy_history import rounds_as_json
    from stages.photometry.fast_alternation import solve

    how = _fast(settings)
    with job.progress("rounds", how.max_rounds) as step:
        descent = solve(views, images, how, job.threads, step)
    histories = rounds_as_json(descent, how.weights)
    return Solved(descent.albedo, descent.light, histories, [descent.outcome] * len(images))


def _solve_as_the_paper(
    job: Job, settings: DecompositionSettings, views: StackedViews, images: list[np.ndarray]
) -> Solved:
    import numpy as np

    from stages.photometry.alternation import decompose_channels
    from stages.photometry.energy_history import descent_as_json

    with job.progress("alternations", 3 * settings.max_alternations) as step:
        exact = [image.astype(np.float64) for image in images]
        descents = decompose_channels(views, exact, _alternation(settings), job.executor, step)
    return Solved(
        albedo=np.stack([descent.state.albedo for descent in descents], axis=-1),
        light=np.stack([descent.state.light for descent in descents], axis=1),
        histories=[descent_as_json(descent) for descent in descents],
        outcomes=[descent.outcome for descent in descents],
    )


def _fast(settings: DecompositionSettings) -> FastSettings:
    from stages.photometry.energy import EnergyWeights
    from stages.photometry.fast_alternation import FastSettings

    return FastSettings(
        weights=EnergyWeights(settings.lambda_, settings.mu, settings.delta),
        tolerance=settings.fast_tolerance,
        gap_tolerance=settings.fast_gap,
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
    views: StackedViews,
    solved: Solved,
    scale: float,
) -> None:
    """Albedo in the images' own units, shading σ·ν as it is, and the light."""
    import numpy as np

    from stages.photometry.stack import unstack_pixels
    from stages.scene.exr import write_exr
    from stages.scene.lighting_file import write_lighting

    albedo, light = solved.albedo * scale, solved.light
    shading = np.stack([views.shading(light[:, k]) for k in range(3)], axis=-1)
    for name, stacked in (("albedo", albedo), ("shading", shading)):
        for camera, image in zip(cameras, unstack_pixels(masks, stacked), strict=True):
            write_exr(job.outputs[name] / f"{camera.name}.exr", image)
    write_lighting(job.outputs["lighting"], cameras, light, scale)
    job.note(
        pixels=len(albedo),
        links=views.link_count,
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
