"""Checked requests from the arguments of the command line and the configuration that they name."""

from __future__ import annotations

import os
from collections.abc import Mapping, Sequence
from pathlib import Path

import stages
from pipeline import UserError, former_names
from pipeline.config import Config, check_settings, override, read_config
from pipeline.errors import shortened, shown
from pipeline.files.file_kinds import FILE, FOLDER, is_folder, kind_of_file
from pipeline.process.library_messages import library_messages_in
from pipeline.request import Absent, Request, Selection, check_flow
from pipeline.stage import settings_of
from stages.command.arguments import Given, Relight, Run
from stages.command.machine import cluster_of, memory_of, memory_to_fit, threads_of
from stages.scene.datasets import Dataset, find_dataset
from stages.scene.wording import listed

SOURCE_OF_FLAG = {
    "images": "images",
    "colmap": "colmap",
    "mesh": "mesh_file",
    "masks": "masks",
    "object": "object",
    "environment": "environment",
    "known_light": "known_light",
}
LIGHTS = ("light", "known_light", "environment")
FILES = {"mesh", "object", "environment", "light", "known_light"}
DATASET_PHOTOS = "images"
WORKSPACES = Path("workspaces")  # below the current folder
# Generic names of folders of photos: projects named by them would share a workspace.
SAY_NOTHING = {"images", "img", "photos", "photo", "pictures", "input", "jpg", "jpeg", "png", "tif", "tiff"}


def request_of(command: Run) -> Request:
    """Build a checked request from a command.

    Raises
    ------
    UserError
        The command or its configuration has an error that the user can correct.
    """
    selection = Selection(command.only, command.first, command.last, command.force)
    config = config_of(command)
    added = stages.TEXTURE if command.texture else stages.FULL_RESOLUTION if command.full_resolution else None
    for flag, stage in (("to", command.last), ("only", command.only)):
        if added is not None and stage not in (None, added.name):
            asked = added.name.replace("_", "-")
            raise UserError(f"--{asked} and --{flag} {stage} were given: it comes last. Leave out one.")
    return _request(
        command, config, sources_of(command, config), selection, command.full_resolution, command.texture
    )


def relighting_of(command: Relight) -> Request:
    """Build a checked request for `relight`: all stages that lead to the albedo, and the relighting.

    Raises
    ------
    UserError
        The command or its configuration has an error that the user can correct; no light was given.
    """
    config = config_of(command)
    if (command.light is None) == (command.sun is None):
        both = "Two lights were given" if command.light else "No light was given"
        raise UserError(
            f"{both}; expected --light FILE, a picture of all directions (EXR or HDR, twice as wide as "
            "high), or --sun AZIMUTH,ELEVATION in degrees, for a clear sky."
        )
    sources = sources_of(command, config)
    if command.light is not None:
        sources |= {"light": existing("light", command.light)}
    sun = None if command.sun is None else f"relight.sun={_sun_of(command.sun)}"
    return _request(command, config, sources, Selection(), relighting=True, further=[sun] if sun else [])


def _sun_of(given: str) -> str:
    """Write azimuth and elevation as a list, as settings have it."""
    parts = given.split(",")
    try:
        azimuth, elevation = (float(part) for part in parts)
    except ValueError as error:
        raise UserError(
            f"--sun is {shown(given)}; expected azimuth and elevation in degrees, as in --sun 40,30."
        ) from error
    return f"[{azimuth:g}, {elevation:g}]"


def _request(
    command: Given,
    config: Config,
    sources: dict[str, Path],
    selection: Selection,
    full_resolution: bool = False,
    texture: bool = False,
    relighting: bool = False,
    further: Sequence[str] = (),
) -> Request:
    given = override(config.settings, [*command.assignments, *further])
    declared = {stage.name: stage.settings for stage in stages.ALL_STAGES}
    settings = check_settings(declared, given, former_names(stages.ALL_STAGES))
    flow_of = stages.experiment if "render" in given else stages.dataflow
    flow = flow_of(sources, stages.kind_of_light(settings, sources))
    if relighting:
        flow = stages.with_relighting(flow)
    if full_resolution:
        flow = stages.with_full_resolution(flow)
    if texture:
        flow = stages.with_texture(flow)
    kinds = stages.kinds_of_sources(flow)
    check_flow(flow, kinds)
    memory = memory_of(command)
    room = memory_to_fit(memory)
    if room is not None:
        settings |= {stage.name: stage.within(settings_of(stage, settings), room) for stage in flow}
    workspace = workspace_of(command, config, sources)
    for path in (workspace, *sources.values()):
        check_text(path)
    check_apart(workspace, sources)
    cluster = cluster_of(command)
    if cluster is not None:  # whose workers may be in other folders
        workspace, sources = workspace.absolute(), {name: path.absolute() for name, path in sources.items()}
    return Request(
        flow=flow,
        settings=settings,
        sources=sources,
        kinds=kinds,
        workspace=workspace,
        threads=threads_of(command),
        cluster=cluster,
        memory=memory,
        selection=selection,
        absent=absent_sources(command, config),
    )


