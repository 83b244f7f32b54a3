"""Absolute scale by grey cards and charts: their form, the patches found, the factors, the command."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest

from pipeline import UserError
from stages.formats.artefacts.lighting_json import calibrated_lighting
from stages.formats.decoders.pictures import turned_back, upright_places
from stages.formats.images.exr import read_exr
from stages.formats.images.photos import read_mask
from stages.geometry.lenses import photo_from_pinhole
from stages.photometry.calibration.balance import common_factors, disagreement, read_reference
from stages.photometry.calibration.colour_chart import chart_boxes, chart_reflectances
from stages.photometry.calibration.references import Reference, references_of, view_of
from stages.photometry.calibration.settings import CalibrationSettings
from stages.scene.cameras import Camera, pixel_centres
from tests.rendered_scene import TINY, unshade, write_config
from tests.test_stories import actions

RNG = np.random.default_rng(0)


def card(given: str, **settings) -> Reference:
    return references_of(CalibrationSettings(white=(given,), **settings))[0]


def chart(given: str, **settings) -> Reference:
    return references_of(CalibrationSettings(chart=(given,), **settings))[0]


def test_the_charts_reflectances_are_those_that_are_known_of_it():
    """X-Rite's own 8-bit sRGB of greys and primaries, as printed with the chart; white to black in order."""
    colours = chart_reflectances()
    grey = colours[18:].mean(axis=1)
    assert np.all(np.diff(grey) < 0)
    assert np.allclose(grey, [0.884, 0.588, 0.365, 0.19, 0.089, 0.031], atol=0.02)
    assert np.abs(colours[19:] - grey[1:, None]).max() < 0.02
    dominant = {12: 2, 13: 1, 14: 0}  # blue, green, red
    for patch, channel in dominant.items():
        assert colours[patch].argmax() == channel
    assert colours[17, 0] < 0.01  # cyan has no red


def test_the_boxes_of_the_chart_are_its_patches_and_do_not_meet():
    boxes = chart_boxes(0.14, 1.0)
    assert np.allclose(boxes[0, :2], 0) and np.allclose(boxes[23, 2:], 1)
    assert boxes[5, 2] == pytest.approx(1) and boxes[18, 3] == pytest.approx(1)
    side, gap = boxes[0, 2], boxes[1, 0] - boxes[0, 2]
    assert gap == pytest.approx(0.14 * side)
    half = chart_boxes(0.14, 0.5)
    assert np.allclose(half[:, 2] - half[:, 0], (boxes[:, 2] - boxes[:, 0]) / 2)


@pytest.mark.parametrize("orientation", range(1, 9))
def test_places_turn_as_pixels_do(orientation):
    upright = RNG.random((6, 9))
    stored = turned_back(upright, orientation)
    places = upright_places(pixel_centres(stored.shape[1], stored.shape[0]), stored.shape[::-1], orientation)
    column, row = (places - 0.5).astype(int).transpose(2, 0, 1)
    assert np.array_equal(upright[row, column], stored)


@pytest.mark.parametrize(
    ("flag", "given"),
    [
        ("white", "1,2,3@a.jpg=0.18"),
        ("white", "1,2,3,4=0.18"),
        ("white", "1,2,3,4@a.jpg"),
        ("white", "1,2,-3,4@a.jpg=0.18"),
        ("white", "1,2,3,4@a.jpg=18"),
        ("white", "1,2,3,4@a.jpg=0"),
        ("white", "1,2,nan,4@a.jpg=0.18"),
        ("white", "1,2,3,4@a.jpg=0.1,0.2"),
        ("chart", "0,0,1,0,1,1@a.jpg"),
        ("chart", "0,0,1,1,1,0,0,1@a.jpg"),
        ("chart", "0,0,1,0,1,1,0,1"),
        ("chart", "0,0,0,0,0,0,0,0@a.jpg"),
        ("chart", "1e999,0,1,0,1,1,0,1@a.jpg"),
    ],
)
def test_a_reference_that_is_written_otherwise_is_refused_with_its_form(flag, given, tmp_path, capsys):
    with pytest.raises(UserError, match=rf"--{flag} .* was not understood; expected X"):
        references_of(CalibrationSettings(**{flag: (given,)}))
    code, _, said = unshade(capsys, "plan", "--images", tmp_path, f"--{flag}", given)
    assert code == 2 and "was not understood" in said


