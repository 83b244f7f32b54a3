"""A lit ball in a few views, the stage `report` on it, and the page: all that a report needs, in seconds."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path

import numpy as np

from pipeline.cache.record import Record
from pipeline.request import Result
from stages.formats.artefacts.camera_file import write_cameras
from stages.formats.artefacts.correspondence_files import write_matrix
from stages.formats.artefacts.light_npz import StoredLight, write_light
from stages.formats.artefacts.lighting_json import LightAround
from stages.formats.images.exr import write_exr
from stages.formats.images.photos import write_mask
from stages.formats.meshes.triangle_meshes import write_mesh
from stages.report import REPORT
from stages.reporting.document.page import summary
from stages.scene.cameras import Camera
from stages.texture import TEXTURE
from tests.rendered_scene import ball
from tests.sphere_scene import PAINTS, SphereScene, sphere_scene

NAMES = ("<script>alert(1)</script>", 'b" onerror="alert(2)', "c&amp;</title>", "Größe/höher")
KEY = "0" * 32
WHITE = float(PAINTS.max())


def written_scene(folder: Path, names: tuple[str, ...] = NAMES, side: int = 96) -> dict[str, Path]:
    """Write what the stage takes: photos are paint × shading; the last is twice as bright."""
    scene = sphere_scene(len(names), side, side, turn_deg=0.0)
    cameras = [replace(camera, name=name) for camera, name in zip(scene.cameras, names, strict=True)]
    kinds = ("linear", "mask", "depth", "normal", "albedo", "shading", "confidence")
    places = {kind: folder / kind for kind in kinds}
    for number, camera in enumerate(cameras):
        gain = 2 if number == len(cameras) - 1 else 1
        mask, shading = scene.masks[number], gain * np.repeat(scene.shadings[number][..., None], 3, axis=2)
        maps = {
            "linear": scene.albedos[number] * shading,
            "depth": scene.depths[number],
            "normal": np.where(mask[..., None], scene.normals[number], 0),
            "albedo": scene.albedos[number],
            "shading": shading,
            "confidence": np.where(mask, 0.9, 0.0),
        }
        for kind, values in maps.items():
            write_exr(places[kind] / f"{camera.name}.exr", values.astype(np.float32))
        write_mask(places["mask"] / f"{camera.name}.png", mask)
    places |= _further_files(folder, scene, cameras)
    return places


def _further_files(folder: Path, scene: SphereScene, cameras: list[Camera]) -> dict[str, Path]:
    """Write what is not a map of a view."""
    places = {
        "cameras": folder / "cameras.json",
        "mesh": folder / "mesh.ply",
        "scales": folder / "scales.json",
        "energy": folder / "energy.json",
        "found_light": folder / "light.npz",
        "light_pictures": folder / "light_pictures",
        "correspondences": folder / "correspondences",
    }
    write_cameras(places["cameras"], cameras)
    unit = ball()
    write_mesh(places["mesh"], replace(unit, vertices=2 * unit.vertices))
    places["scales"].write_text(json.dumps({"png_white": {"albedo": WHITE, "shading": 1.5}}))
    steps = [{"alternation": 1, "energy": 5.0, "gap": 0.1}, {"alternation": 2, "energy": 4.0, "gap": 0.01}]
    channels = {name: {"outcome": "converged", "alternations": steps} for name in ("red", "green", "blue")}
    places["energy"].write_text(json.dumps({"legend": {"energy": "of Eq. 2"}, "channels": channels}))
    write_light(places["found_light"], overhead_light(len(cameras)))
    write_exr(
        places["light_pictures"] / "shared.exr", np.linspace(2, 0, 8)[:, None, None] * np.ones((8, 16, 3))
    )
    places["correspondences"].mkdir()
    rows = []
    for (i, j), matrix in scene.correspondences.items():
        write_matrix(places["correspondences"] / f"{i}_{j}.npz", matrix)
        pair = {"i": cameras[i].name, "j": cameras[j].name}
        rows.append(pair | {"file": f"{i}_{j}.npz", "links": int(matrix.nnz)})
    (places["correspondences"] / "index.json").write_text(json.dumps(rows))
    return places


def overhead_light(views: int) -> StoredLight:
    """Light from the world's z alone; the last view is twice as bright."""
    gains = np.ones((views, 3))
    gains[-1] = 2
    around = LightAround(
        directions=np.array([[0.0, 0, 1], [0, 0, -1]]),
        cells=np.array([0.5, 0.5]),
        radiance=np.array([[[1.0, 1, 1], [0, 0, 0]]]),
        light_of_view=np.zeros(views, int),
        gains=gains,
        centre=np.zeros(3),
        radius=np.inf,
    )
    return StoredLight(around, 1.0, np.ones(3), np.zeros(3), 0.0, 0.0, True, 0.0)


def reported(make_job, folder: Path, places: dict[str, Path], **settings) -> Path:
    """Run the stage on what was written; returns the folder of its result."""
    stage = replace(REPORT, takes=tuple(name for name in REPORT.takes if name in places))
    inputs = {name: places[name] for name in stage.takes}
    result = folder / "my <workspace>/cache/report" / KEY
    stage.run(make_job(result, stage, stage.settings(**settings), **inputs))
    return result


def record_of(stage: str, **values) -> Record:
    """A record of a stage with nothing in it but what is said."""
    empty = {name: {} for name in ("settings", "inputs", "tools", "machine", "outputs")}
    return Record(stage=stage, version=1, key=KEY, **(empty | {"finished": "2026-01-01T00:00"} | values))


def textured_model(make_job, folder: Path, places: dict[str, Path]) -> Path:
    """Run the stage `texture` on what was written; returns the folder of its model."""
    takes = (*TEXTURE.takes, "confidence", "found_light")
    job = make_job(folder / "texture", TEXTURE, None, **{name: places[name] for name in takes})
    TEXTURE.run(job)
    return job.outputs["textured_model"]


def page_of(result: Path, *others: Record) -> dict[str, str]:
    """The page and its JSON, from the content in `result` and records of other stages."""
    records = {record.stage: record for record in (*others, record_of("report", seconds=2.0))}
    results = {name: Result(record, result) for name, record in records.items()}
    return summary(results, {"sfm": {"max_features": 8192}}, "0.1")
