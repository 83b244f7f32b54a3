"""Objects of the MIT intrinsic images as Barron and Malik extended them, read by path and never copied.

Photos and measured reflectance are in colour. Eq. 2 gets them as **gray** values, the mean of the three
channels in linear light, as in the data set's own program (Grosse et al., ICCV 2009) where it estimates from
several lamps; all estimates are evaluated as gray values.
"""

from __future__ import annotations

import os
from dataclasses import dataclass
from pathlib import Path

import cv2
import numpy as np
from scipy.io import loadmat

from pipeline import UserError
from stages.formats.images.resize import reduce_by_area
from stages.scene.datasets import DATA_VARIABLE

FOLDER = Path("gt-mit-berkeley-intrinsic") / "MIT-Berkeley-Laboratory"
LAMPS = 10


@dataclass(frozen=True, eq=False)
class LampObject:
    """One object under ten lamps, one viewpoint.

    Attributes
    ----------
    name : str
    mask : ndarray, shape (h, w), bool
        Pixels of the object whose depth is known.
    photos : ndarray, shape (10, h, w, 3), float32
        Linear; as they are outside the mask.
    reflectance : ndarray, shape (h, w), float32
        Measured, gray; its scale is arbitrary.
    normals : ndarray, shape (h, w, 3), float64
        In camera axes (x right, y down, z forward), which are the world's here; 0 outside the mask.
    height : ndarray, shape (h, w), float32
        Towards the viewer, in pixels of this size; 0 outside the mask.
    """

    name: str
    mask: np.ndarray
    photos: np.ndarray
    reflectance: np.ndarray
    normals: np.ndarray
    height: np.ndarray

    @property
    def lamps(self) -> np.ndarray:
        """Photos in gray, shape (10, h, w), float32."""
        return self.photos.mean(axis=-1)


def objects_folder() -> Path:
    """Find the folder of the objects.

    Raises
    ------
    UserError
        The data are absent.
    """
    given = os.environ.get(DATA_VARIABLE)
    folder = Path(given) / FOLDER if given else None
    if folder is None or not folder.is_dir():
        where = folder or f"$UNSHADE_DATA/{FOLDER.as_posix()} (UNSHADE_DATA is not set)"
        raise UserError(
            f"There is no folder {where}; expected the objects of the MIT-Berkeley intrinsic images "
            "(SIRFS 1.5). They may be used for research only and are not fetched: put them there."
        )
    return folder


def read_object(folder: Path, reduction: int) -> LampObject:
    """Read an object, cut to its mask and reduced by area to 1/`reduction` of its width and height.

    A reduced pixel is valid if all of its area is. Normals are computed at full size, averaged, and
    normalised.
    """
    valid = (_gray(folder / "mask.png") > 0) & (_gray(folder / "depth_valid.png") > 0)
    height = np.where(valid, loadmat(folder / "Z.mat")["depth"], 0.0)
    photos = [_colour(folder / f"light{k:02d}.png") for k in range(1, LAMPS + 1)]
    planes = [valid, height / reduction, _gray(folder / "reflectance.png")]
    planes = [plane[..., None].astype(np.float32) for plane in planes]
    maps = [*planes, normals_from_height(height, valid).astype(np.float32), *photos]
    small = _reduced(np.concatenate(maps, axis=-1), valid, reduction)
    mask = small[..., 0] == 1
    normals = np.where(mask[..., None], small[..., 3:6].astype(np.float64), 0)
    lengths = np.linalg.norm(normals, axis=-1, keepdims=True)
    colours = small[..., 6:].reshape(*mask.shape, LAMPS, 3)
    return LampObject(
        name=folder.name,
        mask=mask,
        photos=np.ascontiguousarray(np.moveaxis(colours, 2, 0)),
        reflectance=small[..., 2],
        normals=normals / np.where(lengths > 0, lengths, 1),
        height=np.where(mask, small[..., 1], np.float32(0)),
    )


def normals_from_height(height: np.ndarray, valid: np.ndarray) -> np.ndarray:
    """Compute unit normals of an orthographic height map, towards the viewer.

    Parameters
    ----------
    height : ndarray, shape (h, w)
        Towards the viewer, in pixels: Barron and Malik's Z, larger where the surface is nearer.
    valid : ndarray, shape (h, w), bool

    Returns
    -------
    ndarray, shape (h, w, 3), float64
        ``n = −(∂x h, ∂y h, 1) / |·|`` in camera axes, x right, y down, z **forward**, so that n_z < 0 on
        all visible surface; (0, 0, 0) where not valid. Slopes are means of the forward and the backward
        difference where both neighbours are valid, the one difference where one is, 0 where none is.
    """
    slopes = [_slope(height.T, valid.T).T, _slope(height, valid)]
    normals = -np.stack([*slopes, np.ones(height.shape)], axis=-1)
    return normals / np.linalg.norm(normals, axis=-1, keepdims=True) * valid[..., None]


def _slope(height: np.ndarray, valid: np.ndarray) -> np.ndarray:
    """Compute the derivative along the first axis, from valid neighbours only."""
    both = valid[1:] & valid[:-1]
    steps = np.where(both, np.diff(height, axis=0), 0.0)
    total, count = np.zeros(height.shape), np.zeros(height.shape)
    for rows in (np.s_[:-1], np.s_[1:]):
        total[rows] += steps
        count[rows] += both
    return total / np.maximum(count, 1)


def _gray(file: Path) -> np.ndarray:
    """Read the mean of the channels, (h, w), float32, relative to the file's largest possible value."""
    return _colour(file).mean(axis=-1)


def _colour(file: Path) -> np.ndarray:
    """Read red, green and blue, (h, w, 3), float32, relative to the file's largest possible value."""
    image = cv2.imread(str(file), cv2.IMREAD_ANYDEPTH | cv2.IMREAD_COLOR)
    if image is None:
        raise UserError(f"{file} cannot be read; expected a PNG of the MIT-Berkeley intrinsic images.")
    return image[..., ::-1].astype(np.float32) / np.iinfo(image.dtype).max


def _reduced(maps: np.ndarray, mask: np.ndarray, reduction: int) -> np.ndarray:
    """Crop to the mask's box, pad to a multiple of `reduction`, and average."""
    rows, columns = (np.flatnonzero(mask.any(axis=axis)) for axis in (1, 0))
    cut = maps[rows[0] : rows[-1] + 1, columns[0] : columns[-1] + 1]
    missing = [(0, -size % reduction) for size in cut.shape[:2]]
    cut = np.pad(cut, [*missing, (0, 0)])
    return reduce_by_area(cut, (cut.shape[0] // reduction, cut.shape[1] // reduction))
