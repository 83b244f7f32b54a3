"""The report: what its figures and colours mean, what its page holds, and that no name can harm it."""

from __future__ import annotations

import json
import re
from base64 import b64decode
from html.parser import HTMLParser
from io import BytesIO

import numpy as np
import pytest
from PIL import Image

from stages.formats.images.exr import read_exr, write_exr
from stages.formats.images.photos import encode_srgb8
from stages.formats.meshes.triangle_meshes import Surface
from stages.reporting.content.light_pictures import ball
from stages.reporting.content.link_samples import LinkSample, LinkValues
from stages.reporting.content.picture_size import encode_webp, longest_side, size_within
from stages.reporting.content.pictures import (
    AS_EXPLAINED,
    TOO_BRIGHT,
    TOO_DARK,
    area_mean,
    masked_mean,
    residual_picture,
    srgb_picture,
)
from stages.reporting.content.sides_seen import roundness, widest_gap
from stages.reporting.content.view_brightness import BesideOthers, brightness_beside_others
from stages.reporting.content.view_figures import SampledView, share_of_light
from stages.reporting.document.markup import tag
from stages.reporting.parts import KINDS, read_content
from stages.reporting.settings import PictureSettings
from tests.reported_scene import NAMES, overhead_light, page_of, record_of, reported, written_scene


@pytest.fixture(scope="module")
def result(tmp_path_factory, make_job):
    folder = tmp_path_factory.mktemp("report")
    return reported(make_job, folder, written_scene(folder))


@pytest.fixture(scope="module")
def content(result):
    return read_content(result / "report_content")


@pytest.fixture(scope="module")
def texts(result):
    photos = {f"{name}.jpg": "digest" for name in (*NAMES, "lost<b>")}
    warning = f"Left out: lost<b>.jpg overlaps with none; so, nearly, does {NAMES[3]}."
    facts = {"photos": 5, "registered": 4, "mean_reprojection_error_px": 0.25, "compared": "exhaustive"}
    return page_of(
        result,
        record_of("sfm", inputs={"images": photos}, warnings=(warning,), facts=facts,
                  settings={"max_features": 100}, tools={"pycolmap": "4.0"}, seconds=61.0),
    )  # fmt: skip


def sampled(albedo, shading, **more) -> SampledView:
    return SampledView(1.0, albedo * shading, albedo, shading, **more)


def test_a_flat_albedo_says_that_all_variation_was_light_and_flat_light_that_none_was():
    rng = np.random.default_rng(0)
    varied, flat = rng.uniform(0.2, 1, (5000, 3)), np.full((5000, 3), 0.4)
    assert share_of_light([sampled(flat, varied)], 0.001) == pytest.approx(1)
    assert share_of_light([sampled(varied, flat)], 0.001) == pytest.approx(0)
    other = rng.permutation(varied)
    assert share_of_light([sampled(varied, other)], 0.001) == pytest.approx(0.5, abs=0.03)


def test_the_residual_is_what_albedo_and_shading_leave():
    one = np.ones((100, 3))
    assert SampledView(1.0, 1.1 * one, one, one).residual() == pytest.approx(0.1 / 1.1)
    assert SampledView(1.0, one).residual() is None


def test_views_that_agree_in_albedo_but_not_in_exposure_are_told_from_their_photos():
    values = LinkValues([LinkSample(0, 1, np.array([0, 2]), np.array([1, 0]))])
    albedo = np.array([[0.2] * 3, [9] * 3, [0.6] * 3])
    outside = np.full((1, 3), 7.0)
    for kind, scale in (("albedo", 1), ("photo", 3)):
        values.add(0, kind, albedo, np.arange(3))
        values.add(1, kind, scale * np.concatenate([outside, albedo[[2, 0]]]), np.array([1, 2]))
    assert values.difference("albedo") == 0
    assert values.difference("photo") == pytest.approx(1)  # |a − 3a| over 2a
    assert LinkValues([]).difference("albedo") is None


def test_colours_of_the_residual_are_grey_orange_and_blue():
    explained = np.full((1, 3, 3), 0.5, np.float32)
    photo = explained * np.array([1, 4, 0.25], np.float32)[:, None]
    picture = residual_picture(photo, explained, np.ones_like(explained), stops=0.5)[0]
    np.testing.assert_array_equal(picture, [AS_EXPLAINED, TOO_BRIGHT, TOO_DARK])


