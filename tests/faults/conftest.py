"""The recorder of what the suite of faults tried."""

from __future__ import annotations

import json
import os
from collections.abc import Callable
from pathlib import Path

import pytest


@pytest.fixture(scope="session")
def tried() -> Callable[..., None]:
    """``tried(attack, outcome, times=1, lost=0)``: a line in the file that UNSHADE_FAULT_LOG names."""
    log = os.environ.get("UNSHADE_FAULT_LOG")

    def record(attack: str, outcome: str, times: int = 1, lost: int = 0) -> None:
        if log:
            line = {"attack": attack, "outcome": outcome, "times": times, "lost": lost}
            with Path(log).open("a", encoding="utf-8") as file:
                file.write(json.dumps(line) + "\n")

    return record
