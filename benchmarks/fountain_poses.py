"""Camera poses of fountain-P11 against its ground truth: ``python -m benchmarks.fountain_poses [WHERE]``.

WHERE is a workspace (its current `sfm` result is read) or a folder with a COLMAP model; `workspaces/fountain`
if not given. The truth comes with the data set: from ``$UNSHADE_DATA``, or fetched as `make fountain` does.
"""

from __future__ import annotations

import sys
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from benchmarks.similarity import similarity
from pipeline import UserError
from pipeline.cache.store import Store
from stages.formats.colmap.model import find_model, read_model, registered
from stages.scene.datasets import dataset_folder

LARGEST_CENTRE_MM = 5.0
LARGEST_ROTATION_DEG = 0.1


@dataclass(frozen=True)
class Poses:
    """Camera poses, by photo name: centres in world axes (n, 3) and rotations world to camera (n, 3, 3)."""

    names: list[str]
    centres: np.ndarray
    cam_from_world: np.ndarray


def true_poses(folder: Path) -> Poses:
    """Read Strecha's ``.camera`` files: K, a distortion row, R **camera to world**, centre (metres), size."""
    files = sorted(folder.glob("*.camera"))
    if not files:
        raise UserError(f"There are no .camera files in {folder}; expected the ground truth of fountain-P11.")
    values = [np.array(file.read_text().split(), float) for file in files]
    return Poses(
        names=[file.name.removesuffix(".camera") for file in files],
        centres=np.array([v[21:24] for v in values]),
        cam_from_world=np.array([v[12:21].reshape(3, 3).T for v in values]),
    )


def model_poses(folder: Path) -> Poses:
    """Read the poses of a COLMAP model."""
    images = registered(read_model(folder))
    return Poses(
        names=[image.name for image in images],
        centres=np.array([image.projection_center() for image in images]),
        cam_from_world=np.array([image.cam_from_world().matrix()[:, :3] for image in images]),
    )


def errors(estimate: Poses, truth: Poses) -> tuple[np.ndarray, np.ndarray]:
    """Compute errors of the common photos after similarity alignment of the centres.

    Returns
    -------
    centre_mm, rotation_deg : ndarray, shape (n,)
    """
    both = sorted(set(estimate.names) & set(truth.names))
    if len(both) < 3:
        raise UserError(
            f"The model and the truth share {len(both)} photos; expected at least 3 to align them."
        )
    ours = [estimate.names.index(name) for name in both]
    theirs = [truth.names.index(name) for name in both]
    fit = similarity(estimate.centres[ours], truth.centres[theirs])
    centre_mm = 1000 * np.linalg.norm(fit.points(estimate.centres[ours]) - truth.centres[theirs], axis=1)
    residual = truth.cam_from_world[theirs] @ fit.rotation @ estimate.cam_from_world[ours].transpose(0, 2, 1)
    # The skew part keeps small angles that the trace rounds away.
    skew = (residual - residual.transpose(0, 2, 1))[:, [2, 0, 1], [1, 2, 0]] / 2
    sine, cosine = np.linalg.norm(skew, axis=1), (np.trace(residual, axis1=1, axis2=2) - 1) / 2
    return centre_mm, np.degrees(np.arctan2(sine, cosine))


def newest_model(where: Path) -> Path:
    """Find the model: the folder itself, or the current `sfm` result of a workspace."""
    if (where / "cache").is_dir():
        store = Store(where)
        record = store.current("sfm")
        if record is None:
            raise UserError(f"{where} holds no sfm result; run `unshade run configs/fountain.yaml --to sfm`.")
        return store.entry("sfm", record.key) / "model"
    return find_model(where)


def main(arguments: list[str]) -> int:
    """Print the table; 0 if the targets are met, 1 if not, 2 if there is nothing to measure."""
    where = Path(arguments[0] if arguments else "workspaces/fountain")
    try:
        folder = newest_model(where)
        truth = true_poses(dataset_folder("fountain-P11") / "gt_dense_cameras")
        centre_mm, rotation_deg = errors(model_poses(folder), truth)
    except UserError as error:
        print(error, file=sys.stderr)
        return 2
    print(f"{folder}: {len(centre_mm)} of {len(truth.names)} photos")
    print(f"camera centre  mean {centre_mm.mean():.2f} mm  max {centre_mm.max():.2f} mm")
    print(f"rotation       mean {rotation_deg.mean():.4f}°  max {rotation_deg.max():.4f}°")
    met = centre_mm.mean() <= LARGEST_CENTRE_MM and rotation_deg.mean() <= LARGEST_ROTATION_DEG
    verdict = "met" if met else "missed"
    print(f"target: mean ≤ {LARGEST_CENTRE_MM:g} mm and ≤ {LARGEST_ROTATION_DEG:g}°: {verdict}")
    return 0 if met else 1


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
