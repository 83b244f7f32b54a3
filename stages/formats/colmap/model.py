"""COLMAP's sparse models: found, read and checked, turned into our cameras, and built again as PINHOLE."""

from __future__ import annotations

import errno
import re
import shutil
import struct
import tempfile
from collections.abc import Mapping
from itertools import islice
from pathlib import Path

import numpy as np
import pycolmap

from pipeline import UserError
from pipeline.errors import shown
from stages.formats.colmap.assembly import PosedImage, assemble, points2d_of
from stages.formats.colmap.binary_files import check_binary_files
from stages.formats.colmap.plausible_cameras import check_cameras
from stages.formats.images.photo_folder import check_view_names
from stages.scene.cameras import Camera, intrinsics_for_integer_centres, view_name
from stages.scene.image_names import fault_of_name

PINHOLES = ("PINHOLE", "SIMPLE_PINHOLE")
COUNTED = ("cameras", "images", "points3D")  # in the comments of text models


def find_model(folder: Path) -> Path:
    """Find the folder that holds ``cameras`` and ``images`` (.bin or .txt) of a COLMAP project.

    Looks at `folder`, then `folder/sparse`, then numbered sub-folders of both (``sparse/0``, ``sparse/1``):
    of several numbered models, the one with the most images; the lowest number among equals.

    Raises
    ------
    UserError
        There is none.
    """
    for parent in (folder, folder / "sparse"):
        if _format_of(parent):
            return parent
        if parent.is_dir():
            numbered = [sub for sub in parent.iterdir() if sub.name.isdecimal() and _format_of(sub)]
            if numbered:
                return min(numbered, key=lambda sub: (-_count_images(sub), int(sub.name)))
    raise UserError(
        f"There is no COLMAP model in {folder}: expected cameras and images (.bin or .txt) there, in sparse/ "
        "or in sparse/0/. Give the folder that holds the model."
    )


def read_model(folder: Path) -> pycolmap.Reconstruction:
    """Read a model, binary or text; a missing ``points3D`` counts as no points.

    Raises
    ------
    UserError
        There is no model, it cannot be read, was cut off, has impossible cameras or poses, or an image name
        is not UTF-8, is absolute, leaves its folder with ``..``, or shares its view name with another.
    """
    form = _format_of(folder)
    if form is None:
        raise UserError(f"There is no COLMAP model in {folder}: expected cameras and images, .bin or .txt.")
    promised = check_binary_files(folder) if form == ".bin" else _promised_in_text(folder)
    try:
        if (folder / f"points3D{form}").is_file():
            model = pycolmap.Reconstruction(folder)
        else:
            model = _read_without_points(folder, form)
    except (RuntimeError, ValueError, IndexError, MemoryError) as error:
        reason = " ".join(str(error).split())[:200]
        raise UserError(
            f"The COLMAP model in {folder} cannot be read ({reason}); export it again from COLMAP."
        ) from error
    _check_counts(model, promised, folder)
    _check_names(_names_of(model, folder), folder)
    check_cameras(model, folder)
    return model


def write_model(model: pycolmap.Reconstruction, folder: Path) -> None:
    """Write a model in binary, creating the folder, and read back how much of it has come to the disk.

    Raises
    ------
    OSError
        A file is shorter than it has to be: COLMAP's writer does not notice.
    """
    folder.mkdir(parents=True, exist_ok=True)
    model.write_binary(folder)
    wanted = {
        "cameras": len(model.cameras),
        "images": model.num_reg_images(),
        "points3D": len(model.points3D),
    }
    try:
        written = check_binary_files(folder)
    except UserError as error:
        raise OSError(errno.EIO, f"it was cut short: {error}", str(folder)) from error
    if {part: written.get(part) for part in wanted} != wanted:
        raise OSError(errno.EIO, f"it was cut short: {written} of {wanted}", str(folder))


