"""The parts of the page that show views: the comparison at its top, all views, the model."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

from stages.reporting.document.html_file import webp_uri
from stages.reporting.document.markup import Markup, joined, table, tag
from stages.reporting.document.told import Told
from stages.reporting.document.wording import NOTHING, percent, short
from stages.reporting.parts import KINDS, THUMBNAILS, picture_file, thumbnail_file

GAIN = (
    "Gain: exposure and white balance of a photo beside the others, per colour channel, which are found "
    "with the light and divided out. Below 1: a darker photo."
)


def data_uri(told: Told, file: str) -> str:
    """Read a picture as a data URI."""
    return webp_uri((told.folder / file).read_bytes())


def kinds_of(told: Told) -> list[str]:
    """List the kinds of pictures that any view has, in their order."""
    return [kind for kind in KINDS if any(kind in view["kinds"] for view in told.views)]


def comparison(left: Markup, right: Markup, label: str, **attributes: str) -> Markup:
    """Put two pictures of a view over one another, with a slider between them."""
    pane = tag(
        "div",
        tag("div", left, class_="layer left"),
        tag("div", right, class_="layer right"),
        tag("span", class_="divider", aria_hidden="true"),
        class_="pane",
    )
    slider = tag("input", type="range", min=0, max=100, step=0.5, value=50, aria_label=label)
    return tag("div", pane, slider, class_="comparison", **attributes)


def best_view(told: Told) -> Markup:
    """Show photo and albedo of the best view, or the photo alone."""
    number = told.best_view()
    view = told.views[number]
    kinds = ["photo", "albedo" if "albedo" in view["kinds"] else "photo"]
    left, right = (data_uri(told, picture_file(number, kind)) for kind in kinds)
    return large_pair(number, view, {kinds[0]: left} | {kinds[1]: right})


def large_pair(number: int, view: Mapping[str, Any], uris: Mapping[str, str]) -> Markup:
    """Show one or two pictures of a view beneath a slider, at the top of a page.

    Parameters
    ----------
    number : int
        Of the view.
    view : mapping
        With its `name`, `width` and `height`.
    uris : mapping of str to str
        Pictures by kind, the left one first.
    """
    kinds = [next(iter(uris)), list(uris)[-1]]
    left, right = (
        tag(
            "img",
            src=uris[kind],
            alt=f"{kind} of view {view['name']}",
            width=view["width"],
            height=view["height"],
        )
        for kind in kinds
    )
    caption = tag(
        "figcaption", f"{kinds[0]} | {kinds[1]} · view ", tag("a", view["name"], href=f"#view-{number + 1}")
    )
    whole = comparison(left, right, f"Left of the slider the {kinds[0]}, right of it the {kinds[1]}")
    return tag("figure", whole, caption, class_="best")


def views_section(told: Told) -> Markup:
    """Show one view at a time with all its maps; a script fills in the pictures."""
    names = [view["name"] for view in told.views]
    kinds = {kind: KINDS[kind] for kind in kinds_of(told)}
    right = "albedo" if "albedo" in kinds else list(kinds)[-1]
    return tag(
        "section",
        tag("h2", "Views"),
        viewer(names, kinds, "photo", right),
        thumbnails(names, [_small_pictures(told, number) for number in range(len(names))]),
        _table_of_views(told),
        tag("p", GAIN, class_="note"),
        id="views",
    )


def viewer(names: Sequence[str], kinds: Mapping[str, str], left: str, right: str, *more: Markup) -> Markup:
    """Show one view at a time: the controls, two maps beneath a slider, all maps small, and the keys.

    Parameters
    ----------
    names : sequence of str
        Of the views.
    kinds : mapping of str to str
        What maps show, by kind.
    left, right : str
        Kinds of the maps that are chosen at first.
    *more : Markup
        Further controls.
    """
    whole = tag(
        "div",
        _tools(names, kinds, left, right, more),
        _large(),
        _small_maps(kinds),
        tag("div", id="about-view"),
        id="viewer",
    )
    keys = tag(
        "p",
        "Keys: ",
        tag("kbd", "N"),
        " and ",
        tag("kbd", "P"),
        " next and previous view, ",
        tag("kbd", "1"),
        "–",
        tag("kbd", len(kinds)),
        " map on the right, with ",
        tag("kbd", "Shift"),
        " on the left, ",
        tag("kbd", "+"),
        " ",
        tag("kbd", "−"),
        " ",
        tag("kbd", "0"),
        " zoom; arrows move the slider, or the picture where that has the focus. Drag to move, pinch or "
        "double-click to zoom; all maps move together.",
        class_="note",
    )
    return joined([whole, keys])


def _tools(
    names: Sequence[str], kinds: Mapping[str, str], left: str, right: str, more: Sequence[Markup]
) -> Markup:
    """Build the controls above the picture."""
    views = [
        tag("option", f"{number}: {name}", value=number - 1) for number, name in enumerate(names, start=1)
    ]

    def choice(label: str, chosen: str, name: str) -> Markup:
        options = [tag("option", kind, value=kind, selected=kind == chosen) for kind in kinds]
        return tag("label", f"{label} ", tag("select", *options, id=name))

    return tag(
        "div",
        tag("label", "View ", tag("select", *views, id="which-view")),
        button("‹", "previous", "Previous view"),
        button("›", "next", "Next view"),
        choice("Left", left, "left-kind"),
        choice("Right", right, "right-kind"),
        *more,
        button("−", "zoom-out", "Zoom out"),
        button("+", "zoom-in", "Zoom in"),
        button("whole", "zoom-reset", "Show the whole picture"),
        class_="tools",
    )


def button(text: str, name: str, label: str) -> Markup:
    """Build a button, which a script finds by its name."""
    return tag("button", text, id=name, type="button", aria_label=label)


def _large() -> Markup:
    left, right = (tag("img", alt="", draggable="false") for _ in range(2))
    whole = comparison(left, right, "Slider between the left and the right map", id="large")
    return tag("figure", whole, tag("figcaption", id="large-caption", aria_live="polite"))


def _small_maps(kinds: Mapping[str, str]) -> Markup:
    """Build a button for each map: all show the same part of the view."""
    maps = [
        tag(
            "button",
            tag("span", tag("img", alt="", draggable="false"), class_="window"),
            tag("span", kind),
            type="button",
            aria_pressed="false",
            data_kind=kind,
            title=about,
        )
        for kind, about in kinds.items()
    ]
    return tag("div", *maps, class_="maps", role="group", aria_label="Map on the right of the slider")


def _small_pictures(told: Told, number: int) -> list[str]:
    """List the small pictures of a view, as data URIs."""
    kinds = [kind for kind in THUMBNAILS if kind in told.views[number]["kinds"]]
    return [data_uri(told, thumbnail_file(number, kind)) for kind in kinds]


def thumbnails(names: Sequence[str], uris: Sequence[Sequence[str]]) -> Markup:
    """List all views with their small pictures, of each one or several, each a link to the view."""
    shown = [
        tag(
            "li",
            tag(
                "a",
                *(tag("img", src=uri, alt="") for uri in pictures),
                tag("span", f"{number}: {name}"),
                href=f"#view-{number}",
            ),
        )
        for number, (name, pictures) in enumerate(zip(names, uris, strict=True), start=1)
    ]
    return tag("ol", *shown, class_="thumbnails", aria_label="All views")


def _table_of_views(told: Told) -> Markup:
    gains = {one["name"]: one for one in told.content["lights"]["gains"]}
    links = told.links
    rows = [
        (
            tag("a", f"{number + 1}: {view['name']}", href=f"#view-{number + 1}"),
            f"{view['width']} × {view['height']}",
            percent(view["coverage"]),
            percent(view["confident"]),
            percent(view["residual"], 1),
            _gain(gains.get(view["name"])),
            len(links[number]),
        )
        for number, view in enumerate(told.views)
    ]
    headings = [
        "view",
        "pixels",
        "surface",
        "known well",
        "residual",
        "gain r, g, b",
        "linked views",
    ]
    return table(headings, rows, "Every view in figures", class_="figures")


def _gain(one: dict[str, list[float]] | None) -> str:
    return short([round(value, 3) for value in one["gain"]]) if one else NOTHING
