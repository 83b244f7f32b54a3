"""The parts of the page that show views: the comparison at its top, all views, the model."""

from __future__ import annotations

from base64 import b64encode

from stages.reporting.document.markup import Markup, definitions, table, tag
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


def data_uri(told: Told, file: str) -> str:
    """Read a picture as a data URI: the page asks for nothing from elsewhere."""
    return "data:image/webp;base64," + b64encode((told.folder / file).read_bytes()).decode("ascii")


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
    left, right = (
        tag(
            "img",
            src=data_uri(told, picture_file(number, kind)),
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
    kinds = kinds_of(told)
    return tag(
        "section",
        tag("h2", "Views"),
        tag(
            "div", _tools(told, kinds), _large(), _small_maps(kinds), tag("div", id="about-view"), id="viewer"
        ),
        tag(
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
        ),
        _thumbnails(told),
        _table_of_views(told),
        id="views",
    )


def _tools(told: Told, kinds: list[str]) -> Markup:
    """Build the controls above the picture."""
    names = [
        tag("option", f"{number}: {view['name']}", value=number - 1)
        for number, view in enumerate(told.views, start=1)
    ]
    right = "albedo" if "albedo" in kinds else kinds[-1]

    def choice(label: str, chosen: str, name: str) -> Markup:
        options = [tag("option", kind, value=kind, selected=kind == chosen) for kind in kinds]
        return tag("label", f"{label} ", tag("select", *options, id=name))

    def button(text: str, name: str, label: str) -> Markup:
        return tag("button", text, id=name, type="button", aria_label=label)

    return tag(
        "div",
        tag("label", "View ", tag("select", *names, id="which-view")),
        button("‹", "previous", "Previous view"),
        button("›", "next", "Next view"),
        choice("Left", "photo", "left-kind"),
        choice("Right", right, "right-kind"),
        button("−", "zoom-out", "Zoom out"),
        button("+", "zoom-in", "Zoom in"),
        button("whole", "zoom-reset", "Show the whole picture"),
        class_="tools",
    )


def _large() -> Markup:
    left, right = (tag("img", alt="", draggable="false") for _ in range(2))
    whole = comparison(left, right, "Slider between the left and the right map", id="large")
    return tag("figure", whole, tag("figcaption", id="large-caption", aria_live="polite"))


def _small_maps(kinds: list[str]) -> Markup:
    """Build a button for each map: all show the same part of the view."""
    maps = [
        tag(
            "button",
            tag("span", tag("img", alt="", draggable="false"), class_="window"),
            tag("span", kind),
            type="button",
            aria_pressed="false",
            data_kind=kind,
            title=KINDS[kind],
        )
        for kind in kinds
    ]
    return tag("div", *maps, class_="maps", role="group", aria_label="Map on the right of the slider")


def _thumbnails(told: Told) -> Markup:
    shown = [
        tag(
            "li",
            tag(
                "a",
                tag("img", src=data_uri(told, thumbnail_file(number)), alt=""),
                tag("span", f"{number + 1}: {view['name']}"),
                href=f"#view-{number + 1}",
            ),
        )
        for number, view in enumerate(told.views)
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
    headings = ["view", "pixels", "surface", "known well", "residual", "gain r, g, b", "linked views"]
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
            "camera of the view chosen above is orange. The mesh is reduced for this page, and each "
            "vertex has a mean over the views; what no view shows is grey. The lamp casts no shadows, unlike "
            "the light of unshade relight.",
            class_="note",
        ),
        about,
        id="model",
    )
