"""The page of growth, in Markdown."""

from __future__ import annotations

from collections.abc import Callable, Sequence

from benchmarks.paper.tables import markdown
from benchmarks.scale.albedo_error import SHARED
from benchmarks.scale.growth import Grown, Taken
from benchmarks.solver.growth import slope

HEAD = """# Growth with the number of views

Written by `python -m benchmarks.scale`: a street of {size} px views, {source}. Peak memory is the process's,
libraries included. A slope of 1 is linear growth."""
FIGURES: tuple[tuple[str, Callable[[Taken], float], str], ...] = (
    ("Seconds", lambda taken: taken.seconds, ".1f"),
    ("Processor seconds", lambda taken: taken.cpu_seconds, ".1f"),
    ("Peak memory, GB", lambda taken: taken.peak_bytes / 1e9, ".2f"),
)
LEAST = 0.01  # of a figure, where a slope is fitted


def page_of(measured: Sequence[Grown], size: str, from_photos: bool) -> str:
    """Write all tables of a series."""
    source = "cameras and mesh estimated" if from_photos else "cameras and mesh given"
    views = [one.views for one in measured]
    head = ["stage", *(f"{count} views" for count in views), "slope"]
    parts = [HEAD.format(size=size, source=source)]
    for title, figure, form in FIGURES:
        rows = []
        for stage in measured[-1].stages:
            values = [figure(one.stages[stage]) for one in measured]
            steep = slope(views, [max(value, LEAST) for value in values]) if len(views) > 1 else float("nan")
            rows.append([f"`{stage}`", *(format(value, form) for value in values), f"{steep:.2f}"])
        parts.append(f"## {title}\n\n{markdown(head, rows)}")
    if any(one.error for one in measured):
        parts.append(f"## Error of the albedo\n\n{_errors(measured)}")
    return "\n\n".join(parts) + "\n"


def _errors(measured: Sequence[Grown]) -> str:
    """Tabulate si-RMSE, relative error and that of the views that all streets have."""
    head = ["views", "si-RMSE (red green blue)", "over RMS of the true albedo", f"first {SHARED} views"]
    rows = [
        [str(one.views), *(_three(part) for part in (error.si_rmse, error.relative, error.shared))]
        for one in measured
        if (error := one.error)
    ]
    return markdown(head, rows)


def _three(values: Sequence[float]) -> str:
    return " ".join(f"{value:.4f}" for value in values)
