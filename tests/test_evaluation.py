"""The measures of albedo: values computed by hand, the truth against itself, what must change nothing."""

from __future__ import annotations

import json
import math

import numpy as np
import pytest
import scipy.sparse as sp

from pipeline import UserError
from stages.evaluation.agreement import Correspondences, consistency, photometric_residual
from stages.evaluation.judged_views import judge_view
from stages.evaluation.leak import channel_leaks, part_leaks
from stages.evaluation.part_variance import part_variances, variance_ratios
from stages.evaluation.scaled_error import lmse, psnr_h, si_rmse
from stages.evaluation.scores import score_albedo
from tests.judged_scene import NAMES, PARTS, predicted, truth_views


def grey(name: str, prediction, truth, **maps):
    """A view whose channels are all alike, from arrays (h, w); judged everywhere unless said otherwise."""
    prediction, truth = (np.repeat(np.float32(x)[..., None], 3, axis=-1) for x in (prediction, truth))
    judged = maps.pop("judged", np.ones(truth.shape[:2], bool))
    return judge_view(name, prediction, truth, judged, **maps)


def ones_like(values) -> np.ndarray:
    return np.ones(np.shape(values), np.uint8)


# --- variance inside parts (footnote 5) ---


def test_variance_by_hand_to_six_digits():
    """Two views together: median 4, scale 0.2; 0.2·(1, 2, 4, 5, 9) has mean 0.84 and variance 0.3104."""
    views = [
        grey("a", [[1.0, 4.0]], [[0.8, 0.8]], parts=ones_like([[0, 0]])),
        grey("b", [[9.0, 2.0, 5.0]], [[0.8, 0.8, 0.8]], parts=ones_like([[0, 0, 0]])),
    ]
    red, green, blue = part_variances(views, ["all"])
    assert (red.channel, green.channel, blue.channel) == ("red", "green", "blue")
    assert (red.median, red.pixels) == (4, 5)
    assert red.scale == pytest.approx(0.2)
    assert f"{red.variance:.6f}" == "0.310400"
    assert red.enters_ratios


def test_pixels_on_seams_belong_to_no_part_and_unjudged_ones_to_none_either():
    """The same five values as above, with wild ones on a seam and outside the mask."""
    view = grey(
        "a",
        [[1, 4, 9, 2, 5, 777, 888]],
        [[0.8] * 7],
        parts=np.array([[1, 1, 1, 1, 1, 0, 1]], np.uint8),
        judged=np.array([[True] * 6 + [False]]),
    )
    assert f"{part_variances([view], ['all'])[0].variance:.6f}" == "0.310400"


def test_a_median_of_zero_is_explained_not_divided_by():
    view = grey("a", [[0.0, 0, 0, 1]], [[0.5] * 4], parts=ones_like([[0] * 4]))
    for cell in part_variances([view], ["dark"]):
        assert math.isnan(cell.variance)
        assert "median is 0" in cell.remark
        assert not cell.enters_ratios


def test_a_part_that_no_pixel_shows_is_explained():
    cells = part_variances(truth_views(), [*PARTS, "plinth"])[-3:]
    assert all(math.isnan(cell.variance) and cell.remark == "no judged pixel shows it" for cell in cells)


def test_a_part_that_is_not_uniform_in_the_truth_is_refused():
    view = grey("a", [[1.0, 1]], [[0.5, 0.6]], parts=ones_like([[0, 0]]))
    with pytest.raises(UserError, match="the part 'shirt' is not uniform"):
        part_variances([view], ["shirt"])


def test_dark_true_values_are_printed_but_enter_no_ratio():
    entering = {(c.part, c.channel) for c in part_variances(truth_views(), PARTS) if c.enters_ratios}
    assert entering == {
        ("hair", "red"), ("hair", "green"),
        ("face", "red"), ("face", "green"), ("face", "blue"),
        ("shirt", "green"), ("shirt", "blue"),
    }  # fmt: skip


def test_ratios_apply_both_floors():
    """0.02 for the truth; 0.0005 for the variance in the method compared with, not for one's own."""
    rng = np.random.default_rng(1)
    noise = [rng.standard_normal((*view.judged.shape, 1)) for view in truth_views()]
    one = part_variances(predicted(lambda view, i: view.truth * (1 + 0.05 * noise[i])), PARTS)
    other = part_variances(predicted(lambda view, i: view.truth * (1 + 0.1 * noise[i])), PARTS)
    ratios = {(r.part, r.channel): r for r in variance_ratios(one, other)}
    assert ratios["hair", "red"].ratio == pytest.approx(0.25, rel=0.05)
    assert math.isnan(ratios["shirt", "red"].ratio)
    assert "below 0.02" in ratios["shirt", "red"].remark
    assert math.isnan(ratios["hair", "green"].ratio)
    assert "below 0.0005" in ratios["hair", "green"].remark
    exact = part_variances(truth_views(), PARTS)
    assert {r.ratio for r in variance_ratios(exact, other) if not math.isnan(r.ratio)} == {0.0}


