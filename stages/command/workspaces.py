"""Workspaces: the folder that a run works in, and the one that it used before."""

from __future__ import annotations

from pathlib import Path

from pipeline import UserError
from pipeline.config import Config
from pipeline.files.file_kinds import is_folder
from stages.command.arguments import Given
from stages.command.sources import beside, config_of, sources_of
from stages.scene.wording import listed

WORKSPACES = Path("workspaces")  # below the current folder
# Generic names of folders of photos: projects named by them would share a workspace.
SAY_NOTHING = {"images", "img", "photos", "photo", "pictures", "input", "jpg", "jpeg", "png", "tif", "tiff"}


def workspace_of(command: Given, config: Config, sources: dict[str, Path]) -> Path:
    """Select the workspace: the one given, or `workspaces/` and the first specific folder name upwards."""
    if command.workspace is not None:
        return command.workspace
    if config.workspace is not None:
        return beside(config, config.workspace)
    if "images" not in sources:
        return WORKSPACES / (command.config.stem if command.config else "render")
    photos = sources["images"].resolve()
    names = [folder.name for folder in (photos, *photos.parents) if folder.name]
    return WORKSPACES / next((name for name in names if name.lower() not in SAY_NOTHING), photos.name)


def existing_workspace(command: Given) -> Path:
    """Find the workspace that `run` uses with the same arguments.

    Raises
    ------
    UserError
        None was named and there is not exactly one, or it does not exist.
    """
    config = config_of(command)
    named = command.workspace is not None or config.workspace is not None
    sources = {} if named else sources_of(command, config)
    if named or sources or command.config is not None:
        workspace = workspace_of(command, config, sources)
    else:
        workspace = only_workspace()
    if not is_folder(workspace / "cache"):
        raise UserError(f"{workspace} holds no results yet; `unshade run` makes them, or check the path.")
    return workspace


def only_workspace() -> Path:
    """Find the only workspace below `workspaces/`.

    Raises
    ------
    UserError
        There is none, or there are several.
    """
    found = sorted(cache.parent for cache in WORKSPACES.glob("*/cache"))
    if len(found) != 1:
        there = f" There are {listed(list(map(str, found)))}." if found else ""
        raise UserError(
            "No workspace was named; expected a configuration, --images DIR as it was run, or --workspace "
            f"DIR.{there}"
        )
    return found[0]
