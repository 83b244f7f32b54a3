"""Normals of smoothed meshes, refined: ``python -m benchmarks.refined_normals [--scenes bust-wood]``.

Subjects in natural paint under a sun and a sky, by rays of our own, ten noisy 8-bit photos each. The exact
mesh is smoothed by so many Laplacian steps and refined with the defaults of the stage `refine`. Printed:
median, 90 % and mean of the angles between the normals of the views and the true ones, before and after.
Scans need ``UNSHADE_DATA``; without it only subjects of our own are taken. ``key=value`` after ``--`` sets
settings of the stage, as in ``-- roughness.tail=1``.
"""

from __future__ import annotations

import argparse
import os
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

os.environ["OPENBLAS_NUM_THREADS"] = "1"  # before numpy: more threads sum in another order

import numpy as np  # noqa: E402

from benchmarks.accuracy.natural import OWN_SUBJECTS  # noqa: E402
from benchmarks.accuracy.scenes import SCANS  # noqa: E402
from benchmarks.paper.tables import markdown  # noqa: E402
from benchmarks.scale.daylight import Daylight  # noqa: E402
from benchmarks.scale.growth import own_and_further  # noqa: E402
from benchmarks.scale.photo_set import SHOT_NOISE, daylight_on, interpolated, shading_seen  # noqa: E402
from pipeline.config import check_settings, override  # noqa: E402
from stages.formats.colour.srgb import linear_from_srgb  # noqa: E402
from stages.formats.images.photos import encode_srgb8  # noqa: E402
from stages.formats.images.resize import reduce_by_area  # noqa: E402
from stages.formats.meshes.triangle_meshes import Surface, read_mesh  # noqa: E402
from stages.geometry.rays import RayCaster  # noqa: E402
from stages.scene.cameras import Camera  # noqa: E402
from stages.stereo.refinement.compared_photos import radiance  # noqa: E402
from stages.stereo.refinement.refined_surface import refine, remeshed, widest_relief  # noqa: E402
from stages.stereo.refinement.settings import RefineSettings  # noqa: E402
from stages.stereo.refinement.view_pairs import sources_of_views  # noqa: E402
from stages.synthetic import staging  # noqa: E402
from stages.synthetic.render_settings import RenderSettings  # noqa: E402
from stages.synthetic.sensor_noise import with_sensor_noise  # noqa: E402
from stages.synthetic.subjects.smoothing import laplacian_smoothing  # noqa: E402
from stages.synthetic.subjects.subject import (  # noqa: E402
    Subject,
    built_subject,
    bust_subject,
    mesh_subject,
)

SCENES: dict[str, dict[str, Any]] = {  # subject, paint
    "relief-stains": {"subject": "relief", "paint": "stains", "contrast": 0.2, "paint_seed": 7},
    "relief-masonry": {"subject": "relief", "paint": "masonry", "contrast": 0.3, "paint_seed": 1},
    "courtyard-quilt": {"subject": "courtyard", "paint": "quilt", "contrast": 0.2, "paint_seed": 3},
    "courtyard-fractal": {"subject": "courtyard", "paint": "fractal", "contrast": 0.3, "paint_seed": 5},
    "bust-wood": {"subject": "bust", "paint": "wood", "contrast": 0.35, "paint_seed": 6},
    "plato-rust_and_moss": {"subject": "plato", "paint": "rust_and_moss", "contrast": 0.3, "paint_seed": 13},
    "gutenberg-masonry": {"subject": "gutenberg", "paint": "masonry", "contrast": 0.15, "paint_seed": 1},
}
VIEWS, PARTS = 10, 4
RAYS = 2  # of a pixel, along a side
WHOLE = 0.99  # share of a pixel that shows the subject, at least
HEADROOM = 1.1  # white over the brightest hundredth of a photo
QUANTILES = (0.5, 0.9)
THREADS = 2


@dataclass(frozen=True, eq=False)
class Photographed:
    """A subject's exact mesh; of each view its camera, linear photo, mask of whole pixels, true normals."""

    mesh: Surface
    cameras: list[Camera]
    photos: dict[str, np.ndarray]
    masks: dict[str, np.ndarray]
    normals: dict[str, np.ndarray]


def main(argv: Sequence[str] | None = None) -> None:
    """Render, smooth, refine, and print a table."""
    own, further = own_and_further(argv)
    data = Path(os.environ["UNSHADE_DATA"]) if "UNSHADE_DATA" in os.environ else None
    at_hand = [name for name, scene in SCENES.items() if data or scene["subject"] in OWN_SUBJECTS]
    parser = argparse.ArgumentParser(description=__doc__.split("\n\n")[0])
    parser.add_argument("--scenes", default=",".join(at_hand), help="of " + ", ".join(SCENES))
    parser.add_argument("--smoothing", default="10,20", help="steps, comma-separated")
    parser.add_argument("--size", type=int, default=480, help="of the square photos, px")
    given = parser.parse_args(own)
    settings, rows = settings_of(further), []
    for name in given.scenes.split(","):
        photographed = photograph(SCENES[name], given.size, data)
        for steps in map(int, given.smoothing.split(",")):
            smoothed = laplacian_smoothing(photographed.mesh, steps)
            before = angles_deg(photographed, smoothed)
            after = angles_deg(photographed, refined(photographed, smoothed, settings))
            change = " ".join(f"{100 * ratio:+.0f} %" for ratio in after / before - 1)
            rows.append([name, str(steps), _in_words(before), _in_words(after), change])
            print(*rows[-1], sep=" | ", flush=True)
    heads = ["scene", "steps", "smoothed, °: median, 90 %, mean", "refined", "change"]
    print(markdown(heads, rows))