def test_ratios_refuse_methods_that_were_judged_on_other_parts():
    cells = part_variances(truth_views(), PARTS)
    with pytest.raises(ValueError, match="same parts"):
        variance_ratios(cells, cells[:-3])


# --- si-RMSE ---


def test_si_rmse_by_hand():
    """p = (1, 2), t = (2, 1): a = 4/5, residual (1.2, −0.6), √(1.8/2) = 0.948683."""
    errors, scales = si_rmse([grey("a", [[1.0]], [[2.0]]), grey("b", [[2.0]], [[1.0]])])
    assert scales == pytest.approx((0.8, 0.8, 0.8))
    assert errors == pytest.approx((math.sqrt(0.9),) * 3)


def test_a_black_prediction_leaves_the_whole_truth_as_error():
    errors, scales = si_rmse([grey("a", [[0.0, 0]], [[3.0, 4]])])
    assert scales == (0, 0, 0)
    assert errors == pytest.approx((math.sqrt(12.5),) * 3)


# --- LMSE ---


def test_lmse_by_hand_on_three_windows():
    """20 × 40 px: windows at columns 0, 10, 20; only the middle one sees both halves, p = 1, t = 1 and 2.

    There a = 600/400 and the residual 400·0.25 = 100; energies 400 + 1000 + 1600.
    """
    truth = np.ones((20, 40))
    truth[:, 20:] = 2
    assert lmse([grey("a", np.ones((20, 40)), truth)]) == pytest.approx((100 / 3000,) * 3)


def test_lmse_takes_judged_pixels_only_and_all_views_together():
    truth = np.ones((20, 40))
    truth[:, 20:] = 2
    wild = np.ones((20, 40))
    judged = np.zeros((20, 40), bool)
    judged[:, :20] = True
    wild[:, 20:] = 1000
    views = [grey("a", np.ones((20, 40)), truth), grey("b", wild, truth, judged=judged)]
    assert lmse(views) == pytest.approx((100 / (3000 + 400 + 200),) * 3)


def test_lmse_is_at_most_one_and_unknown_without_a_window():
    rng = np.random.default_rng(2)
    worst = rng.standard_normal((33, 47))
    assert 0 < lmse([grey("a", worst, rng.random((33, 47)))])[0] <= 1
    assert lmse([grey("a", np.zeros((20, 20)), np.ones((20, 20)))]) == (1, 1, 1)
    assert all(math.isnan(score) for score in lmse([grey("a", np.ones((19, 40)), np.ones((19, 40)))]))


# --- PSNR-H ---


def test_psnr_by_hand_with_clipping_erosion_and_the_whole_frame():
    """9 × 9 px judged within 20 × 20: erosion by 5 × 5 leaves 5 × 5 pixels, all of them 1, two of them 3.

    The prediction is 1 there: a = (23 + 6)/25 = 1.16, clipped to 1; the truth is clipped to 1: no error. With
    a prediction of 0.5 in one of the 23: a = 28.5/24.25 > 1, so that only this pixel errs, by 1 − a/2.
    """
    judged = np.zeros((20, 20), bool)
    judged[5:14, 5:14] = True
    truth = np.ones((20, 20))
    truth[8, 8] = truth[9, 9] = 3
    assert psnr_h([grey("a", np.ones((20, 20)), truth, judged=judged)]) == {"a": math.inf}
    prediction = np.ones((20, 20))
    prediction[10, 10] = 0.5
    prediction[5, 5] = 99  # eroded away
    error = (1 - 0.5 * 28.5 / 24.25) ** 2 / 400
    found = psnr_h([grey("a", prediction, truth, judged=judged)])
    assert found["a"] == pytest.approx(-10 * math.log10(error), abs=1e-5)


def test_what_the_frame_cuts_is_no_silhouette():
    """All of 10 × 10 px judged: the erosion takes nothing, and one black corner costs 1/100, 20 dB."""
    prediction = np.ones((10, 10))
    prediction[0, 0] = 0
    assert psnr_h([grey("a", prediction, np.ones((10, 10)))])["a"] == pytest.approx(20)


