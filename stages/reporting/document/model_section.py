"""The model of the page: a canvas that a script draws on, its switches, and what it shows."""

from __future__ import annotations

from stages.reporting.document.markup import Markup, definitions, tag
from stages.reporting.document.told import Told
from stages.reporting.document.wording import percent

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
