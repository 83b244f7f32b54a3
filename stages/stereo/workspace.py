"""A COLMAP dense workspace, opened: cameras, images, sparse points, and where the results go."""

from __future__ import annotations

from collections import OrderedDict
from dataclasses import dataclass, field, replace
from pathlib import Path
from threading import Lock
from typing import Any

import cv2
import numpy as np

from pipeline import UserError
from stages.formats.colmap.assembly import points_seen
from stages.formats.colmap.dense_workspace import read_posed_image
from stages.formats.colmap.depth_maps import write_map
from stages.formats.colmap.model import camera_of, read_model, registered
from stages.formats.images.masks import kept_at
from stages.scene.cameras import Camera, normals_in_cam
from stages.stereo.view_selection import SparsePoints

IMAGES_HELD = 16  # decoded images kept at hand: a view, its sources, and some of the next view's


@dataclass(frozen=True, eq=False)
class Workspace:
    """A dense workspace.

    Attributes
    ----------
    folder : Path
    image_names : list of str
        Posed images, sorted.
    cameras : list of Camera
        In the same order, at the size at which the images are read.
    points : SparsePoints
        The model's 3-D points; may be none.
    colours : ndarray, shape (n, 3), uint8
        Their colours.
    shapes : list of tuple of int
        Height and width of the images' files.
    model_folder : Path
        Of the model.
    mask_folder : Path or None
        Masks named like the views, white = keep; a view without one is kept whole.
    """

    folder: Path
    image_names: list[str]
    cameras: list[Camera]
    points: SparsePoints
    colours: np.ndarray
    shapes: list[tuple[int, int]]
    model_folder: Path
    mask_folder: Path | None = None

    def reduced(self, scale: float) -> Workspace:
        """Reduce the size at which the images are read."""
        return replace(self, cameras=[camera.reduced(scale) for camera in self.cameras])

    def images(self) -> ImageReader:
        """Make a reader of the images."""
        sizes = [one.shape for one in self.cameras]
        return ImageReader(self.folder / "images", self.image_names, self.shapes, sizes)

    def masks(self) -> MaskReader | None:
        """Make a reader of the masks, at the size of the cameras; None where there are none."""
        if self.mask_folder is None:
            return None
        return MaskReader(self.mask_folder, [(one.name, one.shape) for one in self.cameras])


@dataclass(frozen=True)
class MaskReader:
    """A picklable function from a view's index to the pixels that its mask keeps, (h, w), bool."""

    folder: Path
    views: list[tuple[str, tuple[int, int]]]

    def __call__(self, view: int) -> np.ndarray:
        """Read the mask of a view; everything where it has none."""
        name, shape = self.views[view]
        return kept_at(self.folder / f"{name}.png", shape)


@dataclass(eq=False)
class ImageReader:
    """A picklable function from a view's index to its image, (h, w, 3), uint8, RGB; it holds the last few.

    Several threads may call it at once. Images of the files' `shapes` are reduced to the `sizes` wanted.
    """

    folder: Path
    names: list[str]
    shapes: list[tuple[int, int]]
    sizes: list[tuple[int, int]]
    _held: OrderedDict[int, np.ndarray] = field(default_factory=OrderedDict)
    _lock: Lock = field(default_factory=Lock)

    def __reduce__(self) -> tuple[Any, ...]:
        return ImageReader, (self.folder, self.names, self.shapes, self.sizes)

    def __call__(self, view: int) -> np.ndarray:
        """Read the image of a view, unless it is held.

        Raises
        ------
        UserError
            It is missing or unreadable, or of another size than its camera.
        """
        with self._lock:
            image = self._held.get(view)
        if image is None:
            image = self._read(view)  # perhaps by two threads: the same image
        with self._lock:
            self._held[view] = image
            self._held.move_to_end(view)
            if len(self._held) > IMAGES_HELD:
                self._held.popitem(last=False)
        return image

    def _read(self, view: int) -> np.ndarray:
        path = self.folder / self.names[view]
        image = read_posed_image(path)
        height, width = self.shapes[view]
        if image.shape[:2] != (height, width):
            raise UserError(
                f"{path} has {image.shape[1]}×{image.shape[0]} pixels, its camera {width}×{height}; expected "
                "an undistorted workspace where the two agree."
            )
        if (height, width) != self.sizes[view]:
            image = cv2.resize(image, self.sizes[view][::-1], interpolation=cv2.INTER_AREA)
        return image


def open_workspace(
    folder: Path, mask_folder: Path | None = None, model_folder: Path | None = None
) -> Workspace:
    """Open a workspace: ``images/`` and a pinhole model in ``sparse/``, with a folder of masks or without.

    `model_folder` holds the same model with points, where that has none.
    """
    model_folder = model_folder or folder / "sparse"
    model = read_model(model_folder)
    images = registered(model)
    points = [model.points3D[key] for key in sorted(model.points3D)]
    cameras = [camera_of(image, model.cameras[image.camera_id]) for image in images]
    return Workspace(
        folder=folder,
        image_names=[image.name for image in images],
        cameras=cameras,
        points=SparsePoints(*points_seen(model, images)),
        colours=np.array([point.color for point in points], np.uint8).reshape(-1, 3),
        shapes=[camera.shape for camera in cameras],
        mask_folder=mask_folder,
        model_folder=model_folder,
    )


def write_depth_maps(
    folder: Path, image_name: str, camera: Camera, depth: np.ndarray, normals_in_world: np.ndarray
) -> None:
    """Write a view's maps in COLMAP's layout and axes below `folder`.

    Parameters
    ----------
    depth : ndarray, shape (h, w)
        z, 0 where unknown.
    normals_in_world : ndarray, shape (h, w, 3)
        Unit, zeros where unknown.
    """
    write_map(folder / "depth_maps" / f"{image_name}.geometric.bin", depth)
    normals = normals_in_cam(camera, normals_in_world)
    write_map(folder / "normal_maps" / f"{image_name}.geometric.bin", normals)
