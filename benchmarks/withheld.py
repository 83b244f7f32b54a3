"""Shadows of walls that the mesh does not have: ``python -m benchmarks.withheld [--views 12]``.

A courtyard under sun and sky, by rays of our own, without one of its two arcades in the given mesh: its
shadow falls on the ground and on the back wall. Printed for albedo with and without `lighting.sun.shadows`:
the si-RMSE, and how much of the contrast of those shadows' edges is left, 1 in the photos, 0 at best.
Photos, truth and workspaces are kept in ``workspaces/withheld``; a picture is written to ``docs/accuracy``.
"""

from __future__ import annotations

import argparse
import os
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path

os.environ["OPENBLAS_NUM_THREADS"] = "1"  # before numpy: more threads sum in another order

import numpy as np  # noqa: E402

from benchmarks.scale.albedo_error import albedo_error  # noqa: E402
from benchmarks.scale.daylight import Daylight  # noqa: E402
from benchmarks.scale.growth import run_program  # noqa: E402
from benchmarks.scale.photo_set import (  # noqa: E402
    FINISHED,
    SHOT_NOISE,
    WHITE,
    PhotoSet,
    daylight_on,
    interpolated,
)
from stages.formats.colmap.model import pinhole_model, write_model  # noqa: E402
from stages.formats.images.contact_sheet import contact_sheet  # noqa: E402
from stages.formats.images.exr import read_exr  # noqa: E402
from stages.formats.images.photos import (  # noqa: E402
    encode_srgb8,
    read_mask,
    read_photo,
    write_mask,
    write_png8,
    write_png_srgb8,
)
from stages.formats.meshes.triangle_meshes import Surface, write_mesh  # noqa: E402
from stages.geometry.occluders import Occluders  # noqa: E402
from stages.geometry.rays import RayCaster  # noqa: E402
from stages.geometry.surface import with_faces  # noqa: E402
from stages.scene.cameras import Camera, back_project  # noqa: E402
from stages.synthetic.paints.natural_paint import natural_paint  # noqa: E402
from stages.synthetic.paints.textures.pattern import Scale  # noqa: E402
from stages.synthetic.sensor_noise import with_sensor_noise  # noqa: E402
from stages.synthetic.subjects.architecture import build_courtyard  # noqa: E402
from stages.synthetic.views import arc_of_views, framed  # noqa: E402

ROOT = Path(__file__).resolve().parent.parent
SPACING = 0.005  # of the mesh's grid, model units
PAINT, CONTRAST = "rubble", 0.25
ELEVATIONS_DEG, ARC_DEG, DISTANCE = (18.0, 32.0), 50.0, 2.0
WHITEST = 0.99  # quantile that is shown white
ACROSS = (2, 4, 8)  # px: pairs of pixels whose contrast is compared
VARIANTS = {"without": ["--set", "lighting.sun.shadows.find=false"], "with": []}


@dataclass(frozen=True, eq=False)
class Courtyard:
    """A courtyard with all its walls; `shown`, (F,) bool, are the faces that the given mesh has."""

    surface: Surface
    shown: np.ndarray
    albedo: np.ndarray
    cameras: list[Camera]

    @property
    def given(self) -> Surface:
        """The mesh without what is withheld."""
        return with_faces(self.surface, self.shown)


def main(argv: Sequence[str] | None = None) -> None:
    """Render, run and print."""
    parser = argparse.ArgumentParser(description=__doc__.split("\n\n")[0])
    parser.add_argument("--views", type=int, default=12)
    parser.add_argument("--size", default="640x480")
    parser.add_argument("--workspace", type=Path, default=ROOT / "workspaces" / "withheld")
    parser.add_argument("--picture", type=Path, default=ROOT / "docs" / "accuracy" / "withheld.png")
    given = parser.parse_args(argv)
    photos = PhotoSet(given.workspace, given.views)
    if not (photos.folder / FINISHED).exists():
        render(photos, build(given.views, *map(int, given.size.split("x"))))
    for name, settings in VARIANTS.items():
        workspace = photos.folder / name
        inputs = ["--images", photos.photos, "--masks", photos.folder / "masks", "--colmap", photos.model]
        inputs += ["--mesh", photos.mesh, "--workspace", workspace, "--set", "undistort.max_size_px=null"]
        run_program([*map(str, inputs), *settings])
        error = albedo_error(photos, workspace / "output" / "albedo").si_rmse
        left = contrast_left(photos, workspace / "output" / "albedo")
        print(f"{name} search: si-RMSE {' '.join(f'{one:.4f}' for one in error)}, contrast left {left:.2f}")
    write_png8(given.picture, picture_of(photos))