def settings_of(assignments: Sequence[str]) -> RefineSettings:
    """Set the stage's settings from ``group.key=value``."""
    given = override({}, (f"refine.{assignment}" for assignment in assignments))
    settings = check_settings({"refine": RefineSettings}, given)["refine"]
    assert isinstance(settings, RefineSettings)
    return settings


def photograph(scene: dict[str, Any], size: int, data: Path | None) -> Photographed:
    """Render a scene's photos, (size, size), of 8 bits, with shot noise; linearised again."""
    subject, settings = _subject(scene, size, data)
    cameras = staging.cameras_of(settings, subject)
    footprint = staging.footprint_of(cameras, subject.centre)
    fine = staging.with_room_for_paint(settings, subject, footprint)
    albedo = staging.paint_of(settings, fine, None, footprint)[0].astype(np.float32)
    daylight, caster = daylight_on(fine.surface, albedo), RayCaster(fine.surface)
    found = Photographed(subject.surface, cameras, {}, {}, {})
    for number, camera in enumerate(cameras):
        image, covered = _render(fine.surface, albedo, daylight, caster, camera)
        mask = covered == 1
        white = HEADROOM * np.quantile(image[mask], 0.99)
        noisy = with_sensor_noise(image / white, 0.0, SHOT_NOISE, seed=number)
        found.photos[camera.name] = linear_from_srgb(encode_srgb8(noisy) / 255).astype(np.float32)
        found.masks[camera.name] = mask
        found.normals[camera.name] = caster.see(camera).normals
    return found


def refined(scene: Photographed, given: Surface, settings: RefineSettings) -> Surface:
    """Refine a mesh by a scene's photos, as the stage does."""

    def radiance_at(camera: Camera) -> np.ndarray:
        image = reduce_by_area(scene.photos[camera.name], camera.shape)
        covered = reduce_by_area(scene.masks[camera.name].astype(np.float32)[..., None], camera.shape)
        return radiance(image, covered[..., 0] > WHOLE, settings.errors)

    surface = remeshed(given, scene.cameras, settings)
    sources = sources_of_views(surface, scene.cameras, settings.neighbours, settings.pairs, THREADS)
    widest = widest_relief(given, scene.cameras, settings)
    for last in refine(surface, widest, scene.cameras, sources, radiance_at, settings, THREADS):
        surface = last.surface
    return surface


def angles_deg(scene: Photographed, mesh: Surface) -> np.ndarray:
    """Measure the angles between a mesh's normals and the true ones: median, 90 %, mean of all pixels, °."""
    caster, angles = RayCaster(mesh), []
    for camera in scene.cameras:
        seen, truth = caster.see(camera), scene.normals[camera.name]
        both = seen.mask & scene.masks[camera.name]
        angles.append(angles_between(seen.normals[both], truth[both]))
    return summary_of(angles)


def angles_between(normals: np.ndarray, others: np.ndarray) -> np.ndarray:
    """Measure the angles between unit vectors, (n, 3) each, °, (n,)."""
    cosines = np.einsum("nk,nk->n", normals, others)
    return np.rad2deg(np.arccos(np.clip(cosines, -1, 1)))


def summary_of(angles: Iterable[np.ndarray]) -> np.ndarray:
    """Summarise the angles of views: median, 90 % and mean of all pixels."""
    every = np.concatenate(list(angles))
    return np.array([*np.quantile(every, QUANTILES), every.mean()])


def _subject(scene: dict[str, Any], size: int, data: Path | None) -> tuple[Subject, RenderSettings]:
    kind, views = scene["subject"], {"views": VIEWS, "width_px": size, "height_px": size}
    if kind not in OWN_SUBJECTS:
        if data is None:
            raise SystemExit(f"The scan {kind} needs the test data: set UNSHADE_DATA to their folder.")
        paint = {key: value for key, value in scene.items() if key != "subject"}
        settings = RenderSettings(y_up=True, **paint, **views)
        return mesh_subject(read_mesh(data / SCANS[kind]), PARTS, settings.y_up), settings
    settings = RenderSettings(**OWN_SUBJECTS[kind], **scene, **views)
    own = bust_subject(settings.spacing) if kind == "bust" else built_subject(kind, settings.spacing)
    return own, settings


def _render(
    surface: Surface, albedo: np.ndarray, daylight: Daylight, caster: RayCaster, camera: Camera
) -> tuple[np.ndarray, np.ndarray]:
    """Average several rays of each pixel: radiance, (h, w, 3), and share that meets the subject, (h, w)."""
    fine = camera.scaled(RAYS * camera.width, RAYS * camera.height)
    seen = caster.see(fine)
    image = np.zeros((*fine.shape, 3), np.float32)
    image[seen.mask] = interpolated(seen, surface, albedo) * shading_seen(seen, fine, surface, daylight)
    covered = seen.mask[..., None].astype(np.float32)
    return reduce_by_area(image, camera.shape), reduce_by_area(covered, camera.shape)[..., 0]


def _in_words(angles: np.ndarray) -> str:
    return " ".join(f"{angle:.2f}" for angle in angles)


if __name__ == "__main__":
    main()
