"""Pairs of photos that match, and what their matches say before any photo is placed."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import cv2
import numpy as np
import pycolmap
from scipy.optimize import least_squares
from scipy.spatial.transform import Rotation

from stages.motion.sfm_settings import PairSettings

NEARLY_ASIDE = 1e-3  # of a ray's length, ahead: farther aside, it is in no image
MOST_RADIAL = 1.0  # a coefficient that no lens has, as in COLMAP


@dataclass(frozen=True, eq=False)
class Side:
    """One photo's side of a pair.

    Attributes
    ----------
    photo : int
        Index, from 0.
    xy : ndarray, shape (n, 2)
        Its verified matches, relative to the image's centre, in longest sides.
    focal : float or None
        Focal length in longest sides, where it is known before.
    """

    photo: int
    xy: np.ndarray
    focal: float | None


@dataclass(frozen=True, eq=False)
class Pair:
    """Two photos and the matches that agree with one motion of the camera."""

    one: Side
    other: Side

    def __len__(self) -> int:
        return len(self.one.xy)


def verified_pairs(database: Path) -> list[Pair]:
    """Read the verified pairs of a database, those with the most matches first."""
    with pycolmap.Database.open(database) as found:
        cameras = {camera.camera_id: camera for camera in found.read_all_cameras()}
        images = found.read_all_images()
        camera_of = {image.image_id: cameras[image.camera_id] for image in images}
        keypoints = {image.image_id: found.read_keypoints(image.image_id)[:, :2] for image in images}
        pairs = []
        for number, geometry in zip(*found.read_two_view_geometries(), strict=True):
            sides = [
                _side(image_id, keypoints[image_id][column], camera_of[image_id])
                for image_id, column in zip(
                    pycolmap.pair_id_to_image_pair(number), geometry.inlier_matches.T, strict=True
                )
            ]
            pairs.append(Pair(*sides))
    pairs = [pair for pair in pairs if len(pair)]
    return sorted(pairs, key=lambda pair: (-len(pair), pair.one.photo, pair.other.photo))


def _side(image_id: int, xy: np.ndarray, camera: pycolmap.Camera) -> Side:
    longest = max(camera.width, camera.height)
    known = camera.mean_focal_length() / longest if camera.has_prior_focal_length else None
    return Side(image_id - 1, (xy - np.array([camera.width, camera.height]) / 2) / longest, known)


def sample(pairs: Sequence[Pair], at_most: int) -> Sequence[Pair]:
    """Take every so-manieth pair, `at_most` in all."""
    return pairs[:: max(1, -(-len(pairs) // at_most))]


def still_share(pair: Pair, settings: PairSettings) -> float:
    """Compute the share of a pair's matches that lie at the same pixels in both photos."""
    return float(np.mean(np.linalg.norm(pair.one.xy - pair.other.xy, axis=1) <= settings.still))


def shows_depth(pair: Pair, settings: PairSettings) -> bool:
    """Test whether turning the camera does not explain a pair's matches.

    Two hypotheses are compared by the median residual of the matches: a camera that turned, and any plane
    before a camera that moved (a homography). A turn that is both near and hardly worse than the plane
    explains the pair. Without the second, a wall photographed square on would be a turn.
    """
    chosen = slice(None, None, max(1, len(pair) // settings.matches))
    thinned = Pair(
        *(Side(side.photo, side.xy[chosen], side.focal) for side in (pair.one, pair.other)),
    )
    turn = turn_residual(thinned, settings)
    return turn > settings.parallax or turn > settings.plane_ratio * plane_residual(thinned)


def turn_residual(pair: Pair, settings: PairSettings) -> float:
    """Fit a turn of the camera, x' = π(R π⁻¹(x)), and return the median residual, in longest sides.

    R, one radial coefficient k (x = x_u (1 + k r²), undone to first order) and, unless both are known, one
    focal length are free.
    """
    known = (pair.one.focal, pair.other.focal) if pair.one.focal and pair.other.focal else None
    low, high = np.log([settings.shortest_focal, settings.longest_focal])

    def off(values: np.ndarray) -> np.ndarray:
        focal, focal_other = known or (float(np.exp(values[4])), float(np.exp(values[4])))
        rays = _rays(pair.one.xy, focal, values[3]) @ _turn(values[:3]).T
        seen = _rays(pair.other.xy, focal_other, values[3])
        ahead = np.maximum(rays[:, 2:], NEARLY_ASIDE)
        return np.asarray(focal_other * (rays[:, :2] / ahead - seen[:, :2])).ravel()

    best = np.inf
    for guess in np.linspace(low, high, settings.focal_guesses + 2)[1:-1]:
        start = np.array([0, 0, 0, 0, guess])
        found = least_squares(
            off,
            start,
            bounds=([-np.pi] * 3 + [-MOST_RADIAL, low], [np.pi] * 3 + [MOST_RADIAL, high]),
            loss="soft_l1",
            f_scale=settings.parallax,
        )
        best = min(best, float(np.median(np.linalg.norm(found.fun.reshape(-1, 2), axis=1))))
    return best


def plane_residual(pair: Pair) -> float:
    """Fit a homography and return the median residual, in longest sides."""
    homography, _ = cv2.findHomography(pair.one.xy, pair.other.xy, cv2.LMEDS)
    if homography is None:
        return np.inf
    mapped = np.column_stack([pair.one.xy, np.ones(len(pair))]) @ homography.T
    return float(np.median(np.linalg.norm(mapped[:, :2] / mapped[:, 2:] - pair.other.xy, axis=1)))


def _turn(vector: np.ndarray) -> np.ndarray:
    return Rotation.from_rotvec(vector).as_matrix()


def _rays(xy: np.ndarray, focal: float, radial: float) -> np.ndarray:
    rays = xy / focal
    rays = rays * (1 - radial * np.sum(rays**2, axis=1, keepdims=True))
    return np.column_stack([rays, np.ones(len(rays))])
