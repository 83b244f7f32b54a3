"""The views' files: masks, normals, linear values, maps, arrays of their pixels."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from pathlib import Path
from typing import Protocol, TypeVar

import numpy as np

from pipeline import UserError
from stages.formats.artefacts.camera_file import read_cameras
from stages.formats.images.exr import read_exr, write_exr
from stages.formats.images.photos import read_mask, write_png_srgb8
from stages.formats.images.resize import reduce_by_area
from stages.scene.cameras import Camera, rays_in_world

PREVIEW_WHITE = 0.99  # quantile that is white in previews, which people look at and nothing reads

Item = TypeVar("Item")
Made = TypeVar("Made")


class Each(Protocol):
    """`map`, or one on threads."""

    def __call__(self, work: Callable[[Item], Made], items: Iterable[Item], /) -> Iterable[Made]:
        """What is made of the items, in their order."""


def read_views(
    paths: Mapping[str, Path], cameras: Sequence[Camera], each: Each = map
) -> Iterator[tuple[np.ndarray, np.ndarray, np.ndarray]]:
    """Open one view after the other; never more full-size images at a time than there are threads.

    Parameters
    ----------
    paths : mapping of str to Path
        The artefacts `mask`, `normal` and `linear`: folders with a file per camera.
    cameras : sequence of Camera
        At the size of masks and normals. An image that is larger is reduced to it.
    each : callable
        `map`, or that of an executor.

    Yields
    ------
    tuple of three ndarray
        Ω of shape (h, w), bool; normals in the world, (h, w, 3); linear values of the masked pixels, (·, 3).

    Raises
    ------
    UserError
        An image holds values that are not numbers.
    """

    def read_view(camera: Camera) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        mask = read_mask(paths["mask"] / f"{camera.name}.png")
        linear = reduce_by_area(read_exr(paths["linear"] / f"{camera.name}.exr"), camera.shape)[mask]
        bad = int(np.count_nonzero(~np.isfinite(linear)))
        if bad:
            raise UserError(
                f"View {camera.name} has {bad} values in its mask that are not numbers; expected finite "
                "linear light. Mask these pixels out, or repair the image."
            )
        return mask, read_exr(paths["normal"] / f"{camera.name}.exr"), linear

    yield from each(read_view, cameras)


def masked_pixels(paths: Mapping[str, Path]) -> int:
    """Count the pixels in the masks of all views."""
    cameras = read_cameras(paths["cameras"])
    return sum(int(np.count_nonzero(read_mask(paths["mask"] / f"{one.name}.png"))) for one in cameras)


def read_maps(
    folder: Path, cameras: Sequence[Camera], masks: Sequence[np.ndarray], each: Each = map
) -> np.ndarray:
    """Open an EXR per view; values of the masked pixels, (N,) or (N, 3), view after view."""

    def read_view(view: tuple[Camera, np.ndarray]) -> np.ndarray:
        camera, mask = view
        return read_exr(folder / f"{camera.name}.exr")[mask]

    return np.concatenate(list(each(read_view, zip(cameras, masks, strict=True))))


def read_surface_points(
    paths: Mapping[str, Path], cameras: Sequence[Camera], masks: Sequence[np.ndarray]
) -> tuple[list[np.ndarray], list[np.ndarray]]:
    """Read where on the mesh the masked pixels of every view are.

    Returns
    -------
    tuple of two lists of ndarray
        Faces, (N_i,); barycentric coordinates (u, v), (N_i, 2).
    """
    faces, barycentric = [], []
    for camera, mask in zip(cameras, masks, strict=True):
        with np.load(paths["triangles"] / f"{camera.name}.npz", allow_pickle=False) as file:
            faces.append(file["triangles"][mask])
            barycentric.append(file["barycentric"][mask])
    return faces, barycentric


def scaled_channels(pixels: np.ndarray, scale: float | None = None) -> tuple[list[np.ndarray], float]:
    """Divide all images by one number, so that δ means something.

    Parameters
    ----------
    pixels : ndarray, shape (N, c)
        Linear values of all masked pixels.
    scale : float or None
        That number, from images that these belong to; None: their own.

    Returns
    -------
    tuple of list of ndarray, shape (N,), float32, and float
        The channels, and the scale by which they were divided: where none was given, the 99th percentile of
        all values (of those above 0, where these are fewer than one in a hundred).

    Raises
    ------
    UserError
        The images are black.
    """
    bright = float(np.percentile(pixels, 99)) if scale is None else scale
    if bright <= 0:
        if not (pixels > 0).any():
            raise UserError(
                f"The images are black inside the masks (the brightest value is {pixels.max(initial=0):g}); "
                "expected some light. Check that the masks are white where the object is."
            )
        bright = float(np.percentile(pixels[pixels > 0], 99))  # hardly any of it is lit
    channels = range(pixels.shape[1])
    return [np.ascontiguousarray(pixels[:, c], np.float32) / np.float32(bright) for c in channels], bright


def ways_to_cameras(cameras: Sequence[Camera], masks: Sequence[np.ndarray]) -> np.ndarray:
    """Compute unit vectors from masked pixels' surface to their camera, world axes, (N, 3), float32."""
    rays = [rays_in_world(camera)[mask] for camera, mask in zip(cameras, masks, strict=True)]
    towards = -np.concatenate(rays)
    return (towards / np.linalg.norm(towards, axis=1, keepdims=True)).astype(np.float32)


