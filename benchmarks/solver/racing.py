"""All methods on one problem, one after the other."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass

from benchmarks.solver import compiled_alternation, ours, reweighting
from benchmarks.solver.clock import Trace
from benchmarks.solver.comparison import Comparison, compare
from benchmarks.solver.corrugated_plane import corrugated_plane
from benchmarks.solver.inner_solvers import INNER_SOLVERS
from benchmarks.solver.problems import RaceProblem

TINY_PIXELS, TINY_BUDGET_S = 2000, 0.02


@dataclass(frozen=True)
class Rules:
    """The same for every method.

    Attributes
    ----------
    budget_s : float
        Time of each method.
    threads : int
    most_rounds : int
        Limit of our rounds.
    rivals : tuple of str
        Only rivals whose names contain one of these words; all if empty.
    """

    budget_s: float
    threads: int
    most_rounds: int = 400
    rivals: tuple[str, ...] = ()

    def admit(self, method: str) -> bool:
        """Check whether a rival takes part."""
        return not self.rivals or any(word in method for word in self.rivals)


@dataclass(frozen=True, eq=False)
class Race:
    """A problem and its traces; the first is ours."""

    problem: RaceProblem
    traces: tuple[Trace, ...]

    @property
    def comparisons(self) -> tuple[Comparison, ...]:
        """Comparisons of every method with ours."""
        return compare(self.traces, self.traces[0])


def left_out() -> list[str]:
    """List a sentence for every rival whose package is missing."""
    return [
        f"{inner.name} is left out: its package is not installed (`pip install 'unshade[benchmarks]'`)."
        for inner in INNER_SOLVERS
        if not inner.available
    ]


def rival_names() -> tuple[str, ...]:
    """List the names of all rivals, installed or not."""
    return (compiled_alternation.NAME, *(inner.name for inner in INNER_SOLVERS))


def hold(problem: RaceProblem, rules: Rules, say: Callable[[str], None]) -> Race:
    """Run every available method for its time."""
    traces = []
    for trace in _traces(problem, rules):
        say(f"{problem.name}: {trace.method}: {trace.least:.6g} after {trace.looks[-1].seconds:.1f} s")
        traces.append(trace)
    return Race(problem, tuple(traces))


def warm_up(threads: int) -> None:
    """Compile and import everything, on a problem too small to take time."""
    for _ in _traces(corrugated_plane(TINY_PIXELS), Rules(TINY_BUDGET_S, threads)):
        pass


def _traces(problem: RaceProblem, rules: Rules) -> Iterator[Trace]:
    yield ours.race(problem, rules.budget_s, rules.threads, rules.most_rounds)
    if rules.admit(compiled_alternation.NAME):
        yield compiled_alternation.race(problem, rules.budget_s, rules.threads)
    for inner in INNER_SOLVERS:
        if inner.available and rules.admit(inner.name):
            yield reweighting.race(problem, inner, rules.budget_s, rules.threads)
