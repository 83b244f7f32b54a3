"""The parts of the page that tell of light, energy, shared surface, cost, settings and records."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import Any

from pipeline import json_text
from pipeline.cache.record import Record
from stages.reporting.document.charts import bar, line_chart, view_map
from stages.reporting.document.markup import Markup, definitions, details, joined, table, tag
from stages.reporting.document.remarks import is_named
from stages.reporting.document.told import Told
from stages.reporting.document.view_sections import data_uri
from stages.reporting.document.wording import NOTHING, megabytes, seconds, short
from stages.reporting.parts import light_file
from stages.scene.wording import listed

ABSENT = "absent"  # what records say of a library that is not installed
DECISIONS = {  # facts of the records by which a stage chose, and what they are
    "light_distance": "distance of the light",
    "disagreement": "disagreement by distance of the light (the first wins, unless another is clearly less)",
    "lights": "lights",
    "suns": "suns and lamps: the direction to each, in world axes, and its share of all light",
    "shadowed_pixels": "pixels in the shadow of something that the mesh does not have",
    "lights_apart": "how far views have lights of their own: 0 one light, 1 each its own",
    "spread_between_views": "difference of the light between views",
    "brightening_between_views": "brightness of the views beside one another",
    "brightest": "what the brightest material reflects, and the disagreement of those tried",
    "specular": "specular reflection",
    "compared": "pairs of photos chosen by",
    "focal_spread": "spread of the focal lengths",
    "principal_point": "principal point",
    "outcomes": "outcome of the minimisation",
    "weights": "weights of the energy",
    "uncertainty": "uncertainty of the shading, by octave",
}


def light_section(told: Told) -> Markup:
    """Show every light as a picture of all directions and as a white ball in it; then what was decided."""
    lights = told.content["lights"]["shown"]
    figures = [_light(told, one) for one in lights]
    nothing = tag("p", "The light is in output/lighting.json, as coefficients of spherical harmonics.")
    return tag(
        "section",
        tag("h2", "Light"),
        tag("div", *figures, class_="lights") if figures else nothing,
        _decisions(told),
        id="light",
    )


def _light(told: Told, one: dict[str, Any]) -> Markup:
    number = one["number"]
    views = one["views"]
    which = "all views" if len(views) == len(told.views) else listed(views, at_most=3)
    environment = (
        tag(
            "img",
            src=data_uri(told, light_file(number, "environment")),
            class_="environment",
            alt=f"The light of {which} from all directions: the zenith above, the horizon in the middle",
        )
        if one["environment"]
        else Markup("")
    )
    ball = tag(
        "img",
        src=data_uri(told, light_file(number, "ball")),
        class_="ball",
        alt=f"A white ball in the light of {which}, from where the cameras were",
    )
    return tag("figure", environment, ball, tag("figcaption", f"Light {number + 1}: {which}"))


def _decisions(told: Told) -> Markup:
    rows = [
        (DECISIONS[name], _figures(value), stage)
        for stage, record in told.records.items()
        for name, value in record.facts.items()
        if name in DECISIONS
    ]
    return table(["decided", "figures", "stage"], rows, "How decisions fell, and by how much")


def _figures(value: Any) -> str:
    return short(value) if value not in ([], {}, "") else "none found"


def energy_section(told: Told) -> Markup:
    """Draw the energy over its evaluations, and list it with its terms."""
    energy = told.content["energy"]
    if not energy:
        return tag("section", tag("h2", "Energy"), tag("p", "No energy was minimised yet."), id="energy")
    clusters = energy.get("clusters") or [{"channels": energy.get("channels", {})}]
    channels: Mapping[str, Any] = clusters[0]["channels"]
    several = f" Of cluster 1 of {len(clusters)}." if len(clusters) > 1 else ""
    about = f"Energy after every evaluation; red is a whole line, green is dashed, blue dotted.{several}"
    lines = {name: _over_last(one["alternations"]) for name, one in channels.items()}
    lines = {name: line for name, line in lines.items() if line}
    drawn = line_chart(lines, "evaluations", "energy over its last value") if lines else Markup("")
    explained = definitions([(name, text) for name, text in energy.get("legend", {}).items()])
    return tag(
        "section",
        tag("h2", "Energy"),
        drawn,
        tag("p", about, class_="note"),
        _terms(channels),
        details("Meaning of the terms", explained),
        id="energy",
    )


def _over_last(steps: list[dict[str, Any]]) -> list[float]:
    """Divide energies by the last one: channels differ in size, but not in how they fall."""
    energies = [float(step["energy"]) for step in steps]
    return [energy / energies[-1] for energy in energies] if energies and energies[-1] > 0 else []


def _terms(channels: Mapping[str, Any]) -> Markup:
    """List the last evaluation of each channel, term by term."""
    last = {name: one["alternations"][-1] for name, one in channels.items() if one["alternations"]}
    names = list(dict.fromkeys(key for one in last.values() for key in one if not isinstance(one[key], dict)))
    rows = [
        (name, channels[name]["outcome"].replace("_", " "), *(short(one.get(key)) for key in names))
        for name, one in last.items()
    ]
    return table(["channel", "outcome", *names], rows, "The last evaluation, term by term")


def graph_section(told: Told) -> Markup:
    """Draw which views share surface."""
    names = [view["name"] for view in told.views]
    drawn = view_map([view["place"] for view in told.views], names, told.links)
    rows = [
        (
            tag("a", f"{number + 1}: {names[number]}", href=f"#view-{number + 1}"),
            ", ".join(
                f"{names[other]} ({count:,})".replace(",", " ")
                for other, count in sorted(own.items(), key=lambda item: -item[1])[:8]
            )
            or NOTHING,
        )
        for number, own in told.links.items()
    ]
    listed = table(
        ["view", "views with most surface in common (corresponding pixels)"], rows, "Shared surface"
    )
    return tag(
        "section",
        tag("h2", "Shared surface"),
        tag("p", "The views from above. The stronger a line, the more surface two views share."),
        tag("div", drawn, class_="stage"),
        details("In numbers", listed),
        id="graph",
    )


def cost_section(told: Told) -> Markup:
    """List time and memory of every stage."""
    longest = max((record.seconds for record in told.records.values()), default=0) or 1
    most = max((record.peak_bytes for record in told.records.values()), default=0) or 1
    rows = [
        (
            name,
            joined([seconds(record.seconds), bar(record.seconds / longest)]),
            seconds(record.cpu_seconds),
            joined([megabytes(record.peak_bytes), bar(record.peak_bytes / most)]),
            record.finished[:16].replace("T", " "),
        )
        for name, record in told.records.items()
    ]
    total = seconds(sum(record.seconds for record in told.records.values()))
    headings = ["stage", "time", "processor time", "peak memory", "finished (UTC)"]
    return tag(
        "section",
        tag("h2", "Time and memory"),
        tag("p", f"All stages together: {total}."),
        table(headings, rows, "Time and memory of every stage", class_="figures"),
        id="cost",
    )


def settings_section(told: Told) -> Markup:
    """List the settings of every stage, those that are not the default first."""
    rows = list(_settings(told))
    headings = ["setting", "value", "default", "origin"]
    changed = [row for row in rows if row[3] != "default"]
    first = (
        table(headings, changed, "Settings that are not the default")
        if changed
        else tag("p", "All settings are at their defaults.")
    )
    return tag(
        "section",
        tag("h2", "Settings"),
        first,
        details(f"All {len(rows)} settings that shape the result", table(headings, rows, "All settings")),
        id="settings",
    )


def _settings(told: Told) -> Iterator[tuple[str, str, str, str]]:
    for stage, record in told.records.items():
        defaults = told.defaults.get(stage, {})
        for name, value in record.settings.items():
            default = defaults.get(name)
            origin = "default" if value == default else "configuration, --set or --memory"
            yield f"{stage}.{name}", short(value), short(default), origin


def records_section(told: Told) -> Markup:
    """List versions, and every record as it is, but for the digests of files."""
    versions = {"unshade": told.version}
    for record in told.records.values():
        versions |= {name: version for name, version in record.tools.items() if version != ABSENT}
    folded = [
        details(
            f"{name} {record.key[:12]}", tag("pre", json_text(without_digests(record), indent=1), tabindex=0)
        )
        for name, record in told.records.items()
    ]
    return tag(
        "section",
        tag("h2", "Versions and records"),
        definitions(sorted(versions.items())),
        *folded,
        id="records",
    )


def without_digests(record: Record) -> dict[str, Any]:
    """Convert a record to JSON values, with the number of files in place of their digests."""
    values = record.as_json()
    for name in ("inputs", "outputs"):
        values[name] = {key: f"{len(files)} files" for key, files in values[name].items()}
    return values


def left_out_section(told: Told) -> Markup:
    """Name the photos that are no views, and what the stages said of them."""
    if not told.left_out:
        return Markup("")
    said = [sentence for record in told.records.values() for sentence in record.warnings]

    def reason(name: str) -> str:
        return next(
            (one for one in said if is_named(name, one)), "Not among the cameras, or left out by choice."
        )

    rows = [(name, reason(name)) for name in told.left_out]
    return tag(
        "section",
        tag("h2", "Photos left out"),
        table(["photo", "why"], rows, "Photos left out"),
        id="left-out",
    )
