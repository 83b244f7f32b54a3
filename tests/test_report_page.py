"""The report in a browser: sliders, keys, maps, model; nothing leaves, nothing is unreadable.

It takes Debian's chromium (`apt-get install chromium`) and `pip install playwright axe-playwright-python`;
where these are missing, the tests are skipped.
"""

from __future__ import annotations

import shutil
from collections.abc import Iterator
from dataclasses import dataclass, field
from pathlib import Path

import pytest

from tests.reported_scene import NAMES, page_of, record_of, reported, written_scene

playwright = pytest.importorskip("playwright.sync_api", reason="playwright is not installed")
axe = pytest.importorskip("axe_playwright_python.sync_playwright", reason="axe-core is not installed")
CHROMIUM = shutil.which("chromium") or shutil.which("chromium-browser")
pytestmark = [
    pytest.mark.skipif(CHROMIUM is None, reason="chromium is not installed"),
    pytest.mark.filterwarnings("ignore::DeprecationWarning"),
]
DRAWS_ON_THE_PROCESSOR = ["--use-angle=swiftshader", "--enable-unsafe-swiftshader", "--ignore-gpu-blocklist"]
WIDTHS = (360, 1600)
KINDS = ("photo", "albedo", "shading", "normal", "depth", "confidence", "residual")


@dataclass
class Opened:
    """An open page, and what it complained of or asked for."""

    page: playwright.Page
    complaints: list[str] = field(default_factory=list)
    requests: list[str] = field(default_factory=list)

    def chosen(self, side: str) -> str:
        return self.page.input_value(f"#{side}-kind")

    def picture(self, side: str) -> str:
        return self.page.get_attribute(f"#large .{side} img", "src")

    def drawn(self) -> str:
        """The canvas of the model, after it has been drawn anew."""
        self.page.evaluate(
            "() => new Promise((done) => requestAnimationFrame(() => requestAnimationFrame(done)))"
        )
        return self.page.evaluate("() => document.getElementById('surface').toDataURL()")


@pytest.fixture(scope="module")
def file(tmp_path_factory, make_job) -> Path:
    folder = tmp_path_factory.mktemp("page")
    result = reported(make_job, folder, written_scene(folder))
    photos = {f"{name}.jpg": "digest" for name in (*NAMES, "lost")}
    sfm = record_of("sfm", inputs={"images": photos}, warnings=(f"Blurred: {NAMES[2]}.",), seconds=3.0)
    (folder / "report.html").write_text(page_of(result, sfm)["report.html"], encoding="utf-8")
    return folder / "report.html"


@pytest.fixture(scope="module")
def browser() -> Iterator[playwright.Browser]:
    with playwright.sync_playwright() as driver:
        started = driver.chromium.launch(executable_path=CHROMIUM, args=DRAWS_ON_THE_PROCESSOR)
        yield started
        started.close()


@pytest.fixture
def open_at(browser, file):
    """``open_at(width, **more)``: the page in a window of this width."""
    pages = []

    def opened(width: int, fragment: str = "", **more) -> Opened:
        page = browser.new_page(viewport={"width": width, "height": 900}, **more)
        pages.append(page)
        shown = Opened(page)
        page.on("console", lambda said: shown.complaints.append(said.text))
        page.on("pageerror", lambda error: shown.complaints.append(str(error)))
        page.on("dialog", lambda dialog: shown.complaints.append(dialog.message))
        page.on("request", lambda request: shown.requests.append(request.url))
        page.goto(file.as_uri() + fragment)
        page.wait_for_function("() => document.querySelector('#large .left img').naturalWidth > 0")
        return shown

    yield opened
    for page in pages:
        page.close()


@pytest.mark.parametrize("width", WIDTHS)
def test_the_page_opens_without_a_complaint_and_nothing_is_requested(open_at, file, width):
    shown = open_at(width)
    assert shown.complaints == []
    assert [url for url in shown.requests if not url.startswith("data:")] == [file.as_uri()]
    assert shown.page.evaluate("document.documentElement.scrollWidth") <= width


def test_the_line_between_photo_and_albedo_follows_slider_keys_and_finger(open_at):
    page = open_at(1600).page
    best = page.locator(".best .comparison")
    slider = best.locator("input")

    def line() -> str:
        return best.evaluate("(root) => root.style.getPropertyValue('--at')")

    assert line() == "50%"
    slider.focus()
    page.keyboard.press("Home")
    assert line() == "0%"
    page.keyboard.press("ArrowRight")
    assert line() == "0.5%"
    box = best.locator(".pane").bounding_box()
    page.mouse.move(box["x"] + 0.2 * box["width"], box["y"] + 50)
    page.mouse.down()
    page.mouse.move(box["x"] + 0.8 * box["width"], box["y"] + 50)
    page.mouse.up()
    assert line() == "80%"


