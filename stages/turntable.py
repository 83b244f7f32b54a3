"""The textured model under another light, from all around: views that the photos do not have."""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING, Any

from pipeline import Artefact, Job, Settings, Stage, setting
from stages.scene.distributions import OPEN3D, PICTURES
from stages.scene.upright_settings import UPRIGHT_WITHIN_DEG

if TYPE_CHECKING:
    import numpy as np

    from stages.formats.artefacts.surface_light_npz import StoredSurfaceLight
    from stages.formats.artefacts.transfer_file import StoredTransfer
    from stages.formats.meshes.triangle_meshes import Surface
    from stages.photometry.transport.directional_transport import DirectionalTransport
    from stages.scene.cameras import Camera
    from stages.texturing.rendering import TexturedSurface

ANIMATION = "turntable.gif"


class TurntableSettings(Settings):
    """Settings of the `turntable` stage."""

    frames: int = setting(36, "Pictures of a whole turn.", ge=1, le=720)
    side_px: int = setting(
        512,
        "Width and height of a picture. Finer than the photos' pixels shows nothing more.",
        unit="px",
        ge=16,
        le=4096,
    )
    elevation_deg: float | None = setting(
        None,
        "From how far above the horizon the model is seen. none: as the photos were taken, in the median.",
        unit="°",
        ge=-85,
        le=85,
    )
    distance: float = setting(
        3.0,
        "Of the camera from the middle of the model: nearer is steeper perspective.",
        unit="radii",
        gt=1,
        le=100,
    )
    frames_per_second: float = setting(12.0, "Of the animation.", gt=0, le=50)
    upright_within_deg: float = UPRIGHT_WITHIN_DEG
    sheet_offset: float = setting(
        1.0,
        "Visibility is that of the nearest point of the mesh that it was computed on. Of a thin sheet this "
        "may be on the other side; then that nearest to a point this far above the surface is taken.",
        unit="mean edges",
        ge=0,
    )


def run(job: Job[TurntableSettings]) -> None:
    """Render the frames one after another, then animate them. Memory: some 200 B per pixel of a frame."""
    from stages.formats.artefacts.camera_file import read_cameras
    from stages.formats.artefacts.surface_light_npz import read_surface_light
    from stages.formats.artefacts.transfer_file import read_transfer
    from stages.formats.artefacts.turntable_gif import write_gif
    from stages.formats.images.exr import read_exr
    from stages.formats.images.photos import write_png_srgb8
    from stages.formats.meshes.textured_models import read_model
    from stages.solvers.kernels.threading_layer import use_threads
    from stages.texturing.rendering import TexturedSurface

    use_threads(job.threads)
    model, folder = job.inputs["textured_model"], job.outputs["turntable"]
    given = read_model(model / "model.obj")
    textures = [read_exr(colour.with_suffix(".exr")) for colour in given.base_colours]
    textured = TexturedSurface(given.surface, given.uv, textures, given.texture)
    stored, lit_by = read_transfer(job.inputs["transfer"]), read_surface_light(job.inputs["surface_light"])
    around = cameras_around(given.surface, read_cameras(job.inputs["cameras"]), job.settings)
    pictures = [folder / f"{camera.name}.png" for camera in around]
    with job.progress("frames", len(around)) as step:
        for camera, picture in zip(around, pictures, strict=True):
            frame = frame_of(textured, camera, stored, lit_by, job.settings.sheet_offset, job.threads)
            write_png_srgb8(picture, frame / lit_by.white)
            step()
    write_gif(folder / ANIMATION, pictures, job.settings.frames_per_second)
    job.note(frames=len(around), focal_px=round(around[0].focal_px, 2))


def cameras_around(surface: Surface, photos: list[Camera], how: TurntableSettings) -> list[Camera]:
    """Place a camera per frame; the first is on the side of the first photo."""
    import numpy as np

    from stages.scene.upright import upright_from_world
    from stages.synthetic.views import elevations_of, ring_of_views

    upright = upright_from_world(photos, how.upright_within_deg)
    shown = surface.vertices[np.unique(surface.faces)]  # a file's other vertices may be anywhere
    elevation_deg = how.elevation_deg
    if elevation_deg is None:
        elevation_deg = float(np.median(elevations_of(photos, shown.mean(axis=0), upright)))
    size = (how.side_px, how.side_px)
    first = photos[0].centre_in_world
    return ring_of_views(how.frames, first, elevation_deg, how.distance, shown, size, upright)


def frame_of(
    textured: TexturedSurface,
    camera: Camera,
    stored: StoredTransfer,
    light: StoredSurfaceLight,
    sheet_offset: float,
    threads: int,
) -> np.ndarray:
    """Render the radiance that a camera sees, (h, w, 3), float32, linear; 0 beside the model.

    As `relight` lights the views: visibility and interreflection are those of the nearest points of the mesh
    that the transfer was computed on, the cosine is the pixel's own.
    """
    import numpy as np

    from stages.photometry.transport.relighting import SurfaceLight, relit_points

    seen = textured.seen_by(camera, threads)
    points = transport_to(seen.points, seen.normals, stored, sheet_offset, threads)
    lit_by = SurfaceLight(light.sky, light.indirect, light.to_absolute)
    frame = np.zeros((*seen.mask.shape, 3), np.float32)
    frame[seen.mask], _ = relit_points(points, seen.texture, lit_by)
    return frame


def transport_to(
    points: np.ndarray, normals: np.ndarray, stored: StoredTransfer, sheet_offset: float, threads: int
) -> DirectionalTransport:
    """Build the transport of light from infinity to points, (n, 3), from what the proxy's vertices see."""
    import numpy as np

    from stages.formats.meshes.triangle_meshes import Surface
    from stages.geometry.decimation.proxy import blend_of
    from stages.geometry.settings import ProxySettings
    from stages.geometry.vertex_interpolation import blend_matrix
    from stages.photometry.transport.directional_transport import DirectionalTransport, offsets_in
    from stages.photometry.transport.pixel_transfer import without_opposed

    alone = Surface(points, np.zeros((0, 3), np.int32))
    how = ProxySettings(sheet_offset=sheet_offset)
    nearest = blend_of(alone, normals, Surface(stored.vertices, stored.faces), how, threads)
    blend, _ = without_opposed(normals, blend_matrix(*nearest, len(stored.vertices)), stored.normals)
    return DirectionalTransport.of(
        normals, offsets_in(None, points), blend, stored.visible[0], int(stored.directions)
    )


def in_words(facts: Mapping[str, Any]) -> str:
    """Tell in a few words what was found."""
    return f"{facts['frames']} frames"


TURNTABLE = Stage(
    name="turntable",
    version=3,
    about="The textured model under another light, from all around.",
    settings=TurntableSettings,
    takes=("textured_model", "cameras", "transfer", "surface_light"),
    gives=(Artefact("turntable", "frames, PNG, and the animation, GIF", output="turntable"),),
    run=run,
    tools=("numpy", "scipy", "numba", "llvmlite", "fast-simplification", *OPEN3D, *PICTURES),
    saves_memory="lower turntable.side_px",
    found=in_words,
)
