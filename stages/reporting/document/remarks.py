"""Warnings in plain words: those of the stages, and those that the figures give; each with what to do."""

from __future__ import annotations

import re
from collections.abc import Callable
from dataclasses import dataclass
from math import log2
from statistics import median
from typing import Any

from stages.reporting.document.told import Told
from stages.reporting.document.wording import percent


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
    """

    text: str
    stage: str
    views: tuple[int, ...] = ()


def remarks(told: Told) -> list[Remark]:
    """Collect the warnings, those of the stages first."""
    of_stages = [
        Remark(sentence, record.stage, _named_in(sentence, told))
        for record in told.records.values()
        for sentence in record.warnings
    ]
    return of_stages + _of_figures(told)


def _named_in(sentence: str, told: Told) -> tuple[int, ...]:
    """Find the views that a sentence names."""
    return tuple(
        number
        for number, view in enumerate(told.views)
        if re.search(rf"(?<![\w/]){re.escape(view['name'])}(?![\w/])", sentence)
    )


def _of_figures(told: Told) -> list[Remark]:
    """Name the views whose figures stand out."""
    bounds = told.content["remarks"]
    found = [
        _of_views(
            told,
            lambda view: view["coverage"] < bounds["least_coverage"],
            "hardly any surface ({}). If the subject fills these photos, the surface is incomplete: "
            "add photos from nearby places; else leave them out by raycast.views, or mask the background.",
            lambda view: percent(view["coverage"]),
        ),
        _of_views(
            told,
            lambda view: (
                (view["confident"] or 0) < bounds["least_confident"] and view["confident"] is not None
            ),
            "the albedo is mostly uncertain ({} of it is known well). Look where the confidence "
            "is black: grazing surface and highlights gain from photos taken from more in front.",
            lambda view: percent(view["confident"]),
        ),
        _of_views(
            told,
            lambda view: (view["residual"] or 0) > bounds["most_residual"],
            "not explained by albedo and shading (median residual {}). Look at the residual: something "
            "moved, a highlight, or a surface that is not in the mesh; masks take such places out.",
            lambda view: percent(view["residual"]),
        ),
        _of_gains(told, bounds["most_gain_stops"]),
    ]
    return [remark for remark in found if remark is not None]


def _of_views(
    told: Told, stands_out: Callable[[Any], bool], what: str, figure: Callable[[Any], str]
) -> Remark | None:
    """Name the views that stand out by one reason, with their figures."""
    numbers = [number for number, view in enumerate(told.views) if stands_out(view)]
    if not numbers:
        return None
    most = told.content["remarks"]["most_named"]
    names = ", ".join(told.views[number]["name"] for number in numbers[:most])
    more = f" and {len(numbers) - most} more" if len(numbers) > most else ""
    figures = ", ".join(figure(told.views[number]) for number in numbers[:most])
    noun = "View" if len(numbers) == 1 else "Views"
    return Remark(f"{noun} {names}{more}: {what.format(figures)}", "report", tuple(numbers[:most]))


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
        "differed as well, compare their shading, and leave them out if it looks wrong.",
        lambda view: f"{gains[view['name']] / middle:.2f}",
    )
