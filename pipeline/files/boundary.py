"""The workspace's boundary: every folder that a run writes to, or deletes in, lies inside the workspace."""

from __future__ import annotations

import os
from pathlib import Path

from pipeline.errors import UserError

OWN_FOLDERS = ("cache", "output")


def check_workspace(workspace: Path) -> None:
    """Refuse a workspace whose path no file could hold, or in which a run would write elsewhere.

    Raises
    ------
    UserError
        Its path is not UTF-8, a file is in the way of one of its folders, or a link leads out of it.
    """
    try:
        os.path.realpath(workspace).encode()
    except UnicodeEncodeError as error:
        raise UserError(
            f"The workspace is {os.fsencode(workspace)!r}; expected a path in UTF-8. Choose another folder "
            "with --workspace."
        ) from error
    for name in OWN_FOLDERS:
        check_own_folder(workspace / name, workspace)


def check_own_folder(folder: Path, workspace: Path) -> None:
    """Refuse to write below a path of the workspace that is not, or cannot become, a folder inside it.

    Files are replaced by renaming, which never follows a link; so only links in place of folders can lead
    out. None are followed, not even to another place of the workspace.

    Raises
    ------
    UserError
        Something else is in the way, or a link or ``..`` leads elsewhere.
    """
    leads_to = os.path.realpath(folder)
    if leads_to != str(Path(os.path.realpath(workspace)) / folder.relative_to(workspace)):
        raise UserError(
            f"{folder} leads to {leads_to}; expected a folder of the workspace itself, for nothing outside "
            "is written or deleted. Remove the link, or choose another folder with --workspace."
        )
    place = folder
    while place != workspace and not os.path.lexists(place):
        place = place.parent
    if place != workspace and not place.is_dir():
        raise UserError(
            f"{place} is in the way: expected a folder there, or nothing. Move it elsewhere, and run again; "
            "earlier results are kept."
        )