def check_lights(sources: Mapping[str, Path]) -> None:
    """Refuse a picture of light that cannot be one, before the stages that lead to its use are run.

    Raises
    ------
    UserError
        As `read_environment`.
    """
    for name in (one for one in LIGHTS if one in sources):
        from stages.formats.images.photos import read_environment

        with library_messages_in(Path(os.devnull)):
            read_environment(sources[name])


def config_of(command: Given) -> Config:
    """Read the configuration file; without one, return an empty configuration.

    Raises
    ------
    UserError
        There is no such file, or it is not a configuration.
    """
    if command.config is None:
        return Config()
    if is_folder(command.config):
        raise UserError(
            f"The configuration {command.config} is a folder; expected a YAML file. A folder of photos is "
            f"given by `--images {command.config}`, one with a COLMAP model by `--colmap {command.config}`."
        )
    names = [stage.name for stage in stages.ALL_STAGES]
    return read_config(command.config, [*SOURCE_OF_FLAG, "dataset"], names, former_names(stages.ALL_STAGES))


def sources_of(command: Given, config: Config) -> dict[str, Path]:
    """Collect the sources that were given, those on the command line before those of the configuration."""
    sources = {}
    if dataset := dataset_of(command, config):
        sources["images"] = dataset.folder / DATASET_PHOTOS
    for flag, name in SOURCE_OF_FLAG.items():
        given = getattr(command, flag)
        if given is None and flag in config.sources:
            given = beside(config, config.sources[flag])
        if given is not None:
            sources[name] = existing(flag, given)
    if "colmap" in sources and "images" not in sources and is_folder(sources["colmap"] / "images"):
        sources["images"] = sources["colmap"] / "images"
    return sources


def dataset_of(command: Given, config: Config) -> Dataset | None:
    """Find the data set that the photos are of, if the configuration names one and no folder was given."""
    named = "dataset" in config.sources and command.images is None
    return find_dataset(config.sources["dataset"]) if named else None


def absent_sources(command: Given, config: Config) -> dict[str, Absent]:
    """Describe the photos of a data set that is not on this machine; a user's own folder has to be here."""
    dataset = dataset_of(command, config)
    if dataset is None or dataset.is_here():
        return {}
    return {"images": Absent(dataset.digests(DATASET_PHOTOS), dataset.fetch)}


def beside(config: Config, path: str) -> Path:
    """Resolve a path in a configuration relative to its folder; ~ is the user's home."""
    try:
        return Path(os.path.normpath(config.folder / Path(path).expanduser()))
    except RuntimeError as error:
        raise UserError(
            f"The path {path} in the configuration begins with a home that is not known here ({error}); "
            "write it in full."
        ) from error


def existing(flag: str, path: Path) -> Path:
    """Check that the path exists and is of the right kind, and return it."""
    expected, flag = FILE if flag in FILES else FOLDER, flag.replace("_", "-")
    try:
        kind = kind_of_file(path)
    except (FileNotFoundError, NotADirectoryError):
        raise UserError(
            f"--{flag} {shortened(str(path))} does not exist; expected {expected}. Check the path."
        ) from None
    except OSError as error:
        raise UserError(
            f"--{flag} {shortened(str(path))} cannot be looked up ({error.strerror}); expected {expected}. "
            "Check the path."
        ) from error
    if kind != expected:
        raise UserError(f"--{flag} {path} is {kind}; expected {expected}.")
    return path


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


def check_text(path: Path) -> None:
    """Refuse a path that is not text: libraries take names as UTF-8, and would not find it.

    Raises
    ------
    UserError
        Some bytes of its name, or of the name of a folder above it, are not UTF-8.
    """
    name = os.fsencode(path.absolute())
    try:
        name.decode("utf-8")
    except UnicodeDecodeError:
        raise UserError(
            f"The path {name!r} is not UTF-8; expected names in UTF-8. Rename what it names, or choose "
            "another place."
        ) from None


def check_apart(workspace: Path, sources: dict[str, Path]) -> None:
    """Refuse a workspace in the folder of a source: the next run would read its results as that source.

    Raises
    ------
    UserError
        The workspace lies in such a folder.
    """
    for name, place in sources.items():
        if workspace.resolve().is_relative_to(place.resolve()):
            raise UserError(
                f"The workspace {workspace} lies in {place.resolve()}, the folder of the source {name!r}, "
                "which would come to hold results; expected a place outside. Choose one with --workspace DIR."
            )


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
