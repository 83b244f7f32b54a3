"""What was found of machine, libraries and photos: sentences for a screen, values for JSON, problems."""

from __future__ import annotations

import os
import platform
import shutil
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Any

from pipeline import Settings
from pipeline.cache.key import tool_version
from pipeline.process.memory_limits import free_bytes, machine_bytes
from pipeline.process.processors import affine_processors, processor_quota
from stages.diagnosis import advice
from stages.diagnosis.extras import EXTRAS, Extra
from stages.diagnosis.libraries import NEEDED, Library, check_libraries
from stages.solvers.kernels.loop_cache import VARIABLE

if TYPE_CHECKING:
    from stages.diagnosis.expectation import Expectation


@dataclass
class Findings:
    """What was found.

    Attributes
    ----------
    rows : list of tuple of str
        Topic and sentence.
    problems : list of str
        What keeps a run from its end, each with what to do.
    facts : dict
        As JSON values.
    """

    rows: list[tuple[str, str]] = field(default_factory=list)
    problems: list[str] = field(default_factory=list)
    facts: dict[str, Any] = field(default_factory=dict)

    def as_rows(self) -> list[dict[str, str]]:
        """List topics and sentences, the problems last."""
        result = [("missing", said) for said in self.problems] or [("result", "unshade can run here")]
        return [{"topic": topic, "what": said} for topic, said in (*self.rows, *result)]

    def as_json(self) -> dict[str, Any]:
        """Convert to plain JSON values."""
        return self.facts | {"problems": self.problems}


def find_machine(found: Findings, threads: int, room: int | None) -> None:
    """Tell of system, processors and memory.

    Parameters
    ----------
    found : Findings
        Is added to.
    threads : int
        That a run takes.
    room : int or None
        Memory into which stages divide their work, bytes.
    """
    quota, usable, version = processor_quota(), affine_processors(), tool_version("unshade")
    limit = "" if quota is None else f", of which the container has the time of {quota:.3g}"
    system, python = platform.platform(), platform.python_version()
    free, whole = free_bytes(), machine_bytes()
    found.rows += [
        ("system", f"{system}, Python {python}, unshade {version}"),
        ("processors", f"{usable} usable{limit}; a run takes {threads} thread(s) (--threads)"),
    ]
    if free is not None and whole is not None and room is not None:
        found.rows.append(
            (
                "memory",
                f"{advice.gigabytes(whole)} in all, {advice.gigabytes(free)} free with swap; stages divide "
                f"their work into {advice.gigabytes(room)} (--memory)",
            )
        )
    found.facts |= {"system": system, "python": python, "unshade": version}
    found.facts["processors"] = {"usable": usable, "quota": quota, "threads": threads}
    found.facts["memory"] = {"bytes": whole, "free_bytes": free, "stages_take_bytes": room}


def find_libraries(found: Findings) -> None:
    """Tell which libraries load, what dense stereo and loops run on, and which extras are installed."""
    wanted = dict(NEEDED)
    for extra in EXTRAS:
        wanted |= extra.modules if extra.is_installed else {}
    libraries = {one.module: one for one in check_libraries(wanted)}
    needed = [libraries[module] for module in NEEDED]
    sound = sum(one.fault is None for one in needed)
    found.rows.append(("libraries", f"{sound} of {len(needed)} load"))
    if libraries["pycolmap"].fault is None:
        stereo = advice.on_stereo(libraries["pycolmap"])
        found.rows.append(("pycolmap", f"{libraries['pycolmap'].version}, {stereo}"))
    loop_cache = os.environ.get(VARIABLE)
    if libraries["numba"].fault is None and loop_cache is not None:
        found.rows.append(("loops", advice.on_loops(libraries["numba"], loop_cache)))
    found.rows += [(f"extra {extra.name}", _on_extra(extra, libraries)) for extra in EXTRAS]
    found.problems += advice.library_problems(needed) + advice.loop_problems(loop_cache)
    found.facts["libraries"] = {one.module: asdict(one) for one in needed}
    found.facts["loop_cache"] = loop_cache
    found.facts["extras"] = {
        one.name: {"installed": one.is_installed, "gives": one.gives, "command": one.command}
        for one in EXTRAS
    }


def _on_extra(extra: Extra, libraries: Mapping[str, Library]) -> str:
    """Say whether an extra is installed and loads, and how to install it."""
    if not extra.is_installed:
        return f"not installed, for {extra.gives}: {extra.command}"
    faults = [
        f"{name} does not load: {libraries[name].fault}" for name in extra.modules if libraries[name].fault
    ]
    return f"installed, but {'; '.join(faults)}" if faults else f"installed, for {extra.gives}"


def find_photos_cost(
    found: Findings,
    sizes: Sequence[tuple[int, int]],
    remark: str,
    settings: Mapping[str, Settings],
    threads: int,
) -> Expectation:
    """Tell at which size a run works, what it takes, and what would help; returns what it takes.

    Parameters
    ----------
    found : Findings
        Is added to.
    sizes : sequence of tuple of int
        Width and height of every photo, px.
    remark : str
        Of photos that are not read; empty without any.
    settings : mapping of str to Settings
        Of the stages, adapted to the memory.
    threads : int
    """
    from stages.diagnosis.expectation import chosen_size, expected

    wanted, auto = settings["undistort"].max_size_px, settings["undistort"].auto  # type: ignore[attr-defined]
    clusters = settings["decomposition"].clusters  # type: ignore[attr-defined]
    at_size = expected(sizes, chosen_size(sizes, wanted, auto), auto, clusters)
    is_automatic = wanted == "auto"
    helps = advice.what_helps(sizes, at_size, auto, clusters, is_automatic)
    found.rows += [
        ("photos", f"{at_size.photos}, of up to {max(w * h for w, h in sizes) / 1e6:.1f} megapixels"),
        ("a run", advice.on_size(at_size, threads, is_automatic)),
        *(("", said) for said in helps),
        *([("left out", remark)] if remark else []),
    ]
    found.facts["photos"] = asdict(at_size) | {"advice": helps, "left_out": remark or None}
    return at_size


def find_room(found: Findings, workspace: Path, expected: Expectation | None, least_memory: int) -> None:
    """Tell whether disk and memory are enough: for the photos, or else for the libraries.

    Parameters
    ----------
    found : Findings
        Is added to.
    workspace : Path
        Or where it will be.
    expected : Expectation or None
        Of the photos.
    least_memory : int
        Bytes.
    """
    folders = (workspace.absolute(), *workspace.absolute().parents)
    place = next(folder for folder in folders if os.access(folder, os.F_OK))  # not in one that is closed
    free, may_write = shutil.disk_usage(place).free, os.access(place, os.W_OK | os.X_OK)
    found.rows.append(("disk", f"{advice.gigabytes(free)} free in {workspace} (--workspace)"))
    needed = (expected.memory_bytes, expected.disk_bytes) if expected else (None, None)
    found.problems += advice.memory_problems(free_bytes(), needed[0], least_memory)
    found.problems += advice.disk_problems(free, needed[1], str(workspace), may_write)
    found.facts["disk"] = {"workspace": str(workspace), "free_bytes": free, "may_write": may_write}
