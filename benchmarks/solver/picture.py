"""Energy against time, both logarithmic: excess of every method over the best known energy."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from PIL import Image, ImageDraw, ImageFont

from benchmarks.solver.clock import Trace
from benchmarks.solver.comparison import NEAR, best_known

SIZE_PX = (1000, 640)
LEFT, TOP, RIGHT, BOTTOM = 90, 50, 760, 570  # of the frame; the legend is to its right
INK, GREY, PAPER = (40, 40, 40), (215, 215, 215), (255, 255, 255)
COLOURS = (
    (20, 20, 20), (214, 39, 40), (31, 119, 180), (44, 160, 44), (148, 103, 189), (255, 127, 14),
    (23, 170, 190),
)  # fmt: skip
FLOOR = 1e-4  # lower excess is drawn here: the best itself has none


@dataclass(frozen=True)
class Axis:
    """A logarithmic axis from `least` to `most` over pixels `start` to `end`."""

    least: float
    most: float
    start: int
    end: int

    def place(self, value: float) -> float:
        """Convert a value to a pixel, clamped to the border."""
        inside = min(max(value, self.least), self.most)
        part = np.log(inside / self.least) / np.log(self.most / self.least)
        return self.start + part * (self.end - self.start)

    def decades(self) -> list[float]:
        """List the powers of ten on the axis."""
        first, last = np.ceil(np.log10(self.least) - 1e-9), np.floor(np.log10(self.most) + 1e-9)
        return [float(10**k) for k in np.arange(first, last + 1)]


def chart(title: str, traces: Sequence[Trace]) -> np.ndarray:
    """Draw the chart, (h, w, 3) uint8 sRGB; times at 0 are drawn at the left border."""
    best = best_known(traces)
    seconds = [look.seconds for trace in traces for look in trace.looks if look.seconds > 0]
    excess = [look.energy / best - 1 for trace in traces for look in trace.looks]
    across = Axis(min(seconds) / 1.2, max(seconds) * 1.2, LEFT, RIGHT)
    up = Axis(FLOOR, max(*excess, 10 * FLOOR) * 1.2, BOTTOM, TOP)
    image = Image.new("RGB", SIZE_PX, PAPER)
    draw = ImageDraw.Draw(image)
    _frame(draw, title, across, up)
    for trace, colour in zip(traces, _colours(len(traces)), strict=True):
        points = [(across.place(look.seconds), up.place(look.energy / best - 1)) for look in trace.looks]
        draw.line(points, colour, 2)
        for x, y in points:
            draw.ellipse((x - 3, y - 3, x + 3, y + 3), colour)
    _legend(draw, [trace.method for trace in traces])
    return np.asarray(image)


def _frame(draw: ImageDraw.ImageDraw, title: str, across: Axis, up: Axis) -> None:
    font = ImageFont.load_default(13)
    for value in across.decades():
        x = across.place(value)
        draw.line((x, TOP, x, BOTTOM), GREY)
        draw.text((x - 12, BOTTOM + 6), f"{value:g}", INK, font)
    for value in up.decades():
        y = up.place(value)
        draw.line((LEFT, y, RIGHT, y), GREY)
        draw.text((LEFT - 60, y - 8), f"{100 * value:g} %", INK, font)
    _dashes(draw, up.place(NEAR - 1))
    draw.rectangle((LEFT, TOP, RIGHT, BOTTOM), outline=INK)
    draw.text((LEFT, 14), title.replace("×", "x"), INK, ImageFont.load_default(16))
    draw.text((LEFT, TOP - 16), "energy above the best known", INK, font)
    draw.text(((LEFT + RIGHT) / 2 - 30, BOTTOM + 28), "seconds", INK, font)


def _dashes(draw: ImageDraw.ImageDraw, y: float) -> None:
    """Draw the line of the target energy."""
    for start, end in pairwise(range(LEFT, RIGHT, 6)):
        if start // 6 % 2:
            draw.line((start, y, end, y), INK)


def _legend(draw: ImageDraw.ImageDraw, names: Sequence[str]) -> None:
    font = ImageFont.load_default(14)
    for row, (name, colour) in enumerate(zip(names, _colours(len(names)), strict=True)):
        y = TOP + 14 + 26 * row
        draw.line((RIGHT + 20, y, RIGHT + 50, y), colour, 4)
        draw.text((RIGHT + 60, y - 9), name, INK, font)


def _colours(count: int) -> list[tuple[int, int, int]]:
    return [COLOURS[k % len(COLOURS)] for k in range(count)]
