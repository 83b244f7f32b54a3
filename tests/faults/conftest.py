"""A record of the attacks that the tests of faults try, from which `docs/reliability.md` is written."""

from __future__ import annotations

import json
import os
from collections.abc import Callable
from pathlib import Path

import pytest


@pytest.fixture(scope="session")
def tried() -> Callable[..., None]:
    """``tried(attack, outcome, times=1, lost=0)`` appends a line to the file that UNSHADE_FAULT_LOG names."""

    def record(attack: str, outcome: str, times: int = 1, lost: int = 0) -> None:
        if path := os.environ.get("UNSHADE_FAULT_LOG"):
            row = {"attack": attack, "outcome": outcome, "times": times, "lost": lost}
            with Path(path).open("a", encoding="utf-8") as file:
                file.write(json.dumps(row) + "\n")

    return record
