"""The page: one HTML file that asks for nothing from anywhere, and the same in JSON."""

from __future__ import annotations

from base64 import b64encode
from collections.abc import Mapping
from typing import Any

from pipeline import json_text
from pipeline.request import Result
from stages.reporting.document.html_file import embedded, html_file
from stages.reporting.document.markup import Markup, tag
from stages.reporting.document.model_section import model_section
from stages.reporting.document.remarks import Remark, remarks
from stages.reporting.document.result_sections import (
    cost_section,
    energy_section,
    graph_section,
    left_out_section,
    light_section,
    records_section,
    settings_section,
)
from stages.reporting.document.told import REPORT, Told
from stages.reporting.document.verdict import verdict
from stages.reporting.document.view_sections import best_view, data_uri, views_section
from stages.reporting.document.wording import percent
from stages.reporting.parts import KINDS, SURFACE, TEXTURES, picture_file, texture_file

HTML, JSON = "report.html", "report.json"
SCRIPTS = ("comparison.js", "views.js", "textures.js", "surface.js")
PARTS = {
    "views": "Views",
    "model": "Model",
    "light": "Light",
    "energy": "Energy",
    "graph": "Shared surface",
    "cost": "Time and memory",
    "settings": "Settings",
    "records": "Records",
}


def summary(
    results: Mapping[str, Result], defaults: Mapping[str, Mapping[str, Any]], version: str
) -> dict[str, str]:
    """Write the report of all results: the page, and the same in JSON.

    Parameters
    ----------
    results : mapping of str to Result
        By stage.
    defaults : mapping of str to mapping of str to value
        Defaults of the settings, by stage.
    version : str
        Of unshade.

    Returns
    -------
    dict of str to str
        Texts by file name; nothing where the stage `report` has no result.
    """
    if REPORT not in results:
        return {}
    told = Told.of(results, defaults, version)
    found = remarks(told)
    return {HTML: page(told, found), JSON: json_text(as_json(told, found), indent=1) + "\n"}


def as_json(told: Told, found: list[Remark]) -> dict[str, Any]:
    """Collect what the page tells as JSON values, without pictures."""
    surface = told.content["surface"]
    return {
        "workspace": told.title,
        "unshade": told.version,
        "verdict": verdict(told),
        "warnings": [
            {"text": one.text, "stage": one.stage, "views": [told.views[i]["name"] for i in one.views]}
            for one in found
        ],
        "left_out": told.left_out,
        **{name: value for name, value in told.content.items() if name not in ("remarks", "surface")},
        "surface": surface and {name: surface[name] for name in ("vertices", "faces", "seen")},
        "records": {name: record.as_json() for name, record in told.records.items()},
    }


def page(told: Told, found: list[Remark]) -> str:
    """Put the page together from its sections."""
    sections = [
        views_section(told),
        left_out_section(told),
        model_section(told),
        light_section(told),
        energy_section(told),
        graph_section(told),
        cost_section(told),
        settings_section(told),
        records_section(told),
    ]
    top = {
        "best": best_view(told),
        "verdict": tag("p", " ".join(verdict(told)), class_="verdict"),
        "remarks": _remarks(told, found),
    }
    footer = tag("p", f"Written by unshade {told.version}. The same in numbers: {JSON}, beside this page.")
    title = f"{told.title}: report of unshade"
    return html_file(title, told.title, PARTS, top, sections, footer, _data(told), SCRIPTS)


def _remarks(told: Told, found: list[Remark]) -> Markup:
    """List the warnings, each with the views that show it."""
    if not found:
        return tag("p", "No warnings.", class_="note")
    items = []
    for one in found:
        views = [Markup(" ") + tag("a", told.views[i]["name"], href=_address(i, one.kind)) for i in one.views]
        shown = [tag("span", " See view", *map(Markup, views), ".")] if views else []
        items.append(tag("li", one.text, *shown, tag("small", f" ({one.stage})")))
    heading = "One warning" if len(items) == 1 else f"{len(items)} warnings"
    return tag("div", tag("h2", heading), tag("ul", *items), class_="remarks", id="warnings")


def _address(view: int, kind: str) -> str:
    """Name a view's place in the page, and which of its maps is on the right there."""
    return f"#view-{view + 1}-{kind}" if kind else f"#view-{view + 1}"


def _data(told: Told) -> str:
    """Embed the pictures of all views and the model."""
    views = [
        {
            "name": view["name"],
            "size": [view["width"], view["height"]],
            "about": f"Surface {percent(view['coverage'])}, known well {percent(view['confident'])}, "
            f"residual {percent(view['residual'], 1)}.",
            "depth": view["depth_range"],
            "pictures": {kind: data_uri(told, picture_file(number, kind)) for kind in view["kinds"]},
        }
        for number, view in enumerate(told.views)
    ]
    textures = [
        {kind: data_uri(told, texture_file(number, kind)) for kind in TEXTURES}
        for number in range(_number_of_textures(told))
    ]
    surface = told.content["surface"] and told.content["surface"] | {"front": told.best_view()}
    written = embedded({"views": views, "kinds": KINDS, "surface": surface, "textures": textures})
    if surface is not None:
        mesh = b64encode((told.folder / SURFACE).read_bytes()).decode("ascii")
        written += f'<script type="text/plain" id="surface-data">{mesh}</script>\n'
    return written


def _number_of_textures(told: Told) -> int:
    surface = told.content["surface"]
    return 0 if surface is None else len(surface["textures"])
