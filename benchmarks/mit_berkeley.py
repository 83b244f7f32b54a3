"""Eq. 2 whole on real photographs with measured reflectance: ``python -m benchmarks.mit_berkeley [--quick]``.

Ten lamps are ten views of one viewpoint: every pixel corresponds to itself in all 45 pairs, normals come from
the given orthographic depth, `mode: paper`'s core does the rest. Rule for λ and μ: the pair of a stated grid
with the least LMSE on the first object, kept for the others. Cartoon-texture gets besides: its best λ per
object, the mean of its ten cartoons, and a solver that comes near its goal.

LMSE (windows of 20 px, step 10, at the reduced size) and si-RMSE with one scale for all estimates of an
object, on gray linear values as in the data set's own program. Needs
``$UNSHADE_DATA/gt-mit-berkeley-intrinsic``.
"""

from __future__ import annotations

import argparse
import json
import os
import sys
import time
from collections.abc import Callable, Iterable, Sequence
from concurrent.futures import Executor, ProcessPoolExecutor, ThreadPoolExecutor
from dataclasses import asdict, dataclass, field, replace
from itertools import combinations, product
from multiprocessing import get_context
from pathlib import Path

os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")  # before numpy: more threads sum in another order

import numpy as np  # noqa: E402
import scipy.sparse as sp  # noqa: E402

from benchmarks.mit_berkeley_objects import LAMPS, LampObject, objects_folder, read_object  # noqa: E402
from pipeline import UserError  # noqa: E402
from stages.decomposition import DecompositionSettings  # noqa: E402
from stages.evaluation.judged_views import judge_view  # noqa: E402
from stages.evaluation.scaled_error import lmse, si_rmse  # noqa: E402
from stages.photometry.alternation import AlternationSettings, Descent, advance, start  # noqa: E402
from stages.photometry.cartoon_texture import cartoon_texture  # noqa: E402
from stages.photometry.energy import EnergyWeights  # noqa: E402
from stages.photometry.stack import StackedViews, stack_pixels, stack_views, unstack_pixels  # noqa: E402
from stages.solvers.primal_dual_cartoon import CartoonSettings  # noqa: E402

PAPER = DecompositionSettings()  # δ, conjugate gradients and the stopping rule; λ and μ are chosen here
OBJECTS = ("box", "dinosaur", "panther")  # the first is the one that λ and μ are chosen on


@dataclass(frozen=True)
class Plan:
    """How large, which grids, how far."""

    reduction: int
    fidelities: tuple[float, ...]
    lambdas: tuple[float, ...]
    mus: tuple[float, ...]
    far: int
    far_tolerance: float


FIDELITIES = (0.02, 0.05, 0.1, 0.2, 0.3, 0.5, 0.8, 1.2, 2.0)
FULL = Plan(3, FIDELITIES, (0.1, 0.2, 0.5, 1, 2, 5), (0.2, 1, 5), 300, 1e-6)
QUICK = Plan(6, FIDELITIES[1::2], (0.2, 0.5, 1, 2), (1,), 150, 1e-5)
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
    """One object as Eq. 2 sees it: ten views with the same mask and normals, each pixel linked to itself."""

    subject: LampObject
    views: StackedViews
    image: np.ndarray

    @classmethod
    def of(cls, subject: LampObject) -> Problem:
        """Stack the lamps; scaled by one number, 99th percentile = 1."""
        masks = [subject.mask] * LAMPS
        itself = sp.eye_array(int(subject.mask.sum()), format="csr")
        links = dict.fromkeys(combinations(range(LAMPS), 2), itself)
        views = stack_views(masks, [subject.normals] * LAMPS, links)
        values = stack_pixels(masks, list(subject.lamps))
        return cls(subject, views, values / np.percentile(values, 99))

    def decompose(
        self,
        lambda_: float,
        mu: float,
        limit: int = PAPER.max_alternations,
        tolerance: float = PAPER.energy_tolerance,
    ) -> Descent:
        """`mode: paper` from its start to its end, with its own stopping rule unless told otherwise."""
        settings = AlternationSettings(
            EnergyWeights(lambda_, mu, PAPER.delta), limit, tolerance, PAPER.cg_tolerance, PAPER.cg_max_steps
        )
        descent = start(self.views, self.image, settings.weights)
        while descent.outcome is None:
            descent = advance(self.views, self.image, descent, settings)
        return descent

    def score(self, method: str, estimates: Iterable[np.ndarray], **notes: object) -> Row:
        """Judge gray estimates, shape (h, w) each, all together."""
        truth = np.repeat(self.subject.reflectance[..., None], 3, axis=-1)
        judged = [
            judge_view(str(k), np.repeat(estimate[..., None], 3, axis=-1), truth, self.subject.mask)
            for k, estimate in enumerate(estimates)
        ]
        return Row(self.subject.name, method, lmse(judged)[0], si_rmse(judged)[0][0], notes)

    def score_descent(self, method: str, descent: Descent, lambda_: float, mu: float) -> Row:
        """Judge the ten albedos, with the energy that was reached."""
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
    """The lamps taken for the albedo, a constant, and the mean of the lamps."""
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
    """Cartoon-texture of every photo at every λ of the grid; the ten cartoons together, and their mean."""
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
    """What the table shows: the scheme at the λ that was kept; then each way at its own best λ."""
    lines = [row for row in own if row.method == "cartoon-texture" and row.notes["lambda_"] == kept]
    for method in dict.fromkeys(row.method for row in own):
        best = _best(row for row in own if row.method == method)
        lines.append(replace(best, method=f"{method}, own λ"))
    return lines


