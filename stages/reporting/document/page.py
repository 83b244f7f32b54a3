"""The page: one HTML file that asks for nothing from anywhere, and the same in JSON."""

from __future__ import annotations

from base64 import b64encode
from collections.abc import Mapping
from hashlib import sha256
from importlib.resources import files
from string import Template
from typing import Any

from pipeline import json_text
from pipeline.request import Result
from stages.reporting.document.markup import Markup, tag
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
from stages.reporting.document.view_sections import (
    best_view,
    data_uri,
    model_section,
    views_section,
)
from stages.reporting.document.wording import percent
from stages.reporting.parts import KINDS, SURFACE, picture_file

HTML, JSON = "report.html", "report.json"
SCRIPTS = ("comparison.js", "views.js", "surface.js")


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
    """Put the page together from its template, style, scripts and sections."""
    scripts = [_text(name) for name in SCRIPTS]
    style = _text("report.css")
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
    return Template(_text("report.html")).substitute(
        policy=_policy(style, scripts),
        title=tag("title", f"{told.title}: report of unshade"),
        style=Markup(f"<style>{style}</style>"),
        heading=tag("h1", told.title),
        best=best_view(told),
        verdict=tag("p", " ".join(verdict(told)), class_="verdict"),
        remarks=_remarks(told, found),
        sections="\n".join(section for section in sections if section),
        version=tag(
            "p", f"Written by unshade {told.version}. The same in numbers: {JSON}, beside this page."
        ),
        data=_data(told),
        scripts="".join(f"<script>{script}</script>\n" for script in scripts),
    )


def _remarks(told: Told, found: list[Remark]) -> Markup:
    """List the warnings, each with the views that show it."""
    if not found:
        return tag("p", "No warnings.", class_="note")
    items = []
    for one in found:
        views = [Markup(" ") + tag("a", told.views[i]["name"], href=f"#view-{i + 1}") for i in one.views]
        shown = [tag("span", " See view", *map(Markup, views), ".")] if views else []
        items.append(tag("li", one.text, *shown, tag("small", f" ({one.stage})")))
    heading = "One warning" if len(items) == 1 else f"{len(items)} warnings"
    return tag("div", tag("h2", heading), tag("ul", *items), class_="remarks", id="warnings")


def _data(told: Told) -> str:
    """Embed the pictures of all views and the model; `<` is escaped, so that no name can end the element."""
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
    data = json_text({"views": views, "kinds": KINDS, "surface": told.content["surface"]})
    written = f'<script type="application/json" id="data">{data.replace("<", chr(92) + "u003c")}</script>\n'
    if told.content["surface"] is not None:
        surface = b64encode((told.folder / SURFACE).read_bytes()).decode("ascii")
        written += f'<script type="text/plain" id="surface-data">{surface}</script>\n'
    return written


def _policy(style: str, scripts: list[str]) -> Markup:
    """Allow this page's own style and scripts and data URIs, and nothing else: no request can leave."""
    allowed = " ".join(_hash(script) for script in scripts)
    policy = (
        f"default-src 'none'; img-src data:; style-src {_hash(style)}; script-src {allowed}; base-uri 'none'"
    )
    return tag("meta", http_equiv="Content-Security-Policy", content=policy)


def _hash(text: str) -> str:
    return f"'sha256-{b64encode(sha256(text.encode('utf-8')).digest()).decode('ascii')}'"


def _text(name: str) -> str:
    return (files("stages.reporting") / "page" / name).read_text(encoding="utf-8")
