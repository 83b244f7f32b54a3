"""The record of one result: its ingredients, outputs, facts and cost. Written last."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import Any

from pipeline.cache.sealed_json import read_sealed, sealed
from pipeline.files.replacing import replace_text

RECORD = "record.json"
TYPES: dict[str, type | tuple[type, ...]] = {  # in JSON; a field that is not named here holds an object
    "stage": str,
    "version": int,
    "key": str,
    "warnings": list,
    "finished": str,
    "seconds": (int, float),
    "cpu_seconds": (int, float),
    "peak_bytes": int,
    "spans": list,
}
SPAN: dict[str, type | tuple[type, ...]] = {  # of a stage: the types of its values
    "label": str,
    "total": (int, type(None)),
    "steps": int,
    "begun_s": (int, float),
    "seconds": (int, float),
    "at_most": bool,
}


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
    spans : list of dict
        The tasks whose progress it showed (`pipeline.process.spans.Span`); empty in older records.
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
    spans: tuple[Mapping[str, Any], ...] = ()

    def as_json(self) -> dict[str, Any]:
        """Convert to plain JSON values."""
        return asdict(self) | {"warnings": list(self.warnings), "spans": list(self.spans)}


def write_record(folder: Path, record: Record) -> None:
    """Write `record.json` into `folder`, with a digest of itself."""
    replace_text(folder / RECORD, sealed(record.as_json()))


def read_record(folder: Path) -> Record:
    """Read the record in `cache/STAGE/KEY`, which has to be of that stage and key.

    Raises
    ------
    OSError
        There is none, or it cannot be read.
    ValueError
        It was changed, has values of other types than a record's, or belongs elsewhere.
    """
    values = read_sealed(folder / RECORD)
    if not _is_typed(values):
        raise ValueError(f"{folder / RECORD} has a value of another type than a record's")
    try:
        lists = {"warnings": tuple(values["warnings"]), "spans": tuple(values.get("spans", ()))}
        record = Record(**{**values, **lists})
    except (TypeError, KeyError) as error:
        raise ValueError(f"{folder / RECORD} has other fields than a record: {error}") from error
    if (record.stage, record.key) != (folder.parent.name, folder.name):
        raise ValueError(f"{folder / RECORD} is that of {record.stage}/{record.key}")
    return record


def _is_typed(values: Mapping[str, Any]) -> bool:
    """Check that every field, and the texts within, have the type that they have in a record."""
    if not all(isinstance(value, TYPES.get(name, dict)) for name, value in values.items()):
        return False
    digests = [files for name in ("inputs", "outputs") for files in values.get(name, {}).values()]
    if not all(isinstance(files, dict) for files in digests):
        return False
    named = [values.get("tools", {}), values.get("machine", {}), *digests]
    texts = [*values.get("warnings", []), *(text for one in named for text in one.values())]
    return all(isinstance(text, str) for text in texts) and all(map(_is_span, values.get("spans", [])))


def _is_span(one: Any) -> bool:
    """Check for the values of a span, and for no others."""
    return (
        isinstance(one, dict)
        and one.keys() == SPAN.keys()
        and all(isinstance(value, SPAN[name]) for name, value in one.items())
    )
