"""Similarity alignment of a reconstruction to its truth: rotation, shift and scale."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from stages.scene.cameras import Camera


@dataclass(frozen=True)
class Similarity:
    """``x_in_truth = scale · rotation @ x_in_model + shift``."""

    scale: float
    rotation: np.ndarray
    shift: np.ndarray

    def points(self, x_in_model: np.ndarray) -> np.ndarray:
        """Transform points of the model, (n, 3) or (3,), into the truth's frame."""
        return self.scale * x_in_model @ self.rotation.T + self.shift

    def camera(self, camera: Camera) -> Camera:
        """Transform a camera into the truth's frame (its depths are `scale` times as large there)."""
        rotation = camera.rotation @ self.rotation.T
        centre = self.points(camera.centre_in_world)
        return replace(camera, cam_from_world=np.column_stack([rotation, -rotation @ centre]))


def similarity(x_in_model: np.ndarray, x_in_truth: np.ndarray) -> Similarity:
    """Fit the least-squares similarity of matched points (Umeyama 1991), both (n, 3)."""
    mean_model, mean_truth = x_in_model.mean(axis=0), x_in_truth.mean(axis=0)
    a, b = x_in_model - mean_model, x_in_truth - mean_truth
    u, values, vt = np.linalg.svd(b.T @ a)
    signs = np.array([1.0, 1.0, np.sign(np.linalg.det(u @ vt))])
    rotation = (u * signs) @ vt
    scale = float((values * signs).sum() / (a**2).sum())
    return Similarity(scale, rotation, mean_truth - scale * rotation @ mean_model)
