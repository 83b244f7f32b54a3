"""The methods compared, each with its own defaults on every scene, and ours with parts left out."""

from __future__ import annotations

import time
from collections.abc import Sequence
from dataclasses import asdict, dataclass, field
from typing import Any

import numpy as np

from benchmarks.accuracy.reliability import Reliability
from benchmarks.paper.judging import Judge, Maps, maps_in
from benchmarks.paper.laboratory import Laboratory
from benchmarks.paper.methods import SOLVED_WELL, Estimate, cartoon
from benchmarks.paper.pictures import figure
from benchmarks.paper.rows import Row
from pipeline.files.json_text import finite_or_null
from stages.evaluation.scores import Scores
from stages.photometry.decomposition_settings import DecompositionSettings
from stages.photometry.solver_settings import weights_at

CARTOON_FIDELITY = 0.05  # the best of its grid on Fig. 3 at this size (docs/paper)


@dataclass(frozen=True)
class Method:
    """A name, and settings of the decomposition and the lighting that differ from their defaults.

    `settings` are the decomposition's: None where it is not run.
    """

    name: str
    settings: dict[str, Any] | None = None
    artefact: str = "albedo"
    lighting: dict[str, Any] = field(default_factory=dict)


def _ours(name: str, artefact: str = "albedo", lighting: dict[str, Any] | None = None, **settings: Any):
    return Method(name, {"mode": "transfer", **settings}, artefact, lighting or {})


PAPER = Method("mode: paper", {"mode": "paper"})
WELL = Method("mode: paper, solved well", {"mode": "paper", **SOLVED_WELL})
OURS = _ours("mode: transfer")
IMAGE = Method("the image itself")
METHODS = (IMAGE, Method("cartoon-texture"), PAPER, WELL, OURS)
ABLATIONS = (
    _ours("albedo_tv", artefact="albedo_tv"),
    _ours("light: harmonics", light="harmonics"),
    _ours("no bounces", lighting={"bounces": 0}),
    _ours("no specular", lighting={"specular": {"remove": False}}),
    _ours("one light per view", lighting={"lights": "per-view"}),
    _ours("channels apart", lighting={"neutrality": 0.0}),
    _ours("no evenness", lighting={"evenness": 0.0}),
    _ours("any change of colour is paint", edges={"chroma_step": 1e-3}),
    _ours("hardly any λ", edges={"coarse_lambda": 0.3}),
)


@dataclass(frozen=True, eq=False)
class Judged:
    """A method's result on a row: scores, seconds, record, and reliability of its confidence."""

    method: str
    scores: Scores
    seconds: float
    facts: dict[str, Any] = field(default_factory=dict)
    reliability: Reliability | None = None

    def as_json(self) -> dict[str, Any]:
        """Convert to plain JSON values."""
        told = {} if self.reliability is None else {"reliability": finite_or_null(asdict(self.reliability))}
        return {"scores": self.scores.as_json(), "seconds": round(self.seconds, 1), **told}


@dataclass(frozen=True, eq=False)
class JudgedRow:
    """A row by all methods.

    Attributes
    ----------
    name, about : str
    judged : tuple of Judged
    picture : ndarray, shape (h, w, 3), uint8
        One view: photo, truth, the albedo of every method.
    """

    name: str
    about: str
    judged: tuple[Judged, ...]
    picture: np.ndarray

    def by(self, method: Method) -> Judged:
        """Look up the result of one of the methods."""
        return next(one for one in self.judged if one.method == method.name)


def judge_row(laboratory: Laboratory, row: Row, methods: Sequence[Method]) -> JudgedRow:
    """Decompose a row by every method, and evaluate."""
    prepared = laboratory.prepare(row)
    judge = Judge.of(prepared)
    about = f"{row.about} (noise of the render {prepared.facts['render']['noise']:.1%})"
    judged, estimates = [], []
    for method in methods:
        begun = time.monotonic()
        albedo, facts, confidence = _albedo(laboratory, row, judge, method)
        seconds, scores = time.monotonic() - begun, judge.scores(albedo)
        reliability = None if confidence is None else _reliability(judge, confidence, albedo)
        judged.append(Judged(method.name, scores, seconds, facts, reliability))
        if method != IMAGE:
            estimates.append(Estimate(method.name, "", albedo, scores))
    return JudgedRow(row.name, about, tuple(judged), figure(judge, estimates, shown=(0.5,)))


def _albedo(
    laboratory: Laboratory, row: Row, judge: Judge, method: Method
) -> tuple[Maps, dict[str, Any], Maps | None]:
    """Compute albedo, records, and confidence where the method gives it."""
    if method.name == "cartoon-texture":
        return cartoon(judge, CARTOON_FIDELITY, laboratory.threads).albedo, {}, None
    if method.settings is None:
        return judge.images, {}, None
    settings = dict(method.settings)
    if settings["mode"] == "paper":
        settings |= _best_weights(settings, row, judge)
    results = laboratory.run_with(row, settings, method.lighting)
    facts = results.facts.get("lighting", {}) | results.facts["decomposition"]
    told = maps_in(results.paths["confidence"], judge.names) if method == OURS else None
    return maps_in(results.paths[method.artefact], judge.names), facts, told


def _reliability(judge: Judge, confidence: Maps, albedo: Maps) -> Reliability:
    """Compute the reliability of confidence on the judged pixels of all views together."""
    true = {name: judge.true_albedo(name) for name in judge.names}
    inside = {name: judge.judged(name) for name in judge.names}
    stacked = (
        np.concatenate([maps[name][inside[name]] for name in judge.names])
        for maps in (confidence, albedo, true)
    )
    return Reliability.of(*stacked)


def _best_weights(settings: dict[str, Any], row: Row, judge: Judge) -> dict[str, float]:
    """Scale λ and μ of Fig. 3 to the size of the views, and apply the paper's own factor of the row."""
    height, width = judge.masks[judge.names[0]].shape
    weights = weights_at(DecompositionSettings(**settings), (height * width) ** 0.5, 0.0)
    return {"lambda": round(weights.smoothness * row.lambda_factor, 9), "mu": weights.consistency}
