"""The page of `unshade compare` in a browser: sides, keys and maps; nothing leaves, nothing is unreadable."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest

from stages.cli import main
from tests.opened_pages import in_chromium, opener_of, playwright, started_browser
from tests.reported_scene import NAMES, written_scene
from tests.test_compare import with_albedo, workspace_of

pytestmark = in_chromium
at_both_widths = pytest.mark.parametrize("width", [360, 1600])


@pytest.fixture(scope="module")
def written(tmp_path_factory) -> Path:
    """The page of two results, of which one is darker on the left and brighter on the right."""
    folder = tmp_path_factory.mktemp("compared")
    places = written_scene(folder)

    def sloped(_: int, albedo: np.ndarray) -> np.ndarray:
        return albedo * np.linspace(0.5, 1.5, albedo.shape[1], dtype=np.float32)[:, None]

    other = with_albedo(places, folder / "other", sloped)
    two = workspace_of(folder / "a <b>", places), workspace_of(folder / "b", other, "2")
    assert main(["compare", *map(str, two), "--output", str(folder / "page.html")]) == 0
    return folder / "page.html"


@pytest.fixture(scope="module")
def browser() -> Iterator[playwright.Browser]:
    with started_browser() as started:
        yield started


@pytest.fixture
def open_at(browser, written):
    with opener_of(browser, written) as open_page:
        yield open_page


@at_both_widths
def test_the_two_results_lie_side_by_side_and_keys_switch_views_and_maps(open_at, width):
    shown = open_at(width)
    page = shown.page
    assert page.evaluate("document.documentElement.scrollWidth") <= width
    assert shown.picture("left") != shown.picture("right")
    kinds = page.eval_on_selector_all("#right-kind option", "all => all.map((one) => one.value)")
    seen = set()
    for number, kind in enumerate(kinds, start=1):
        page.keyboard.press(str(number))
        assert shown.chosen("right") == kind
        seen.add(shown.picture("right"))
    assert len(seen) > 2  # maps that are the same in both results have the same picture
    before = shown.picture("left")
    page.keyboard.press("n")
    assert page.input_value("#which-view") == "1"
    assert shown.picture("left") != before
    assert page.text_content("#large-caption").endswith(f"view {NAMES[1]}")


@at_both_widths
def test_axe_finds_nothing_serious_by_day_and_by_night(open_at, width):
    shown = open_at(width)
    shown.page.evaluate("() => document.querySelectorAll('details').forEach((one) => { one.open = true; })")
    for scheme in ("light", "dark"):
        shown.page.emulate_media(color_scheme=scheme)
        assert shown.serious() == []
