"""Runs of the program's own stages on a row of the paper, cached in the workspace."""

from __future__ import annotations

import json
import os
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import stages
from benchmarks.paper.rows import Row
from pipeline import Stage
from pipeline.cache.store import Store
from pipeline.config import check_settings
from pipeline.request import Request, Selection
from pipeline.run import Listener, run
from stages.photometry.decomposition_settings import DecompositionSettings


@dataclass(frozen=True)
class Size:
    """Size and number of the views.

    Attributes
    ----------
    width_px, height_px : int
    views : int
    noise : float
        Noise of the renders relative to the mean.
    paper_scheme : bool
        Run the paper's own scheme, too: at the full size it takes hours a row.
    spacing : float
        Grid of the bust's mesh, bust heights.
    """

    width_px: int
    height_px: int
    views: int = 13
    noise: float = 0.02
    paper_scheme: bool = True
    spacing: float = 0.004

    @property
    def name(self) -> str:
        """Name, as in 540x960."""
        return f"{self.width_px}x{self.height_px}"

    @property
    def scale(self) -> float:
        """Length of a pixel row against the paper's 540."""
        return self.width_px / 540


FULL = Size(540, 960, paper_scheme=False)
QUARTER, TENTH = Size(135, 240), Size(54, 96)
TINY = Size(27, 48, views=3, noise=0.3, spacing=0.02)


@dataclass(frozen=True)
class Weights:
    """λ and μ at the paper's size, 540×960.

    The data term and the agreement between views scale with the number of pixels, the smoothness with length:
    for the same balance at another size λ scales with the side, and μ stays.
    """

    smoothness: float
    agreement: float

    def at(self, size: Size) -> dict[str, float]:
        """Convert to settings of the `decomposition` stage at a size."""
        return {"lambda": round(self.smoothness * size.scale, 9), "mu": self.agreement}


@dataclass(frozen=True)
class Results:
    """Paths of the artefacts of a run, by name, and the records of its stages."""

    paths: dict[str, Path]
    facts: dict[str, dict[str, Any]]

    def energy(self) -> dict[str, Any]:
        """Read `energy.json`."""
        return json.loads(self.paths["energy"].read_text(encoding="utf-8"))


def results_of(
    flow: tuple[Stage, ...],
    sources: Mapping[str, Path],
    given: Mapping[str, Mapping[str, Any]],
    workspace: Path,
    last: str,
    threads: int,
    listener: Listener,
) -> Results:
    """Run a dataflow with these settings up to a stage, and return its results."""
    request = Request(
        flow=flow,
        settings=check_settings({stage.name: stage.settings for stage in stages.ALL_STAGES}, given),
        sources=sources,
        kinds=stages.kinds_of_sources(flow),
        workspace=workspace,
        threads=threads,
        selection=Selection(last=last),
    )
    store, paths, facts = Store(workspace), {}, {}
    for done in run(request, listener):
        record, stage = done.record, done.decision.stage
        folder = store.entry(record.stage, record.key)
        paths |= {artefact.name: folder / artefact.path for artefact in stage.gives}
        facts[stage.name] = record.facts
    return Results(paths, facts)


@dataclass(frozen=True)
class Laboratory:
    """A workspace, a size, and a listener."""

    workspace: Path
    size: Size
    listener: Listener
    threads: int = field(default_factory=lambda: len(os.sched_getaffinity(0)))

    def prepare(self, row: Row) -> Results:
        """Render a row and compute the decomposition's inputs."""
        return self._run(row, {"mode": "paper"}, {}, last="correspondence")

    def decompose(self, row: Row, weights: Weights, **settings: Any) -> Results:
        """Decompose a row; λ's factor of the row is applied here."""
        own = Weights(weights.smoothness * row.lambda_factor, weights.agreement)
        return self._run(row, own.at(self.size) | settings, {}, last="decomposition")

    def run_with(
        self,
        row: Row,
        settings: dict[str, Any],
        lighting: dict[str, Any] | None = None,
        correspondence: dict[str, Any] | None = None,
    ) -> Results:
        """Decompose a row with the given settings of the decomposition, the lighting, the correspondence."""
        return self._run(row, settings, lighting or {}, "decomposition", correspondence)

    def given(
        self,
        row: Row,
        decomposition: dict[str, Any],
        lighting: dict[str, Any] | None = None,
        correspondence: dict[str, Any] | None = None,
    ) -> dict[str, dict[str, Any]]:
        """Collect the settings of all stages for a row."""
        return {
            "render": {
                "views": self.size.views,
                "width_px": self.size.width_px,
                "height_px": self.size.height_px,
                "noise": self.size.noise,
                "spacing": self.size.spacing,
                **row.render,
            },
            "undistort": {"max_size_px": None},
            "known_geometry": dict(row.known_geometry),
            "correspondence": correspondence or {},
            "lighting": lighting or {},
            "decomposition": decomposition,
        }

    def _run(
        self,
        row: Row,
        decomposition: dict[str, Any],
        lighting: dict[str, Any],
        last: str,
        correspondence: dict[str, Any] | None = None,
    ) -> Results:
        given = self.given(row, decomposition, lighting, correspondence)
        flow = stages.experiment(row.sources, DecompositionSettings(**decomposition).kind_of_light)
        return results_of(flow, row.sources, given, self.workspace, last, self.threads, self.listener)