def test_keys_switch_views_and_maps(open_at):
    shown = open_at(1600)
    page = shown.page
    seen = set()
    for number in range(1, len(KINDS) + 1):
        page.keyboard.press(str(number))
        assert shown.chosen("right") == KINDS[number - 1]
        seen.add(shown.picture("right"))
    assert len(seen) == len(KINDS)
    page.keyboard.press("Shift+Digit3")
    assert shown.chosen("left") == "shading"
    before = shown.picture("left")
    page.keyboard.press("n")
    assert page.input_value("#which-view") == "1"
    assert shown.picture("left") != before
    page.keyboard.press("p")
    page.keyboard.press("p")
    assert page.input_value("#which-view") == str(len(NAMES) - 1)
    assert page.text_content("#large-caption").endswith(f"view {NAMES[-1]}")
    assert shown.complaints == []


def test_every_view_is_reached_by_its_small_picture_and_by_links_of_warnings(open_at):
    shown = open_at(360)
    for number in range(len(NAMES)):
        shown.page.click(f".thumbnails li:nth-child({number + 1}) a")
        shown.page.wait_for_function(f"() => document.getElementById('which-view').value === '{number}'")
        assert shown.page.text_content("#large-caption").endswith(f"view {NAMES[number]}")
    shown.page.click(".remarks a")
    shown.page.wait_for_function("() => document.getElementById('which-view').value === '2'")
    assert open_at(360, "#view-3").page.input_value("#which-view") == "2"


def test_all_maps_move_together(open_at):
    page = open_at(1600).page
    page.locator("#large .pane").dblclick(position={"x": 100, "y": 100})

    def places() -> set[str]:
        pictures = "#viewer .maps img, #viewer .layer img"
        return set(page.eval_on_selector_all(pictures, "all => all.map((one) => getComputedStyle(one).scale "
                   "+ new DOMMatrix(getComputedStyle(one).transform).a)"))  # fmt: skip

    assert len(places()) == 1
    assert places() == {"none3"}
    before = page.evaluate("() => document.getElementById('viewer').style.getPropertyValue('--x')")
    page.locator("#large .pane").focus()
    page.keyboard.press("ArrowRight")
    assert page.evaluate("() => document.getElementById('viewer').style.getPropertyValue('--x')") != before
    page.keyboard.press("0")
    assert places() == {"none1"}


def test_two_fingers_zoom_and_one_moves_the_line(open_at):
    page = open_at(360, has_touch=True).page
    page.locator("#large").scroll_into_view_if_needed()
    box = page.locator("#large .pane").bounding_box()
    x, y = box["x"] + box["width"] / 2, box["y"] + box["height"] / 2
    session = page.context.new_cdp_session(page)

    def touch(kind: str, *points: tuple[float, float]) -> None:
        places = [{"x": px, "y": py, "id": number} for number, (px, py) in enumerate(points)]
        session.send("Input.dispatchTouchEvent", {"type": kind, "touchPoints": places})

    touch("touchStart", (x - 20, y), (x + 20, y))
    for apart in (30, 40, 60):
        touch("touchMove", (x - apart, y), (x + apart, y))
    touch("touchEnd")
    zoom = page.evaluate("() => Number(document.getElementById('viewer').style.getPropertyValue('--zoom'))")
    assert zoom == pytest.approx(3, rel=0.3)


@pytest.mark.parametrize("width", WIDTHS)
def test_the_model_draws_other_pixels_for_every_switch_lamp_and_turn(open_at, width):
    shown = open_at(width)
    page = shown.page
    drawn = {}
    for kind in ("albedo", "photo", "shading", "normal", "confidence", "relit"):
        page.check(f"input[name=surface][value={kind}]")
        drawn[kind] = shown.drawn()
    page.evaluate("() => { const lamp = document.getElementById('lamp-azimuth'); lamp.value = -120; "
                  "lamp.dispatchEvent(new Event('input', { bubbles: true })); }")  # fmt: skip
    drawn["another lamp"] = shown.drawn()
    page.focus("#surface")
    page.keyboard.press("ArrowLeft")
    drawn["turned"] = shown.drawn()
    page.check("#frusta")
    drawn["cameras"] = shown.drawn()
    assert len(set(drawn.values())) == len(drawn)
    assert shown.complaints == []


@pytest.mark.parametrize("scheme", ["light", "dark"])
@pytest.mark.parametrize("width", WIDTHS)
def test_axe_finds_nothing_serious(open_at, width, scheme):
    page = open_at(width, color_scheme=scheme).page
    page.evaluate("() => document.querySelectorAll('details').forEach((one) => { one.open = true; })")
    found = axe.Axe().run(page).response["violations"]
    serious = [one for one in found if one["impact"] in ("serious", "critical")]
    assert not serious, [(one["id"], [node["html"] for node in one["nodes"]][:3]) for one in serious]


def test_names_of_photos_run_nothing(open_at):
    shown = open_at(1600)
    assert shown.page.title() == "my <workspace>: report of unshade"
    assert NAMES[0] in shown.page.text_content(".thumbnails")
    assert shown.complaints == []
