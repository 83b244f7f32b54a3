"""Take fused points that exist already instead of dense stereo (`--points FILE`)."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from pipeline import Artefact, Job, Settings, Stage, UserError


class AdoptPointsSettings(Settings):
    """Settings of the `adopt_points` stage: none."""


def run(job: Job[AdoptPointsSettings]) -> None:
    """Read the points and normals, keep those that are of any use."""
    import numpy as np

    from stages.formats.meshes.point_clouds import read_cloud, write_points
    from stages.scene.cameras import FARTHEST

    source = job.inputs["points_file"]
    x_in_world, normals, colours = read_cloud(source)
    with np.errstate(over="ignore", invalid="ignore"):
        lengths = np.linalg.norm(normals.astype(float), axis=1)
        usable = (np.abs(x_in_world) < FARTHEST).all(axis=1) & np.isfinite(lengths) & (lengths > 0)
    if not usable.any():
        raise UserError(
            f"{source} holds {len(usable)} points, none with a place and a normal; expected a fused cloud. "
            "Fuse the points again."
        )
    if unusable := int((~usable).sum()):
        job.warn(
            f"{unusable} of the {len(usable)} points have no place or no normal and are left out. "
            "Where that leaves holes, export them again, with normals."
        )
    write_points(
        job.outputs["fused"], x_in_world[usable], normals[usable] / lengths[usable, None], colours[usable]
    )
    job.note(points_in_file=len(usable), points=int(usable.sum()))


def in_words(facts: Mapping[str, Any]) -> str:
    """Tell in a few words what was found."""
    return f"{facts['points']:,} of {facts['points_in_file']:,} points used"


ADOPT_POINTS = Stage(
    name="adopt_points",
    version=2,
    about="The user's own fused points, in the frame of the cameras.",
    settings=AdoptPointsSettings,
    takes=("points_file",),
    gives=(Artefact("fused", "fused points with normals and colours, world axes", file="fused.ply"),),
    run=run,
    tools=("numpy",),
    saves_memory="give fewer points",
    found=in_words,
)
