"""Take the user's mesh instead of reconstructing one (`--mesh FILE`)."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from pipeline import Artefact, Job, Settings, Stage, UserError, setting
from stages.scene.distributions import OPEN3D


class AdoptMeshSettings(Settings):
    """Settings of the `adopt_mesh` stage."""

    crease_deg: float = setting(
        60.0,
        "Where a file gives every face corners of its own (STL; OBJ and GLB with a texture), those that lie "
        "on one another become one vertex, so that normals are smooth, as the shading is; but not where "
        "faces meet at more than this angle. The corners of a box are kept, and the noise of a scan makes "
        "none. What faces share in the file they go on sharing. 0: as the file has it.",
        unit="degrees",
        ge=0,
        le=180,
    )


def run(job: Job[AdoptMeshSettings]) -> None:
    """Read the mesh, whatever its format, and keep it as PLY; corners that are one become one."""
    from stages.formats.meshes.mesh_files import read_mesh_file
    from stages.formats.meshes.triangle_meshes import without_strays, write_mesh
    from stages.geometry.creases import shared_corners

    given = read_mesh_file(job.inputs["mesh_file"])
    surface, crease_deg = without_strays(given), job.settings.crease_deg
    surface = shared_corners(surface, crease_deg) if crease_deg else surface
    if not len(surface.faces):
        raise UserError(
            f"{job.inputs['mesh_file']} has {len(given.faces)} triangles, each with corners in one place; "
            "expected a surface. Export the mesh again."
        )
    write_mesh(job.outputs["mesh"], surface)
    job.note(vertices_in_file=len(given.vertices), vertices=len(surface.vertices), faces=len(surface.faces))


def in_words(facts: Mapping[str, Any]) -> str:
    """Tell in a few words what was found."""
    return f"{facts['faces']:,} faces, {facts['vertices']:,} vertices"


ADOPT_MESH = Stage(
    name="adopt_mesh",
    version=5,
    about="The user's own mesh, in the frame of the cameras.",
    settings=AdoptMeshSettings,
    takes=("mesh_file",),
    gives=(Artefact("mesh", "triangle mesh, world axes", file="mesh.ply", output="mesh.ply"),),
    run=run,
    tools=("numpy", "scipy", *OPEN3D),
    saves_memory="give a mesh of fewer faces",
    found=in_words,
)
