"""Whether libraries load on this machine: they are imported in a child process, which may crash."""

from __future__ import annotations

import json
import re
import subprocess
import sys
from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path
from signal import Signals
from typing import Any

from pipeline.cache.key import tool_version
from pipeline.process.installation import pip_install

PATIENCE_S = 900  # a cold disk and busy processors read a gigabyte of libraries in minutes
ROOT = Path(__file__).parents[2]  # where `stages` is found, also from a checkout
NEEDED = {  # modules that stages import, and their distributions
    "blake3": ("blake3",),
    "cv2": ("opencv-python-headless",),
    "fast_simplification": ("fast-simplification",),
    "numba": ("numba",),
    "numpy": ("numpy",),
    "open3d": ("open3d-cpu", "open3d"),
    "OpenEXR": ("openexr",),
    "PIL": ("pillow",),
    "pycolmap": ("pycolmap", "pycolmap-cuda12"),
    "scipy": ("scipy",),
    "trimesh": ("trimesh",),
    "xatlas": ("xatlas",),
}
SYSTEM_LIBRARIES = {  # shared libraries that these link to, and Debian's packages of them
    "libusb-1.0.so.0": "libusb-1.0-0",
    "libGL.so.1": "libgl1",
    "libEGL.so.1": "libegl1",
    "libX11.so.6": "libx11-6",
    "libudev.so.1": "libudev1",
    "libgomp.so.1": "libgomp1",
    "libatomic.so.1": "libatomic1",
}
NOT_THERE = "ModuleNotFoundError"


@dataclass(frozen=True)
class Library:
    """A library and whether it loads.

    Attributes
    ----------
    module : str
    version : str
        Of its distribution; `absent` where that is not installed.
    fault : str or None
        Why it does not load; None where it does.
    facts : dict
        What else is known of it.
    """

    module: str
    version: str
    fault: str | None = None
    facts: dict[str, Any] = field(default_factory=dict)


def check_libraries(needed: dict[str, tuple[str, ...]]) -> list[Library]:
    """Import modules in a child process, and in another one from where it crashed.

    Parameters
    ----------
    needed : dict of str to tuple of str
        Distributions that may hold a module, by the module.
    """
    left, found = list(needed), list[dict[str, Any]]()
    while left:
        outcomes = _imported(left)
        found += outcomes
        left = left[len(outcomes) :]
    return [
        Library(module, _version(needed[module]), outcome.pop("fault"), outcome)
        for module, outcome in zip(needed, found, strict=True)
    ]


def _imported(modules: Sequence[str]) -> list[dict[str, Any]]:
    """Import modules in one child process; the last outcome is that of the one that ended it."""
    command = [sys.executable, "-m", "stages.diagnosis.probe", *modules]
    try:
        done = subprocess.run(command, cwd=ROOT, capture_output=True, timeout=PATIENCE_S)
        output, why = done.stdout, _how_it_ended(done)
    except subprocess.TimeoutExpired as error:
        output, why = error.stdout or b"", f"it does not load within {PATIENCE_S} s"
    outcomes = [json.loads(line) for line in output.decode("utf-8").splitlines()]
    return outcomes if len(outcomes) == len(modules) else [*outcomes, {"fault": why}]


def _how_it_ended(done: subprocess.CompletedProcess[bytes]) -> str:
    """Describe the end of a child that a module ended."""
    if done.returncode < 0:
        return f"loading it ends the process ({Signals(-done.returncode).name})"
    said = done.stderr.decode("utf-8", "replace").strip().splitlines()
    return said[-1] if said else f"loading it ends the process (exit code {done.returncode})"


def _version(distributions: Sequence[str]) -> str:
    """Look up the version of the distribution that is installed."""
    versions = (tool_version(name) for name in distributions)
    return next((version for version in versions if version != "absent"), "absent")


def what_to_do(library: Library) -> str:
    """Say how a library comes to load: a system package, or its distribution anew."""
    fault = library.fault or ""
    if package := next((SYSTEM_LIBRARIES[name] for name in SYSTEM_LIBRARIES if name in fault), None):
        return f"Install the system package {package} (Debian, Ubuntu: sudo apt-get install {package})."
    if other := re.search(r"([\w.+-]+\.so[.\d]*): cannot open shared object file", fault):
        return f"Install the system package that holds {other[1]}."
    if "SIGILL" in fault:
        return "Its wheel was built for a newer processor; build it from source, or take another machine."
    distribution = NEEDED.get(library.module, (library.module,))[0]
    again = [] if fault.startswith(NOT_THERE) else ["--force-reinstall"]
    return f"Install it: {pip_install(*again, distribution)}"
