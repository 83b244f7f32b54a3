"""Cards and charts as they are given on the command line."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from math import isfinite

import numpy as np

from pipeline import UserError
from pipeline.errors import shortened
from pipeline.settings import near
from stages.photometry.calibration.colour_chart import FIRST_GREY, chart_boxes, chart_reflectances
from stages.photometry.calibration.settings import CalibrationSettings
from stages.scene.cameras import view_name

WHITE_FORM = "X,Y,WIDTH,HEIGHT@PHOTO=REFLECTANCE, as in 812,440,60,60@IMG_0012.jpg=0.18"
CHART_FORM = (
    "X1,Y1,X2,Y2,X3,Y3,X4,Y4@PHOTO, the outer corners of the patches dark skin, bluish green, black and white"
)
WHOLE = np.array([[0.0, 0, 1, 1]])


@dataclass(frozen=True, eq=False)
class Reference:
    """A card or a chart in a photo.

    Attributes
    ----------
    given : str
        As it was given, for messages.
    photo : str
        Name of the photo, with or without its extension.
    corners : ndarray, shape (4, 2)
        Of the card, or of the chart's outer patches: pixels of the upright photo, in the order of the unit
        square's (0, 0), (1, 0), (1, 1), (0, 1).
    boxes : ndarray, shape (n, 4)
        Patches in the unit square: left, top, right, bottom.
    reflectances : ndarray, shape (n, 3)
        Linear sRGB.
    is_grey : ndarray, shape (n,), bool
        Patches that scale and balance are found from.
    """

    given: str
    photo: str
    corners: np.ndarray
    boxes: np.ndarray
    reflectances: np.ndarray
    is_grey: np.ndarray

    @property
    def is_chart(self) -> bool:
        """Whether it has several patches."""
        return len(self.boxes) > 1


def references_of(how: CalibrationSettings) -> list[Reference]:
    """Parse the cards and charts of the settings.

    Raises
    ------
    UserError
        One has another form, an area of nothing, or a reflectance that is none.
    """
    return [_card(given) for given in how.white] + [_chart(given, how) for given in how.chart]


def view_of(reference: Reference, photos: Sequence[str]) -> str:
    """Find the view of a reference among the photos' names.

    Raises
    ------
    UserError
        There is none of that name.
    """
    for name in photos:
        if reference.photo in (name, view_name(name)):
            return view_name(name)
    raise UserError(
        f"{reference.given}: no photo of that name takes part (it may not have been placed, or raycast.views "
        f"leaves it out); {near(reference.photo, photos)}"
    )


def _card(given: str) -> Reference:
    place, _, reflectance = given.rpartition("=")
    numbers, _, photo = place.partition("@")
    sides, values = _numbers(numbers), _numbers(reflectance)
    fits = len(sides) == 4 and len(values) in (1, 3) and bool(photo)
    if not fits or min(sides[2:]) <= 0 or not all(0 < value <= 1 for value in values):
        raise UserError(
            f"--white {shortened(given)} was not understood; expected {WHITE_FORM}: pixels of the photo as "
            "it is shown, and a reflectance above 0 and up to 1, or three."
        )
    left, top, width, height = sides
    corners = np.array([left, top]) + np.array([[0, 0], [width, 0], [width, height], [0, height]])
    colour = np.broadcast_to(values, (1, 3)).astype(float)
    return Reference(f"--white {shortened(given)}", photo, corners, WHOLE, colour, np.ones(1, bool))


def _chart(given: str, how: CalibrationSettings) -> Reference:
    numbers, _, photo = given.partition("@")
    corners = np.array(_numbers(numbers))
    if corners.size != 8 or not photo or not _is_convex(corners.reshape(4, 2)):
        raise UserError(
            f"--chart {shortened(given)} was not understood; expected {CHART_FORM}, in this order, in pixels "
            "of the photo as it is shown."
        )
    reflectances = chart_reflectances()
    return Reference(
        f"--chart {shortened(given)}",
        photo,
        corners.reshape(4, 2),
        chart_boxes(how.chart_gap, how.chart_centre),
        reflectances,
        np.arange(len(reflectances)) >= FIRST_GREY,
    )


def _numbers(text: str) -> list[float]:
    """Parse numbers between commas; none where one is no number."""
    try:
        numbers = [float(part) for part in text.split(",")]
    except ValueError:
        return []
    return numbers if all(map(isfinite, numbers)) else []


def _is_convex(corners: np.ndarray) -> bool:
    """Whether the way round the corners turns the same way at each; mirrored charts do so as well."""
    along = np.roll(corners, -1, axis=0) - corners
    after = np.roll(along, -1, axis=0)
    turns = along[:, 0] * after[:, 1] - along[:, 1] * after[:, 0]
    return bool((turns > 0).all() or (turns < 0).all())