def check_image_name(name: str, source: Path | str) -> None:
    """Refuse an image name that would leave the folder it is joined to, or be no name of a result.

    Raises
    ------
    UserError
        `fault_of_name` finds fault with it.
    """
    if fault := fault_of_name(name):
        raise UserError(
            f"The COLMAP model in {source} has an image named {shown(name)}, which {fault}; names "
            "must be relative paths without '..'. Rename it in the model, and its photo."
        )


def registered(model: pycolmap.Reconstruction) -> list[pycolmap.Image]:
    """List the images that have a pose, sorted by name."""
    return sorted((model.images[i] for i in model.reg_image_ids()), key=lambda image: image.name)


def cameras_of(model: pycolmap.Reconstruction) -> list[Camera]:
    """Convert a pinhole model's posed images to our cameras, sorted by image name.

    Raises
    ------
    ValueError
        A camera is not PINHOLE or SIMPLE_PINHOLE: the model has not been undistorted.
    """
    cameras = []
    for image in registered(model):
        camera = model.cameras[image.camera_id]
        if camera.model_name not in PINHOLES:
            raise ValueError(f"{image.name} has a {camera.model_name} camera; undistort the model first")
        cameras.append(camera_of(image, camera))
    return cameras


def camera_of(image: pycolmap.Image, camera: pycolmap.Camera) -> Camera:
    """Convert a posed COLMAP image and a pinhole COLMAP camera to our camera; both count pixels alike."""
    return Camera(
        name=view_name(image.name),
        width=camera.width,
        height=camera.height,
        intrinsics=np.array(camera.calibration_matrix(), float),
        cam_from_world=np.array(image.cam_from_world().matrix(), float),
    )


def pinhole_model(
    cameras: list[Camera],
    points_from: pycolmap.Reconstruction | None = None,
    extension: str | Mapping[str, str] = ".png",
) -> pycolmap.Reconstruction:
    """Build a PINHOLE model of given cameras, one image ``NAME.extension`` each.

    Parameters
    ----------
    cameras : list of Camera
        Views; equal intrinsics share one COLMAP camera.
    points_from : pycolmap.Reconstruction, optional
        A model of the same views (matched by view name, any camera model, same poses) whose 3-D points and
        tracks are kept: each 2-D point is carried over along its ray. Without it there are no points.
    extension : str or mapping of str to str
        Of the image names, of all or by view name.

    Returns
    -------
    pycolmap.Reconstruction
        Image ids follow `points_from` where given, else the order of `cameras`, from 1.
    """
    sources = {view_name(i.name): i for i in registered(points_from)} if points_from else {}
    images = []
    for index, camera in enumerate(cameras):
        image_id, xy = index + 1, np.zeros((0, 2))
        if points_from is not None:
            source = sources[camera.name]
            image_id = source.image_id
            xy = carried_points(source, points_from.cameras[source.camera_id], camera.intrinsics)
        images.append(
            PosedImage(
                image_id=image_id,
                name=camera.name + (extension if isinstance(extension, str) else extension[camera.name]),
                camera=_colmap_camera(camera),
                cam_from_world=pycolmap.Rigid3d(camera.cam_from_world),
                xy=xy,
            )
        )
    return assemble(images, points_from)


def carried_points(image: pycolmap.Image, camera: pycolmap.Camera, to_intrinsics: np.ndarray) -> np.ndarray:
    """Move 2-D points of an image along their rays into a pinhole camera K at the same pose.

    Returns
    -------
    ndarray, shape (n, 2), float64
        Pixels; NaN where the camera model finds no ray.
    """
    xy = points2d_of(image)
    if not len(xy):
        return xy
    normalised = np.asarray(camera.cam_from_img(xy), float)
    return normalised @ to_intrinsics[:2, :2].T + to_intrinsics[:2, 2]


def _colmap_camera(camera: Camera) -> pycolmap.Camera:
    K = camera.intrinsics
    return pycolmap.Camera(
        model="PINHOLE",
        width=camera.width,
        height=camera.height,
        params=[K[0, 0], K[1, 1], K[0, 2], K[1, 2]],
        has_prior_focal_length=True,
    )


