"""COLMAP's database, written in a fixed order so that equal input gives equal bytes."""

from __future__ import annotations

import errno
import sqlite3
from collections.abc import Iterable, Sequence
from contextlib import closing
from pathlib import Path

import numpy as np
import pycolmap

from stages.motion.features import Features


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
            database.write_camera(camera, use_camera_id=True)
            rig = pycolmap.Rig(rig_id=camera.camera_id)
            rig.add_ref_sensor(camera.sensor_id)
            database.write_rig(rig, use_rig_id=True)
        for index, (group, found) in enumerate(zip(groups, features, strict=True)):
            camera_id = cameras[group].camera_id
            image = pycolmap.Image(name=working_name(index), camera_id=camera_id, image_id=index + 1)
            database.write_image(image, use_image_id=True)
            frame = pycolmap.Frame(frame_id=index + 1, rig_id=camera_id)
            frame.add_data_id(image.data_id)
            database.write_frame(frame, use_frame_id=True)
            database.write_keypoints(index + 1, found.keypoints)
            sift = pycolmap.FeatureDescriptors(pycolmap.FeatureExtractorType.SIFT, found.descriptors)
            database.write_descriptors(index + 1, sift)
            colours.append(found.colours)
    return colours


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
