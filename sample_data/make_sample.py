"""Render `sample_data` again from code: `python sample_data/make_sample.py [--samples 121] [--to FOLDER]`."""

from __future__ import annotations

import argparse
import json
from dataclasses import asdict
from pathlib import Path

import numpy as np
from PIL import Image

from stages.formats.colmap.model import pinhole_model
from stages.formats.images.exr import write_exr
from stages.formats.images.photos import encode_srgb8
from stages.formats.meshes.triangle_meshes import Surface
from stages.geometry.occluders import distances_to
from stages.scene.cameras import Camera, footprint
from stages.synthetic.render import Quality, Scene
from stages.synthetic.sample import (
    DISTANCE,
    SampleScene,
    compact_mesh,
    exposure,
    halved,
    rounded,
    sample_scene,
)
from stages.synthetic.subjects.small_ply import write_compact_ply
from stages.synthetic.truth import PaintedSurface, Truth

LINEAR_VIEWS = ("001", "003", "004", "009")
JPEG_QUALITY = 96


def main() -> None:
    """Render, measure, write; a line per step, since it takes minutes."""
    arguments = _arguments()
    print("mesh and paint", flush=True)
    scene = sample_scene(quality=Quality(samples=arguments.samples))
    surface = PaintedSurface(scene.bust.surface, scene.albedo)
    truths = [surface.truth(camera) for camera in scene.cameras]
    mesh = compact_mesh(scene.bust.surface, faces=50_000)
    images, noise = _photograph(scene, truths)
    scale = exposure(images, [truth.mask for truth in truths])
    write_photos(arguments.to, scene.cameras, images, scale)
    write_truth(arguments.to, scene, truths, mesh, scale)
    write_linear(arguments.to, scene.cameras, images, truths, scale)
    figures = _figures(scene, mesh, truths, noise, scale)
    (arguments.to / "truth" / "figures.json").write_text(
        json.dumps(figures, indent=1) + "\n", encoding="utf-8"
    )
    print(json.dumps(figures, indent=1))


def _arguments() -> argparse.Namespace:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--samples", type=int, default=121, help="per pixel and light")
    parser.add_argument("--to", type=Path, default=Path(__file__).parent)
    return parser.parse_args()


def _photograph(scene: SampleScene, truths: list[Truth]) -> tuple[list[np.ndarray], float]:
    """All views, and the noise: RMS difference of one view's two renders over √2, divided by the mean."""
    tracer = Scene(scene.bust.surface, scene.albedo, scene.light)
    images = []
    for index, camera in enumerate(scene.cameras):
        print(f"view {camera.name} of {len(scene.cameras)}", flush=True)
        images.append(tracer.photograph(camera, scene.quality, seed=index))
    print("one half-size view twice more, for the noise", flush=True)
    camera = scene.cameras[2].scaled(scene.cameras[2].width // 2, scene.cameras[2].height // 2)
    mask = halved(truths[2].mask.astype(np.float32))[..., 0] == 1
    first, second = (tracer.photograph(camera, scene.quality, seed=seed)[mask] for seed in (1001, 1002))
    return images, float(np.sqrt(np.mean((first - second) ** 2) / 2) / first.mean())


def write_photos(to: Path, cameras: list[Camera], images: list[np.ndarray], scale: float) -> None:
    """8-bit sRGB photographs, all at one exposure, as a camera would leave them."""
    (to / "photos").mkdir(parents=True, exist_ok=True)
    for camera, image in zip(cameras, images, strict=True):
        photo = Image.fromarray(encode_srgb8(image * scale))
        photo.save(to / "photos" / f"{camera.name}.jpg", quality=JPEG_QUALITY, subsampling=0)


def write_truth(to: Path, scene: SampleScene, truths: list[Truth], mesh: Surface, scale: float) -> None:
    """Cameras, mesh, albedo per view, and the light in the photos' exposure."""
    truth = to / "truth"
    _write_model(truth / "sparse", scene.cameras, ".jpg")
    write_compact_ply(truth / "mesh.ply", mesh.vertices, mesh.faces)
    for camera, view in zip(scene.cameras, truths, strict=True):
        write_exr(truth / "albedo" / f"{camera.name}.exr", rounded(view.albedo), half=True)
    light = {"exposure": scale, "before_exposure": asdict(scene.light)}
    (truth / "light.json").write_text(json.dumps(light, indent=1) + "\n", encoding="utf-8")


def write_linear(
    to: Path, cameras: list[Camera], images: list[np.ndarray], truths: list[Truth], scale: float
) -> None:
    """A few views at half size as linear EXR, with their own model and albedo: the entry without SfM."""
    small = []
    for camera, image, truth in zip(cameras, images, truths, strict=True):
        if camera.name not in LINEAR_VIEWS:
            continue
        small.append(camera.scaled(camera.width // 2, camera.height // 2))
        inside = halved(truth.mask.astype(np.float32)) == 1
        write_exr(to / "linear" / "images" / f"{camera.name}.exr", halved(image * scale), half=True)
        write_exr(
            to / "linear" / "albedo" / f"{camera.name}.exr", rounded(halved(truth.albedo) * inside), half=True
        )
    _write_model(to / "linear" / "sparse", small, ".exr")


def _write_model(folder: Path, cameras: list[Camera], extension: str) -> None:
    folder.mkdir(parents=True, exist_ok=True)
    pinhole_model(cameras, extension=extension).write_binary(folder)


def _figures(scene: SampleScene, mesh: Surface, truths: list[Truth], noise: float, scale: float) -> dict:
    """What the README of the sample quotes."""
    deviation = distances_to(mesh, scene.bust.surface.vertices) / footprint(scene.cameras[0], DISTANCE)
    return {
        "rendered_faces": len(scene.bust.surface.faces),
        "mesh_faces": len(mesh.faces),
        "mesh_deviation_footprints": {
            "mean": round(float(deviation.mean()), 4),
            "p95": round(float(np.quantile(deviation, 0.95)), 4),
            "p99": round(float(np.quantile(deviation, 0.99)), 4),
            "max": round(float(deviation.max()), 3),
        },
        "samples_per_pixel_and_light": scene.quality.samples,
        "reflections": scene.quality.reflections,
        "noise_over_mean": round(noise, 4),
        "exposure": scale,
        "covered_by_object": round(float(np.mean([truth.mask.mean() for truth in truths])), 3),
    }


if __name__ == "__main__":
    main()
