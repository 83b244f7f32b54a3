"""`unshade evaluate` with photos or another light in place of a truth, as its users meet it."""

from __future__ import annotations

import json
from pathlib import Path

import cv2
import numpy as np
import pytest

from stages.cli import main
from stages.formats.images.exr import read_exr, write_exr
from stages.formats.images.photos import write_mask, write_png_srgb16
from tests.raw_exr import write_raw_exr

NAMES, SHAPE = ("a/früh am morgen", "b.2"), (60, 80)
KEPT = 0.5  # of the log of the true texture


def evaluate(capsys, *words: str | Path) -> tuple[int, str, str]:
    """Exit code, output, error output."""
    code = main(["evaluate", *(str(word) for word in words)])
    return code, *capsys.readouterr()


def report(capsys, *words: str | Path) -> dict:
    """The JSON of a command that succeeds."""
    code, told, said = evaluate(capsys, *words, "--json")
    assert code == 0, said
    return json.loads(told, parse_constant=lambda word: pytest.fail(f"{word} is not JSON"))


def texture(seed: int) -> np.ndarray:
    """True albedo of a view, coloured, (h, w, 3)."""
    rng = np.random.default_rng(seed)
    noise = cv2.GaussianBlur(rng.standard_normal((*SHAPE, 3)), (0, 0), 1) + rng.standard_normal(3) * 0.1
    return 0.3 * np.exp(noise)


def light(turned: bool) -> np.ndarray:
    """Smooth shading from one side or the other, warm or cold, (h, w, 3)."""
    ramp = np.linspace(0.3, 1.7, SHAPE[1])[:: -1 if turned else 1]
    return ramp[None, :, None] * np.ones((SHAPE[0], 1, 1)) * ([1, 1.1, 1.3] if turned else [1.2, 1, 0.9])


def write_light(folder: Path, turned: bool) -> Path:
    """An output folder beside its photos, under one light: half the texture's log, a rest of shading."""
    for k, name in enumerate(NAMES):
        albedo, shading = texture(k), light(turned)
        mask = np.zeros(SHAPE, bool)
        mask[3:-3, 3:-3] = True
        write_exr(folder / "photos" / f"{name}.exr", albedo * shading)
        estimate = albedo**KEPT * shading**0.05 * mask[..., None]
        write_exr(folder / "output/albedo" / f"{name}.exr", estimate)
        write_exr(folder / "output/shading" / f"{name}.exr", shading)
        write_mask(folder / "output/mask" / f"{name}.png", mask)
    return folder


@pytest.fixture
def noon(tmp_path) -> Path:
    return write_light(tmp_path / "noon", False)


@pytest.fixture
def evening(tmp_path) -> Path:
    return write_light(tmp_path / "evening", True)


def test_a_finished_folder_is_compared_with_its_photos(noon, capsys):
    told = report(capsys, noon / "output", "--photos", noon / "photos")
    assert set(told) == {"detail_against_photos"}
    detail = told["detail_against_photos"]
    assert (detail["views"], detail["pixels"]) == (2, 2 * 54 * 74)
    for octave in detail["octaves"][:3]:
        assert octave["brightness_gain"] == pytest.approx(KEPT, abs=0.03)
        assert octave["chroma_gain"] == pytest.approx(KEPT, abs=0.03)
    assert min(octave["brightness_share"] for octave in detail["octaves"][:2]) > 0.9
    assert [octave["sigma_low_px"] for octave in detail["octaves"]] == [1, 2, 4, 8, 16]


