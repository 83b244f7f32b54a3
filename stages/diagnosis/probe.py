"""The child process of `libraries`: imports modules one by one, and prints a line of JSON for each.

One that crashes ends the process; the lines before tell which that was.
"""

from __future__ import annotations

import ctypes
import os
import sys
from collections.abc import Callable, Sequence
from importlib import import_module
from types import ModuleType
from typing import Any

from pipeline.files.json_text import json_text


def main(names: Sequence[str]) -> None:
    """Import modules, in order."""
    answers = os.fdopen(os.dup(1), "w", encoding="utf-8")
    os.dup2(2, 1)  # libraries may print while they are loaded
    for name in names:
        answers.write(json_text(_outcome(name)) + "\n")
        answers.flush()


def _outcome(name: str) -> dict[str, Any]:
    """Import one module; whatever it raises is its message."""
    try:
        module = import_module(name)
        facts = FACTS[name](module) if name in FACTS else {}
    except Exception as error:  # libraries raise what they like
        return {"fault": f"{type(error).__name__}: {error}"}
    return {"fault": None, **facts}


def _of_pycolmap(module: ModuleType) -> dict[str, Any]:
    """Look up whether it was built with CUDA, and how many devices there are: as it counts itself, if so."""
    if module.has_cuda:
        return {"cuda": True, "devices": import_module("stages.stereo.cuda_cards").count_cards()}
    return {"cuda": False, "devices": cuda_devices()}


def _of_numba(module: ModuleType) -> dict[str, Any]:
    """Look up the threading layer that compiled loops will take."""
    layer = import_module("stages.solvers.kernels.threading_layer")
    return {"openmp": layer.loops_may_run_at_once(), "threads": module.config.NUMBA_NUM_THREADS}


def cuda_devices() -> int:
    """Count the CUDA devices that the driver offers; 0 without a driver."""
    count = ctypes.c_int(0)
    try:
        driver = ctypes.CDLL("libcuda.so.1")
        if driver.cuInit(0) != 0 or driver.cuDeviceGetCount(ctypes.byref(count)) != 0:
            return 0
    except (OSError, AttributeError):
        return 0
    return count.value


FACTS: dict[str, Callable[[ModuleType], dict[str, Any]]] = {"pycolmap": _of_pycolmap, "numba": _of_numba}

if __name__ == "__main__":
    main(sys.argv[1:])
