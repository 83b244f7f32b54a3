"""The report in a browser: sliders, keys, maps, model; nothing leaves, nothing is unreadable.

It takes Debian's chromium (`apt-get install chromium`), driven by playwright; without, the tests are skipped.
A small report in `make test`, that of `make sample` in `make test-all`.
"""

from __future__ import annotations

import json
from base64 import b64decode
from collections.abc import Iterator
from dataclasses import dataclass
from io import BytesIO
from pathlib import Path

import numpy as np
import pytest
from PIL import Image

from stages.cli import main
from stages.formats.artefacts.camera_file import read_cameras
from stages.report import REPORT
from stages.scene.upright import gltf_from_world
from tests.opened_pages import Opened, in_chromium, opener_of, playwright, started_browser
from tests.reported_scene import NAMES, page_of, record_of, reported, textured_model, written_scene
from tests.sphere_scene import bumpy

pytestmark = in_chromium
SAMPLE = Path(__file__).parent.parent / "configs/sample.yaml"
at_both_widths = pytest.mark.parametrize("width", [360, 1600])
LONG = pytest.param("sample", marks=pytest.mark.slow)
of_the_small_report = pytest.mark.parametrize("written", ["small"], indirect=True)
of_the_textured_report = pytest.mark.parametrize("written", ["small", "textured", LONG], indirect=True)


@dataclass(frozen=True)
class Written:
    """A report's file, the names of its views, and the kinds of their maps."""

    file: Path
    names: list[str]
    kinds: list[str]


@pytest.fixture(scope="module", params=["small", LONG])
def written(request, tmp_path_factory, make_job) -> Written:
    folder = tmp_path_factory.mktemp(request.param)
    if request.param == "sample":
        assert main(["run", str(SAMPLE), "--workspace", str(folder), "--texture"]) == 0
        folder = folder / "output"
    else:
        photos = {f"{name}.jpg": "digest" for name in (*NAMES, "lost")}
        sfm = record_of("sfm", inputs={"images": photos}, warnings=(f"Blurred: {NAMES[2]}.",), seconds=3.0)
        places = written_scene(folder)
        if request.param == "textured":
            places["textured_model"] = textured_model(make_job, folder, places)
        result = reported(make_job, folder, places)
        for name, text in page_of(result, sfm).items():
            (folder / name).write_text(text, encoding="utf-8")
    views = json.loads((folder / "report.json").read_text(encoding="utf-8"))["views"]
    return Written(folder / "report.html", [view["name"] for view in views], views[0]["kinds"])


@pytest.fixture(scope="module")
def browser() -> Iterator[playwright.Browser]:
    with started_browser() as started:
        yield started


@pytest.fixture
def open_at(browser, written):
    with opener_of(browser, written.file) as open_page:
        yield open_page


@at_both_widths
def test_the_page_opens_without_a_complaint_asks_for_nothing_and_is_no_wider_than_its_window(
    open_at, written, width
):
    shown = open_at(width)
    shown.page.wait_for_load_state("networkidle")
    assert shown.complaints == []
    assert [url for url in shown.requests if not url.startswith("data:")] == [written.file.as_uri()]
    assert shown.page.evaluate("document.documentElement.scrollWidth") <= width
    broken = "() => [...document.images].filter((one) => !one.complete || !one.naturalWidth).length"
    assert shown.page.evaluate(broken) == 0


@at_both_widths
def test_the_line_between_photo_and_albedo_follows_slider_keys_and_finger(open_at, width):
    page = open_at(width).page
    best = page.locator(".best .comparison")
    slider = best.locator("input")

    def line() -> float:
        return float(best.evaluate("(root) => root.style.getPropertyValue('--at')").rstrip("%"))

    assert line() == 50
    slider.focus()
    page.keyboard.press("Home")
    assert line() == 0
    page.keyboard.press("ArrowRight")
    assert line() == 0.5
    best.scroll_into_view_if_needed()
    box = best.locator(".pane").bounding_box()
    page.mouse.move(box["x"] + 0.2 * box["width"], box["y"] + 50)
    page.mouse.down()
    page.mouse.move(box["x"] + 0.8 * box["width"], box["y"] + 50)
    page.mouse.up()
    assert line() == pytest.approx(80, abs=0.5)
    edge = best.locator(".divider").bounding_box()
    assert edge["x"] + edge["width"] / 2 == pytest.approx(box["x"] + 0.8 * box["width"], abs=2)


@at_both_widths
def test_keys_switch_views_and_maps(open_at, written, width):
    shown = open_at(width)
    page = shown.page
    seen = set()
    for number, kind in enumerate(written.kinds, start=1):
        page.keyboard.press(str(number))
        assert shown.chosen("right") == kind
        seen.add(shown.picture("right"))
    assert len(seen) == len(written.kinds)
    page.keyboard.press("Shift+Digit3")
    assert shown.chosen("left") == "shading"
    before = shown.picture("left")
    page.keyboard.press("n")
    assert page.input_value("#which-view") == "1"
    assert shown.picture("left") != before
    page.keyboard.press("p")
    page.keyboard.press("p")
    assert page.input_value("#which-view") == str(len(written.names) - 1)
    assert page.text_content("#large-caption").endswith(f"view {written.names[-1]}")