def test_a_photos_name_may_hold_any_sign_and_its_extension_may_be_left_out():
    found = card("1,2,30,40@left/a=b@c.jpg=0.5")
    assert found.photo == "left/a=b@c.jpg"
    assert view_of(found, ["left/x.jpg", "left/a=b@c.jpg"]) == "left/a=b@c"
    assert view_of(card("1,2,30,40@left/x=0.5"), ["left/x.jpg"]) == "left/x"
    with pytest.raises(UserError, match="no photo of that name takes part.*did you mean 'left/x.jpg'"):
        view_of(card("1,2,30,40@left/y.jpg=0.5"), ["left/x.jpg"])


def places(width: int, height: int, times: float = 1.0) -> np.ndarray:
    """Where the pixels of an undistorted, reduced image lie in its photo."""
    return pixel_centres(width, height) * times


def test_a_card_gives_the_factor_of_every_channel_in_spite_of_dust_on_it():
    albedo = np.full((60, 80, 3), 0.9, np.float32)
    albedo[20:40, 10:30] = [0.4, 0.3, 0.2]
    albedo[25:27, 15:17] = 0.05
    found = card("20,40,40,40@a.jpg=0.18")  # of a photo twice as large
    reading = read_reference(found, "a", albedo, np.ones((60, 80), bool), places(80, 60, 2.0), 6)
    assert reading.factors() == pytest.approx([0.45, 0.6, 0.9])
    assert reading.pixels[0] == 18 * 18  # without its border
    assert reading.spread[0] < 0.01
    assert reading.residual(reading.factors(), True) == pytest.approx(0, abs=1e-6)
    other = read_reference(
        card("20,40,40,40@a.jpg=0.2"), "a", albedo, np.ones((60, 80), bool), places(80, 60, 2.0), 6
    )
    assert common_factors([reading, other]) == pytest.approx(
        reading.factors() * np.sqrt(0.2 / 0.18), rel=1e-6
    )
    assert disagreement([reading, other]) == pytest.approx(np.log(0.2 / 0.18))


def test_a_card_that_is_not_seen_or_has_no_albedo_is_refused_with_what_to_do():
    albedo, mask = np.ones((60, 80, 3), np.float32), np.ones((60, 80), bool)
    with pytest.raises(UserError, match="covers 0 pixels.*Check the numbers"):
        read_reference(card("200,40,40,40@a.jpg=0.18"), "a", albedo, mask, places(80, 60), 6)
    mask[:, :50] = False
    with pytest.raises(UserError, match="The card in a has 0 pixels with an albedo.*include it in the mask"):
        read_reference(card("10,10,20,20@a.jpg=0.18"), "a", albedo, mask, places(80, 60), 6)
    with pytest.raises(UserError, match="The card in a has .* pixels with an albedo"):
        read_reference(card("60,10,15,15@a.jpg=0.18"), "a", 0 * albedo, mask, places(80, 60), 6)


def painted_chart(corners: np.ndarray, gains: np.ndarray) -> np.ndarray:
    """An image of the chart in perspective, each channel divided by a gain, (200, 260, 3)."""
    import cv2

    flat = np.full((400, 580, 3), 0.02, np.float32)
    for (left, top, right, bottom), colour in zip(
        chart_boxes(0.14, 1.0) * [580, 400, 580, 400], chart_reflectances(), strict=True
    ):
        flat[round(top) : round(bottom), round(left) : round(right)] = np.maximum(colour, 0)
    square = np.array([[0, 0], [580, 0], [580, 400], [0, 400]], np.float32)
    homography = cv2.getPerspectiveTransform(square, corners.astype(np.float32))
    return cv2.warpPerspective(flat, homography, (260, 200), flags=cv2.INTER_AREA) / gains.astype(np.float32)