def test_the_table_of_srgb_gives_the_codes_of_the_curve():
    linear = np.linspace(-0.1, 1.1, 100_001, dtype=np.float32)
    apart = srgb_picture(linear).astype(int) - encode_srgb8(linear)
    assert np.abs(apart).max() <= 1 and np.mean(apart != 0) < 0.002


def test_what_is_outside_the_mask_does_not_darken_what_is_inside():
    values, mask = np.zeros((4, 4), np.float32), np.zeros((4, 4), bool)
    values[:2, :1], mask[:2, :1] = 7, True
    np.testing.assert_allclose(
        masked_mean(values, area_mean(mask.astype(np.float32), (2, 2))), [[7, 0], [0, 0]]
    )


def test_pictures_shrink_until_all_fit_but_no_further():
    def bytes_at(side: int) -> float:
        return 40 * side**1.7

    side = longest_side(1280, bytes_at, 1e6)
    assert bytes_at(side) <= 1e6 < bytes_at(1.1 * side)
    assert longest_side(1280, bytes_at, 1e9) == 1280
    assert longest_side(1280, bytes_at, 1) == 32
    assert size_within((300, 600), 100) == (50, 100)
    assert size_within((30, 60), 100) == (30, 60)


def test_a_picture_is_transparent_where_nothing_was_seen():
    visible = np.array([[True] * 8, [False] * 8] * 4)
    with Image.open(
        BytesIO(encode_webp(np.full((8, 8, 3), 200, np.uint8), visible, PictureSettings()))
    ) as picture:
        alpha = np.asarray(picture.convert("RGBA"))[..., 3]
    np.testing.assert_array_equal(alpha > 0, visible)


def test_a_white_ball_is_brightest_towards_the_light_and_shading_has_its_unit():
    to_the_right = np.array([[0.0, 0, 1], [1, 0, 0], [0, 1, 0]])  # the light comes from the right
    shown = ball(overhead_light(1).around, 0, to_the_right, 65)
    middle = shown[32, :, 0]
    assert np.nanargmax(middle) == 64
    assert (middle[:32] == 0).all()
    assert np.nanmax(shown) == pytest.approx(2, abs=0.05)  # 4 · cell · radiance
    assert np.isnan(shown[0, 0]).all()


def test_figures_of_the_whole_are_those_of_the_scene(content):
    figures = content["figures"]
    assert figures["difference_of_albedo"] < 0.05 < figures["difference_of_photos"]
    assert 0.3 < figures["share_of_light"] < 1
    assert all(view["residual"] < 1e-3 and view["confident"] == 1 for view in content["views"])
    assert len(content["graph"]) == 6


