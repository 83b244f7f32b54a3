"""COLMAP's database, written in a fixed order so that equal input gives equal bytes."""

from __future__ import annotations

import errno
import shutil
import sqlite3
from collections.abc import Iterable, Sequence
from contextlib import closing
from pathlib import Path

import numpy as np
import pycolmap

from stages.motion.features import Features
from stages.motion.room import check_room, room_for_copy


def working_name(index: int) -> str:
    """Name the photo of this index while COLMAP works, whose list of pairs is split at spaces."""
    return f"{index:06d}"


def copy_name(index: int) -> str:
    """Name the file of the reduced copy of the photo with this index."""
    return f"{index:06d}.png"


def write_features(
    path: Path, cameras: Sequence[pycolmap.Camera], groups: Sequence[int], features: Iterable[Features]
) -> list[np.ndarray]:
    """Write a new database of photos and their features, under working names.

    Parameters
    ----------
    path : Path
    cameras : sequence of pycolmap.Camera
        Ids from 1.
    groups : sequence of int
        Per photo, the index of its camera; image, frame and photo share the id index + 1.
    features : iterable of Features
        Per photo, taken one at a time.

    Returns
    -------
    list of ndarray, shape (n, 3), uint8
        Per photo, the colours at its features.
    """
    colours = []
    with pycolmap.Database.open(path) as database:
        for camera in cameras:
            _write_camera(database, camera)
        for index, (group, found) in enumerate(zip(groups, features, strict=True)):
            camera_id = cameras[group].camera_id
            _write_photo(database, index + 1, camera_id)
            database.write_keypoints(index + 1, found.keypoints)
            sift = pycolmap.FeatureDescriptors(pycolmap.FeatureExtractorType.SIFT, found.descriptors)
            database.write_descriptors(index + 1, sift)
            colours.append(found.colours)
    return colours


def write_own_cameras(database: Path, copy: Path) -> None:
    """Copy a database of working names and give every photo a camera of its own; nobody may have it open.

    Raises what `check_room` does.
    """
    check_room(copy, room_for_copy(database))
    shutil.copyfile(database, copy)
    with pycolmap.Database.open(copy) as opened:
        cameras = {camera.camera_id: camera for camera in opened.read_all_cameras()}
        images = opened.read_all_images()
        beyond = max(cameras)
        for image in images:
            camera = pycolmap.Camera(cameras[image.camera_id].todict())
            camera.camera_id = beyond + image.image_id
            _write_camera(opened, camera)
            image.camera_id = camera.camera_id
            frame = pycolmap.Frame(frame_id=image.frame_id, rig_id=camera.camera_id)
            frame.add_data_id(image.data_id)
            opened.update_frame(frame)
            opened.update_image(image)


def write_part(database: Path, part: Path, photos: Iterable[int]) -> None:
    """Write a new database of some photos (indices) of another, with their features and without matches."""
    with pycolmap.Database.open(database) as whole, pycolmap.Database.open(part) as opened:
        for camera in whole.read_all_cameras():
            _write_camera(opened, camera)
        for image_id in (one + 1 for one in photos):
            _write_photo(opened, image_id, whole.read_image(image_id).camera_id)
            opened.write_keypoints(image_id, whole.read_keypoints(image_id))
            opened.write_descriptors(image_id, whole.read_descriptors(image_id))


def take_matches(database: Path, part: Path, pairs: Iterable[tuple[int, int]]) -> None:
    """Write to a database what a part of it has of these pairs."""
    with pycolmap.Database.open(database) as whole, pycolmap.Database.open(part) as opened:
        for ids in ((one + 1, other + 1) for one, other in pairs):
            whole.write_matches(*ids, opened.read_matches(*ids))
            whole.write_two_view_geometry(*ids, opened.read_two_view_geometry(*ids))


def write_without_matches(database: Path, copy: Path, pairs: Iterable[tuple[int, int]]) -> None:
    """Copy a database of working names without the matches of some pairs of photos; nobody may have it open.

    Raises what `check_room` does.
    """
    check_room(copy, room_for_copy(database))
    shutil.copyfile(database, copy)
    with pycolmap.Database.open(copy) as opened:
        for one, other in pairs:
            opened.delete_matches(one + 1, other + 1)
            opened.delete_two_view_geometry(one + 1, other + 1)


def _write_photo(database: pycolmap.Database, image_id: int, camera_id: int) -> None:
    """Write an image under its working name, and the frame of it alone, of the same id."""
    image = pycolmap.Image(name=working_name(image_id - 1), camera_id=camera_id, image_id=image_id)
    database.write_image(image, use_image_id=True)
    frame = pycolmap.Frame(frame_id=image_id, rig_id=camera_id)
    frame.add_data_id(image.data_id)
    database.write_frame(frame, use_frame_id=True)


def _write_camera(database: pycolmap.Database, camera: pycolmap.Camera) -> None:
    """Write a camera and the rig of it alone, of the same id."""
    database.write_camera(camera, use_camera_id=True)
    rig = pycolmap.Rig(rig_id=camera.camera_id)
    rig.add_ref_sensor(camera.sensor_id)
    database.write_rig(rig, use_rig_id=True)


def publish(working: Path, published: Path, names: Sequence[str]) -> None:
    """Write the database anew under the photos' own names, byte for byte reproducible.

    Rows reach the working file in the order in which threads finish; ``VACUUM INTO`` lays the tables out by
    key, without free pages or a journal. Python's SQLite may touch the file only now that COLMAP's own copy
    of the library has closed it: two copies on one open file corrupt it.

    Raises
    ------
    OSError
        The disk takes no more.
    """
    try:
        with closing(sqlite3.connect(working)) as database:
            for index, name in enumerate(names):
                database.execute("UPDATE images SET name = ? WHERE image_id = ?", (name, index + 1))
            database.commit()
            database.execute("VACUUM INTO ?", (str(published),))
    except sqlite3.OperationalError as error:  # all that SQLite says of a full disk
        raise OSError(errno.EIO, f"it was cut short: {error}", str(published)) from error
