"""Photos that a model takes as they are stored: COLMAP passes over the orientation in their header."""

from __future__ import annotations

import json
from collections.abc import Iterable
from pathlib import Path

from pipeline import UserError, json_text
from pipeline.errors import shown

AS_STORED = "as_stored.json"  # beside the model's own files


def write_as_stored(model: Path, names: Iterable[str]) -> None:
    """Write the names of photos whose pixels the model in this folder means as they are stored."""
    (model / AS_STORED).write_text(json_text(sorted(names)) + "\n", encoding="utf-8")


def says_which(model: Path) -> bool:
    """Test whether the folder holds this list: such a model was made of photos as they are read here."""
    return (model / AS_STORED).is_file()


def read_as_stored(model: Path) -> frozenset[str]:
    """Read these names; none where there is no list: then all photos are meant upright.

    Raises
    ------
    UserError
        The file is no list of names.
    """
    file = model / AS_STORED
    if not file.is_file():
        return frozenset()
    try:
        names = json.loads(file.read_text(encoding="utf-8"))
    except (ValueError, RecursionError) as error:
        raise UserError(
            f"{file} is not JSON ({error}); expected a list of photos. Copy it again, or remove it."
        ) from error
    if not isinstance(names, list) or not all(isinstance(name, str) for name in names):
        raise UserError(
            f"{file} holds {shown(names)}; expected a list of photos. Copy it again, or remove it."
        )
    return frozenset(names)
