"""Methods against ours: ratio of the times to the same energy."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from benchmarks.solver.clock import Trace

NEAR = 1.01  # of the best energy known


@dataclass(frozen=True)
class Comparison:
    """One method on one problem.

    Attributes
    ----------
    method : str
    looks : int
    least : float
        Energy of all channels together, in the gauge.
    above_best : float
        Its excess relative to the best known energy.
    near_s : float or None
        Until within 1 % of the best known; None if never.
    common : float
        Energy at which times are compared: within 1 % of the best known, or the method's own least.
    common_s, ours_s : float or None
        Times until that energy.
    at_least : bool
        True if ours was below that energy at its first evaluation: the ratio is then a lower bound.
    """

    method: str
    looks: int
    least: float
    above_best: float
    near_s: float | None
    common: float
    common_s: float | None
    ours_s: float | None
    at_least: bool

    @property
    def ratio(self) -> float | None:
        """Time relative to ours; None where ours never reaches the energy, or the method never starts to."""
        return self.common_s / self.ours_s if self.common_s and self.ours_s else None


def best_known(traces: Sequence[Trace]) -> float:
    """Find the least energy of all methods."""
    return min(trace.least for trace in traces)


def compare(traces: Sequence[Trace], ours: Trace) -> tuple[Comparison, ...]:
    """Compare every trace with ours, which may be among them."""
    best = best_known(traces)
    return tuple(_compare(trace, ours, best) for trace in traces)


def _compare(trace: Trace, ours: Trace, best: float) -> Comparison:
    near_s = trace.seconds_to(NEAR * best)
    common = trace.least if near_s is None else NEAR * best
    return Comparison(
        method=trace.method,
        looks=len(trace.looks),
        least=trace.least,
        above_best=trace.least / best - 1,
        near_s=near_s,
        common=common,
        common_s=trace.seconds_to(common),
        ours_s=ours.seconds_to(common),
        at_least=trace is not ours and ours.looks[0].energy <= common,
    )