def picture_of(photos: PhotoSet) -> np.ndarray:
    """Put a photo, the albedos with and without the search and the true one side by side: sRGB, 8 bits."""
    name = f"{photos.views // 2:03d}"
    mask = read_mask(photos.folder / "masks" / f"{name}.png")
    box = tuple(slice(at.min(), at.max() + 1) for at in np.nonzero(mask))
    shown = [read_photo(photos.photos / f"{name}.png")]
    shown += [read_exr(photos.folder / one / "output" / "albedo" / f"{name}.exr") for one in VARIANTS]
    shown += [photos.true_albedo(name).astype(np.float32)]
    pictures = [encode_srgb8((one / np.quantile(one[mask], WHITEST) * mask[..., None])[box]) for one in shown]
    heads = ["photo", *(f"albedo {one} search" for one in VARIANTS), "true albedo"]
    return contact_sheet({name: pictures}, heads, 300)


def build(views: int, width_px: int, height_px: int, spacing: float = SPACING) -> Courtyard:
    """Build the courtyard; its left arcade, where the sun stands, is withheld."""
    built = build_courtyard(spacing)
    points, arcades = built.surface.vertices, built.part_names.index("arcades")
    withheld = (built.parts == arcades) & (points[:, 0] < 0)
    albedo = natural_paint(PAINT, points, Scale(3 * spacing, 0.5), CONTRAST, seed=1)
    azimuths = np.linspace(-ARC_DEG / 2, ARC_DEG / 2, views)
    elevations = [ELEVATIONS_DEG[number % len(ELEVATIONS_DEG)] for number in range(views)]
    middle = (points.min(axis=0) + points.max(axis=0)) / 2
    cameras = arc_of_views(azimuths, elevations, DISTANCE, middle, (width_px, height_px), float(width_px))
    shown = ~withheld[built.surface.faces].all(axis=1)
    return Courtyard(built.surface, shown, albedo, framed(cameras, points))


def render(photos: PhotoSet, yard: Courtyard) -> None:
    """Write photos, masks of what the given mesh shows, cameras, mesh and truth."""
    for folder in ("truth", "withheld", "masks"):
        (photos.folder / folder).mkdir(parents=True, exist_ok=True)
    write_mesh(photos.mesh, yard.given)
    write_model(pinhole_model(yard.cameras), photos.model)
    surface, known = yard.surface, Occluders(yard.given)
    caster, light = RayCaster(surface), daylight_on(surface, yard.albedo)
    for number, camera in enumerate(yard.cameras):
        seen = caster.see(camera)
        shown = seen.mask.copy()
        shown[seen.mask] = yard.shown[seen.triangles[seen.mask]]
        own = replace(seen, mask=shown)
        albedo, sky = (interpolated(own, surface, values) for values in (yard.albedo, light.skylight))
        places, towards = back_project(camera, seen.depth)[shown], seen.normals[shown]
        sun = light.sunlight((places - light.occluders.origin).astype(np.float32), towards)
        by_given = Daylight(known, light.skylight).sunlight(
            (places - known.origin).astype(np.float32), towards
        )
        image, truth, hidden = (np.zeros((*camera.shape, 3), np.float32) for _ in range(3))
        image[shown], truth[shown] = albedo * (sky + sun), albedo
        hidden[shown] = np.log((sky + by_given) / (sky + sun))  # contrast that no wall of the mesh explains
        noisy = with_sensor_noise(image / WHITE, 0.0, SHOT_NOISE, seed=number)
        write_png_srgb8(photos.photos / f"{camera.name}.png", noisy)
        write_mask(photos.folder / "masks" / f"{camera.name}.png", shown)
        np.save(photos.folder / "truth" / f"{camera.name}.npy", truth.astype(np.float16))
        np.save(photos.folder / "withheld" / f"{camera.name}.npy", hidden.astype(np.float16))
    (photos.folder / FINISHED).touch()


def contrast_left(photos: PhotoSet, albedo: Path) -> float:
    """Fit the share of the withheld walls' shadow that the log albedo has, over pairs of pixels nearby."""
    products = squares = 0.0
    for file in sorted(albedo.glob("*.exr")):
        truth, found = photos.true_albedo(file.stem).astype(np.float32), read_exr(file)
        stored = np.load(photos.folder / "withheld" / f"{file.stem}.npy", allow_pickle=False)
        hidden = stored.astype(np.float32)
        inside = (truth > 0).all(axis=2) & (found > 0).all(axis=2)
        wrong = np.log(np.where(inside[..., None], found, 1) / np.where(inside[..., None], truth, 1))
        for far in ACROSS:
            for one, two in ((np.s_[far:], np.s_[:-far]), (np.s_[:, far:], np.s_[:, :-far])):
                both = inside[one] & inside[two]
                shadow = (hidden[two] - hidden[one])[both]
                products += float(np.sum(shadow * (wrong[one] - wrong[two])[both]))
                squares += float(np.sum(shadow**2))
    return products / squares


if __name__ == "__main__":
    main()
