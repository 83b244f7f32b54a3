"""An HTML file that asks for nothing from anywhere: template, style, scripts, data, and its policy."""

from __future__ import annotations

from base64 import b64encode
from collections.abc import Mapping, Sequence
from hashlib import sha256
from importlib.resources import files
from string import Template
from typing import Any

from pipeline import json_text
from stages.reporting.document.markup import Markup, tag


def html_file(
    title: str,
    heading: str,
    parts: Mapping[str, str],
    top: Mapping[str, Markup],
    sections: Sequence[Markup],
    footer: Markup,
    data: str,
    scripts: Sequence[str],
) -> str:
    """Put a page together.

    Parameters
    ----------
    title, heading : str
        Of the window, and above the page.
    parts : mapping of str to str
        What the navigation calls the sections, by their ids.
    top : mapping of str to Markup
        `best`, `verdict` and `remarks`.
    sections : sequence of Markup
        Empty ones are left out.
    footer : Markup
    data : str
        Elements that scripts read, as of `embedded`.
    scripts : sequence of str
        Names of files.
    """
    style, texts = _text("report.css"), [_text(name) for name in scripts]
    return Template(_text("report.html")).substitute(
        policy=_policy(style, texts),
        title=tag("title", title),
        style=Markup(f"<style>{style}</style>"),
        heading=tag("h1", heading),
        navigation="\n".join(tag("a", name, href=f"#{part}") for part, name in parts.items()),
        **top,
        sections="\n".join(section for section in sections if section),
        version=footer,
        data=data,
        scripts="".join(f"<script>{script}</script>\n" for script in texts),
    )


def embedded(value: Mapping[str, Any]) -> str:
    """Write JSON values for scripts; `<` is escaped, so that no name can end the element."""
    data = json_text(value).replace("<", chr(92) + "u003c")
    return f'<script type="application/json" id="data">{data}</script>\n'


def webp_uri(picture: bytes) -> str:
    """Write a picture as a data URI: the page asks for nothing from elsewhere."""
    return "data:image/webp;base64," + b64encode(picture).decode("ascii")


def _policy(style: str, scripts: list[str]) -> Markup:
    """Allow this page's own style and scripts and data URIs, and nothing else: no request can leave."""
    allowed = " ".join(_hash(script) for script in scripts)
    policy = (
        f"default-src 'none'; img-src data:; style-src {_hash(style)}; script-src {allowed}; base-uri 'none'"
    )
    return tag("meta", http_equiv="Content-Security-Policy", content=policy)


def _hash(text: str) -> str:
    return f"'sha256-{b64encode(sha256(text.encode('utf-8')).digest()).decode('ascii')}'"


def _text(name: str) -> str:
    return (files("stages.reporting") / "page" / name).read_text(encoding="utf-8")
