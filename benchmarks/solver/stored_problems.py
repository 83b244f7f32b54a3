"""The problems of the issue, opened from what the flow left in workspaces."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

from benchmarks.paper.laboratory import FULL, QUARTER, Laboratory, Size, Weights
from benchmarks.paper.rows import ROWS
from benchmarks.solver.problems import RaceProblem, views_and_images, weights_of
from pipeline import UserError
from pipeline.run import Listener, run
from pipeline.store import Store
from stages.command.request import request_of
from stages.command.words import Run

ROOT = Path(__file__).resolve().parent.parent.parent
BALANCES = (Weights(40.0, 1.0), Weights(4.0, 1.0))  # at a quarter of the size λ = 10 and 1


def bust(full: bool, listener: Listener) -> Iterator[RaceProblem]:
    """Fig. 3 with two balances of its terms, rendered if the workspace does not hold it yet.

    The second balance shares the first one's views.
    """
    size: Size = FULL if full else QUARTER
    laboratory = Laboratory(ROOT / "workspaces" / "paper" / size.name, size, listener)
    views, images = views_and_images(laboratory.prepare(ROWS[0]).paths)
    for balance in BALANCES:
        given = balance.at(size)
        weights = weights_of(given["lambda"], given["mu"])
        name = f"bust-{size.name}-lambda-{weights.smoothness:g}"
        yield RaceProblem(name, f"the bust, 13 views of {size.name}", views, images, weights)


def fountain(listener: Listener) -> Iterator[RaceProblem]:
    """fountain-P11 at 768×512, of the mesh that the workspace holds.

    Raises
    ------
    UserError
        It holds none: making one takes many minutes, which nobody asked for here.
    """
    workspace = ROOT / "workspaces" / "fountain"
    if not (workspace / "cache").is_dir() or Store(workspace).current("mesh") is None:
        raise UserError(f"{workspace} holds no mesh of the fountain yet; `make fountain` makes it.")
    words = Run(
        config=ROOT / "configs" / "fountain.yaml", assignments=("raycast.reduce=1",), last="correspondence"
    )
    paths = paths_of_run(words, listener)
    views, images = views_and_images(paths)
    weights = weights_of(1.0, 1.0)  # the stage's defaults
    yield RaceProblem("fountain", "fountain-P11, 8 views of 768×512", views, images, weights)


def paths_of_run(words: Run, listener: Listener) -> dict[str, Path]:
    """Run, or find what has been run, and tell where every artefact lies."""
    request = request_of(words)
    store, paths = Store(request.workspace), {}
    for done in run(request, listener):
        folder = store.entry(done.record.stage, done.record.key)
        paths |= {artefact.name: folder / artefact.path for artefact in done.decision.stage.gives}
    return paths
