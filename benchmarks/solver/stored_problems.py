"""Problems opened from results in workspaces."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

import numpy as np

import stages
from benchmarks.paper.laboratory import FULL, QUARTER, Laboratory, Size, Weights
from benchmarks.paper.rows import ROWS
from benchmarks.solver.problems import RaceProblem, views_and_images
from pipeline import UserError
from pipeline.cache.record import Record
from pipeline.cache.store import Store
from pipeline.run import Listener
from stages.photometry.decomposition_settings import DecompositionSettings
from stages.photometry.paper.energy import EnergyWeights
from stages.photometry.solver_settings import weights_at

ROOT = Path(__file__).resolve().parent.parent.parent
LARGE = replace(FULL, noise=0.06)  # two hours of rendering are not what races here
BALANCES = (Weights(40.0, 1.0), Weights(4.0, 1.0))  # at a quarter of the size λ = 10 and 1


def bust(full: bool, listener: Listener) -> Iterator[RaceProblem]:
    """Open Fig. 3 with two balances of its terms, rendered if the workspace does not hold it yet.

    The second balance shares the first one's views.
    """
    size: Size = LARGE if full else QUARTER
    laboratory = Laboratory(ROOT / "workspaces" / "paper" / size.name, size, listener)
    views, images = views_and_images(laboratory.prepare(ROWS[0]).paths)
    for balance in BALANCES:
        given = balance.at(size)
        weights = EnergyWeights(given["lambda"], given["mu"])
        name = f"bust-{size.name}-lambda-{weights.smoothness:g}"
        yield RaceProblem(name, f"the bust, 13 views of {size.name}", views, images, weights)


def fountain() -> Iterator[RaceProblem]:
    """Open fountain-P11 at the finest size in the workspace, without running any stage.

    Raises
    ------
    UserError
        The workspace holds no such result.
    """
    store = Store(ROOT / "workspaces" / "fountain")
    raycast, correspondence = _finest_pair(store)
    records = [store.current("undistort"), raycast, correspondence]
    views, images = views_and_images(paths_of(store, records))
    tall, wide = np.max([mask.shape for mask in views.masks], axis=0)
    about = f"fountain-P11, {views.view_count} views within {wide}×{tall}"
    asked = DecompositionSettings(mode="paper", solver="fast")
    weights = weights_at(asked, views.side, views.correspondences_per_pixel)
    yield RaceProblem(f"fountain-{wide}x{tall}", about, views, images, weights)


def _finest_pair(store: Store) -> tuple[Record, Record]:
    """Find the `raycast` result with the most pixels, and its correspondences."""
    pairs = [
        (cast.settings["reduce"], cast, linked)
        for cast in store.records("raycast")
        for linked in store.records("correspondence")
        if linked.inputs["depth"] == cast.outputs["depth"]
    ]
    if not pairs or store.current("undistort") is None:
        raise UserError(
            "workspaces/fountain holds no correspondences; `unshade run configs/fountain.yaml "
            "--set raycast.reduce=1 --to correspondence` makes them, at 768×512."
        )
    return min(pairs, key=lambda pair: pair[0])[1:]


def paths_of(store: Store, records: list[Record]) -> dict[str, Path]:
    """Find the paths of the artefacts of results, by name."""
    gives = {stage.name: stage.gives for stage in stages.ALL_STAGES}
    return {
        artefact.name: store.entry(record.stage, record.key) / artefact.path
        for record in records
        for artefact in gives[record.stage]
    }
