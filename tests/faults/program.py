"""The program as a process, and the data of the checkout that it is tried on."""

from __future__ import annotations

import sys
from pathlib import Path

ROOT = Path(__file__).parents[2]
PHOTOS = ROOT / "sample_data/photos"
LINEAR = ROOT / "sample_data/linear"
PROGRAM = (sys.executable, "-m", "unshade")
