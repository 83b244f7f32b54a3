"""The parts of the page that show views: the comparison at its top, all views, the model."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

from stages.reporting.document.html_file import webp_uri
from stages.reporting.document.markup import Markup, definitions, joined, table, tag
from stages.reporting.document.told import Told
from stages.reporting.document.wording import NOTHING, percent, short
from stages.reporting.parts import KINDS, picture_file, thumbnail_file

SURFACES = {  # what the model shows: label, and what that is
    "albedo": "albedo",
    "photo": "photo",
    "shading": "shading",
    "normal": "normals",
    "confidence": "confidence",
    "relit": "relit by a lamp",
}
FROM_TEXTURE = "It is the textured model of this run, its textures reduced for this page."
FROM_VERTICES = (
    "The mesh is reduced for this page, and each vertex has a mean over the views; what no view shows is "
    "grey. With --texture the textured model is here instead."
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
        thumbnails(names, [data_uri(told, thumbnail_file(number)) for number in range(len(names))]),
        _table_of_views(told),
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


def thumbnails(names: Sequence[str], uris: Sequence[str]) -> Markup:
    """List all views with their small pictures, each a link to the view."""
    shown = [
        tag(
            "li",
            tag(
                "a",
                tag("img", src=uri, alt=""),
                tag("span", f"{number}: {name}"),
                href=f"#view-{number}",
            ),
        )
        for number, (name, uri) in enumerate(zip(names, uris, strict=True), start=1)
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
        "gain r, g, b (below 1: darker)",
        "linked views",
    ]
    return table(headings, rows, "Every view in figures", class_="figures")


def _gain(one: dict[str, list[float]] | None) -> str:
    return short([round(value, 3) for value in one["gain"]]) if one else NOTHING


def model_section(told: Told) -> Markup:
    """Show the surface: a canvas that a script draws on, and what to draw on it."""
    surface = told.content["surface"]
    if surface is None:
        return tag(
            "section", tag("h2", "Model"), tag("p", "There is no albedo on a surface yet."), id="model"
        )
    switches = [
        tag(
            "label",
            tag("input", type="radio", name="surface", value=kind, checked=kind == "albedo"),
            f" {label}",
        )
        for kind, label in SURFACES.items()
    ]
    lamp = [
        tag("label", f"{label} ", tag("input", type="range", id=name, min=low, max=high, value=value))
        for label, name, low, high, value in (
            ("Lamp around", "lamp-azimuth", -180, 180, 40),
            ("Lamp height", "lamp-elevation", -90, 90, 40),
        )
    ]
    canvas = tag(
        "canvas",
        "The model needs WebGL 2.",
        id="surface",
        tabindex=0,
        role="img",
        aria_label="The surface with its albedo; arrows turn it, plus and minus zoom",
    )
    source = FROM_TEXTURE if surface["textures"] else FROM_VERTICES
    about = definitions(
        [
            ("vertices", surface["vertices"]),
            ("faces", surface["faces"]),
            ("seen by a view", percent(surface["seen"])),
        ]
    )
    return tag(
        "section",
        tag("h2", "Model"),
        tag("fieldset", tag("legend", "Surface shows"), *switches, class_="switches"),
        tag("div", canvas, class_="stage"),
        tag(
            "div",
            tag("label", tag("input", type="checkbox", id="frusta"), " cameras"),
            *lamp,
            tag("button", "first position", type="button", id="turn-back"),
            class_="tools",
        ),
        tag(
            "p",
            "Drag to turn, with Shift or two fingers to move, scroll with Ctrl or pinch to zoom; the "
            f"camera of the view chosen above is orange. {source} The lamp casts no shadows, unlike the "
            "light of unshade relight.",
            class_="note",
        ),
        about,
        id="model",
    )