def _format_of(folder: Path) -> str | None:
    """ ".bin" or ".txt" when both files of that kind are there."""
    for form in (".bin", ".txt"):
        if (folder / f"cameras{form}").is_file() and (folder / f"images{form}").is_file():
            return form
    return None


def _count_images(folder: Path) -> int:
    if _format_of(folder) == ".bin":
        with (folder / "images.bin").open("rb") as file:
            head = file.read(8)
        return struct.unpack("<Q", head)[0] if len(head) == 8 else 0
    lines = (folder / "images.txt").read_bytes().splitlines()
    return sum(not line.startswith(b"#") for line in lines) // 2


def _promised_in_text(folder: Path) -> dict[str, int]:
    """What the comments of a text model say that it holds."""
    promised = {}
    for part in COUNTED:
        head = b" ".join(line for line in _first_lines(folder / f"{part}.txt") if line.startswith(b"#"))
        if found := re.search(rb"Number of \w+: (\d+)", head):
            promised[part] = int(found[1])
    return promised


def _first_lines(path: Path, count: int = 8) -> list[bytes]:
    """None of a file that is not there."""
    if not path.is_file():
        return []
    with path.open("rb") as file:
        return list(islice(file, count))


def _check_counts(model: pycolmap.Reconstruction, promised: Mapping[str, int], source: Path) -> None:
    for part, count in promised.items():
        found = len(getattr(model, part))
        if found < count:
            raise UserError(
                f"The COLMAP model in {source} promises {count} {part} and holds {found}; it was cut off or "
                "damaged. Copy or export it again; if it was meant to hold fewer, mend the comment with "
                "their number at the head of the file."
            )


def _read_without_points(folder: Path, form: str) -> pycolmap.Reconstruction:
    """COLMAP insists on a points3D file: read beside an empty one."""
    with tempfile.TemporaryDirectory() as beside:
        for file in (one for one in folder.glob(f"*{form}") if one.is_file()):
            shutil.copy(file, beside)
        (Path(beside) / f"points3D{form}").write_bytes(struct.pack("<Q", 0) if form == ".bin" else b"")
        return pycolmap.Reconstruction(beside)


def _names_of(model: pycolmap.Reconstruction, source: Path) -> list[str]:
    try:
        return [image.name for image in model.images.values()]
    except UnicodeDecodeError as error:
        raise UserError(
            f"The COLMAP model in {source} has an image named {error.object!r}; names must be UTF-8. "
            "Rename it in the model, and its photo."
        ) from error


def _check_names(names: list[str], source: Path) -> None:
    seen: dict[str, str] = {}
    for name in sorted(names):
        check_image_name(name, source)
        if (view := view_name(name)) in seen:
            raise UserError(
                f"The COLMAP model in {source} has {seen[view]} and {name}, whose results would have the "
                "same name; rename one of them in the model. (Text models cut names at a space.)"
            )
        seen[view] = name
    check_view_names(seen, source)


def count_from_first_centre(model: pycolmap.Reconstruction) -> None:
    """Move the principal points of a model, in place, to where COLMAP's PatchMatch and fusion expect them.

    They take array indices for image coordinates, as though the first pixel's centre were at (0, 0);
    everywhere else in COLMAP it is at (0.5, 0.5).
    """
    for camera in model.cameras.values():
        shifted = intrinsics_for_integer_centres(np.array(camera.calibration_matrix(), float))
        camera.principal_point_x, camera.principal_point_y = shifted[0, 2], shifted[1, 2]


def centre_on_cameras(model: pycolmap.Reconstruction) -> np.ndarray:
    """Move a model, in place, until the mean of its cameras is at the origin; returns where that was, (3,).

    COLMAP's PatchMatch and fusion compute in single precision.
    """
    centre = np.mean([image.projection_center() for image in registered(model)], axis=0)
    model.transform(pycolmap.Sim3d(1.0, pycolmap.Rotation3d(), -centre))
    return np.asarray(centre, float)
