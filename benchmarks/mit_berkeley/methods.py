"""The methods on an object, a line of the table each."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from concurrent.futures import Executor
from dataclasses import dataclass, field, replace
from itertools import combinations, product
from pathlib import Path

import numpy as np
import scipy.sparse as sp

import stages
from benchmarks.cartoon.cartoon_texture import cartoon_texture
from benchmarks.cartoon.primal_dual import CartoonSettings
from benchmarks.mit_berkeley.objects import LAMPS, LampObject
from benchmarks.mit_berkeley.sources import write_sources
from benchmarks.paper.judging import maps_in
from benchmarks.paper.laboratory import results_of
from pipeline.run import Listener
from stages.evaluation.judged_views import judge_view
from stages.evaluation.scaled_error import lmse, si_rmse
from stages.photometry.paper.alternation import Descent, advance, start
from stages.photometry.paper.energy import EnergyWeights
from stages.photometry.paper.settings import PaperSettings
from stages.photometry.stack import StackedViews, stack_pixels, stack_views, unstack_pixels

PAPER = PaperSettings()  # δ, conjugate gradients and the stopping rule; λ and μ are chosen here
# The article's steps and limit, and steps that suit values in [0, 255] better, with a longer breath.
SCHEMES = {
    "cartoon-texture": {},
    "cartoon, solved": {"max_iterations": 10_000, "primal_step": 3.5, "dual_step": 0.035},
}


@dataclass(frozen=True)
class Row:
    """One line of the table."""

    subject: str
    method: str
    lmse: float
    si_rmse: float
    notes: dict = field(default_factory=dict)


@dataclass(frozen=True, eq=False)
class Problem:
    """One object as input of Eq. 2: ten views of equal mask and normals; each pixel corresponds to itself."""

    subject: LampObject
    views: StackedViews
    image: np.ndarray

    @classmethod
    def of(cls, subject: LampObject) -> Problem:
        """Stack the photos of all lamps, scaled by one number, 99th percentile = 1."""
        masks = [subject.mask] * LAMPS
        itself = sp.eye_array(int(subject.mask.sum()), format="csr")
        correspondences = dict.fromkeys(combinations(range(LAMPS), 2), itself)
        views = stack_views(masks, [subject.normals] * LAMPS, correspondences)
        values = stack_pixels(masks, list(subject.lamps))
        return cls(subject, views, values / np.percentile(values, 99))

    def decompose(
        self,
        lambda_: float,
        mu: float,
        limit: int = PAPER.max_alternations,
        tolerance: float = PAPER.energy_tolerance,
    ) -> Descent:
        """Run `mode: paper` from its start, with its own stopping rule unless another is given."""
        weights = EnergyWeights(lambda_, mu)
        how = PaperSettings(max_alternations=limit, energy_tolerance=tolerance)
        descent = start(self.views, self.image, weights)
        while descent.outcome is None:
            descent = advance(self.views, self.image, descent, weights, how)
        return descent

    def score(self, method: str, estimates: Iterable[np.ndarray], **notes: object) -> Row:
        """Evaluate gray estimates, shape (h, w) each, all together."""
        truth = np.repeat(self.subject.reflectance[..., None], 3, axis=-1)
        judged = [
            judge_view(str(k), np.repeat(estimate[..., None], 3, axis=-1), truth, self.subject.mask)
            for k, estimate in enumerate(estimates)
        ]
        return Row(self.subject.name, method, lmse(judged)[0], si_rmse(judged)[0][0], notes)

    def score_descent(self, method: str, descent: Descent, lambda_: float, mu: float) -> Row:
        """Evaluate the ten albedos, with the final energy."""
        last = descent.history[-1]
        albedos = unstack_pixels([self.subject.mask] * LAMPS, descent.state.albedo)
        return self.score(
            method,
            albedos,
            lambda_=lambda_,
            mu=mu,
            energy=last.energy,
            alternations=len(descent.history),
            cg_steps=sum(record.cg_steps for record in descent.history),
            outcome=descent.outcome.name.lower(),
        )


def images_themselves(problem: Problem) -> list[Row]:
    """Evaluate the photos used as albedo, a constant, and the mean of the photos."""
    lamps = problem.subject.lamps
    single = [problem.score(f"lamp {k + 1}", [lamp], lamp=k + 1) for k, lamp in enumerate(lamps)]
    best = min(single, key=lambda row: row.lmse)
    return [
        problem.score("constant albedo", [np.ones_like(lamps[0])]),
        problem.score("the photos, all ten", lamps),
        replace(best, method="the best single photo"),
        problem.score("mean of the photos", [lamps.mean(axis=0)]),
    ]


def cartoons(problem: Problem, fidelities: Sequence[float], executor: Executor) -> list[Row]:
    """Evaluate cartoon-texture of every photo at every λ of the grid: the ten cartoons, and their mean."""
    rows = []
    masks = [problem.subject.mask] * LAMPS
    images = [lamp[..., None] for lamp in problem.subject.lamps]
    for (scheme, more), fidelity in product(SCHEMES.items(), fidelities):
        found = cartoon_texture(images, masks, CartoonSettings(fidelity, **more), executor)
        albedos = [image[..., 0] for image in found.albedos]
        notes = {"lambda_": fidelity, "unconverged": found.unconverged, "worst_gap": found.worst_gap}
        rows.append(problem.score(scheme, albedos, **notes))
        rows.append(problem.score(f"{scheme}, mean of ten", [np.mean(albedos, axis=0)], **notes))
    return rows


def cartoon_lines(own: list[Row], kept: float) -> list[Row]:
    """Select the table's lines: the scheme at the λ that was kept; then each variant at its own best λ."""
    lines = [row for row in own if row.method == "cartoon-texture" and row.notes["lambda_"] == kept]
    for method in dict.fromkeys(row.method for row in own):
        best = best_of(row for row in own if row.method == method)
        lines.append(replace(best, method=f"{method}, own λ"))
    return lines


def paper_sweep(problem: Problem, pairs: Sequence[tuple[float, float]], executor: Executor) -> list[Row]:
    """Evaluate `mode: paper` at every λ, μ of a grid."""
    descents = executor.map(problem.decompose, *zip(*pairs, strict=True))
    return [
        problem.score_descent("mode: paper", descent, *pair)
        for pair, descent in zip(pairs, descents, strict=True)
    ]


def by_transfer(problem: Problem, workspace: Path, threads: int, listener: Listener) -> Row:
    """Evaluate `mode: transfer` with its defaults, run on colour photos, cameras and a mesh.

    The mean of the three channels of its albedo is evaluated, without rescaling one against another.
    """
    sources = write_sources(problem.subject, workspace)
    flow = stages.dataflow(sources)
    done = results_of(flow, sources, {}, workspace, "decomposition", threads, listener)
    albedo = done.paths["albedo"]
    maps = maps_in(albedo, tuple(path.stem for path in sorted(albedo.glob("*.exr"))))
    return problem.score("mode: transfer", [image.mean(axis=-1) for image in maps.values()])


def best_of(rows: Iterable[Row]) -> Row:
    """Select the row with the least LMSE."""
    return min(rows, key=lambda row: row.lmse)
