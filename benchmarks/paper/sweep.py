"""λ and μ by a rule: the least mean si-RMSE on the scene of Fig. 3; first λ at μ = 1, then μ at that λ."""

from __future__ import annotations

from dataclasses import dataclass

from benchmarks.paper.judging import Judge
from benchmarks.paper.laboratory import Laboratory, Weights
from benchmarks.paper.methods import Estimate, cartoon, mean_error, paper
from benchmarks.paper.rows import Row

# At the paper's size. λ: from hardly any smoothing to the erasure of parts; μ: weak and strong agreement.
SMOOTHNESS = (4.0, 12.0, 40.0, 120.0)
FIRST_AGREEMENT, OTHER_AGREEMENT = 1.0, (0.2, 5.0)
FIDELITIES = (0.02, 0.05, 0.1, 0.2, 0.3, 0.5, 0.8, 1.2)


@dataclass(frozen=True, eq=False)
class Tried:
    """One point of a grid: its settings, and its estimate."""

    weights: Weights | None
    fidelity: float | None
    estimate: Estimate

    @property
    def error(self) -> float:
        """Error that the choice minimises."""
        return mean_error(self.estimate.scores)


def sweep_paper(laboratory: Laboratory, row: Row, judge: Judge, solved_well: bool = False) -> list[Tried]:
    """Sweep `mode: paper`: every λ at the first μ, then the other μ at the best λ."""

    def tried(smoothness: float, agreement: float) -> Tried:
        weights = Weights(smoothness, agreement)
        return Tried(weights, None, paper(laboratory, row, judge, weights, solved_well))

    first = [tried(smoothness, FIRST_AGREEMENT) for smoothness in SMOOTHNESS]
    smoothness = best(first).weights.smoothness
    return first + [tried(smoothness, agreement) for agreement in OTHER_AGREEMENT]


def sweep_cartoon(judge: Judge, threads: int) -> list[Tried]:
    """Sweep cartoon-texture over its grid."""
    return [Tried(None, fidelity, cartoon(judge, fidelity, threads)) for fidelity in FIDELITIES]


def best(tried: list[Tried]) -> Tried:
    """Select the point with the least error."""
    return min(tried, key=lambda one: one.error)
