"""Take the user's mesh instead of reconstructing one (`--mesh FILE`)."""

from __future__ import annotations

from pipeline import Artefact, Job, Settings, Stage
from stages.scene.distributions import OPEN3D


class AdoptMeshSettings(Settings):
    """The mesh is taken as it is: nothing to set."""


def run(job: Job) -> None:
    """Read the mesh, whatever its format, and keep it as PLY."""
    from stages.scene.meshes import read_mesh, write_mesh

    surface = read_mesh(job.inputs["mesh_file"])
    write_mesh(job.outputs["mesh"], surface)
    job.note(vertices=len(surface.vertices), faces=len(surface.faces))


ADOPT_MESH = Stage(
    name="adopt_mesh",
    version=2,
    about="The user's own mesh, in the frame of the cameras.",
    settings=AdoptMeshSettings,
    takes=("mesh_file",),
    gives=(Artefact("mesh", "triangle mesh, world axes", file="mesh.ply", output="mesh.ply"),),
    run=run,
    tools=("numpy", *OPEN3D),
)
