"""The state of a coarse level in files, mapped where it is read: only the pages that are used take memory."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from stages.solvers.kernels.arrays_in_files import load_mapped
from stages.solvers.kernels.sliced_ellpack import Slices
from stages.solvers.primal_dual.problem import Steps
from stages.solvers.primal_dual.prolongation import CoarseState
from stages.solvers.primal_dual.sliced_graph import SlicedGraph

KINDS = {  # fields that are kept, by what has them
    "slices": ("starts", "first", "places"),
    "graph": ("first", "neighbour", "weight", "total"),
    "state": ("albedo", "light", "edge_dual", "data_dual", "multiplier"),
}


def save_state(folder: Path, state: CoarseState) -> None:
    """Write the arrays of a state to a folder."""
    owners = {"slices": state.slices, "graph": state.graph, "state": state}
    for kind, names in KINDS.items():
        for name in names:
            np.save(folder / f"{kind}_{name}.npy", getattr(owners[kind], name))


def load_state(folder: Path, steps: Steps, free_light: bool) -> CoarseState:
    """Map the arrays of a state that `save_state` wrote; steps and whether the light is free are not kept."""
    of = {
        kind: {name: load_mapped(folder / f"{kind}_{name}.npy") for name in names}
        for kind, names in KINDS.items()
    }
    slices, graph = Slices(**of["slices"]), SlicedGraph(**of["graph"])
    return CoarseState(slices, graph, **of["state"], steps=steps, free_light=free_light)