def test_the_model_has_the_shape_and_the_paint_of_the_ball(result, content):
    surface, data = content["surface"], (result / "report_content/surface.bin").read_bytes()
    n = surface["vertices"]
    places = np.frombuffer(data, "<u2", 3 * n).reshape(n, 3) / 65535 * surface["size"] + surface["low"]
    radii = np.linalg.norm(places - places.mean(axis=0), axis=1)
    np.testing.assert_allclose(radii, 1, atol=0.03)
    normals = np.frombuffer(data, "<i1", 3 * n, 6 * n).reshape(n, 3) / 127
    assert (np.einsum("ij,ij->i", normals, places - places.mean(axis=0)) > 0.9).all()
    confidence = np.frombuffer(data, "<u1", n, 18 * n)
    seen = confidence > 0
    assert 0.3 < seen.mean() < 1
    assert len(data) == -(-19 * n // 4) * 4 + 12 * surface["faces"]
    faces = np.frombuffer(data, "<u4", offset=len(data) - 12 * surface["faces"])
    assert faces.max() == n - 1


def test_of_many_views_each_is_smaller(tmp_path, make_job):
    places = written_scene(tmp_path, names=("a", "b", "c"), side=128)
    small = reported(make_job, tmp_path, places, pictures={"megabytes": 0.015, "tried_views": 3})
    every = set((small / "report_content/pictures").glob("*.webp"))
    thumbnails = {path for path in every if path.stem.endswith("-small")}
    pictures = every - thumbnails
    assert (len(pictures), len(thumbnails)) == (3 * 7, 3 * 2)
    assert sum(path.stat().st_size for path in pictures) <= 15_000
    assert read_content(small / "report_content")["longest_side_px"] < 128


def test_the_view_whose_albedo_is_darker_than_that_of_the_others_is_named_and_no_other(tmp_path, make_job):
    places = written_scene(tmp_path, names=("a", "b", "c", "d"))
    dark = places["albedo"] / "b.exr"
    write_exr(dark, 0.7 * read_exr(dark))
    result = reported(make_job, tmp_path, places)
    told = json.loads(page_of(result)["report.json"])
    stops = [view["albedo_stops"] for view in told["views"]]
    assert stops == pytest.approx([0, np.log2(0.7), 0, 0], abs=0.02)
    (named,) = [one for one in told["warnings"] if "the albedo is" in one["text"]]
    assert named["text"].startswith("View b: the albedo is 30 % darker than where other views show the same")
    assert named["views"] == ["b"]


def test_a_view_that_was_lit_from_elsewhere_is_named_and_no_other(tmp_path, make_job):
    """As bright as the others on the whole, but darker on one side, and brighter on the other."""
    places = written_scene(tmp_path, names=("a", "b", "c", "d"))
    other = places["albedo"] / "c.exr"
    albedo = read_exr(other)
    across = np.linspace(0.8, 1.25, albedo.shape[1], dtype=np.float32)[:, None]
    write_exr(other, across * albedo)
    told = json.loads(page_of(reported(make_job, tmp_path, places))["report.json"])
    spreads = [view["albedo_spread_stops"] for view in told["views"]]
    assert spreads[2] > 0.06 and max(spreads[0], spreads[1], spreads[3]) < 0.02
    (named,) = [one for one in told["warnings"] if "the albedo is" in one["text"]]
    assert named["text"].startswith("View c: the albedo is darker in some places, and brighter in others")
    assert named["views"] == ["c"]
    assert not [one for one in told["warnings"] if "c" in one["views"] and one is not named]


def test_of_two_views_that_differ_none_is_the_odd_one():
    one = np.full(500, 0.4)
    assert brightness_beside_others([one, 0.5 * one], fewest_points=100) == [None, None]
    three = [one, 0.5 * one, one]
    found = brightness_beside_others(three, fewest_points=100)
    assert found == [BesideOthers(0, 0), BesideOthers(-1, 0), BesideOthers(0, 0)]
    three[2] = np.where(np.arange(500) < 50, one, 0)  # it shares fifty points only
    assert brightness_beside_others(three, fewest_points=100) == [None, None, None]
    assert brightness_beside_others([], fewest_points=100) == []


@pytest.mark.parametrize(
    ("azimuths_deg", "gap_deg", "between"),
    [
        ((0, 90, 180, 270), 90, None),
        ((-40, 0, 40), 280, (2, 0)),
        ((170, -170, 150), 320, (1, 2)),
        ((7,), 360, (0, 0)),
    ],
)
def test_the_widest_gap_is_where_no_camera_stands(azimuths_deg, gap_deg, between):
    angle = np.deg2rad(azimuths_deg)
    found, ends = widest_gap(3 * np.column_stack([np.cos(angle), np.sin(angle)]))
    assert found == pytest.approx(gap_deg)
    assert between is None or ends == between


def test_a_statue_is_round_half_of_it_nearly_a_wall_and_the_ground_are_not_and_a_room_is_less():
    angle, height = np.meshgrid(np.linspace(-np.pi, np.pi, 49), np.linspace(0, 3, 7))
    places = np.column_stack([np.cos(angle).ravel(), np.sin(angle).ravel(), height.ravel()])
    corner = np.arange(48)[None, :] + 49 * np.arange(6)[:, None]
    first = np.stack([corner, corner + 1, corner + 50], axis=-1).reshape(-1, 3)
    faces = np.concatenate([first, np.stack([corner, corner + 50, corner + 49], axis=-1).reshape(-1, 3)])
    front = faces[places[faces].mean(axis=1)[:, 0] > 0]
    flat = np.column_stack([np.zeros(len(places)), angle.ravel(), height.ravel()])
    assert roundness(Surface(places, faces)) == pytest.approx(1, abs=0.01)
    assert roundness(Surface(places, front)) == pytest.approx(0.85, abs=0.03)
    assert roundness(Surface(places, faces[:, ::-1])) == pytest.approx(-1, abs=0.01)
    assert roundness(Surface(flat, faces)) == pytest.approx(0, abs=0.01)
    assert roundness(Surface(flat[:, [1, 2, 0]], faces)) == pytest.approx(0, abs=0.01)


def test_a_report_of_photos_and_cameras_alone_says_that_there_is_no_albedo(tmp_path, make_job):
    places = written_scene(tmp_path, names=("a", "b"))
    result = reported(make_job, tmp_path, {name: places[name] for name in ("linear", "cameras")})
    texts = page_of(result)
    assert "There is no albedo yet." in json.loads(texts["report.json"])["verdict"]
    assert "There is no albedo on a surface yet." in texts["report.html"]


class Elements(HTMLParser):
    """What a browser would see: elements with their attributes, and texts."""

    def __init__(self, page: str) -> None:
        super().__init__()
        self.elements: list[tuple[str, dict[str, str | None]]] = []
        self.feed(page)

    def handle_starttag(self, name, attributes):
        self.elements.append((name, dict(attributes)))


def test_no_name_of_a_photo_is_read_as_markup(texts):
    elements = Elements(texts["report.html"]).elements
    scripts = [attributes for name, attributes in elements if name == "script"]
    assert len(scripts) == 6  # data, surface, four scripts
    assert not [name for _, attributes in elements for name in attributes if name.startswith("on")]
    assert not [name for name, _ in elements if name == "b"]
    assert "alert(1)" in texts["report.html"]  # it is shown


def test_the_page_asks_for_nothing_from_anywhere(texts):
    for name, attributes in Elements(texts["report.html"]).elements:
        for where in ("src", "href"):
            target = attributes.get(where)
            assert target is None or target.startswith(("data:", "#")), (name, target)
    policy = re.search(r'Content-Security-Policy" content="([^"]*)"', texts["report.html"])[1]
    assert policy.startswith("default-src &#x27;none&#x27;")
    assert "unsafe" not in policy


def test_every_link_within_the_page_leads_somewhere(texts):
    elements = Elements(texts["report.html"]).elements
    there = {attributes["id"] for _, attributes in elements if "id" in attributes}
    views = {f"view-{number}" for number in range(1, 5)}  # which a script shows, with a map of theirs
    maps = {f"{view}-{kind}" for view in views for kind in KINDS}
    linked = {a["href"][1:] for _, a in elements if a.get("href", "").startswith("#")}
    assert linked <= there | views | maps
    assert "view-4-shading" in linked  # of the gain's warning


def test_the_verdict_is_three_sentences_of_figures(texts):
    placed, covered, explained = json.loads(texts["report.json"])["verdict"]
    assert placed == "4 of 5 photos found their place, 1 did not; their points agree within 0.25 pixels."
    assert re.fullmatch(
        r"The surface covers \d\d % of the pictures, and each point of it is in \d\.\d of the views that "
        r"were compared\.", covered
    )  # fmt: skip
    assert re.fullmatch(
        r"Of the variation of brightness in the photos, \d\d % was light; where two views show the same "
        r"point, the albedo differs by \d\.\d %, the photos by \d+\.\d %\.", explained
    )  # fmt: skip


def test_warnings_say_what_to_do_and_which_view_shows_it(texts):
    told = json.loads(texts["report.json"])
    of_sides, of_gain, of_sfm = told["warnings"]
    assert (of_sfm["stage"], of_sfm["views"]) == ("sfm", [NAMES[3]])
    assert of_gain["views"] == [NAMES[3]]
    assert "exposed otherwise than the rest (times 2.00)" in of_gain["text"]
    assert "No view shows the surface from one side: seen from above, 300° of the circle" in of_sides["text"]
    assert "If a photo that has no place in it yet (see below) was taken from there" in of_sides["text"]
    assert of_sides["views"] == [NAMES[0], NAMES[3]]
    assert told["left_out"] == ["lost<b>.jpg"]
    assert 'See view <a href="#view-4">Größe/höher</a>' in texts["report.html"]


def test_settings_have_their_origin_and_records_are_whole(texts):
    page = texts["report.html"]
    assert '<th scope="row">sfm.max_features</th><td>100</td><td>8192</td>' in page
    assert json.loads(texts["report.json"])["records"]["sfm"]["tools"] == {"pycolmap": "4.0"}
    assert "61.0 s" in page


def test_pictures_in_the_page_are_those_of_the_views(texts):
    data = re.search(r'<script type="application/json" id="data">(.*?)</script>', texts["report.html"])[1]
    views = json.loads(data)["views"]
    assert [view["name"] for view in views] == list(NAMES)
    for kind in ("photo", "albedo", "shading", "normal", "depth", "confidence", "residual"):
        with Image.open(BytesIO(b64decode(views[0]["pictures"][kind].partition(",")[2]))) as picture:
            assert picture.size == (96, 96)


def test_text_is_escaped_and_markup_is_not():
    assert tag("p", "a < b ", tag("b", 1), class_="x", hidden=True, title='"') == (
        '<p class="x" hidden title="&quot;">a &lt; b <b>1</b></p>'
    )
