"""Results of many views on disk as the stage `report` takes them: a few views of a street, repeated by links.

A hundred views of six megapixels would take tens of gigabytes. The files of a few are linked under the names
of all: what it costs to read, reduce and compress them is the same.
"""

from __future__ import annotations

import json
import os
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np
import trimesh

from benchmarks.scale.daylight import sun_directions
from benchmarks.scale.photo_set import SHOT_NOISE, WHITE
from benchmarks.scale.street import Street, build_street
from stages.formats.artefacts.camera_file import write_cameras
from stages.formats.artefacts.correspondence_files import write_matrix
from stages.formats.images.exr import write_exr
from stages.formats.images.photos import write_mask
from stages.formats.meshes.triangle_meshes import Surface, write_mesh
from stages.geometry.covisibility.correspondences import find_correspondences
from stages.geometry.rays import RayCaster, Seen
from stages.scene.cameras import Camera, back_project
from stages.synthetic.sensor_noise import with_sensor_noise

MAPS = ("linear", "depth", "normal", "albedo", "shading", "confidence")
SUN, SKY = np.array([0.9, 0.85, 0.75], np.float32), np.array([0.15, 0.18, 0.24], np.float32)
ALBEDO_NOISE = 0.3  # of the albedo, as a multiple of the photo's: an estimate is smoother than a photo
EPSILON = 3.0  # footprints, as of the stage `correspondence`
NEIGHBOURS = 8  # views after each that are linked to it
COARSER = (
    3  # paint than pixels, each way, and so as fine as that of pictures in the page; it takes minutes else
)
SUBDIVISIONS = 2  # of the street's mesh, so that it is as fine as that of a real scene
FINISHED = "finished"


def repeated_views(folder: Path, views: int, distinct: int, width_px: int, height_px: int) -> dict[str, Path]:
    """Make the results in a folder, unless they are there; returns their places by artefact."""
    places = {kind: folder / kind for kind in (*MAPS, "mask", "correspondences")}
    places |= {
        "cameras": folder / "cameras.json",
        "mesh": folder / "mesh.ply",
        "scales": folder / "scales.json",
    }
    if (folder / FINISHED).exists():
        return places
    coarse = build_street(distinct, width_px // COARSER, height_px // COARSER)
    street = replace(coarse, cameras=[camera.scaled(width_px, height_px) for camera in coarse.cameras])
    names = [f"{number:04d}" for number in range(views)]
    seen = [_write_maps(street, number, places) for number in range(distinct)]
    _repeat_maps(places, names, distinct)
    _write_links(places["correspondences"], street.cameras, seen, names)
    cameras = [replace(street.cameras[n % distinct], name=name) for n, name in enumerate(names)]
    write_cameras(places["cameras"], cameras)
    write_mesh(places["mesh"], _finer(street.surface))
    white = {"albedo": 0.9, "shading": float((SUN + SKY).max())}
    places["scales"].write_text(json.dumps({"png_white": white}), encoding="utf-8")
    (folder / FINISHED).touch()
    return places


def _write_maps(street: Street, number: int, places: dict[str, Path]) -> Seen:
    """Write what a view shows; its photo and albedo have noise, for noise is what compresses worst."""
    camera = street.cameras[number]
    seen = RayCaster(street.surface).see(camera)
    albedo = np.zeros((*camera.shape, 3), np.float32)
    albedo[seen.mask] = street.albedo(back_project(camera, seen.depth)[seen.mask])
    cosine = np.maximum(seen.normals @ sun_directions().mean(axis=0), 0)[..., None]
    shading = ((cosine * SUN + SKY) * seen.mask[..., None]).astype(np.float32)
    maps = {
        "linear": with_sensor_noise(albedo * shading / WHITE, 0.0, SHOT_NOISE, seed=number) * WHITE,
        "depth": seen.depth,
        "normal": seen.normals,
        "albedo": with_sensor_noise(albedo, 0.0, ALBEDO_NOISE * SHOT_NOISE, seed=number),
        "shading": shading,
        "confidence": (0.5 + 0.5 * cosine[..., 0]).astype(np.float32) * seen.mask,
    }
    for kind, values in maps.items():
        write_exr(places[kind] / f"{camera.name}.exr", values, is_colour=kind != "normal")
    write_mask(places["mask"] / f"{camera.name}.png", seen.mask)
    return seen


def _repeat_maps(places: dict[str, Path], names: Sequence[str], distinct: int) -> None:
    """Link the maps of the first views under the names of the others."""
    for kind in (*MAPS, "mask"):
        for number, name in enumerate(names[distinct:], distinct):
            suffix = "png" if kind == "mask" else "exr"
            link = places[kind] / f"{name}.{suffix}"
            link.unlink(missing_ok=True)
            os.link(places[kind] / f"{names[number % distinct]}.{suffix}", link)


def _write_links(folder: Path, cameras: Sequence[Camera], seen: Sequence[Seen], names: Sequence[str]) -> None:
    """Write the links of distinct views, and an index in which every view has neighbours."""
    folder.mkdir(parents=True, exist_ok=True)
    links, rows = {}, []
    for i in range(len(names)):
        for j in range(i + 1, min(i + 1 + NEIGHBOURS, len(names))):
            pair = a, b = i % len(cameras), j % len(cameras)
            if a == b:
                continue
            if pair not in links:
                one, other = ((cameras[n], seen[n].depth, seen[n].mask) for n in pair)
                matrix = find_correspondences(*one, *other, epsilon=EPSILON)
                write_matrix(folder / f"{a}_{b}.npz", matrix)
                links[pair] = int(matrix.nnz)
            rows.append({"i": names[i], "j": names[j], "file": f"{a}_{b}.npz", "links": links[pair]})
    (folder / "index.json").write_text(json.dumps(rows), encoding="utf-8")


def _finer(surface: Surface) -> Surface:
    """Divide every face into four, some times."""
    vertices, faces = surface.vertices, surface.faces
    for _ in range(SUBDIVISIONS):
        vertices, faces = trimesh.remesh.subdivide(vertices, faces)
    return Surface(np.asarray(vertices, np.float64), np.asarray(faces, np.int32))
