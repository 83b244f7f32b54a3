"""`unshade evaluate` as its users meet it: folders in, a table or JSON out, a sentence for every mistake."""

from __future__ import annotations

import json
import shutil
from pathlib import Path

import numpy as np
import pytest
import scipy.sparse as sp

from stages.cli import main
from stages.formats.images.exr import read_exr, write_exr
from stages.formats.images.photos import write_mask, write_png_srgb8, write_png_srgb16
from tests.judged_scene import NAMES, truth_views, write_truth
from tests.raw_exr import write_raw_exr

SAMPLE = Path(__file__).parent.parent / "sample_data/linear"


def evaluate(capsys, *words: str | Path) -> tuple[int, str, str]:
    """Exit code, output, error output."""
    code = main(["evaluate", *(str(word) for word in words)])
    return code, *capsys.readouterr()


def report(capsys, *words: str | Path) -> dict:
    """The JSON of a command that succeeds."""
    code, told, said = evaluate(capsys, *words, "--json")
    assert code == 0, said
    return json.loads(told, parse_constant=lambda word: pytest.fail(f"{word} is not JSON"))


def write_prediction(folder: Path, power: float = 0.2) -> Path:
    """An output folder: a rest of the shading in the albedo, two columns less in the masks than the truth."""
    for view in truth_views():
        kept = view.judged.copy()
        kept[:, :4] = False
        albedo = view.truth * view.shading**power * kept[..., None]
        write_exr(folder / "albedo" / f"{view.name}.exr", albedo)
        write_mask(folder / "mask" / f"{view.name}.png", kept)
    return folder


@pytest.fixture
def truth(tmp_path) -> Path:
    return write_truth(tmp_path / "truth")


@pytest.fixture
def prediction(tmp_path) -> Path:
    return write_prediction(tmp_path / "output")


def test_the_truth_against_itself_is_without_error(truth, capsys):
    told = report(capsys, truth, truth)
    assert set(told["si_rmse"].values()) == set(told["lmse"].values()) == {0}
    assert {cell["variance"] for cell in told["variances"]} == {0}
    assert told["psnr_h"] is None
    assert "PSNR-H: at least one view has no error at all" in told["remarks"]
    assert told["coverage"] == 1


def test_an_output_folder_is_judged_where_it_and_the_truth_have_masks(truth, prediction, capsys):
    told = report(capsys, prediction, truth)
    assert told["colour_space"] == {"prediction": "2 EXR taken as linear", "truth": "2 EXR taken as linear"}
    assert "one least-squares scale per channel for all views together" in told["scaling"]
    assert told["views"] == 2
    judged = [(view.judged.shape[0] - 4) * 33 for view in truth_views()]
    assert told["pixels"] == sum(judged)
    assert told["coverage"] == pytest.approx(33 / 35)
    assert told["leak"]["red"] == pytest.approx(0.2, abs=1e-4)
    assert set(told["psnr_h_of_views"]) == set(NAMES)
    assert told["only_in_prediction"] == told["only_in_truth"] == []


def test_the_table_says_what_the_json_says(truth, prediction, capsys):
    code, table, _ = evaluate(capsys, prediction, truth)
    assert code == 0
    told = report(capsys, prediction, truth)
    lines = {line[:26].strip(): line[26:].split() for line in table.splitlines()}
    hair = [cell for cell in told["variances"] if cell["part"] == "hair"]
    stars = ["" if cell["enters_ratios"] else "*" for cell in hair]
    assert lines["variance, hair"] == [
        f"{cell['variance']:.6f}{star}" for cell, star in zip(hair, stars, strict=True)
    ]
    assert stars == ["", "", "*"]
    assert lines["si-RMSE"] == [f"{value:.5f}" for value in told["si_rmse"].values()]
    assert lines["PSNR-H, dB, all channels"] == [f"{told['psnr_h']:.2f}"]
    assert "94.3% of the truth's masks" in table


def test_a_flat_folder_without_masks_is_judged_all_over_and_says_so(truth, prediction, capsys):
    told = report(capsys, prediction / "albedo", truth)
    assert told["coverage"] == 1
    assert "the prediction has no masks: every pixel of the truth's masks is judged" in told["remarks"]
    with_masks = report(capsys, prediction / "albedo", truth, "--masks", prediction / "mask")
    assert with_masks == report(capsys, prediction, truth)


def test_encoded_maps_are_decoded_and_linear_ones_go_first(truth, tmp_path, capsys):
    folder = tmp_path / "encoded"
    for view in truth_views():
        write_png_srgb16(folder / f"{view.name}.png", view.truth)
    told = report(capsys, folder, truth)
    assert told["colour_space"]["prediction"] == "2 PNG decoded from sRGB"
    assert max(told["si_rmse"].values()) < 1e-4
    first = truth_views()[0]
    write_exr(folder / f"{first.name}.exr", first.truth)
    write_png_srgb8(folder / f"{first.name}.png", 0 * first.truth)
    told = report(capsys, folder, truth)
    assert told["colour_space"]["prediction"] == "1 EXR taken as linear, 1 PNG decoded from sRGB"
    assert max(told["si_rmse"].values()) < 1e-4


def test_views_are_paired_by_name_and_those_without_a_partner_are_named(truth, prediction, capsys):
    second = prediction / "albedo" / f"{NAMES[1]}.exr"
    second.rename(second.with_name("0.exr"))  # first in the order of files, and of another size
    told = report(capsys, prediction, truth)
    assert told["views"] == 1
    assert told["only_in_prediction"] == ["0"]
    assert told["only_in_truth"] == [NAMES[1]]