def paper_sweep(problem: Problem, plan: Plan, executor: Executor) -> list[Row]:
    """`mode: paper` at every λ, μ of the grid."""
    pairs = list(product(plan.lambdas, plan.mus))
    descents = executor.map(problem.decompose, *zip(*pairs, strict=True))
    return [
        problem.score_descent("mode: paper", descent, *pair)
        for pair, descent in zip(pairs, descents, strict=True)
    ]


def experiment(
    folder: Path, plan: Plan, threads: Executor, processes: Executor, say: Callable[[str], None]
) -> dict[str, list[Row]]:
    """Table and sweeps. Threads for what is compiled; processes for scipy, which shares no core."""
    problems = [Problem.of(read_object(folder / name, plan.reduction)) for name in OBJECTS]
    for problem in problems:
        pixels = int(problem.subject.mask.sum())
        say(f"{problem.subject.name}: {pixels} pixels × {LAMPS} lamps at 1/{plan.reduction} of the size")
    cartoon_rows = [cartoons(problem, plan.fidelities, threads) for problem in problems]
    kept = _best(row for row in cartoon_rows[0] if row.method == "cartoon-texture").notes["lambda_"]
    sweep = paper_sweep(problems[0], plan, processes)
    chosen = _best(sweep).notes
    pair = chosen["lambda_"], chosen["mu"]
    say(f"least LMSE on {OBJECTS[0]}: λ = {pair[0]:g}, μ = {pair[1]:g}; cartoon-texture λ = {kept:g}")
    near = [processes.submit(p.decompose, *pair) for p in problems]
    far = [processes.submit(p.decompose, *pair, plan.far, plan.far_tolerance) for p in problems]
    table = []
    for problem, own, stopped, iterated in zip(problems, cartoon_rows, near, far, strict=True):
        table += images_themselves(problem)
        table += cartoon_lines(own, kept)
        table.append(problem.score_descent("mode: paper", stopped.result(), *pair))
        table.append(problem.score_descent("the same energy, iterated on", iterated.result(), *pair))
    return {"cartoons": sum(cartoon_rows, []), "sweep": sweep, "table": table}


def _best(rows: Iterable[Row]) -> Row:
    return min(rows, key=lambda row: row.lmse)


def as_text(rows: Sequence[Row]) -> str:
    """The rows under a heading, notes in words."""
    lines = [f"{'object':<10}{'method':<36}{'LMSE':>8}{'si-RMSE':>9}  notes"]
    for row in rows:
        notes = ", ".join(f"{key.rstrip('_')} {_short(value)}" for key, value in row.notes.items())
        lines.append(f"{row.subject:<10}{row.method:<36}{row.lmse:>8.4f}{row.si_rmse:>9.4f}  {notes}")
    return "\n".join(lines)


def _short(value: object) -> str:
    return f"{value:.4g}" if isinstance(value, float) else str(value)


def main(arguments: Sequence[str]) -> int:
    """Print the sweeps and the table; 2 where there is no data."""
    parser = argparse.ArgumentParser(prog="python -m benchmarks.mit_berkeley", description=__doc__)
    parser.add_argument("--quick", action="store_true", help="smaller images and grids: about two minutes")
    parser.add_argument("--threads", type=int, default=os.cpu_count() or 1)
    parser.add_argument("--json", type=Path, metavar="FILE", help="write all rows there too")
    given = parser.parse_args(arguments)
    began = time.monotonic()
    try:
        folder = objects_folder()
        with (
            ThreadPoolExecutor(given.threads) as threads,
            ProcessPoolExecutor(given.threads, mp_context=get_context("spawn")) as processes,
        ):
            found = experiment(folder, QUICK if given.quick else FULL, threads, processes, print)
    except UserError as error:
        print(error, file=sys.stderr)
        return 2
    for title, rows in found.items():
        print(f"\n{title}\n{as_text(rows)}")
    print(f"\n{time.monotonic() - began:.0f} s on {given.threads} threads")
    if given.json:
        content = {title: [asdict(row) for row in rows] for title, rows in found.items()}
        given.json.write_text(json.dumps(content, indent=1, ensure_ascii=False) + "\n", encoding="utf-8")
    return 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
