"""Text, JSON and XML of other programs, read within bounds; numbers of them, checked."""

from __future__ import annotations

import json
import math
from collections.abc import Iterable, Sequence
from pathlib import Path
from typing import Any
from xml.etree import ElementTree

import numpy as np

from pipeline import UserError
from pipeline.errors import shown
from stages.scene.cameras import FARTHEST
from stages.scene.poses import nearest_rotation

LARGEST = 2**26  # bytes that are read of a file of cameras
LARGEST_SIDE = 2**20  # px, of an image


def begins_with(path: Path, header: str) -> bool:
    """Test whether a file begins with a header."""
    expected = header.encode()
    with path.open("rb") as file:
        return file.read(len(expected)) == expected


def read_text(path: Path, cut: bool = False) -> str:
    """Read a file of text.

    Parameters
    ----------
    path : Path
    cut : bool
        Whether to read the first `LARGEST` bytes of a larger file, rather than refuse it: points may follow.

    Raises
    ------
    UserError
        The file is too large, or is not text in UTF-8.
    """
    with path.open("rb") as file:
        data = file.read(LARGEST + (not cut))
    if len(data) > LARGEST:
        raise UserError(
            f"{path} has more than {LARGEST >> 20} MiB; expected cameras alone. Export them without points."
        )
    try:
        return data.decode("utf-8-sig")
    except UnicodeDecodeError as error:
        raise damaged(path, "it is not text") from error


def damaged(source: Path, fault: str) -> UserError:
    """Make the error that a file of cameras cannot be read."""
    return UserError(f"The cameras in {source} cannot be read: {fault}. Export them again.")


def json_object(text: str, source: Path) -> dict[str, Any]:
    """Parse a JSON object.

    Raises
    ------
    UserError
        It is none.
    """
    try:
        value = json.loads(text)
    except (ValueError, RecursionError) as error:
        raise damaged(source, f"it is not JSON ({error})") from error
    return mapping(value, "the document", source)


def xml_root(text: str, source: Path) -> ElementTree.Element:
    """Parse XML without declarations of its own, which could be expanded beyond bounds.

    Raises
    ------
    UserError
        It is none.
    """
    if "<!DOCTYPE" in text or "<!ENTITY" in text:
        raise damaged(source, "it declares entities of its own, which is not taken")
    try:
        return ElementTree.fromstring(text)
    except (ElementTree.ParseError, ValueError) as error:
        raise damaged(source, f"it is not XML ({error})") from error


def mapping(value: Any, what: str, source: Path) -> dict[str, Any]:
    """Check that a JSON value is an object.

    Raises
    ------
    UserError
        It is not.
    """
    if not isinstance(value, dict):
        raise damaged(source, f"{what} is {shown(value)}, expected an object")
    return value


def mappings(value: Any, what: str, source: Path) -> list[dict[str, Any]]:
    """Check that a JSON value is a list of objects.

    Raises
    ------
    UserError
        It is not.
    """
    if not isinstance(value, list):
        raise damaged(source, f"{what} is {shown(value)}, expected a list")
    return [mapping(one, f"an element of {what}", source) for one in value]


def number(value: Any, what: str, source: Path) -> float:
    """Read a finite number from a JSON value or a word of text.

    Raises
    ------
    UserError
        It is none.
    """
    try:
        found = math.nan if isinstance(value, bool) else float(value)
    except (TypeError, ValueError, OverflowError):
        found = math.nan
    if not math.isfinite(found):
        raise damaged(source, f"{what} is {shown(value)}, expected a number")
    return found


def numbers(values: Any, count: int, what: str, source: Path) -> list[float]:
    """Read so many finite numbers.

    Raises
    ------
    UserError
        There are more or fewer, or one is none.
    """
    if not isinstance(values, Sequence) or isinstance(values, str) or len(values) != count:
        raise damaged(source, f"{what} is {shown(values)}, expected {count} numbers")
    return [number(value, what, source) for value in values]


def whole_size(width: Any, height: Any, source: Path) -> tuple[int, int]:
    """Read width and height of an image, px.

    Raises
    ------
    UserError
        They are not whole, not positive, or larger than any image.
    """
    sides = [number(one, "the size of an image", source) for one in (width, height)]
    if any(side != int(side) or not 1 <= side <= LARGEST_SIDE for side in sides):
        raise damaged(source, f"an image has {sides[0]:g} × {sides[1]:g} pixels")
    return int(sides[0]), int(sides[1])


def pose(rotation: Iterable[Iterable[float]], last: Iterable[float], of: str, source: Path) -> np.ndarray:
    """Put together a pose, shape (3, 4), float64, from a rotation, (3, 3), and the last column, (3,).

    Raises
    ------
    UserError
        The rotation is none, but for a scale, or the place is beyond `FARTHEST`.
    """
    matrix, column = np.array(rotation, float), np.array(last, float)
    try:
        rotated = nearest_rotation(matrix)
    except ValueError as error:
        raise damaged(source, f"the rotation of {shown(of)} is none ({error})") from error
    if np.abs(column).max() >= FARTHEST:
        raise damaged(source, f"{shown(of)} stands beyond {FARTHEST:g}")
    return np.column_stack([rotated, column])
