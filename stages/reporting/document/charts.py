"""Charts as SVG: lines over steps, bars in tables, and the views from above with the surface they share."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

from stages.reporting.document.markup import Markup, joined, tag
from stages.reporting.document.wording import short

WIDTH, HEIGHT, MARGIN = 640, 240, 56
DASHES = ("none", "7 4", "2 3")  # lines differ in more than colour
MAP, RADIUS = 560, 11
MOST_LABELS = 120


def line_chart(lines: Mapping[str, Sequence[float]], across: str, upwards: str) -> Markup:
    """Draw a few lines over their steps; each is dashed in its own way."""
    values = [value for line in lines.values() for value in line]
    low, high = min(values), max(values)
    longest = max(len(line) for line in lines.values())

    def place(step: int, value: float) -> tuple[float, float]:
        x = MARGIN + (WIDTH - 2 * MARGIN) * (step / max(longest - 1, 1))
        y = HEIGHT - MARGIN - (HEIGHT - 2 * MARGIN) * ((value - low) / ((high - low) or 1))
        return round(x, 1), round(y, 1)

    drawn = [
        tag(
            "polyline",
            points=" ".join("{},{}".format(*place(step, value)) for step, value in enumerate(line)),
            stroke_dasharray=DASHES[number % len(DASHES)],
        )
        for number, line in enumerate(lines.values())
    ]
    axes = [
        tag("line", x1=MARGIN, y1=HEIGHT - MARGIN, x2=WIDTH - MARGIN, y2=HEIGHT - MARGIN, class_="axis"),
        tag("text", across, x=WIDTH - MARGIN, y=HEIGHT - MARGIN + 30, text_anchor="end"),
        tag("text", upwards, x=MARGIN, y=MARGIN - 24),
        tag("text", short(high), x=MARGIN - 6, y=MARGIN + 4, text_anchor="end"),
        tag("text", short(low), x=MARGIN - 6, y=HEIGHT - MARGIN, text_anchor="end"),
        tag("text", "1", x=MARGIN, y=HEIGHT - MARGIN + 16),
        tag("text", longest, x=WIDTH - MARGIN, y=HEIGHT - MARGIN + 16, text_anchor="end"),
    ]
    label = f"{upwards} over {across}: " + "; ".join(
        f"{name} from {short(float(line[0]))} to {short(float(line[-1]))}" for name, line in lines.items()
    )
    return tag(
        "svg", *axes, *drawn, viewBox=f"0 0 {WIDTH} {HEIGHT}", role="img", aria_label=label, class_="lines"
    )


def bar(share: float) -> Markup:
    """Draw a share of a table's largest value as a bar; the number stands beside it."""
    filled = tag("rect", width=round(100 * max(0.0, min(share, 1.0)), 1), height=8)
    return tag("svg", filled, viewBox="0 0 100 8", class_="bar", aria_hidden="true")


def view_map(
    places: Sequence[Sequence[float]], names: Sequence[str], links: Mapping[int, Mapping[int, int]]
) -> Markup:
    """Draw the views where they stand, seen from above; a line is as strong as the surface they share."""
    xs, ys = ([place[axis] for place in places] for axis in (0, 1))
    size = max(max(xs) - min(xs), max(ys) - min(ys)) or 1.0
    inner = MAP - 4 * RADIUS
    height = round(inner * (max(ys) - min(ys)) / size + 4 * RADIUS, 1)

    def spot(number: int) -> tuple[float, float]:
        x = 2 * RADIUS + inner * ((xs[number] - (max(xs) + min(xs)) / 2) / size + 0.5)
        y = 2 * RADIUS + inner * (max(ys) - ys[number]) / size
        return round(x, 1), round(y, 1)

    counts = [count for own in links.values() for count in own.values()] or [1]
    fewest, most = min(counts), max(counts)
    lines = []
    for i, own in links.items():
        for j, count in own.items():
            if i < j:
                (x1, y1), (x2, y2) = spot(i), spot(j)
                share = (count - fewest) / ((most - fewest) or 1)
                lines.append(
                    tag(
                        "line",
                        x1=x1,
                        y1=y1,
                        x2=x2,
                        y2=y2,
                        stroke_width=round(0.3 + 4 * share, 2),
                        stroke_opacity=round(0.12 + 0.7 * share, 2),
                    )
                )
    spots = []
    for number, name in enumerate(names):
        x, y = spot(number)
        marks = [tag("title", f"{number + 1}: {name}"), tag("circle", cx=x, cy=y, r=RADIUS)]
        if len(names) <= MOST_LABELS:
            marks.append(tag("text", number + 1, x=x, y=y + 4, text_anchor="middle"))
        spots.append(tag("a", *marks, href=f"#view-{number + 1}", aria_label=f"View {number + 1}: {name}"))
    label = f"{len(names)} views from above; lines join those that share surface"
    return tag(
        "svg",
        tag("g", joined(lines), aria_hidden="true"),
        *spots,
        viewBox=f"0 0 {MAP} {height}",
        role="group",
        aria_label=label,
        class_="map",
    )
