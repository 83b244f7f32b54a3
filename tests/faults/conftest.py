"""The recorder of attacks: what was tried, what happened, what was lost."""

from __future__ import annotations

import json
import os
from collections.abc import Callable
from pathlib import Path

import pytest

LOG_VARIABLE = "UNSHADE_FAULT_LOG"


@pytest.fixture(scope="session")
def tried() -> Callable[..., None]:
    """``tried(attack, outcome, times=1, lost=0)``: append a line of JSON to the file in UNSHADE_FAULT_LOG."""

    def record(attack: str, outcome: str, times: int = 1, lost: int = 0) -> None:
        log = os.environ.get(LOG_VARIABLE)
        if log:
            line = json.dumps({"attack": attack, "outcome": outcome, "times": times, "lost": lost})
            with Path(log).open("a", encoding="utf-8") as file:
                file.write(line + "\n")

    return record