@at_both_widths
def test_every_view_is_reached_by_its_small_picture_with_a_picture_of_its_own(open_at, written, width):
    shown = open_at(width)
    seen = set()
    for number, name in enumerate(written.names):
        shown.page.click(f".thumbnails li:nth-child({number + 1}) a")
        shown.page.wait_for_function(f"() => document.getElementById('which-view').value === '{number}'")
        assert shown.page.text_content("#large-caption").endswith(f"view {name}")
        seen.add(shown.picture("left"))
    assert len(seen) == len(written.names)


@of_the_small_report
def test_links_of_warnings_and_of_elsewhere_lead_to_their_view(open_at):
    shown = open_at(360)
    shown.page.click(".remarks a[href='#view-3']")
    shown.page.wait_for_function("() => document.getElementById('which-view').value === '2'")
    assert open_at(360, "#view-3").page.input_value("#which-view") == "2"
    of_map = open_at(360, "#view-2-residual")
    assert (of_map.page.input_value("#which-view"), of_map.chosen("right")) == ("1", "residual")


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


@of_the_small_report
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


@of_the_textured_report
@at_both_widths
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
    page.check("input[name=surface][value=albedo]")
    assert shown.drawn() == drawn["albedo"]  # nothing but the switches makes a difference
    page.focus("#surface")
    page.keyboard.press("ArrowLeft")
    drawn["turned"] = shown.drawn()
    page.check("#frusta")
    drawn["cameras"] = shown.drawn()
    assert len(set(drawn.values())) == len(drawn)


def test_textures_show_what_vertices_show_and_the_relief_that_these_lack(browser, tmp_path, make_job):
    """The same ball both ways: its relief is in the photos' normals alone, and of a known form."""
    places = written_scene(tmp_path)
    drawn = {"vertices": drawn_model(browser, tmp_path / "vertices", places, make_job)}
    places["textured_model"] = textured_model(make_job, tmp_path, places)
    drawn["textures"] = drawn_model(browser, tmp_path / "textures", places, make_job)
    shown = np.all([pixels["albedo"][..., 3] == 255 for pixels in drawn.values()], axis=0)
    assert shown.mean() > 0.1
    rough, fine = (
        {kind: picture[shown][:, :3].astype(float) for kind, picture in pixels.items()}
        for pixels in drawn.values()
    )
    for kind in ("albedo", "photo", "shading"):
        apart = np.abs(fine[kind] - rough[kind]).mean(axis=1)
        assert np.median(apart) <= 5 and apart.mean() <= 8, kind  # of 255: borders of paint are finer
    turn = gltf_from_world(read_cameras(places["cameras"]), REPORT.settings().upright_within_deg)
    outwards = rough["normal"] / 127.5 - 1
    outwards /= np.linalg.norm(outwards, axis=1, keepdims=True)
    known = bumpy(outwards @ turn) @ turn.T
    found = fine["normal"] / 127.5 - 1
    found /= np.linalg.norm(found, axis=1, keepdims=True)
    assert np.median(degrees_between(outwards, known)) > 15
    assert np.median(degrees_between(found, known)) < 5


def degrees_between(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    return np.degrees(np.arccos(np.clip((a * b).sum(axis=1), -1, 1)))


def drawn_model(browser, folder: Path, places: dict[str, Path], make_job) -> dict[str, np.ndarray]:
    """What the canvas of a report on these files shows, by kind, (h, w, 4), uint8."""
    folder.mkdir()
    (folder / "report.html").write_text(
        page_of(reported(make_job, folder, places))["report.html"], encoding="utf-8"
    )
    with opener_of(browser, folder / "report.html") as open_page:
        return pixels_by_kind(open_page(1600))


def pixels_by_kind(shown: Opened) -> dict[str, np.ndarray]:
    found = {}
    for kind in ("albedo", "photo", "shading", "normal"):
        shown.page.check(f"input[name=surface][value={kind}]")
        data = b64decode(shown.drawn().split(",", 1)[1])
        found[kind] = np.asarray(Image.open(BytesIO(data)).convert("RGBA"))
    return found


@at_both_widths
def test_axe_finds_nothing_serious_by_day_and_by_night(open_at, width):
    shown = open_at(width)
    shown.page.evaluate("() => document.querySelectorAll('details').forEach((one) => { one.open = true; })")
    for scheme in ("light", "dark"):
        shown.page.emulate_media(color_scheme=scheme)
        assert shown.serious() == []


@of_the_small_report
def test_names_of_photos_run_nothing(open_at):
    page = open_at(1600).page
    assert page.title() == "my <workspace>: report of unshade"
    assert NAMES[0] in page.text_content(".thumbnails")


def test_what_these_tests_look_for_is_found_in_a_page_that_has_it(browser, tmp_path):
    """A page that complains, asks for a picture from elsewhere, and is hard to read."""
    file = tmp_path / "bad.html"
    file.write_text(
        "<!doctype html><html lang='en'><title>bad</title><main><h1>Bad</h1>"
        "<p style='color: #ccc; background: #fff'>pale</p><img src='http://127.0.0.1:9/a.png'></main>"
        "<script>console.log('said'); alert('asked'); nothing.there();</script>"
    )
    shown = Opened.of(browser.new_page())
    shown.page.on("dialog", lambda dialog: dialog.dismiss())
    shown.page.goto(file.as_uri())
    assert {"said", "asked"} < set(shown.complaints)
    assert any("nothing is not defined" in one for one in shown.complaints)
    assert shown.left(file) == ["http://127.0.0.1:9/a.png"]
    assert {"color-contrast", "image-alt"} <= {rule for rule, _ in shown.serious()}
    shown.page.close()
