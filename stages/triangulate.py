"""3-D points for cameras that came without any: stereo learns from them where surface is."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from pipeline import Artefact, Job, Stage
from stages.motion.known_poses.settings import TriangulationSettings
from stages.scene.distributions import PICTURES, PYCOLMAP


def run(job: Job[TriangulationSettings]) -> None:
    """Keep the points that the model has; where it has none, triangulate features of near views."""
    from stages.formats.colmap.assembly import add_points
    from stages.formats.colmap.model import read_model, registered
    from stages.motion.known_poses.triangulation import triangulated

    folder = job.inputs["workspace"]
    model = read_model(folder / "sparse")
    given = len(model.points3D)
    if not given:
        names = [image.name for image in registered(model)]
        with job.progress("finding features", len(names)) as step:
            x_in_world, seen = triangulated(
                folder / "images", model, job.scratch, job.settings, job.threads, step
            )
        if len(x_in_world) >= job.settings.fewest_points:
            add_points(model, names, x_in_world, seen)
    model.write(job.outputs["sparse_points"])
    job.note(points=len(model.points3D), given=bool(given))


def in_words(facts: Mapping[str, Any]) -> str:
    """Tell in a few words what was found."""
    return f"{facts['points']:,} points {'that the model has' if facts['given'] else 'between the views'}"


TRIANGULATE = Stage(
    name="triangulate",
    version=1,
    about="3-D points for cameras that came without any, for stereo.",
    settings=TriangulationSettings,
    takes=("workspace",),
    gives=(Artefact("sparse_points", "COLMAP model of the views, with points"),),
    run=run,
    tools=("numpy", *PYCOLMAP, *PICTURES),
    saves_memory="lower triangulate.max_features",
    found=in_words,
)
