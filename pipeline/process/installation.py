"""The command that installs something into the environment that this program runs in."""

from __future__ import annotations

import shlex
import sys
from pathlib import Path

PROJECT = "unshade"
CHECKOUT = Path(__file__).resolve().parents[2]  # where the program is run from one, as `setup.sh` installs it


def pip_install(*words: str) -> str:
    """Write a command of pip, by the Python that runs: another environment may be active, or none."""
    return shlex.join([sys.executable or "python", "-m", "pip", "install", *words])


def install_extra(extra: str) -> str:
    """Write the command that installs an extra of the project: of the checkout, where there is one."""
    if (CHECKOUT / "pyproject.toml").is_file():
        return pip_install("-e", f"{CHECKOUT}[{extra}]")
    return pip_install(f"{PROJECT}[{extra}]")
