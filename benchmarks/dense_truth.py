"""Dense stereo against rendered truth.

``python -m benchmarks.dense_truth WORKSPACE`` reads the newest `undistort` and `mvs` results of a
run on `sample_data` and aligns the model to the truth by the similarity of the camera centres;
errors of structure from motion (a focal length too long by 0.3 % moves all surface by a footprint)
are therefore included, as bias. ``python -m benchmarks.dense_truth
--true-cameras`` runs the stage itself on the true cameras: stereo alone.
"""

from __future__ import annotations

import argparse
import json
import tempfile
from collections.abc import Callable, Iterator
from concurrent.futures import ThreadPoolExecutor
from contextlib import contextmanager
from pathlib import Path

import numpy as np
import open3d as o3d

from benchmarks.similarity import Similarity, similarity
from pipeline import Job, Silence, UserError
from stages.formats.colmap.depth_maps import read_map
from stages.formats.colmap.model import cameras_of, pinhole_model, read_model, registered
from stages.formats.images.photos import read_photo, write_png_srgb8
from stages.formats.meshes.triangle_meshes import read_mesh, to_open3d
from stages.mvs import MVS
from stages.scene.cameras import Camera, footprint, normals_in_world, rays_in_world


def newest(workspace: Path, stage: str) -> Path:
    """Find the newest finished result of a stage in a workspace's cache."""
    records = sorted(workspace.glob(f"cache/{stage}/*/record.json"), key=lambda path: path.stat().st_mtime)
    if not records:
        raise UserError(f"{workspace} holds no finished result of {stage}; run `make sample` first.")
    return records[-1].parent


def undistorted_model(workspace: Path) -> Path:
    """Find the COLMAP model of the pinhole views of a run."""
    return newest(workspace, "undistort") / "workspace" / "sparse"


def true_maps(mesh: o3d.t.geometry.RaycastingScene, camera: Camera) -> tuple[np.ndarray, np.ndarray]:
    """Cast rays: z-depth (h, w), 0 without a hit, and unit face normals towards the camera (h, w, 3)."""
    directions = rays_in_world(camera)
    origins = np.broadcast_to(camera.centre_in_world, directions.shape)
    rays = np.concatenate([origins, directions], axis=-1).astype(np.float32)
    hits = mesh.cast_rays(o3d.core.Tensor(rays))
    depth, normals = hits["t_hit"].numpy(), hits["primitive_normals"].numpy()
    seen = np.isfinite(depth)
    facing = np.sign(-np.sum(normals * directions, axis=-1, keepdims=True))
    return np.where(seen, depth, 0), np.where(seen[..., None], normals * facing, 0)


def compare(found: Path, mesh, camera: Camera, image_name: str, scale: float) -> dict[str, np.ndarray]:
    """Compute errors of a view where both have surface: depth (footprints), normals (degrees); and counts."""
    depth = scale * read_map(found / "depth_maps" / f"{image_name}.geometric.bin")
    normals = normals_in_world(camera, read_map(found / "normal_maps" / f"{image_name}.geometric.bin"))
    true_depth, true_normals = true_maps(mesh, camera)
    both = (depth > 0) & (true_depth > 0)
    cosine = np.clip(np.sum(normals * true_normals, axis=-1)[both], -1, 1)
    return {
        "depth": (depth - true_depth)[both] / footprint(camera, true_depth[both]),
        "normal": np.rad2deg(np.arccos(cosine)),
        "surface": np.sum(true_depth > 0),
        "background": np.sum(true_depth == 0),
        "invented": np.sum((depth > 0) & (true_depth == 0)),
    }