def images_of(masks: Sequence[np.ndarray], stacked: np.ndarray) -> Iterator[np.ndarray]:
    """Unstack values (N, …) into images (h_i, w_i, …), float32, 0 outside the masks, one after the other."""
    for mask, own in zip(masks, _by_view(masks, stacked), strict=True):
        yield image_of(mask, own)


def write_maps(
    folder: Path,
    cameras: Sequence[Camera],
    masks: Sequence[np.ndarray],
    stacked: np.ndarray,
    each: Each = map,
) -> None:
    """Write stacked values, (N,) or (N, 3), as an EXR per view, 0 outside the masks; `each` as above."""

    def write_view(view: tuple[Camera, np.ndarray, np.ndarray]) -> None:
        camera, mask, own = view
        write_exr(folder / f"{camera.name}.exr", image_of(mask, own))

    for _ in each(write_view, zip(cameras, masks, _by_view(masks, stacked), strict=True)):
        pass


def write_arrays(
    folder: Path,
    cameras: Sequence[Camera],
    masks: Sequence[np.ndarray],
    stacked: Mapping[str, np.ndarray],
    each: Each = map,
) -> None:
    """Write stacked values of some kinds, (N, …) each, as they are: an NPZ per view."""
    parts = {kind: _by_view(masks, values) for kind, values in stacked.items()}

    def write_view(view: tuple[int, Camera]) -> None:
        number, camera = view
        path = folder / f"{camera.name}.npz"
        path.parent.mkdir(parents=True, exist_ok=True)
        np.savez(path, allow_pickle=False, **{kind: own[number] for kind, own in parts.items()})

    for _ in each(write_view, enumerate(cameras)):
        pass


def read_arrays(
    folder: Path,
    cameras: Sequence[Camera],
    kinds: Sequence[str],
    each: Each = map,
    kept: Sequence[np.ndarray] | None = None,
) -> dict[str, np.ndarray]:
    """Read some kinds of what `write_arrays` wrote, stacked again; of each view all pixels, or those kept."""

    def read_view(view: tuple[Camera, np.ndarray | None]) -> list[np.ndarray]:
        camera, some = view
        with np.load(folder / f"{camera.name}.npz", allow_pickle=False) as file:
            values = [file[kind] for kind in kinds]
        return values if some is None or some.all() else [one[some] for one in values]

    some = [None] * len(cameras) if kept is None else kept
    of_views = zip(*each(read_view, zip(cameras, some, strict=True)), strict=True)
    return {kind: np.concatenate(own) for kind, own in zip(kinds, of_views, strict=True)}


def write_previews(
    folder: Path, cameras: Sequence[Camera], masks: Sequence[np.ndarray], stacked: np.ndarray
) -> float:
    """Write stacked values, (N, 3), linear, as 8-bit PNGs; returns what is white: a high quantile of all."""
    white = max(float(np.quantile(stacked, PREVIEW_WHITE)), 1e-12) if stacked.size else 1.0
    for camera, image in zip(cameras, images_of(masks, stacked), strict=True):
        write_png_srgb8(folder / f"{camera.name}.png", image / white)
    return white


def write_pictures_of_light(folder: Path, pictures: Mapping[str, np.ndarray]) -> None:
    """Write pictures of all directions as EXR, linear, and as PNG, the brightest hundredth being white.

    A sun in one pixel is a thousand times as bright as the sky.
    """
    every = [picture.max(axis=2).ravel() for picture in pictures.values()]
    white = float(np.quantile(np.concatenate(every), PREVIEW_WHITE)) if every else 1.0
    for name, picture in pictures.items():
        write_exr(folder / f"{name}.exr", picture)
        write_png_srgb8(folder / f"{name}.png", np.maximum(picture, 0) / max(white, 1e-12))


def _by_view(masks: Sequence[np.ndarray], stacked: np.ndarray) -> list[np.ndarray]:
    """Stacked values, (N, …), view by view."""
    ends = np.cumsum([np.count_nonzero(mask) for mask in masks])
    return np.split(stacked, ends[:-1])


def image_of(mask: np.ndarray, own: np.ndarray) -> np.ndarray:
    """Scatter one view's values, (·, …), to its pixels: (h, w, …), float32, 0 outside the mask."""
    image = np.zeros((*mask.shape, *own.shape[1:]), np.float32)
    image[mask] = own
    return image