def test_photos_larger_than_the_albedo_are_averaged_and_may_be_encoded(noon, tmp_path, capsys):
    for name in NAMES:
        image = np.repeat(np.repeat(read_exr(noon / "photos" / f"{name}.exr"), 2, axis=0), 2, axis=1)
        image = np.pad(image, ((0, 1), (0, 1), (0, 0)), mode="edge")  # as where `reduce` drops a rest
        write_exr(tmp_path / "large" / f"{name}.exr", image)
        half = read_exr(noon / "photos" / f"{name}.exr") / 2
        write_png_srgb16(tmp_path / "encoded" / f"{name}.png", half)
    exact = report(capsys, noon / "output", "--photos", noon / "photos")["detail_against_photos"]
    for folder, tolerance in (("large", 0.03), ("encoded", 0.05)):
        found = report(capsys, noon / "output", "--photos", tmp_path / folder)["detail_against_photos"]
        for one, other in zip(found["octaves"][1:3], exact["octaves"][1:3], strict=True):
            assert one["brightness_gain"] == pytest.approx(other["brightness_gain"], abs=tolerance)


def test_the_shading_of_another_folder_can_be_given(noon, capsys):
    words = (noon / "output/albedo", "--photos", noon / "photos", "--masks", noon / "output/mask")
    told = report(capsys, *words, "--shading", noon / "output/shading")
    assert told == report(capsys, noon / "output", "--photos", noon / "photos")
    code, _, said = evaluate(capsys, *words)
    assert code == 2
    assert "There is no shading/ beside the albedo" in said and "--shading" in said


def test_two_lights_are_compared_with_what_their_photos_differ_by(noon, evening, capsys):
    words = (noon / "output", "--other-light", evening / "output")
    told = report(capsys, *words)["stability"]
    assert (told["photos"], told["ratio"], told["left_out"]) == (None, None, [])
    assert 0 < told["albedo"]["green"] < 0.08
    photos = ("--photos", noon / "photos", "--other-photos", evening / "photos")
    both = report(capsys, *words, *photos)
    assert set(both) == {"detail_against_photos", "stability"}
    stability = both["stability"]
    assert stability["albedo"] == told["albedo"]
    for channel in ("red", "green", "blue"):
        expected = stability["albedo"][channel] / stability["photos"][channel]
        assert stability["ratio"][channel] == pytest.approx(expected)
        assert expected < 1 / 8


def test_one_light_with_itself_differs_by_nothing_and_the_photos_give_no_ratio(noon, capsys):
    photos = ("--photos", noon / "photos", "--other-photos", noon / "photos")
    told = report(capsys, noon / "output", "--other-light", noon / "output", *photos)["stability"]
    for key in ("albedo", "photos"):
        assert list(told[key].values()) == pytest.approx([0, 0, 0], abs=1e-7)


def test_maps_without_shading_are_compared_under_two_lights_all_the_same(noon, evening, capsys):
    words = (noon / "output/albedo", "--other-light", evening / "output", "--masks", noon / "output/mask")
    photos = ("--photos", noon / "photos", "--other-photos", evening / "photos")
    told = report(capsys, *words, *photos)
    assert set(told) == {"stability"}
    assert told["stability"]["pixels"] == 2 * 54 * 74


def test_two_lights_are_compared_where_both_have_masks(noon, evening, capsys):
    for folder, rows in ((noon, slice(0, 10)), (evening, slice(50, 60))):
        for name in NAMES:
            mask = np.ones(SHAPE, bool)
            mask[rows] = False
            write_mask(folder / "output/mask" / f"{name}.png", mask)
    told = report(capsys, noon / "output", "--other-light", evening / "output")["stability"]
    assert told["pixels"] == 2 * 40 * 80


def test_views_of_one_light_only_are_left_out_and_named(noon, evening, capsys):
    (evening / "output/albedo/b.2.exr").unlink()
    told = report(capsys, noon / "output", "--other-light", evening / "output")["stability"]
    assert (told["views"], told["left_out"]) == (1, ["b.2"])
    _, table, _ = evaluate(capsys, noon / "output", "--other-light", evening / "output")
    assert "in one folder only, and not compared: b.2" in table


