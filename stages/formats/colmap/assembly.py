"""COLMAP models put together from views: cameras shared where equal, trivial rigs, tracks kept."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import pycolmap


@dataclass(frozen=True, eq=False)
class PosedImage:
    """One image of the model to be.

    Attributes
    ----------
    image_id : int
        Its id; the same as in the model that points are taken from.
    name : str
    camera : pycolmap.Camera
        Any model; its id is ignored, equal cameras become one.
    cam_from_world : pycolmap.Rigid3d
    xy : ndarray, shape (n, 2), float64
        2-D points, pixels, in the order of the model that points are taken from; NaN for those that are lost.
    """

    image_id: int
    name: str
    camera: pycolmap.Camera
    cam_from_world: pycolmap.Rigid3d
    xy: np.ndarray


def assemble(
    images: Sequence[PosedImage], points_from: pycolmap.Reconstruction | None = None
) -> pycolmap.Reconstruction:
    """Build a model of posed images, with the 3-D points of `points_from` that two of them still see."""
    model = pycolmap.Reconstruction()
    camera_ids: dict[tuple[str | float, ...], int] = {}
    lost: set[tuple[int, int]] = set()
    for posed in images:
        camera = posed.camera
        key = (camera.model_name, camera.width, camera.height, *camera.params)
        if key not in camera_ids:
            camera_ids[key] = len(camera_ids) + 1
            model.add_camera_with_trivial_rig(_with_id(camera, camera_ids[key]))
        image = pycolmap.Image(name=posed.name, camera_id=camera_ids[key], image_id=posed.image_id)
        gone = np.flatnonzero(~np.isfinite(posed.xy).all(axis=1))
        lost.update((posed.image_id, int(index)) for index in gone)
        image.points2D = pycolmap.Point2DList([pycolmap.Point2D(point) for point in np.nan_to_num(posed.xy)])
        model.add_image_with_trivial_frame(image, posed.cam_from_world)
    if points_from is not None:
        _add_points(model, points_from, lost)
    return model


def add_points(
    model: pycolmap.Reconstruction, image_names: Sequence[str], x_in_world: np.ndarray, seen: np.ndarray
) -> None:
    """Add black 3-D points to a model whose images have no 2-D points; those of one view only are left out.

    Parameters
    ----------
    model : pycolmap.Reconstruction
    image_names : sequence of str
        Posed images of the model, v of them.
    x_in_world : ndarray, shape (n, 3)
    seen : ndarray, shape (v, n), bool
        Which views observe which point. Where in the image is not recorded: all 2-D points are (0, 0).
    """
    images = {image.name: image for image in model.images.values()}
    views = [images[name] for name in image_names]
    seen = seen & (seen.sum(axis=0) > 1)
    index_in_view = np.cumsum(seen, axis=1) - 1
    for image, own in zip(views, seen, strict=True):
        image.points2D = pycolmap.Point2DList([pycolmap.Point2D(np.zeros(2))] * int(own.sum()))
    for point in np.flatnonzero(seen.any(axis=0)):
        track = [
            pycolmap.TrackElement(views[view].image_id, int(index_in_view[view, point]))
            for view in np.flatnonzero(seen[:, point])
        ]
        model.add_point3D(x_in_world[point], pycolmap.Track(track), np.zeros(3, np.uint8))


def points_seen(
    model: pycolmap.Reconstruction, images: Sequence[pycolmap.Image]
) -> tuple[np.ndarray, np.ndarray]:
    """Read the 3-D points of a model, in the order of their ids, and which of some images observe them.

    Returns
    -------
    ndarray, shape (n, 3), float64
        World axes.
    ndarray, shape (v, n), bool
    """
    points = [model.points3D[key] for key in sorted(model.points3D)]
    row_of = {image.image_id: row for row, image in enumerate(images)}
    seen = np.zeros((len(images), len(points)), bool)
    for column, point in enumerate(points):
        for element in point.track.elements:
            if element.image_id in row_of:
                seen[row_of[element.image_id], column] = True
    return np.array([point.xyz for point in points], float).reshape(-1, 3), seen


def points2d_of(image: pycolmap.Image) -> np.ndarray:
    """Read the 2-D points of an image, shape (n, 2), float64, pixels."""
    return np.array([point.xy for point in image.points2D], float).reshape(-1, 2)


def _with_id(camera: pycolmap.Camera, camera_id: int) -> pycolmap.Camera:
    return pycolmap.Camera(
        camera_id=camera_id,
        model=camera.model_name,
        width=camera.width,
        height=camera.height,
        params=list(camera.params),
        has_prior_focal_length=camera.has_prior_focal_length,
    )


def _add_points(
    model: pycolmap.Reconstruction, source: pycolmap.Reconstruction, lost: set[tuple[int, int]]
) -> None:
    for point_id in sorted(source.points3D):
        point = source.points3D[point_id]
        seen_by = [
            element
            for element in point.track.elements
            if element.image_id in model.images and (element.image_id, element.point2D_idx) not in lost
        ]
        if len(seen_by) >= 2:
            kept = pycolmap.Point3D(
                xyz=point.xyz, color=point.color, error=point.error, track=pycolmap.Track(seen_by)
            )
            model.add_point3D_with_id(point_id, kept)
