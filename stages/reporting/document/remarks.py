"""Warnings in plain words: those of the stages, and those that the figures give; each with what to do."""

from __future__ import annotations

import re
from collections.abc import Callable, Collection
from dataclasses import dataclass
from math import log2
from statistics import median
from typing import Any

from pipeline import json_text
from stages.reporting.document.told import Told
from stages.reporting.document.wording import percent

IN_THE_LIGHT_OF_THE_OTHERS = (
    "Take it again in the light of the others, or leave it out (--set 'raycast.views={out}'); where "
    "every photo has a light of its own, set lighting.lights=per-view."
)


@dataclass(frozen=True)
class Remark:
    """A warning.

    Attributes
    ----------
    text : str
        What there is, and what to do.
    stage : str
        Whose warning it is; `report` where the figures give it.
    views : tuple of int
        Numbers of the views that show it.
    kind : str
        The map that shows it, one of `KINDS`; empty: none in particular.
    """

    text: str
    stage: str
    views: tuple[int, ...] = ()
    kind: str = ""


def remarks(told: Told) -> list[Remark]:
    """Collect the warnings, those that the figures give first: they name causes that people see."""
    of_stages = [
        Remark(sentence, record.stage, _named_in(sentence, told))
        for record in told.records.values()
        for sentence in record.warnings
    ]
    return _of_figures(told) + of_stages


def _named_in(sentence: str, told: Told) -> tuple[int, ...]:
    """Find the views that a sentence names."""
    return tuple(n for n, view in enumerate(told.views) if is_named(view["name"], sentence))


def is_named(name: str, sentence: str) -> bool:
    """Tell whether a sentence names a view or a photo: as a word, and no number that counts something."""
    bare = re.escape(name)
    if name.isdecimal() and not name.startswith("0"):
        word = rf"(?<=[Vv]iew ){bare}|(?<=[Pp]hoto ){bare}|(?<![\w/]){bare}\.\w+"
    else:
        word = rf"(?<![\w/]){bare}"
    return re.search(rf"(?:{word})(?![\w/])", sentence) is not None


def _of_figures(told: Told) -> list[Remark]:
    """Name the views whose figures stand out; those in another light for nothing that follows from it."""
    bounds = told.content["remarks"]
    brightness = _of_views(
        told,
        lambda view: abs(view["albedo_stops"] or 0) > bounds["most_albedo_stops"],
        "the albedo is {} than where other views show the same surface. The light was another in this "
        "photo, by more than its exposure: a lamp was moved, a cloud passed, somebody cast a shadow. "
        + IN_THE_LIGHT_OF_THE_OTHERS,
        lambda view: _brighter(view["albedo_stops"]),
        kind="albedo",
    )
    spread = _of_spread(told, bounds["most_albedo_spread_stops"], bounds["most_albedo_spread_ratio"])
    otherwise_lit = {number for one in (brightness, spread) if one is not None for number in one.views}
    found = [
        brightness,
        spread,
        _of_sides(told),
        _of_views(
            told,
            lambda view: view["coverage"] < bounds["least_coverage"],
            "hardly any surface ({}). If the subject fills these photos, the surface is incomplete: "
            "add photos from nearby places; else leave them out (--set 'raycast.views={out}'), or mask the "
            "background.",
            lambda view: percent(view["coverage"]),
            kind="normal",
        ),
        _of_views(
            told,
            lambda view: (view["residual"] or 0) > bounds["most_residual"],
            "not explained by albedo and shading (median residual {}). Look at the residual: something "
            "moved, a highlight, or a surface that is not in the mesh; masks take such places out.",
            lambda view: percent(view["residual"]),
            but=otherwise_lit,
            kind="residual",
        ),
        _of_views(
            told,
            lambda view: (
                (view["confident"] or 0) < bounds["least_confident"] and view["confident"] is not None
            ),
            "the albedo is mostly uncertain ({} of it is known well). Look where the confidence "
            "is black: grazing surface and highlights gain from photos taken from more in front.",
            lambda view: percent(view["confident"]),
            but=otherwise_lit,
            kind="confidence",
        ),
        _of_gains(told, bounds["most_gain_stops"]),
    ]
    return [remark for remark in found if remark is not None]


