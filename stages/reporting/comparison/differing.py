"""What differs between the records of two results: settings, versions, sources, facts, costs."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import Any

from pipeline.cache.record import Record
from stages.reporting.document.wording import NOTHING, megabytes, percent, seconds, short

Records = Mapping[str, Record]
Row = tuple[str, str, str]
FIGURES = {  # facts of the report, and what they are
    "mean_coverage": "surface covers, of the pictures",
    "share_of_light": "light, of the variation of brightness in the photos",
    "difference_of_photos": "photos differ where two views show the same point",
    "difference_of_albedo": "albedo differs where two views show the same point",
}
IN_OTHER_ROWS = ("estimated_bytes",)  # facts that follow from the machine


def differing_settings(a: Records, b: Records) -> list[Row]:
    """List the settings that both have, and whose values differ."""
    return [row for row, of_both in _settings(a, b) if of_both]


def settings_of_one(a: Records, b: Records) -> list[Row]:
    """List the settings and stages that only one has, as another mode does."""
    return [row for row, of_both in _settings(a, b) if not of_both] + [
        (f"stage {stage}", "there" if stage in a else NOTHING, "there" if stage in b else NOTHING)
        for stage in dict.fromkeys((*a, *b))
        if (stage in a) != (stage in b)
    ]


def _settings(a: Records, b: Records) -> list[tuple[Row, bool]]:
    """List settings that differ, and whether both results have them."""
    return [
        (
            (f"{stage}.{name}", _setting(a[stage], name), _setting(b[stage], name)),
            name in a[stage].settings and name in b[stage].settings,
        )
        for stage in _both(a, b)
        for name in _differing(a[stage].settings, b[stage].settings)
    ]


def _setting(record: Record, name: str) -> str:
    """Format the value of a setting; none is a value, and so is an empty list."""
    if name not in record.settings:
        return NOTHING
    value = record.settings[name]
    return "none" if value is None or value == [] else short(value)


def differing_versions(a: Records, b: Records) -> list[Row]:
    """List versions of stages and of libraries, and choices of the machine, that differ."""
    rows = [
        (f"stage {stage}", str(a[stage].version), str(b[stage].version))
        for stage in _both(a, b)
        if a[stage].version != b[stage].version
    ]
    for kind in ("tools", "machine"):
        values = [
            {name: value for record in one.values() for name, value in getattr(record, kind).items()}
            for one in (a, b)
        ]
        rows += [
            (name, short(values[0].get(name)), short(values[1].get(name))) for name in _differing(*values)
        ]
    return rows


def differing_sources(a: Records, b: Records) -> list[Row]:
    """List the sources whose files differ, by the number of files, and how many are the same."""
    files = [_sources(one) for one in (a, b)]
    rows = []
    for name in _differing(*files):
        first, second = files[0].get(name, {}), files[1].get(name, {})
        same = sum(second.get(file) == digest for file, digest in first.items())
        rows.append((name, f"{len(first)} files", f"{len(second)} files, {same} of them the same"))
    return rows


def differing_facts(a: Records, b: Records) -> list[Row]:
    """List what stages noted otherwise, but for what the report's figures tell."""
    return [
        (
            f"{stage}: {name.replace('_', ' ')}",
            short(a[stage].facts.get(name)),
            short(b[stage].facts.get(name)),
        )
        for stage in _both(a, b)
        if stage != "report"
        for name in _differing(a[stage].facts, b[stage].facts)
        if name not in IN_OTHER_ROWS
    ]


def figures(a: Records, b: Records) -> list[Row]:
    """List the figures of both: those of the reports, time, processor time and memory of all stages."""
    rows = []
    for name, what in FIGURES.items():
        values = [one["report"].facts.get(name) if "report" in one else None for one in (a, b)]
        rows.append((what, percent(values[0], 1), percent(values[1], 1)))
    for what, total in (
        ("time of all stages", lambda one: seconds(sum(record.seconds for record in one.values()))),
        ("processor time", lambda one: seconds(sum(record.cpu_seconds for record in one.values()))),
        ("peak memory", lambda one: megabytes(max(record.peak_bytes for record in one.values()))),
    ):
        rows.append((what, total(a), total(b)))
    return rows


def costs(a: Records, b: Records) -> list[tuple[str, ...]]:
    """List time and peak memory of every stage: of A, of B."""
    rows = []
    for stage in dict.fromkeys((*a, *b)):
        own = [one.get(stage) for one in (a, b)]
        same = own[0] is not None and own[1] is not None and own[0].key == own[1].key
        times = [seconds(record.seconds) if record else NOTHING for record in own]
        peaks = [megabytes(record.peak_bytes) if record else NOTHING for record in own]
        rows.append((stage, *times, *peaks, "the same" if same else ""))
    return rows


def _both(a: Records, b: Records) -> Iterator[str]:
    yield from (stage for stage in a if stage in b)


def _differing(a: Mapping[str, Any], b: Mapping[str, Any]) -> list[str]:
    """List the keys of values that differ, in their order."""
    return [name for name in dict.fromkeys((*a, *b)) if a.get(name, NOTHING) != b.get(name, NOTHING)]


def _sources(records: Records) -> dict[str, Mapping[str, str]]:
    """Collect the files of inputs that no stage gave."""
    made = {name for record in records.values() for name in record.outputs}
    return {
        name: files
        for record in records.values()
        for name, files in record.inputs.items()
        if name not in made
    }
