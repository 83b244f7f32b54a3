"""What stands between the surface and the sky, and what is seen instead: ν of `mode: transfer`."""

from __future__ import annotations

from pipeline import Artefact, Job, Settings, Stage, setting


class TransferSettings(Settings):
    """Settings of the `transfer` stage."""

    degree: int = setting(
        4,
        "Spherical harmonics up to this degree l. Beyond 4 a matt surface hardly sees them.",
        ge=1,
        le=6,
    )
    directions: int = setting(
        256,
        "Rays per vertex, spread by the cosine's weight. The error of a half-blocked sky is about 1 over "
        "this, before neighbouring vertices are blended.",
        unit="rays",
        ge=16,
        le=16384,
    )
    max_vertices: int = setting(
        200_000,
        "Larger meshes are decimated to this for the rays; what blocks the sky varies slowly. The time is "
        "this times `directions`: about a minute on two cores by default.",
        unit="vertices",
        ge=100,
    )
    lift: float = setting(
        0.5,
        "Rays begin this far above the surface, lest its own roughness block the sky.",
        unit="mean edges of the mesh, or of what it is decimated to",
        gt=0,
        le=10,
    )


def run(job: Job) -> None:
    """Open the mesh, look from its vertices into the sky, save. Memory: 16 B per blocked ray, and 400 MB."""
    import numpy as np

    from stages.geometry.occluders import Occluders
    from stages.geometry.proxy import blend_of, proxy_of
    from stages.geometry.rays import vertex_normals
    from stages.geometry.surface import mean_edge
    from stages.photometry.transfer import occlusion, points_at_once
    from stages.scene.meshes import read_mesh
    from stages.scene.transfer_file import StoredTransfer, write_transfer

    settings: TransferSettings = job.settings
    surface = read_mesh(job.inputs["mesh"])
    proxy = proxy_of(surface, settings.max_vertices)
    normals = vertex_normals(proxy.vertices, proxy.faces)
    occluders, count = Occluders(proxy, job.threads), len(proxy.vertices)
    origins = proxy.vertices - occluders.origin + settings.lift * mean_edge(proxy) * normals
    with job.progress("rays", -(-count // points_at_once(settings.directions))) as step:
        seen = occlusion(origins, normals, occluders.cast, count, settings.degree, settings.directions, step)
    own_normals = vertex_normals(surface.vertices, surface.faces)
    corners, weights = blend_of(surface, own_normals, proxy, job.threads)
    write_transfer(
        job.outputs["transfer"],
        StoredTransfer(seen.blocked, normals, seen.form_factors, seen.behind, corners, weights),
    )
    blocked = np.asarray(seen.form_factors.sum(axis=1)) + np.asarray(seen.behind.sum(axis=1))
    job.note(vertices=count, mean_blocked=round(float(blocked.mean()), 4))


TRANSFER = Stage(
    name="transfer",
    version=1,
    about="What of the sky each point sees, and what it sees instead.",
    settings=TransferSettings,
    takes=("mesh",),
    gives=(Artefact("transfer", "transfer vectors and form factors", file="transfer.npz"),),
    run=run,
    tools=("numpy", "scipy", "open3d-cpu", "open3d"),
)