def _of_views(
    told: Told,
    stands_out: Callable[[Any], bool],
    what: str,
    figure: Callable[[Any], str],
    but: Collection[int] = (),
    kind: str = "",
) -> Remark | None:
    """Name the views that stand out by one reason, with their figures; none of those in `but`.

    `what` may name the setting that leaves them out, as `{out}`; `kind` is the map that shows the reason.
    """
    numbers = [number for number, view in enumerate(told.views) if stands_out(view) and number not in but]
    if not numbers:
        return None
    most = told.content["remarks"]["most_named"]
    names = ", ".join(told.views[number]["name"] for number in numbers[:most])
    more = f" and {len(numbers) - most} more" if len(numbers) > most else ""
    figures = ", ".join(figure(told.views[number]) for number in numbers[:most])
    noun = "View" if len(numbers) == 1 else "Views"
    out = json_text([f"!{told.views[number]['name']}" for number in numbers])
    said = what.format(figures, out=out)
    return Remark(f"{noun} {names}{more}: {said}", "report", tuple(numbers[:most]), kind)


def _of_spread(told: Told, most_stops: float, most_ratio: float) -> Remark | None:
    """Name the views whose albedo is brighter in some places and darker in others than the other views'."""
    spreads = [view["albedo_spread_stops"] or 0 for view in told.views]
    most = max(most_stops, most_ratio * median(spreads)) if spreads else most_stops
    return _of_views(
        told,
        lambda view: (view["albedo_spread_stops"] or 0) > most,
        "the albedo is darker in some places, and brighter in others, than where other views show the same "
        "surface (typically by {}): the light came from elsewhere in this photo. A lamp was moved, the sun "
        "went on, a cloud passed. " + IN_THE_LIGHT_OF_THE_OTHERS,
        lambda view: percent(2 ** view["albedo_spread_stops"] - 1),
        kind="albedo",
    )


def _brighter(stops: float) -> str:
    """Say by how much a view is brighter or darker than the others."""
    return f"{percent(abs(2**stops - 1))} {'brighter' if stops > 0 else 'darker'}"


def _of_sides(told: Told) -> Remark | None:
    """Say from where a surface that goes around was photographed by none."""
    sides, bounds = told.content["sides"], told.content["remarks"]
    if sides is None or sides["gap_deg"] <= bounds["widest_gap_deg"]:
        return None
    if sides["roundness"] < bounds["least_roundness"]:
        return None
    ends = sorted(set(sides["between"]))
    names = " and ".join(told.views[number]["name"] for number in ends)
    where = (
        f"beyond views {names}, where the photos end" if len(ends) > 1 else f"all but where view {names} is"
    )
    every = bounds["photo_every_deg"]
    more = int(sides["gap_deg"] / every)
    lost = len(told.left_out)
    photos = "a photo that has" if lost == 1 else f"{lost} photos that have"
    also = (
        f" If {photos} no place in it yet (see below) {'was' if lost == 1 else 'were'} taken from there, the "
        "photos between are missing."
        if lost
        else ""
    )
    return Remark(
        f"No view shows the surface from one side: seen from above, {sides['gap_deg']:.0f}° of the circle "
        f"around it are without a camera, {where}. What only photos from there would show, as its back, is "
        f"missing from the model, or grey and made up.{also} If it should be there, walk on around it from "
        f"the last photos: about {more} more, one every {every:g}°, so that each overlaps its "
        "neighbours.",
        "report",
        tuple(ends),
    )


def _of_gains(told: Told, most_stops: float) -> Remark | None:
    """Name the views whose exposure differs from that of the others."""
    gains = {one["name"]: sum(one["gain"]) / len(one["gain"]) for one in told.content["lights"]["gains"]}
    if not gains or min(gains.values()) <= 0:
        return None
    middle = median(gains.values())
    return _of_views(
        told,
        lambda view: abs(log2(gains.get(view["name"], middle) / middle)) > most_stops,
        "exposed otherwise than the rest (times {}). Unshade has divided this out; if their light "
        "differed as well, compare their shading, and leave them out (--set 'raycast.views={out}') if it "
        "looks wrong.",
        lambda view: f"{gains[view['name']] / middle:.2f}",
        kind="shading",
    )
