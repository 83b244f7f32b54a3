"""A street as a user has it: photos, a COLMAP model, a mesh; and the true albedo of every view."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np

from benchmarks.scale.daylight import Daylight
from benchmarks.scale.street import Street, build_street
from stages.formats.colmap.model import pinhole_model, write_model
from stages.formats.images.photos import write_png_srgb8
from stages.formats.meshes.triangle_meshes import Surface, write_mesh
from stages.geometry.occluders import Occluders
from stages.geometry.rays import RayCaster, Seen, vertex_normals
from stages.scene.cameras import Camera, back_project
from stages.synthetic.sensor_noise import with_sensor_noise

WHITE = 1.1  # radiance that is white in the photos: a card that faces the sun shows about 1
SHOT_NOISE = 0.01  # deviation at white
FINISHED = "finished"


@dataclass(frozen=True)
class PhotoSet:
    """Folders and files of a street.

    Attributes
    ----------
    folder : Path
    views : int
    """

    folder: Path
    views: int

    @property
    def photos(self) -> Path:
        """8-bit sRGB photos."""
        return self.folder / "photos"

    @property
    def model(self) -> Path:
        """COLMAP model of the cameras."""
        return self.folder / "sparse"

    @property
    def mesh(self) -> Path:
        """Exact mesh."""
        return self.folder / "mesh.ply"

    def true_albedo(self, name: str) -> np.ndarray:
        """Read the albedo of a view, (h, w, 3), float16; 0 where there is no wall."""
        return np.load(self.folder / "truth" / f"{name}.npy", allow_pickle=False)


def photo_set(folder: Path, views: int, width_px: int, height_px: int) -> PhotoSet:
    """Make a street's photos in the folder, unless they are there."""
    made = PhotoSet(folder, views)
    if (folder / FINISHED).exists():
        return made
    street = build_street(views, width_px, height_px)
    (folder / "truth").mkdir(parents=True, exist_ok=True)
    write_mesh(made.mesh, street.surface)
    write_model(pinhole_model(street.cameras), made.model)
    caster, daylight = (
        RayCaster(street.surface),
        daylight_on(street.surface, street.albedo(street.surface.vertices)),
    )
    for number, camera in enumerate(street.cameras):
        image, albedo = _photograph(street, caster, daylight, camera)
        noisy = with_sensor_noise(image / WHITE, 0.0, SHOT_NOISE, seed=number)
        write_png_srgb8(made.photos / f"{camera.name}.png", noisy)
        np.save(folder / "truth" / f"{camera.name}.npy", albedo.astype(np.float16))
    (folder / FINISHED).touch()
    return made


def daylight_on(surface: Surface, albedo: np.ndarray) -> Daylight:
    """Light a mesh, whose vertices have an albedo, (V, 3), and which hides the light from itself."""
    occluders = Occluders(surface)
    points = (surface.vertices - occluders.origin).astype(np.float32)
    normals = vertex_normals(surface.vertices - occluders.origin, surface.faces)
    return Daylight.of(occluders, points, normals, albedo)


def interpolated(seen: Seen, surface: Surface, values: np.ndarray) -> np.ndarray:
    """Interpolate values of vertices, (V, 3), at the masked pixels, (n, 3)."""
    u, v = seen.barycentric[seen.mask].T[:, :, None]
    a, b, c = (values[corner] for corner in surface.faces[seen.triangles[seen.mask]].T)
    return (1 - u - v) * a + u * b + v * c


def shading_seen(seen: Seen, camera: Camera, surface: Surface, daylight: Daylight) -> np.ndarray:
    """Compute the shading of a surface at the masked pixels, (n, 3)."""
    points, normals = back_project(camera, seen.depth)[seen.mask], seen.normals[seen.mask]
    relative = (points - daylight.occluders.origin).astype(np.float32)
    return interpolated(seen, surface, daylight.skylight) + daylight.sunlight(relative, normals)


def _photograph(
    street: Street, caster: RayCaster, daylight: Daylight, camera: Camera
) -> tuple[np.ndarray, np.ndarray]:
    """Render radiance and albedo of a view, (h, w, 3) each, linear, 0 where there is no wall."""
    seen = caster.see(camera)
    image, albedo = np.zeros((2, *camera.shape, 3), np.float32)
    albedo[seen.mask] = street.albedo(back_project(camera, seen.depth)[seen.mask])
    image[seen.mask] = albedo[seen.mask] * shading_seen(seen, camera, street.surface, daylight)
    return image, albedo
