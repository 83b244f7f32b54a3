"""HTML from Python: whatever is no markup yet is escaped, names of photos above all."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from html import escape

VOID = frozenset({"img", "input", "meta"})


class Markup(str):
    """Text that is HTML already."""

    __slots__ = ()


def tag(name: str, /, *children: str | float | Markup, **attributes: str | float | bool | None) -> Markup:
    """Build an element.

    Parameters
    ----------
    name : str
    *children : str, number or Markup
        Text is escaped, markup is not.
    **attributes : str, number, bool or None
        `class_` for class; other underscores become hyphens. True is an attribute without a value; None and
        False leave it out.

    >>> tag("p", "a < b ", tag("b", "now"), class_="x", hidden=True)
    '<p class="x" hidden>a &lt; b <b>now</b></p>'
    """
    written = "".join(
        f" {key.rstrip('_').replace('_', '-')}" + ("" if value is True else f'="{escape(str(value))}"')
        for key, value in attributes.items()
        if value is not None and value is not False
    )
    opened = f"<{name}{written}>"
    return Markup(opened if name in VOID else f"{opened}{joined(children)}</{name}>")


def joined(children: Iterable[str | float | Markup]) -> Markup:
    """Put pieces one after the other."""
    return Markup("".join(one if isinstance(one, Markup) else escape(str(one)) for one in children))


def table(
    headings: Sequence[str], rows: Iterable[Sequence[str | float | Markup]], caption: str, **attributes: str
) -> Markup:
    """Build a table that scrolls sideways where it is too wide; the first cell of a row is its heading."""
    head = tag("thead", tag("tr", *(tag("th", one, scope="col") for one in headings)))
    body = tag(
        "tbody",
        *(tag("tr", tag("th", row[0], scope="row"), *(tag("td", cell) for cell in row[1:])) for row in rows),
    )
    whole = tag("table", tag("caption", caption), head, body, **attributes)
    return tag("div", whole, class_="scroll", tabindex=0, role="group", aria_label=caption)


def details(summary: str | Markup, *children: str | Markup) -> Markup:
    """Build a part that is folded up at first."""
    return tag("details", tag("summary", summary), *children)


def definitions(pairs: Iterable[tuple[str, str | float | Markup]]) -> Markup:
    """Build a list of names and values."""
    return tag("dl", *(tag("div", tag("dt", name), tag("dd", value)) for name, value in pairs))
