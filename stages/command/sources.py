"""Sources of a run: what the command line and the configuration name, checked."""

from __future__ import annotations

import os
from collections.abc import Mapping
from pathlib import Path

import stages
from pipeline import UserError, former_names
from pipeline.config import Config, read_config
from pipeline.errors import shortened
from pipeline.files.file_kinds import FILE, FOLDER, is_folder, kind_of_file
from pipeline.process.library_messages import library_messages_in
from pipeline.request import Absent
from stages.command.arguments import Given
from stages.scene.datasets import Dataset, find_dataset

SOURCE_OF_FLAG = {
    "images": "images",
    "colmap": "colmap",
    "cameras": "camera_file",
    "points": "points_file",
    "mesh": "mesh_file",
    "masks": "masks",
    "object": "object",
    "environment": "environment",
    "known_light": "known_light",
}
LIGHTS = ("light", "known_light", "environment")
FILES_OR_FOLDERS = {"cameras", "points"}
DEPTH_MAPS = "dense_folder"  # the source that `--points` is where it names a folder
FILES = {"mesh", "object", "environment", "light", "known_light"}
DATASET_PHOTOS = "images"
PHOTO_LIST = "list.txt"  # of Bundler, beside its bundle or in the folder above
CAMERAS_OF_OTHERS = (  # names of files that --cameras takes
    *("transforms.json", "transforms_train.json", "bundle.out", "bundle/bundle.out"),
    *("cameras.sfm", "sfm.json", "sfm.sfm", "cameras.xml"),
)


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
    if "points_file" in sources and is_folder(sources["points_file"]):
        sources[DEPTH_MAPS] = sources.pop("points_file")
    if "camera_file" in sources and (listed := photo_list_of(sources["camera_file"])):
        sources["photo_list"] = listed
    if "colmap" in sources:
        refuse_cameras_of_others(sources["colmap"])
    beside_cameras = [sources["colmap"]] if "colmap" in sources else []
    beside_cameras += [sources["camera_file"].parent] if "camera_file" in sources else []
    for folder in beside_cameras:
        if "images" not in sources and is_folder(folder / "images"):
            sources["images"] = folder / "images"
    return sources


def photo_list_of(cameras: Path) -> Path | None:
    """Find the list of photos that Bundler wrote beside a bundle, or in the folder above; None of others."""
    if cameras.suffix != ".out":
        return None
    folder = cameras.absolute().parent
    places = (folder / PHOTO_LIST, folder.parent / PHOTO_LIST)
    return next((place for place in places if place.is_file()), None)


def refuse_cameras_of_others(folder: Path) -> None:
    """Refuse a folder given as that of a COLMAP model, if it holds another program's cameras instead.

    Raises
    ------
    UserError
        It does, and no model of COLMAP.
    """
    there = [name for name in CAMERAS_OF_OTHERS if (folder / name).is_file()]
    of_colmap = (f"{place}cameras.{form}" for place in ("", "*/", "*/*/") for form in ("bin", "txt"))
    if there and not any(any(folder.glob(pattern)) for pattern in of_colmap):
        raise UserError(
            f"--colmap {folder} holds {there[0]} and no COLMAP model; cameras of other programs are given by "
            f"`--cameras {folder / there[0]}`."
        )


def dataset_of(command: Given, config: Config) -> Dataset | None:
    """Find the data set that the photos are of, if the configuration names one and no folder was given."""
    named = "dataset" in config.sources and "images" not in config.sources and command.images is None
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
    kinds = (FILE, FOLDER) if flag in FILES_OR_FOLDERS else (FILE,) if flag in FILES else (FOLDER,)
    expected, flag = " or ".join(kinds), flag.replace("_", "-")
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
    if kind not in kinds:
        hint = (
            f" A file of cameras is given by `--cameras {path}`." if (flag, kind) == ("colmap", FILE) else ""
        )
        raise UserError(f"--{flag} {path} is {kind}; expected {expected}.{hint}")
    return path


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
    """Refuse a workspace in the folder of a source, and a source among its results: runs would mix the two.

    Raises
    ------
    UserError
        The workspace lies in such a folder, or a source in its `output` or `cache`. The light to relight with
        may: no run that uses it makes another.
    """
    results = [(workspace / own).resolve() for own in ("output", "cache")]
    for name, place in sources.items():
        if name != "light" and any(place.resolve().is_relative_to(folder) for folder in results):
            raise UserError(
                f"The source {name!r}, {place}, lies among the results of the workspace {workspace}, and "
                "would be replaced by those of this run; expected a place outside. Copy it elsewhere, or "
                "choose another workspace with --workspace DIR."
            )
        if workspace.resolve().is_relative_to(place.resolve()):
            raise UserError(
                f"The workspace {workspace} lies in {place.resolve()}, the folder of the source {name!r}, "
                "which would come to hold results; expected a place outside. Choose one with --workspace DIR."
            )
