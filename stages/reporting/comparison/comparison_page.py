"""The page of a comparison: views of two results beneath a slider, what differs, and figures."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from stages.reporting.comparison import differing
from stages.reporting.comparison.differing import Records, Row
from stages.reporting.comparison.paired_views import Ratio
from stages.reporting.document.html_file import embedded, html_file, webp_uri
from stages.reporting.document.markup import Markup, details, table, tag
from stages.reporting.document.view_sections import button, large_pair, thumbnails, viewer
from stages.reporting.document.wording import counted, percent
from stages.scene.wording import listed

SCRIPTS = ("comparison.js", "views.js", "toggle.js")
PARTS = {"views": "Views", "figures": "Figures", "settings": "What differs", "cost": "Time and memory"}


@dataclass(frozen=True)
class ComparedView:
    """A view of both results.

    Attributes
    ----------
    name : str
    width, height : int
        Of its pictures, px.
    pictures : mapping of str to bytes
        WebP by kind.
    thumbnail : bytes
        WebP.
    difference : list of float, or None
        Mean difference of the albedos over their mean, per channel; None without a common pixel.
    """

    name: str
    width: int
    height: int
    pictures: Mapping[str, bytes]
    thumbnail: bytes
    difference: list[float] | None


@dataclass(frozen=True)
class Compared:
    """All that the page tells.

    Attributes
    ----------
    names : tuple of str
        What A and B are called.
    records : tuple of mapping of str to Record
        Of A and B, by stage.
    views : sequence of ComparedView
    only_in : tuple of list of str
        Views that only A, only B has.
    ratio : Ratio
    difference : list of float, or None
        As of a view, of all together.
    remarks : list of str
        What has to be known before pictures are compared.
    version : str
        Of unshade.
    """

    names: tuple[str, str]
    records: tuple[Records, Records]
    views: Sequence[ComparedView]
    only_in: tuple[list[str], list[str]]
    ratio: Ratio
    difference: list[float] | None
    remarks: list[str]
    version: str

    def as_json(self) -> dict[str, Any]:
        """Collect the figures as JSON values."""
        return {
            "a": self.names[0],
            "b": self.names[1],
            "scale": self.ratio.scale.tolist(),
            "difference": self.difference,
            "views": {view.name: view.difference for view in self.views},
            "only_in_a": self.only_in[0],
            "only_in_b": self.only_in[1],
            "settings": [list(row) for row in differing.differing_settings(*self.records)],
            "settings_of_one": [list(row) for row in differing.settings_of_one(*self.records)],
            "remarks": self.remarks,
        }


def comparison_page(compared: Compared) -> str:
    """Put the page together."""
    a, b = compared.names
    best = _most_different(compared.views)
    pair = {kind: webp_uri(compared.views[best].pictures[kind]) for kind in ("albedo A", "albedo B")}
    top = {
        "best": large_pair(best, vars(compared.views[best]), pair),
        "verdict": tag("p", " ".join(verdict(compared)), class_="verdict"),
        "remarks": _remarks(compared),
    }
    return html_file(
        f"{a} and {b}: comparison by unshade",
        f"A: {a} · B: {b}",
        PARTS,
        top,
        [_views(compared), _figures(compared), _what_differs(compared), _cost(compared)],
        tag("p", f"Written by unshade {compared.version}."),
        _data(compared),
        SCRIPTS,
    )


def verdict(compared: Compared) -> list[str]:
    """Say how many views were compared, by how much the albedos differ, and what was taken out before."""
    scale = ", ".join(f"{one:.3g}" for one in compared.ratio.scale)
    settings = len(differing.differing_settings(*compared.records))
    of_one = len(differing.settings_of_one(*compared.records))
    said = [f"{counted(len(compared.views), 'view is', 'views are')} in both results."]
    if compared.difference is not None:
        by = percent(float(np.mean(compared.difference)), 1)
        said.append(
            f"One scale per channel is taken out first (B over A: {scale}, red, green, blue): the albedos "
            f"then differ by {by} of their mean."
        )
    further = f", {_of_one(of_one)}" if of_one else ""
    return [*said, f"{counted(settings, 'setting differs', 'settings differ')}{further}."]


def _of_one(number: int) -> str:
    """Count what only one of the two results has."""
    return counted(number, "setting or stage is of one alone", "settings or stages are of one alone")


def kinds_of(compared: Compared) -> dict[str, str]:
    """Say what each kind of picture shows, for the kinds that are there."""
    a, b = compared.names
    stops = compared.ratio.stops
    about = {
        "photo": "the photo, undistorted, as A has it",
        "albedo A": f"albedo of {a}",
        "albedo B": f"albedo of {b}, divided by the scale",
        "shading A": f"shading of {a}",
        "shading B": f"shading of {b}, multiplied by the scale",
        "difference": "albedo B over albedo A, the scale taken out: grey the same, orange B brighter, blue B "
        f"darker; full colour from {stops:.2g} stops ({percent(2**stops - 1)})",
        "confidence A": f"certainty of the albedo of {a}: white is certain",
        "confidence B": f"certainty of the albedo of {b}: white is certain",
    }
    return {
        kind: text for kind, text in about.items() if any(kind in view.pictures for view in compared.views)
    }


def _most_different(views: Sequence[ComparedView]) -> int:
    """Choose the view whose albedos differ most."""
    return max(range(len(views)), key=lambda number: sum(views[number].difference or [0]))


def _remarks(compared: Compared) -> Markup:
    """List what has to be known before pictures are compared."""
    if not compared.remarks:
        return Markup("")
    items = [tag("li", one) for one in compared.remarks]
    return tag("div", tag("h2", "To be known"), tag("ul", *items), class_="remarks", id="warnings")


def _views(compared: Compared) -> Markup:
    """Show one view at a time, and list those that only one result has."""
    names = [view.name for view in compared.views]
    toggle = button("A ⇄ B", "toggle", "Show the same map of the other result over the whole picture")
    left_out = [
        tag("p", f"Only {name} has {counted(len(own), 'a further view', 'further views')}: {listed(own)}.")
        for name, own in zip("AB", compared.only_in, strict=True)
        if own
    ]
    rows = [
        (
            tag("a", f"{number}: {view.name}", href=f"#view-{number}"),
            *_percents(view.difference),
        )
        for number, view in enumerate(compared.views, start=1)
    ]
    return tag(
        "section",
        tag("h2", "Views"),
        viewer(names, kinds_of(compared), "albedo A", "albedo B", toggle),
        tag("p", "Key ", tag("kbd", "T"), " changes between A and B over the whole picture.", class_="note"),
        *left_out,
        thumbnails(names, [[webp_uri(view.thumbnail)] for view in compared.views]),
        table(
            ["view", "red", "green", "blue"],
            rows,
            "Mean difference of the albedos over their mean, the scale taken out",
            class_="figures",
        ),
        id="views",
    )


def _percents(difference: list[float] | None) -> list[str]:
    """Format a difference, per channel."""
    return [percent(share, 1) for share in difference or (None, None, None)]


def _figures(compared: Compared) -> Markup:
    """Show the figures of both results side by side."""
    return tag(
        "section",
        tag("h2", "Figures"),
        table(["figure", "A", "B"], differing.figures(*compared.records), "Figures of both results"),
        tag(
            "p",
            "Where two views show the same point, albedo should differ less than the photos do; so does a "
            "flat albedo, without detail. The share of light is no measure of quality.",
            class_="note",
        ),
        id="figures",
    )


def _what_differs(compared: Compared) -> Markup:
    """List settings, sources and versions that differ, and fold up the facts."""
    records = compared.records
    parts = [
        _differing(differing.differing_settings(*records), "setting", "Settings that differ"),
        _differing(differing.differing_sources(*records), "source", "Sources that differ"),
        _differing(differing.differing_versions(*records), "version", "Versions that differ"),
    ]
    shown = [part for part in parts if part] or [tag("p", "No setting, source or version differs.")]
    facts, of_one = differing.differing_facts(*records), differing.settings_of_one(*records)
    own = table(["setting or stage", "A", "B"], of_one, "Settings and stages that only one has")
    folded = table(["noted", "A", "B"], facts, "What the stages noted otherwise")
    return tag(
        "section",
        tag("h2", "What differs"),
        *shown,
        *([details(_of_one(len(of_one)), own)] if of_one else []),
        details(f"{counted(len(facts), 'fact differs', 'facts differ')} in the records", folded),
        id="settings",
    )


def _differing(rows: list[Row], what: str, caption: str) -> Markup:
    return table([what, "A", "B"], rows, caption) if rows else Markup("")


def _cost(compared: Compared) -> Markup:
    """List time and memory of every stage of both results."""
    headings = ["stage", "time A", "time B", "peak A", "peak B", "result"]
    rows = differing.costs(*compared.records)
    return tag(
        "section",
        tag("h2", "Time and memory"),
        table(headings, rows, "Time and memory of every stage", class_="figures"),
        id="cost",
    )


def _data(compared: Compared) -> str:
    """Embed the pictures of all views."""
    views = [
        {
            "name": view.name,
            "size": [view.width, view.height],
            "about": f"Difference red, green, blue: {', '.join(_percents(view.difference))}.",
            "depth": None,
            "pictures": {kind: webp_uri(data) for kind, data in view.pictures.items()},
        }
        for view in compared.views
    ]
    return embedded({"views": views, "kinds": kinds_of(compared)})