def test_agreement_between_views_needs_the_correspondences_and_their_masks(truth, prediction, capsys):
    """The truth links the faces of both views: with a rest of the shading in the albedo they disagree."""
    folder = prediction / "links"
    folder.mkdir()
    kept = [view.judged.copy() for view in truth_views()]
    for mask in kept:
        mask[:, :4] = False
    faces = [np.flatnonzero(view.parts[mask] == 2) for view, mask in zip(truth_views(), kept, strict=True)]
    count = min(map(len, faces))
    coords = (faces[0][:count], faces[1][:count])
    shape = tuple(int(mask.sum()) for mask in kept)
    sp.save_npz(folder / "0000_0001.npz", sp.csr_array((np.ones(count, np.uint8), coords), shape=shape))
    row = {"i": NAMES[0], "j": NAMES[1], "file": "0000_0001.npz", "links": count}
    (folder / "index.json").write_text(json.dumps([row]), encoding="utf-8")
    told = report(capsys, prediction, truth, "--correspondences", folder)
    assert told["links"] == count
    assert told["consistency"]["red"] > 0.01
    exact = report(capsys, truth, truth, "--masks", prediction / "mask", "--correspondences", folder)
    assert exact["consistency"]["red"] == 0
    code, _, said = evaluate(capsys, prediction / "albedo", truth, "--correspondences", folder)
    assert code == 2
    assert "Give these with --masks." in said


def test_the_photos_of_the_sample_are_no_albedo(capsys):
    photos = report(capsys, SAMPLE / "images", SAMPLE / "albedo")
    assert photos["views"] == 4
    assert photos["psnr_h"] < 30
    assert min(photos["si_rmse"].values()) > 0.02
    assert any("have no true albedo at all" in remark for remark in photos["remarks"])


def harm(truth: Path, prediction: Path, how: str) -> None:
    """Make one mistake."""
    albedo = prediction / "albedo"
    match how:
        case "size":
            write_exr(albedo / f"{NAMES[1]}.exr", np.ones((25, 20, 3)))
        case "mask size":
            write_mask(prediction / "mask" / f"{NAMES[1]}.png", np.ones((3, 4), bool))
        case "mask gone":
            (prediction / "mask" / f"{NAMES[1]}.png").unlink()
        case "names":
            shutil.rmtree(albedo)
            write_exr(albedo / "other.exr", np.ones((4, 4, 3)))
        case "twice":
            write_png_srgb8(albedo / "c.png", np.ones((4, 4, 3)))
            shutil.copy(albedo / "c.png", albedo / "c.jpg")
        case "nan":
            broken = read_exr(albedo / f"{NAMES[1]}.exr")
            broken[20, 20] = np.nan
            write_raw_exr(albedo / f"{NAMES[1]}.exr", broken)
        case "no maps":
            shutil.rmtree(albedo)
            albedo.mkdir()
        case "damaged":
            (albedo / f"{NAMES[1]}.exr").write_bytes(b"not an image")
        case "part without a name":
            (truth / "parts.json").write_text('{"parts": ["hair", "face"]}', encoding="utf-8")
        case "no part names":
            (truth / "parts.json").unlink()
        case "parts gone":
            (truth / "parts" / f"{NAMES[1]}.png").unlink()
        case "parts in colour":
            write_png_srgb8(truth / "parts" / f"{NAMES[1]}.png", np.ones((50, 41, 3)))
        case "nothing in common":
            for name in NAMES:
                shape = read_exr(albedo / f"{name}.exr").shape[:2]
                write_mask(prediction / "mask" / f"{name}.png", np.zeros(shape, bool))


@pytest.mark.parametrize(
    ("how", "sentence"),
    [
        ("size", "View b.2: the prediction has 20 × 25 pixels, the true albedo 41 × 50"),
        (
            "size",
            "(undistort.max_size_px=none, raycast.reduce=1, and cameras without distortion by --colmap: "
            "undistortion crops)",
        ),
        ("mask size", "View b.2: the prediction's mask has 4 × 3 pixels"),
        ("mask gone", "There is no mask for view b.2"),
        ("names", "(other) has the name of one in"),
        ("twice", "c.jpg and c.png"),
        ("nan", "View b.2: 3 judged values of the prediction are not finite numbers"),
        ("no maps", "holds no albedo maps"),
        ("damaged", "b.2.exr cannot be read"),
        ("part without a name", "holds the number 3, but parts.json has 2 name(s)"),
        ("no part names", "parts.json cannot be read (FileNotFoundError)"),
        ("parts gone", "b.2.png is missing"),
        ("parts in colour", "has the pixel type RGB"),
        ("nothing in common", "No pixel is judged"),
    ],
)
def test_a_mistake_gets_a_sentence_and_exit_code_2(how, sentence, truth, prediction, capsys):
    harm(truth, prediction, how)
    code, told, said = evaluate(capsys, prediction, truth)
    assert (code, told) == (2, "")
    assert sentence in said
    assert "Traceback" not in said


@pytest.mark.parametrize(
    "words", [("nowhere", "{truth}"), ("{truth}", "nowhere"), ("{truth}/parts.json", "x")]
)
def test_a_folder_that_is_not_there_is_named(words, truth, capsys):
    code, _, said = evaluate(capsys, *(word.format(truth=truth) for word in words))
    assert code == 2
    assert "is not a folder; expected one" in said


@pytest.mark.parametrize("flag", ["--masks", "--correspondences"])
def test_options_that_name_nothing_are_refused(flag, truth, capsys):
    code, _, said = evaluate(capsys, truth, truth, flag, "nowhere")
    assert code == 2
    assert "nowhere" in said
