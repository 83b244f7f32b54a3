"""The methods compared: the image itself, cartoon-texture, `mode: paper`, the same energy solved well."""

from __future__ import annotations

import json
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from benchmarks.cartoon.cartoon_texture import cartoon_texture
from benchmarks.cartoon.primal_dual import CartoonSettings
from benchmarks.paper.judging import Judge, Maps, maps_in
from benchmarks.paper.laboratory import Laboratory, Weights
from benchmarks.paper.rows import Row
from stages.evaluation.scores import Scores

# The same energy by the other solver, far beyond the paper's stopping rule.
SOLVED_WELL = {"solver": "fast", "fast": {"tolerance": 3e-4, "gap": 0.02, "max_rounds": 40}}


@dataclass(frozen=True, eq=False)
class Estimate:
    """A method's estimate of a row.

    Attributes
    ----------
    method : str
    settings : str
        λ and μ as text.
    albedo : dict of str to ndarray
    scores : Scores
    energies : dict or None
        Per channel: energy in the gauge, alternations, outcome.
    light : list or None
        `lighting.json`'s views.
    """

    method: str
    settings: str
    albedo: Maps
    scores: Scores
    energies: dict[str, dict[str, Any]] | None = None
    light: list[dict[str, Any]] | None = None


def image_itself(judge: Judge) -> Estimate:
    """Use the image as its albedo."""
    return Estimate("the image itself", "", judge.images, judge.scores(judge.images))


def cartoon(judge: Judge, fidelity: float, threads: int) -> Estimate:
    """Run cartoon-texture with a given λ (per pixel)."""
    with ThreadPoolExecutor(threads) as executor:
        cartoons = cartoon_texture(
            [judge.images[name] for name in judge.names],
            [judge.masks[name] for name in judge.names],
            CartoonSettings(fidelity),
            executor,
        )
    albedo = dict(zip(judge.names, cartoons.albedos, strict=True))
    return Estimate("cartoon-texture", f"λ = {fidelity:g}", albedo, judge.scores(albedo))


def paper(
    laboratory: Laboratory, row: Row, judge: Judge, weights: Weights, solved_well: bool = False
) -> Estimate:
    """Run `mode: paper`, stopped by the paper's rule, or solve the same energy well."""
    results = laboratory.decompose(row, weights, mode="paper", **(SOLVED_WELL if solved_well else {}))
    albedo = maps_in(results.paths["albedo"], judge.names)
    channels = results.energy()["channels"]
    return Estimate(
        "mode: paper, solved well" if solved_well else "mode: paper",
        f"λ = {weights.smoothness * row.lambda_factor:g}, μ = {weights.agreement:g}",
        albedo,
        judge.scores(albedo),
        {
            name: {
                "energy": channel["alternations"][-1]["energy"],
                "alternations": len(channel["alternations"]),
                "outcome": channel["outcome"],
            }
            for name, channel in channels.items()
        },
        _read_light(results.paths["lighting"]),
    )


def _read_light(path: Path) -> list[dict[str, Any]]:
    return json.loads(path.read_text(encoding="utf-8"))["views"]


def mean_error(scores: Scores) -> float:
    """Compute the mean si-RMSE of the channels, by which λ and μ are chosen.

    The variance cannot serve for this: a constant albedo, which a large λ gives, has none in any part.
    """
    return float(np.mean(scores.si_rmse))