def test_a_chart_in_perspective_gives_scale_and_balance_and_says_what_remains():
    corners, gains = np.array([[30, 40], [220, 20], [230, 180], [20, 150]]), np.array([0.5, 0.8, 1.3])
    image = painted_chart(corners, gains) * (1 + 0.02 * RNG.standard_normal((200, 260, 1)))
    found = chart(",".join(map(str, corners.ravel())) + "@a.jpg")
    reading = read_reference(
        found, "a", image.astype(np.float32), np.ones((200, 260), bool), places(260, 200), 6
    )
    assert (reading.pixels > 20).all()
    assert reading.factors() == pytest.approx(gains, rel=0.02)
    assert reading.residual(gains, False) < 0.03  # cyan's negative red is not painted
    told = reading.as_json(gains)
    assert len(told["patches"]) == 24
    half = np.ones((200, 260), bool)
    half[:, 150:] = False
    part = read_reference(found, "a", image.astype(np.float32), half, places(260, 200), 6)
    assert part.used.sum() == 4 and part.factors() == pytest.approx(gains, rel=0.03)


def test_the_pinhole_images_pixels_are_found_in_the_photo():
    lens = {"model": "PINHOLE", "width": 60, "height": 40, "params": [50.0, 50.0, 30.0, 20.0]}
    camera = Camera("a", 30, 20, np.array([[25.0, 0, 15], [0, 25, 10], [0, 0, 1]]), np.eye(3, 4))
    assert np.allclose(photo_from_pinhole(lens, camera), pixel_centres(30, 20) * 2)


def test_light_is_divided_by_what_albedo_is_multiplied_by():
    factors = np.array([0.5, 1.0, 2.0])
    around = {"gauge": "", "radiance": [[[1.0, 1.0, 1.0], [2.0, 2.0, 2.0]]]}
    assert json.loads(calibrated_lighting(json.dumps(around), factors))["radiance"] == [
        [[2.0, 1.0, 0.5], [4.0, 2.0, 1.0]]
    ]
    harmonic = {"gauge": "", "views": [{"name": "a", "red": [1.0], "green": [1.0], "blue": [1.0]}]}
    told = json.loads(calibrated_lighting(json.dumps(harmonic), factors))
    assert told["views"][0] == {"name": "a", "red": [2.0], "green": [1.0], "blue": [0.5]}
    assert "reflectance" in told["gauge"]


@pytest.mark.parametrize("mode", ["transfer", "paper"])
def test_the_command_calibrates_all_that_follows_and_forgets_it_without_a_card(mode, tmp_path, capsys):
    config = write_config(
        tmp_path / "scene.yaml",
        render=TINY | {"views": 2, "arc_deg": 20.0, "noise": 0.3, "width_px": 48, "height_px": 64},
        raycast={"reduce": 1},
        decomposition={"mode": mode} | ({"solver": "fast"} if mode == "paper" else {}),
    )
    output = tmp_path / "w/output"
    assert unshade(capsys, "run", config)[0] == 0
    before, shown = maps(output), {path.relative_to(output): path.read_bytes() for path in files_of(output)}
    place = np.argwhere(read_mask(output / "mask/000.png"))
    (top, left), (bottom, right) = place.min(axis=0), place.max(axis=0) + 1
    given = f"{left},{top},{right - left},{bottom - top}@000=0.3,0.2,0.1"
    code, told, said = unshade(capsys, "run", config, "--white", given, "--full-resolution", "--json")
    assert code == 0, said
    assert [stage for stage, action in actions(told).items() if action == "run"] == [
        "calibration",
        "export",
        "full_resolution",
        "report",
    ]
    after, record = maps(output), json.loads((output / "calibration.json").read_text())
    factors = np.array(record["factors"])
    assert np.allclose(after["albedo"], before["albedo"] * factors, rtol=1e-5)
    assert np.allclose(after["albedo"] * after["shading"], before["albedo"] * before["shading"], atol=1e-5)
    assert record["references"][0]["patches"][0]["albedo"] == pytest.approx([0.3, 0.2, 0.1], abs=1e-3)
    full = read_exr(output / "albedo_full/000.exr")
    assert np.allclose(full[full > 0].mean(), after["albedo"][after["albedo"] > 0].mean(), rtol=0.2)
    code, told, _ = unshade(capsys, "run", config, "--json")
    assert code == 0 and set(actions(told).values()) == {"reuse"}
    again = {path.relative_to(output): path.read_bytes() for path in files_of(output)}
    again = {path: content for path, content in again.items() if path.parts[0] != "albedo_full"}
    assert again == shown


def maps(output: Path) -> dict[str, np.ndarray]:
    return {kind: read_exr(output / kind / "000.exr") for kind in ("albedo", "shading")}


def files_of(folder: Path) -> list[Path]:
    return [path for path in folder.rglob("*") if path.is_file()]