def test_a_view_that_erosion_empties_has_no_psnr():
    thin = np.zeros((20, 20), bool)
    thin[:, 4:8] = True
    views = [
        grey("thin", np.ones((20, 20)), np.ones((20, 20)), judged=thin),
        grey("whole", np.ones((20, 20)), np.ones((20, 20))),
    ]
    assert psnr_h(views).keys() == {"whole"}
    assert psnr_h(views[:1]) == {}
    scores = score_albedo(views[:1])
    assert math.isnan(scores.psnr_h)
    assert scores.as_json()["psnr_h"] is None


# --- leak ---


def test_the_truth_leaks_nothing_and_the_image_everything():
    """ρ = truth: slope 0 exactly. ρ = I = truth × shading: slope 1. Between: ρ = truth × √shading: 1/2."""
    assert channel_leaks(part_leaks(truth_views(), PARTS)) == (0, 0, 0)
    for power in (1, 0.5):
        views = predicted(lambda view, i, power=power: view.truth * view.shading**power)
        assert channel_leaks(part_leaks(views, PARTS)) == pytest.approx((power,) * 3, abs=1e-5)


def test_leak_by_hand():
    """log₂ S = 0, 1, 2 and log₂ ρ = 0, 0, 1 after the mean's removal: slope (1·⅓ + 1·⅔)/2 = 1/2."""
    shading = np.repeat(np.float32([[1, 2, 4, 0, 8]])[..., None], 3, axis=-1)
    view = grey("a", [[0.5, 0.5, 1, 1, 0]], [[0.5] * 5], parts=ones_like([[0] * 5]), shading=shading)
    leak = part_leaks([view], ["all"])[0]
    assert leak.slope == pytest.approx(0.5)
    assert (leak.pixels, leak.left_out) == (3, 2)


def test_the_leak_of_all_parts_weighs_them_by_how_much_their_shading_varies():
    """log₂ S = 0, 2 with slope 1 and 0, 0, 4, 4 with slope 0: (2·1·1 + 4·4·0)/(2·1 + 4·4) = 1/9.

    The second part is twice as bright, which is no leak: each part is taken around its own means.
    """
    shading = np.repeat(np.float32([[1, 4, 1, 1, 16, 16]])[..., None], 3, axis=-1)
    parts = np.array([[1, 1, 2, 2, 2, 2]], np.uint8)
    view = grey("a", [[1, 4, 2, 2, 2, 2]], [[0.4, 0.4, 0.8, 0.8, 0.8, 0.8]], parts=parts, shading=shading)
    leaks = part_leaks([view], ["one", "two"])
    assert [leak.slope for leak in leaks if leak.channel == "red"] == pytest.approx([1, 0])
    assert channel_leaks(leaks) == pytest.approx((1 / 9,) * 3)


def test_leak_is_not_taken_where_the_truth_is_dark_or_the_shading_does_not_vary():
    by_cell = {(leak.part, leak.channel): leak for leak in part_leaks(truth_views(), PARTS)}
    assert "below 0.02" in by_cell["hair", "blue"].remark
    assert math.isnan(by_cell["shirt", "red"].slope)
    flat = np.full((1, 3, 3), 2, np.float32)
    view = grey("a", [[1.0, 2, 3]], [[0.5] * 3], parts=ones_like([[0] * 3]), shading=flat)
    leaks = part_leaks([view], ["all"])
    assert {leak.remark for leak in leaks} == {"the true shading does not vary"}
    assert all(math.isnan(slope) for slope in channel_leaks(leaks))


# --- agreement ---


def linked_views():
    masks = {"one": np.array([[True, True, False]]), "two": np.array([[True], [True]])}
    correspondences = {("one", "two"): sp.csr_array(np.array([[0, 1], [1, 0]], np.uint8))}
    views = [
        grey("two", [[2.0], [5.0]], [[1.0], [1.0]]),  # not in the order of the pair
        grey("one", [[3.0, 4.0, 9.0]], [[1.0] * 3], judged=masks["one"]),
    ]
    return views, Correspondences(correspondences, masks)


def test_consistency_by_hand_matches_views_by_name():
    """|3 − 5|, |4 − 2|: mean 2, over the mean albedo (2 + 5 + 3 + 4)/4 = 3.5."""
    found, correspondences = consistency(*linked_views())
    assert correspondences == 2
    assert found == pytest.approx((2 / 3.5,) * 3)


def test_consistency_leaves_out_links_to_unjudged_pixels_and_needs_one():
    views, correspondences = linked_views()
    judged = np.array([[False], [True]])
    partly = [grey("two", [[2.0], [5.0]], [[1.0]] * 2, judged=judged), views[1]]
    found, count = consistency(partly, correspondences)
    assert count == 1
    assert found == pytest.approx((2 / 4,) * 3)
    found, count = consistency(views[:1], correspondences)
    assert count == 0
    assert all(math.isnan(value) for value in found)