def evaluate(found: Path, cameras: dict[str, Camera], fit: Similarity, truth: Path) -> dict[str, float]:
    """Compare depth maps with the truth; `cameras` by image name, `fit` aligns to the truth's frame."""
    scene = o3d.t.geometry.RaycastingScene()
    scene.add_triangles(o3d.t.geometry.TriangleMesh.from_legacy(to_open3d(read_mesh(truth / "mesh.ply"))))
    views = [compare(found, scene, fit.camera(camera), name, fit.scale) for name, camera in cameras.items()]
    signed = np.concatenate([view["depth"] for view in views])
    depth, normal = np.abs(signed), np.concatenate([view["normal"] for view in views])
    total = {name: float(sum(view[name] for view in views)) for name in ("surface", "background", "invented")}
    return {
        "views": len(views),
        "depth_error_median_footprints": round(float(np.median(depth)), 3),
        "depth_bias_median_footprints": round(float(np.median(signed)), 3),
        "depth_error_about_bias_median_footprints": round(
            float(np.median(np.abs(signed - np.median(signed)))), 3
        ),
        "depth_error_p90_footprints": round(float(np.quantile(depth, 0.9)), 3),
        "depth_off_by_5_footprints": round(float(np.mean(depth > 5)), 4),
        "normal_error_median_deg": round(float(np.median(normal)), 2),
        "normal_error_p90_deg": round(float(np.quantile(normal, 0.9)), 2),
        "coverage_of_surface": round(len(depth) / total["surface"], 4),
        "invented_share_of_background": round(total["invented"] / max(1.0, total["background"]), 5),
    }


def of_a_run(workspace: Path, truth: Path) -> dict[str, float]:
    """Evaluate a finished run, aligned by its camera centres."""
    model = read_model(undistorted_model(workspace))
    cameras = dict(zip((image.name for image in registered(model)), cameras_of(model), strict=True))
    true_centres = {
        camera.name: camera.centre_in_world for camera in cameras_of(read_model(truth / "sparse"))
    }
    cameras = {name: camera for name, camera in cameras.items() if camera.name in true_centres}
    fit = similarity(
        np.array([camera.centre_in_world for camera in cameras.values()]),
        np.array([true_centres[camera.name] for camera in cameras.values()]),
    )
    return evaluate(newest(workspace, "mvs") / "depth_maps", cameras, fit, truth)


@contextmanager
def job_in(folder: Path, say: Callable[[str], None], **inputs: Path) -> Iterator[Job]:
    """Provide a job of the mvs stage with its defaults that writes into `folder`."""
    (folder / "scratch").mkdir()
    outputs = {name: folder / name for name in ("depth_maps", "background")} | {"fused": folder / "fused.ply"}
    for name in ("depth_maps", "background"):
        outputs[name].mkdir()
    settings = MVS.settings()
    with ThreadPoolExecutor(2) as executor:
        machine = dict(MVS.machine(settings))
        yield Job(settings, inputs, outputs, folder / "scratch", 2, executor, Silence(), say, machine)


def of_true_cameras(truth: Path, photos: Path) -> dict[str, float]:
    """Evaluate the stage run on the true cameras (without sparse points)."""
    cameras = cameras_of(read_model(truth / "sparse"))
    with tempfile.TemporaryDirectory() as name:
        workspace = Path(name) / "workspace"
        (workspace / "sparse").mkdir(parents=True)
        pinhole_model(cameras).write(workspace / "sparse")
        for camera in cameras:
            photo = read_photo(next(photos.glob(f"{camera.name}.*")))
            write_png_srgb8(workspace / "images" / f"{camera.name}.png", photo)
        with job_in(Path(name), print, workspace=workspace) as job:
            MVS.run(job)
        identity = Similarity(1.0, np.eye(3), np.zeros(3))
        by_name = {f"{camera.name}.png": camera for camera in cameras}
        return evaluate(job.outputs["depth_maps"], by_name, identity, truth) | {
            "cpu_seconds": job.facts["cpu_seconds"]
        }


def main() -> None:
    """Print the figures as JSON."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("workspace", type=Path, nargs="?", help="a finished run on sample_data")
    parser.add_argument(
        "--true-cameras", action="store_true", help="run the stage on the true cameras instead"
    )
    parser.add_argument("--sample", type=Path, default=Path("sample_data"))
    arguments = parser.parse_args()
    truth = arguments.sample / "truth"
    if arguments.true_cameras:
        figures = of_true_cameras(truth, arguments.sample / "photos")
    elif arguments.workspace:
        figures = of_a_run(arguments.workspace, truth)
    else:
        parser.error("name a workspace, or say --true-cameras")
    print(json.dumps(figures, indent=1))


if __name__ == "__main__":
    main()
