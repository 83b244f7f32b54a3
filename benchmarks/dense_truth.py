"""Dense stereo against rendered truth: ``python -m benchmarks.dense_truth WORKSPACE [TRUTH]``.

WORKSPACE is the finished workspace of a run on `sample_data` (its newest `undistort` and `mvs` are read),
TRUTH the folder with ``mesh.ply`` and ``sparse/`` (default ``sample_data/truth``). The model is brought into
the truth's frame by the similarity that fits the camera centres; depth is compared in the model's cameras.
"""

from __future__ import annotations

import argparse
import json
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
import open3d as o3d

from pipeline import UserError
from stages.scene.cameras import Camera, footprint, normals_in_world, rays_in_world
from stages.scene.colmap_model import cameras_of, read_model, registered
from stages.scene.depth_maps import read_map
from stages.scene.meshes import read_mesh, to_open3d


@dataclass(frozen=True)
class Similarity:
    """``x_in_truth = scale · rotation @ x_in_model + shift``."""

    scale: float
    rotation: np.ndarray
    shift: np.ndarray

    def camera(self, camera: Camera) -> Camera:
        """A camera of the model, posed in the truth's frame (its depths are `scale` times as large there)."""
        rotation = camera.rotation @ self.rotation.T
        centre = self.scale * self.rotation @ camera.centre_in_world + self.shift
        return replace(camera, cam_from_world=np.column_stack([rotation, -rotation @ centre]))


def similarity(x_in_model: np.ndarray, x_in_truth: np.ndarray) -> Similarity:
    """Least-squares similarity of matched points (Umeyama 1991), both (n, 3)."""
    mean_model, mean_truth = x_in_model.mean(0), x_in_truth.mean(0)
    a, b = x_in_model - mean_model, x_in_truth - mean_truth
    u, values, vt = np.linalg.svd(b.T @ a)
    signs = np.array([1.0, 1.0, np.sign(np.linalg.det(u @ vt))])
    rotation = u @ np.diag(signs) @ vt
    scale = float(np.sum(values * signs) / np.sum(a**2))
    return Similarity(scale, rotation, mean_truth - scale * rotation @ mean_model)


def newest(workspace: Path, stage: str) -> Path:
    """The newest finished result of a stage in a workspace's cache."""
    records = sorted(workspace.glob(f"cache/{stage}/*/record.json"), key=lambda path: path.stat().st_mtime)
    if not records:
        raise UserError(f"{workspace} holds no finished result of {stage}; run `make sample` first.")
    return records[-1].parent


def true_maps(mesh: o3d.t.geometry.RaycastingScene, camera: Camera) -> tuple[np.ndarray, np.ndarray]:
    """z-depth (h, w), 0 where nothing is hit, and unit face normals towards the camera (h, w, 3)."""
    directions = rays_in_world(camera)
    origins = np.broadcast_to(camera.centre_in_world, directions.shape)
    rays = np.concatenate([origins, directions], axis=-1).astype(np.float32)
    hits = mesh.cast_rays(o3d.core.Tensor(rays))
    depth, normals = hits["t_hit"].numpy(), hits["primitive_normals"].numpy()
    seen = np.isfinite(depth)
    facing = np.sign(-np.sum(normals * directions, axis=-1, keepdims=True))
    return np.where(seen, depth, 0), np.where(seen[..., None], normals * facing, 0)


def compare(found: Path, mesh, camera: Camera, image_name: str, scale: float) -> dict[str, np.ndarray]:
    """Errors of one view where both know the surface: depth (footprints), normals (degrees); and counts."""
    depth = scale * read_map(found / "depth_maps" / f"{image_name}.geometric.bin")
    normals = normals_in_world(camera, read_map(found / "normal_maps" / f"{image_name}.geometric.bin"))
    true_depth, true_normals = true_maps(mesh, camera)
    both = (depth > 0) & (true_depth > 0)
    cosine = np.clip(np.sum(normals * true_normals, axis=-1)[both], -1, 1)
    return {
        "depth": np.abs(depth - true_depth)[both] / footprint(camera, true_depth[both]),
        "normal": np.rad2deg(np.arccos(cosine)),
        "surface": np.sum(true_depth > 0),
        "background": np.sum(true_depth == 0),
        "invented": np.sum((depth > 0) & (true_depth == 0)),
    }


def evaluate(workspace: Path, truth: Path) -> dict[str, float]:
    """All figures of a run against the truth."""
    model = read_model(newest(workspace, "undistort") / "workspace" / "sparse")
    cameras = dict(zip((image.name for image in registered(model)), cameras_of(model), strict=True))
    true_centres = {
        Path(image.name).stem: image.projection_center() for image in registered(read_model(truth / "sparse"))
    }
    names = [name for name in cameras if Path(name).stem in true_centres]
    fit = similarity(
        np.array([cameras[name].centre_in_world for name in names]),
        np.array([true_centres[Path(name).stem] for name in names]),
    )
    scene = o3d.t.geometry.RaycastingScene()
    scene.add_triangles(o3d.t.geometry.TriangleMesh.from_legacy(to_open3d(read_mesh(truth / "mesh.ply"))))
    found = newest(workspace, "mvs") / "depth_maps"
    views = [compare(found, scene, fit.camera(cameras[name]), name, fit.scale) for name in names]
    depth = np.concatenate([view["depth"] for view in views])
    normal = np.concatenate([view["normal"] for view in views])
    return {
        "views": len(names),
        "depth_error_median_footprints": round(float(np.median(depth)), 3),
        "depth_error_p90_footprints": round(float(np.quantile(depth, 0.9)), 3),
        "depth_off_by_5_footprints": round(float(np.mean(depth > 5)), 4),
        "normal_error_median_deg": round(float(np.median(normal)), 2),
        "normal_error_p90_deg": round(float(np.quantile(normal, 0.9)), 2),
        "coverage_of_surface": round(len(depth) / float(sum(view["surface"] for view in views)), 4),
        "invented_share_of_background": round(
            float(
                sum(view["invented"] for view in views) / max(1, sum(view["background"] for view in views))
            ),
            5,
        ),
    }


def main() -> None:
    """Print the figures as JSON."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("workspace", type=Path)
    parser.add_argument("truth", type=Path, nargs="?", default=Path("sample_data/truth"))
    arguments = parser.parse_args()
    print(json.dumps(evaluate(arguments.workspace, arguments.truth), indent=1))


if __name__ == "__main__":
    main()
