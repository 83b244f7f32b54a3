"""3-D points of views whose cameras are known, by COLMAP: features, matches of near views, triangulation."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from pathlib import Path

import cv2
import numpy as np
import pycolmap

from stages.formats.colmap.assembly import PosedImage, assemble, points_seen
from stages.formats.colmap.dense_workspace import read_posed_image
from stages.formats.colmap.model import camera_of, registered
from stages.formats.images.photos import write_png8
from stages.motion.database import copy_name, working_name, write_features
from stages.motion.features import detect, read_features, size_of_copy
from stages.motion.known_poses.settings import TriangulationSettings
from stages.motion.mapping import quiet_colmap, reproducible_options
from stages.motion.matching import in_batches, match_pairs
from stages.scene.cameras import Camera


def near_pairs(cameras: Sequence[Camera], how: TriangulationSettings) -> list[tuple[int, int]]:
    """List pairs of views that may share features: of each view the nearest ones that look the same way."""
    centres = np.stack([camera.centre_in_world for camera in cameras])
    axes = np.stack([camera.rotation[2] for camera in cameras])
    least = np.cos(np.deg2rad(how.widest_deg))
    pairs = set()
    for view, (centre, axis) in enumerate(zip(centres, axes, strict=True)):
        far = np.linalg.norm(centres - centre, axis=1)
        far[(axes @ axis < least) | (np.arange(len(far)) == view)] = np.inf
        for other in np.argsort(far, kind="stable")[: how.neighbours].tolist():
            if np.isfinite(far[other]):
                pairs.add((min(view, other), max(view, other)))
    return sorted(pairs)


def triangulated(
    images: Path,
    model: pycolmap.Reconstruction,
    scratch: Path,
    how: TriangulationSettings,
    threads: int,
    step: Callable[[], None],
) -> tuple[np.ndarray, np.ndarray]:
    """Triangulate features of images whose cameras and poses a pinhole model holds.

    Parameters
    ----------
    images : Path
        Folder of the images, 8-bit, under the model's names.
    model : pycolmap.Reconstruction
        Its own points are not looked at.
    scratch : Path
        An empty folder.
    how : TriangulationSettings
    threads : int
        Never changes the result.
    step : callable
        Called for every view.

    Returns
    -------
    ndarray, shape (n, 3), float64
        Points, world axes; perhaps none.
    ndarray, shape (v, n), bool
        Which views see them, in the order of `registered`.

    Raises
    ------
    UserError
        An image is missing or unreadable.
    OSError
        The disk has no room for the database.
    """
    posed, copies = registered(model), scratch / "copies"
    own = _under_working_names(posed, model)
    copies.mkdir()
    with quiet_colmap():
        for index, image in enumerate(posed):
            _write_copy(images / image.name, copies / copy_name(index), how.max_size_px)
            detect([copies / copy_name(index)], scratch / "found.db", how.max_features, threads)
            step()
        counts = _copy_features(scratch / "found.db", scratch / "matched.db", own, copies)
        pairs = near_pairs([camera_of(image, model.cameras[image.camera_id]) for image in posed], how)
        for batch in in_batches(pairs, threads):
            match_pairs(scratch / "matched.db", batch, counts, how.seed, threads)
        own = _with_points(own, scratch, copies, how.seed)
    return points_seen(own, [own.images[number + 1] for number in range(len(posed))])


def _under_working_names(
    posed: Sequence[pycolmap.Image], model: pycolmap.Reconstruction
) -> pycolmap.Reconstruction:
    """Build the model of the same views as the database has them: image ids are their numbers, from 1."""
    nothing = np.zeros((0, 2))
    return assemble(
        [
            PosedImage(
                number + 1,
                working_name(number),
                model.cameras[image.camera_id],
                image.cam_from_world(),
                nothing,
            )
            for number, image in enumerate(posed)
        ]
    )


def _copy_features(found_in: Path, database: Path, model: pycolmap.Reconstruction, copies: Path) -> list[int]:
    """Write what was found in the copies to a database of the model's cameras; returns how many per view."""
    cameras = [model.cameras[key] for key in sorted(model.cameras)]
    of_view = [model.images[number].camera_id - 1 for number in sorted(model.images)]
    with pycolmap.Database.open(found_in) as found:
        features = (
            read_features(found, copies / copy_name(view), cameras[camera].width, cameras[camera].height)
            for view, camera in enumerate(of_view)
        )
        return [len(colours) for colours in write_features(database, cameras, of_view, features)]


def _with_points(
    model: pycolmap.Reconstruction, scratch: Path, copies: Path, seed: int
) -> pycolmap.Reconstruction:
    """Triangulate what was matched."""
    (scratch / "model").mkdir()
    return pycolmap.triangulate_points(
        model,
        scratch / "matched.db",
        copies,
        scratch / "model",
        clear_points=True,
        options=reproducible_options(seed),
    )


def _write_copy(image: Path, copy: Path, max_size_px: int) -> None:
    """Write what COLMAP reads: an 8-bit PNG of bounded size."""
    pixels = read_posed_image(image)
    size = size_of_copy(pixels.shape[1], pixels.shape[0], max_size_px)
    if size != (pixels.shape[1], pixels.shape[0]):
        pixels = cv2.resize(pixels, size, interpolation=cv2.INTER_AREA)
    write_png8(copy, pixels)
