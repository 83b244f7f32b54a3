"""What every kind of decomposition leaves: maps of the albedo, `energy.json`, notes and warnings."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

from pipeline import Artefact, Job, json_text, settings_that_matter
from stages.photometry.decomposition_settings import IGNORED, DecompositionSettings

if TYPE_CHECKING:
    import numpy as np

    from stages.photometry.paper.alternation import Outcome
    from stages.photometry.solutions import Solved
    from stages.scene.cameras import Camera

CHANNELS = ("red", "green", "blue")
ALBEDO = Artefact("albedo", "albedo per view, EXR, linear, 0 outside the mask", output="albedo")
ENERGY = Artefact("energy", "energy per alternation", file="energy.json", output="energy.json")
OF_TRANSFER = (
    Artefact("albedo_tv", "Eq. 2's own albedo under the same light, EXR, linear", output="albedo_tv"),
    Artefact("confidence", "how well each pixel is known, 0 to 1, EXR", output="confidence"),
)


@dataclass(frozen=True)
class Solution:
    """Record of the solution of a cluster under a given light.

    Attributes
    ----------
    views : list of str
        Names of the views that see its part of the surface.
    pixels, pixels_with_margin, links : int
        Its own pixels; those and the pixels of its margin; correspondences among these.
    negative_shading, negative_albedo : dict of str to int
        Pixels below 0, per channel.
    histories : list of dict
        Per channel, for `energy.json`; the margin included.
    outcomes : list of Outcome
        Per channel.
    """

    views: list[str]
    pixels: int
    pixels_with_margin: int
    links: int
    negative_shading: dict[str, int]
    negative_albedo: dict[str, int]
    histories: list[dict[str, Any]]
    outcomes: list[Outcome]


def below_zero(values: np.ndarray) -> dict[str, int]:
    """Count the values below 0 per channel, of (N, 3)."""
    return {channel: int((values[:, k] < 0).sum()) for k, channel in enumerate(CHANNELS)}


def write_albedo(
    job: Job[DecompositionSettings],
    cameras: list[Camera],
    masks: list[np.ndarray],
    solved: Solved,
    scale: float,
) -> None:
    """Write the albedo in the images' own units, the minimiser of Eq. 2 and the confidence, if present.

    `scale`: the images' unit over that of the shading.
    """
    from stages.formats.artefacts.view_files import write_maps

    maps: dict[str, Any] = {"albedo": solved.albedo * scale}
    if solved.albedo_tv is not None:
        maps |= {"albedo_tv": solved.albedo_tv * scale, "confidence": solved.confidence}
    for name, stacked in maps.items():
        write_maps(job.outputs[name], cameras, masks, stacked, job.executor.map)
    job.note(
        pixels=len(solved.albedo),
        links=solved.views.correspondence_count,
        negative_shading=below_zero(solved.shading),
        negative_albedo=below_zero(maps["albedo"]),
    )


def write_history(job: Job[DecompositionSettings], solved: Solved) -> None:
    """Write `energy.json` of light and albedo together; warn of channels that did not converge."""
    from stages.photometry.energy_history import LEGEND

    channels = dict(zip(CHANNELS, solved.histories, strict=True))
    _write_energy(job, LEGEND, {"channels": channels})
    _note_descents(job, [solved.histories], [solved.outcomes])
    if job.settings.mode == "transfer":  # its channels are solved together
        _warn_unless_converged(job, {"All channels": solved.outcomes[0]})
    else:
        names = (f"The {name} channel" for name in CHANNELS)
        _warn_unless_converged(job, dict(zip(names, solved.outcomes, strict=True)))


def write_solutions(job: Job[DecompositionSettings], solutions: Sequence[Solution]) -> None:
    """Write `energy.json` of all clusters under a given light; warn of those that did not converge."""
    from stages.photometry.energy_history import UNDER_LIGHT

    histories = [dict(zip(CHANNELS, one.histories, strict=True)) for one in solutions]
    if len(solutions) == 1:
        _write_energy(job, UNDER_LIGHT, {"channels": histories[0]})
    else:
        clusters = [
            {"views": one.views, "channels": own} for one, own in zip(solutions, histories, strict=True)
        ]
        _write_energy(job, UNDER_LIGHT, {"clusters": clusters})
    _note_descents(job, [one.histories for one in solutions], [one.outcomes for one in solutions])
    job.note(
        pixels=sum(one.pixels for one in solutions),
        links=sum(one.links for one in solutions),
        negative_shading={c: sum(one.negative_shading[c] for one in solutions) for c in CHANNELS},
        negative_albedo={c: sum(one.negative_albedo[c] for one in solutions) for c in CHANNELS},
    )
    if len(solutions) == 1:
        _warn_unless_converged(job, {"All channels": solutions[0].outcomes[0]})
    else:
        names = (f"Cluster {number} of {len(solutions)}" for number in range(1, len(solutions) + 1))
        _warn_unless_converged(
            job, {name: one.outcomes[0] for name, one in zip(names, solutions, strict=True)}
        )


def _write_energy(job: Job[DecompositionSettings], legend: dict[str, str], content: dict[str, Any]) -> None:
    settings = settings_that_matter(job.settings, IGNORED[job.settings.kind_of_light])
    whole = {"legend": legend, "settings": settings, **content}
    job.outputs["energy"].write_text(json_text(whole, indent=1) + "\n", encoding="utf-8")


def _note_descents(
    job: Job[DecompositionSettings], histories: list[list[dict[str, Any]]], outcomes: list[list[Outcome]]
) -> None:
    """Note energies, steps and outcomes: per channel and, of several, cluster by cluster."""
    steps = [history["alternations"] for own in histories for history in own]
    job.note(
        energy=sum(history[-1]["energy"] for history in steps),
        alternations=[len(history) for history in steps],
        cg_steps=[sum(one.get("cg_steps", 0) for one in history) for history in steps],
        outcomes=[outcome.name.lower() for own in outcomes for outcome in own],
    )


def _warn_unless_converged(job: Job[DecompositionSettings], outcomes: dict[str, Outcome]) -> None:
    from stages.photometry.paper.alternation import Outcome

    for which, outcome in outcomes.items():
        if outcome is not Outcome.CONVERGED:
            job.warn(f"{which}: {outcome.value}.")