def test_the_tables_say_what_the_json_says_with_and_without_truth(noon, evening, tmp_path, capsys):
    for k, name in enumerate(NAMES):
        write_exr(tmp_path / "truth" / f"{name}.exr", texture(k))
    words = (noon / "output", tmp_path / "truth", "--photos", noon / "photos")
    words += ("--other-light", evening / "output", "--other-photos", evening / "photos")
    told = report(capsys, *words)
    code, page, _ = evaluate(capsys, *words)
    assert code == 0
    tables = page.split("detail, truth")[1].split("detail, photos")
    for text, octaves, measures in (
        (tables[0], told["detail"], ("error", "gain")),
        (tables[1], told["detail_against_photos"]["octaves"], ("gain", "share")),
    ):
        rows = [line.split("px")[1].split() for line in text.splitlines() if line.startswith("σ")]
        for row, octave in zip(rows, octaves, strict=True):
            values = [octave[f"{kind}_{m}"] for kind in ("brightness", "chroma") for m in measures]
            assert row == ["–" if value is None else f"{value:.3f}" for value in values]
    ratio = next(line for line in page.splitlines() if line.startswith("albedo/photos"))
    assert ratio.split()[1:] == [f"{value:.4f}" for value in told["stability"]["ratio"].values()]
    assert told["detail"][0]["brightness_gain"] == pytest.approx(KEPT, abs=0.02)


@pytest.mark.parametrize(
    ("words", "sentence"),
    [
        ("", "There is nothing to judge"),
        ("--shading x --other-light x", "--shading x says nothing without --photos"),
        ("--correspondences x --photos x", "--correspondences x says nothing without TRUTH"),
        ("--other-photos x --photos x", "--other-photos x says nothing without --other-light"),
        ("--other-photos x --other-light x", "--other-photos x says nothing without --photos"),
        ("--photos nowhere", "nowhere is not a folder; expected one"),
        ("--other-light nowhere", "nowhere is not a folder; expected one"),
    ],
)
def test_words_that_do_not_fit_together_get_a_sentence(words, sentence, noon, capsys):
    code, told, said = evaluate(capsys, noon / "output", *words.split())
    assert (code, told) == (2, "")
    assert sentence in said


def harm(noon: Path, evening: Path, how: str) -> None:
    """Make one mistake."""
    photo, other = noon / "photos/b.2.exr", evening / "output/albedo/b.2.exr"
    match how:
        case "photo gone":
            photo.unlink()
        case "photo smaller":
            write_exr(photo, np.ones((30, 40, 3)))
        case "photo of another shape":
            write_exr(photo, np.ones((120, 200, 3)))
        case "photo not finite":
            write_raw_exr(photo, np.full((*SHAPE, 3), np.nan))
        case "shading gone":
            (noon / "output/shading/b.2.exr").unlink()
        case "albedo not finite":
            write_raw_exr(noon / "output/albedo/b.2.exr", np.full((*SHAPE, 3), np.inf))
        case "other size":
            write_exr(other, np.ones((30, 40, 3)))
        case "nothing in common":
            for name in NAMES:
                write_mask(noon / "output/mask" / f"{name}.png", np.zeros(SHAPE, bool))


@pytest.mark.parametrize(
    ("how", "sentence"),
    [
        ("photo gone", "There is no photo of view b.2"),
        ("photo smaller", "View b.2: the photo has 40 × 30 pixels, the albedo 80 × 60"),
        ("photo of another shape", "View b.2: the photo has 200 × 120 pixels, the albedo 80 × 60"),
        ("photo not finite", "View b.2: 11988 masked values of the photo are not finite numbers"),
        ("shading gone", "There is no shading of view b.2"),
        ("albedo not finite", "View b.2: 11988 masked values of the albedo are not finite numbers"),
        ("other size", "View b.2: the albedo under the other light has 40 × 30 pixels"),
        ("nothing in common", "No pixel is compared"),
    ],
)
def test_a_mistake_gets_a_sentence_and_exit_code_2(how, sentence, noon, evening, capsys):
    harm(noon, evening, how)
    words = (noon / "output", "--photos", noon / "photos", "--other-light", evening / "output")
    code, told, said = evaluate(capsys, *words, "--other-photos", evening / "photos")
    assert (code, told) == (2, "")
    assert sentence in said
    assert "Traceback" not in said