def test_consistency_refuses_masks_that_the_links_were_not_made_with():
    views, correspondences = linked_views()
    other = Correspondences(correspondences.links, {**correspondences.masks, "one": np.ones((1, 3), bool)})
    with pytest.raises(UserError, match="between 2 and 2 pixels, the masks have 3 and 2"):
        consistency(views, other)


def test_photometric_residual_by_hand_survives_an_outlier():
    """|I − ρS| = 0.1, 0.1, 50 over median I = 1."""
    image = np.repeat(np.float64([1, 1, 60, 7])[:, None], 3, axis=1)
    albedo = np.repeat(np.float64([0.9, 1.1, 10, 0])[:, None], 3, axis=1)
    mask = np.array([True, True, True, False])
    assert photometric_residual(image, albedo, np.ones((4, 3)), mask) == pytest.approx((0.1,) * 3)
    assert all(math.isnan(v) for v in photometric_residual(image, albedo, albedo, np.zeros(4, bool)))


# --- laws of all ---


def test_the_truth_against_itself_has_no_error_exactly():
    scores = score_albedo(truth_views(), PARTS)
    assert scores.si_rmse == (0, 0, 0)
    assert scores.si_rmse_scales == (1, 1, 1)
    assert scores.lmse == (0, 0, 0)
    assert scores.psnr_h == math.inf
    assert {cell.variance for cell in scores.variances} == {0.0}
    assert scores.leak == (0, 0, 0)
    assert scores.consistency is None


def all_numbers(scores) -> np.ndarray:
    cells = [cell.variance for cell in scores.variances]
    return np.array([*scores.si_rmse, *scores.lmse, scores.psnr_h, *scores.leak, *cells])


def test_a_constant_factor_per_channel_changes_nothing():
    factors = np.array([0.25, 7, 3e-4])
    before = score_albedo(predicted(lambda view, i: view.truth * view.shading**0.3), PARTS)
    after = score_albedo(predicted(lambda view, i: view.truth * view.shading**0.3 * factors), PARTS)
    np.testing.assert_allclose(all_numbers(after), all_numbers(before), rtol=1e-4, atol=1e-9)


def test_a_factor_on_one_view_alone_is_an_error():
    """One scale for all views: what LMSE forgives by its windows, si-RMSE, PSNR-H and variance do not."""
    scores = score_albedo(predicted(lambda view, i: view.truth * (1 + i)), PARTS)
    assert min(scores.si_rmse) > 0.05
    assert scores.psnr_h < 40
    assert next(cell for cell in scores.variances if cell.part == "face").variance > 0.05
    assert scores.lmse == pytest.approx((0, 0, 0), abs=1e-12)


def test_pixels_outside_the_mask_change_nothing_even_if_they_are_no_numbers():
    def wild(view, i):
        return np.where(view.judged[..., None], view.truth, np.float32(np.nan))

    assert score_albedo(predicted(wild), PARTS).as_json() == score_albedo(truth_views(), PARTS).as_json()


def test_the_order_of_the_views_changes_nothing():
    views = predicted(lambda view, i: view.truth * view.shading)
    turned = all_numbers(score_albedo(views[::-1], PARTS))
    np.testing.assert_allclose(turned, all_numbers(score_albedo(views, PARTS)), rtol=1e-12)


@pytest.mark.parametrize("bad", [np.nan, np.inf])
def test_values_that_are_no_numbers_are_counted_and_refused(bad):
    def broken(view, i):
        prediction = view.truth.copy()
        prediction[10, 10:12, 1] = bad
        return prediction

    with pytest.raises(UserError, match=rf"{NAMES[0]}: 2 judged values of the prediction are not finite"):
        predicted(broken)


def test_nothing_judged_is_said_and_a_name_twice_refused():
    view = truth_views()[0]
    with pytest.raises(UserError, match="No pixel is judged"):
        score_albedo([grey("a", [[1.0]], [[1.0]], judged=np.zeros((1, 1), bool))])
    with pytest.raises(ValueError, match="same name"):
        score_albedo([view, view])


def test_scores_are_plain_json_without_nan():
    scores = score_albedo(predicted(lambda view, i: 0 * view.truth), PARTS)
    plain = scores.as_json()
    assert json.loads(json.dumps(plain, allow_nan=False)) == plain
    hair = next(cell for cell in plain["variances"] if cell["part"] == "hair")
    assert hair["variance"] is None
    assert "median is 0" in hair["remark"]
    assert any("variance of hair" in remark for remark in scores.remarks())
