"""The record of one result: its ingredients, outputs, facts and cost. Written last."""

from __future__ import annotations

import json
from collections.abc import Mapping
from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import Any

from pipeline.json_text import json_text

RECORD = "record.json"


@dataclass(frozen=True)
class Record:
    """Provenance of one cached result.

    Attributes
    ----------
    stage, version, key : str, int, str
    settings : dict
        The settings that change the result, by public name.
    inputs : dict of str to dict of str to str
        Per input, the digest of each file by relative path.
    tools, machine : dict of str to str
        Versions of the tools and choices of the machine that are part of the key.
    outputs : dict of str to dict of str to str
        Per artefact, the digest of each file by path relative to the artefact.
    facts : dict
        Values that the stage noted.
    warnings : list of str
    finished : str
        When it was published, ISO 8601, UTC.
    seconds, cpu_seconds : float
        Elapsed and processor time.
    peak_bytes : int
        Peak resident memory while it ran.
    """

    stage: str
    version: int
    key: str
    settings: Mapping[str, Any]
    inputs: Mapping[str, Mapping[str, str]]
    tools: Mapping[str, str]
    machine: Mapping[str, str]
    outputs: Mapping[str, Mapping[str, str]]
    facts: Mapping[str, Any] = field(default_factory=dict)
    warnings: tuple[str, ...] = ()
    finished: str = ""
    seconds: float = 0.0
    cpu_seconds: float = 0.0
    peak_bytes: int = 0

    def as_json(self) -> dict[str, Any]:
        """Convert to plain JSON values."""
        return asdict(self) | {"warnings": list(self.warnings)}


def write_record(folder: Path, record: Record) -> None:
    """Write `record.json` into `folder`."""
    text = json_text(record.as_json(), indent=1)
    (folder / RECORD).write_text(text + "\n", encoding="utf-8")


def read_record(folder: Path) -> Record | None:
    """Read the record in `folder`; None where there is no readable one, which makes the result invalid."""
    try:
        values = json.loads((folder / RECORD).read_text(encoding="utf-8"))
        return Record(**{**values, "warnings": tuple(values["warnings"])})
    except (OSError, ValueError, TypeError, KeyError):
        return None
