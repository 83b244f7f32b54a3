"""The command `doctor`: what the machine has, and what that means for a set of photos."""

from __future__ import annotations

from pathlib import Path

import stages
from pipeline import Settings, UserError, former_names, settings_of
from pipeline.command.terminal import Terminal, table_of
from pipeline.config import check_settings, override
from stages.command.arguments import Doctor
from stages.command.machine import LEAST_MEMORY, memory_of, memory_to_fit, threads_of
from stages.command.workspaces import WORKSPACES
from stages.diagnosis.findings import Findings, find_libraries, find_machine, find_photos_cost, find_room

MOST_PHOTOS, MOST_MEGAPIXELS = 100_000, 256  # the latter as photos are refused
UNFIT = 1
Sizes = list[tuple[int, int]]


def doctor_verb(command: Doctor, terminal: Terminal) -> int:
    """Look at the machine and the photos, and print what was found; returns 1 where something is missing.

    Raises
    ------
    UserError
        An argument, a setting or the folder of photos has an error that the user can correct.
    """
    settings, threads = settings_for(command), threads_of(command)
    sizes, remark = sizes_for(command)
    found = Findings()
    find_machine(found, threads, memory_to_fit(memory_of(command)))
    find_libraries(found)
    expected = find_photos_cost(found, sizes, remark, settings, threads) if sizes else None
    find_room(found, command.workspace or WORKSPACES, expected, LEAST_MEMORY)
    terminal.answer(found.as_json(), table_of(found.as_rows(), {"": "topic", " ": "what"}))
    return UNFIT if found.problems else 0


def settings_for(command: Doctor) -> dict[str, Settings]:
    """Check the settings that were given, and adapt those of the dataflow to the memory, as a run does."""
    declared = {stage.name: stage.settings for stage in stages.ALL_STAGES}
    checked = check_settings(declared, override({}, command.assignments), former_names(stages.ALL_STAGES))
    own = {stage.name: settings_of(stage, checked) for stage in stages.DATAFLOW}
    room = memory_to_fit(memory_of(command))
    if room is None:
        return own
    return {stage.name: stage.within(own[stage.name], room) for stage in stages.DATAFLOW}


def sizes_for(command: Doctor) -> tuple[Sizes, str]:
    """Collect the sizes of the photos, px, none where none were given; and what is to be said of the folder.

    Raises
    ------
    UserError
        There are no photos; a folder and a number were given; or a number is out of bounds.
    """
    number, megapixels = command.photos, command.megapixels
    if command.folder is not None:
        if number is not None or megapixels is not None:
            raise UserError(
                f"The folder {command.folder} was given, and --photos or --megapixels; expected one of the "
                "two. Leave out the other."
            )
        return _sizes_in(command.folder)
    if number is None and megapixels is None:
        return [], ""
    if number is None or megapixels is None:
        raise UserError(
            "--photos and --megapixels go together; expected both, as in --photos 60 --megapixels 24."
        )
    if not 1 <= number <= MOST_PHOTOS or not 0 < megapixels <= MOST_MEGAPIXELS:
        raise UserError(
            f"--photos is {number} and --megapixels {megapixels:g}; expected 1 to {MOST_PHOTOS} photos of up "
            f"to {MOST_MEGAPIXELS} megapixels."
        )
    from stages.diagnosis.expectation import of_megapixels

    return of_megapixels(number, megapixels), ""


def _sizes_in(folder: Path) -> tuple[Sizes, str]:
    """Read the sizes of the photos in a folder from their headers, and name those that cannot be read."""
    from stages.formats.images.photo_folder import find_photos, unread_photos
    from stages.formats.images.photos import photo_size

    names, sizes, damaged = find_photos(folder), list[tuple[int, int]](), list[str]()
    for name in names:
        try:
            sizes.append(photo_size(folder / name))
        except UserError as error:
            damaged.append(str(error))
    remark = unread_photos(folder, names)
    if damaged:
        more = f" (and {len(damaged) - 1} more)" if len(damaged) > 1 else ""
        remark = f"{damaged[0]}{more} {remark}".rstrip()
    if not sizes:
        raise UserError(f"{folder} holds no photos that can be read; expected some. {remark}".rstrip())
    return sizes, remark
