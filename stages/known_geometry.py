"""Given geometry of an experiment: the true mesh, or a smoothed one (the paper's Figs. 2 and 7)."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from pipeline import Artefact, Job, Settings, Stage, setting
from stages.scene.distributions import OPEN3D


class KnownGeometrySettings(Settings):
    """Settings of the `known_geometry` stage."""

    smoothing: int = setting(
        0,
        "Steps of Laplacian smoothing, as a modelling tool's filter does them; 0: the true mesh. The paper "
        "smooths until neighbouring details, not the figure, are lost.",
        unit="steps",
        ge=0,
        le=10000,
    )


def run(job: Job[KnownGeometrySettings]) -> None:
    """Read the true mesh, smooth it, keep it as the mesh of every later stage."""
    import numpy as np

    from stages.formats.meshes.triangle_meshes import read_mesh, write_mesh
    from stages.synthetic.subjects.smoothing import laplacian_smoothing

    truth = read_mesh(job.inputs["true_mesh"])
    known = laplacian_smoothing(truth, job.settings.smoothing)
    moved = np.linalg.norm(known.vertices - truth.vertices, axis=1)
    write_mesh(job.outputs["mesh"], known)
    job.note(
        vertices=len(known.vertices),
        mean_move=float(moved.mean()),
        largest_move=float(moved.max()),
        extent=truth.diagonal,
    )


def in_words(facts: Mapping[str, Any]) -> str:
    """Tell in a few words what was found."""
    return (
        f"{facts['vertices']:,} vertices, moved by {facts['mean_move'] / facts['extent']:.2%} of the extent"
    )


KNOWN_GEOMETRY = Stage(
    name="known_geometry",
    version=2,
    about="The rendered mesh as it is, or smoothed: geometry that is only roughly known.",
    settings=KnownGeometrySettings,
    takes=("true_mesh",),
    gives=(Artefact("mesh", "triangle mesh, world axes", file="mesh.ply", output="mesh.ply"),),
    run=run,
    tools=("numpy", *OPEN3D),
    saves_memory="render fewer views (render.views)",
    found=in_words,
)
