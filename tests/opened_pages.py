"""Pages in a browser: what they complain of, ask for and bar; Debian's chromium, driven by playwright."""

from __future__ import annotations

import shutil
import subprocess
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field
from pathlib import Path

import pytest

playwright = pytest.importorskip("playwright.sync_api", reason="playwright is not installed")
axe = pytest.importorskip("axe_playwright_python.sync_playwright", reason="axe-core is not installed")


def chromium() -> str | None:
    """Find chromium; Ubuntu's package of that name is a script that only asks for another installer."""
    for name in ("chromium", "chromium-browser"):
        if path := shutil.which(name):
            said = subprocess.run([path, "--version"], capture_output=True, text=True, timeout=60)
            if said.returncode == 0 and "Chromium" in said.stdout:
                return path
    return None


CHROMIUM = chromium()
DRAWS_ON_THE_PROCESSOR = ["--use-angle=swiftshader", "--enable-unsafe-swiftshader", "--ignore-gpu-blocklist"]
in_chromium = [
    pytest.mark.skipif(CHROMIUM is None, reason="chromium is not installed"),
    pytest.mark.filterwarnings("ignore::DeprecationWarning"),
]


@contextmanager
def started_browser() -> Iterator[playwright.Browser]:
    with playwright.sync_playwright() as driver:
        started = driver.chromium.launch(executable_path=CHROMIUM, args=DRAWS_ON_THE_PROCESSOR)
        yield started
        started.close()


@dataclass
class Opened:
    """An open page, and what it complained of or asked for."""

    page: playwright.Page
    complaints: list[str] = field(default_factory=list)
    requests: list[str] = field(default_factory=list)

    @classmethod
    def of(cls, page: playwright.Page) -> Opened:
        """Listen to a page, from before it has opened anything."""
        shown = cls(page)
        page.on("console", lambda said: shown.complaints.append(said.text))
        page.on("pageerror", lambda error: shown.complaints.append(str(error)))
        page.on("dialog", lambda dialog: shown.complaints.append(dialog.message))
        page.on("request", lambda request: shown.requests.append(request.url))
        return shown

    def left(self, file: Path) -> list[str]:
        """List what was asked for, besides the page itself and what is in it."""
        return [url for url in self.requests if url.split("#")[0] != file.as_uri() and url[:5] != "data:"]

    def serious(self) -> list[tuple[str, list[str]]]:
        """List what axe-core finds that bars somebody: the rule, and the elements."""
        found = axe.Axe().run(self.page).response["violations"]
        return [
            (one["id"], [node["html"][:200] for node in one["nodes"]][:3])
            for one in found
            if one["impact"] in ("serious", "critical")
        ]

    def chosen(self, side: str) -> str:
        return self.page.input_value(f"#{side}-kind")

    def picture(self, side: str) -> str:
        return self.page.get_attribute(f"#large .{side} img", "src")

    def drawn(self) -> str:
        """The canvas of the model, after it has been drawn anew, with its textures."""
        self.page.evaluate(
            "() => new Promise((done) => requestAnimationFrame(() => requestAnimationFrame(done)))"
        )
        self.page.wait_for_function(
            "() => document.getElementById('surface').getAttribute('aria-busy') === 'false'"
        )
        return self.page.evaluate("() => document.getElementById('surface').toDataURL()")


@contextmanager
def opener_of(browser: playwright.Browser, file: Path) -> Iterator[Callable[..., Opened]]:
    """``open(width, **more)``: the page in a window of this width; at the end, silent and by itself."""
    opened: list[Opened] = []

    def open_page(width: int, fragment: str = "", **more) -> Opened:
        shown = Opened.of(browser.new_page(viewport={"width": width, "height": 900}, **more))
        opened.append(shown)
        shown.page.goto(file.as_uri() + fragment)
        shown.page.wait_for_function("() => document.querySelector('#large .left img').naturalWidth > 0")
        return shown

    yield open_page
    for shown in opened:
        shown.page.close()
        assert shown.complaints == []
        assert shown.left(file) == []
