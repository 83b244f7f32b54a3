"""Detail per octave, stability under two lights: laws, known values, what must change nothing."""

from __future__ import annotations

import math

import cv2
import numpy as np
import pytest

from stages.evaluation.agreement import relative_difference
from stages.evaluation.detail import OctaveDetail, PhotoView, octave_details, photo_octaves
from stages.evaluation.judged_views import JudgedView, judge_view
from stages.evaluation.octave_bands import (
    BandSettings,
    eroded,
    log_floors,
    log_signals,
    octave_bands,
    smooth_inside,
)
from stages.evaluation.scores import score_albedo

SHAPE = (73, 91)
OCTAVES = ((1, 2), (2, 4), (4, 8), (8, 16), (16, 32))


def texture(seed: int, shape=SHAPE, contrast: float = 0.4) -> np.ndarray:
    """Values about 1 with energy in every octave, alike in all channels, (h, w, 3)."""
    rng = np.random.default_rng(seed)
    noise = rng.standard_normal(shape)
    layers = [cv2.GaussianBlur(noise, (0, 0), sigma) * sigma for sigma in (1, 2, 4, 8, 16)]
    return np.repeat(np.exp(contrast * sum(layers))[..., None], 3, axis=-1)


def coloured(seed: int, shape=SHAPE, contrast: float = 0.4) -> np.ndarray:
    """Every channel with a texture of its own, (h, w, 3)."""
    return np.stack([texture(seed + k, shape, contrast)[..., k] for k in range(3)], axis=-1)


def disc(shape=SHAPE) -> np.ndarray:
    """A mask whose edge crosses the rows, cut by the frame on one side."""
    y, x = np.indices(shape)
    return np.hypot(y - shape[0] / 2, x - shape[1] / 4) < shape[0] / 2.2


def view(prediction: np.ndarray, truth: np.ndarray, mask: np.ndarray | None = None, name="a") -> JudgedView:
    return judge_view(name, prediction, truth, np.ones(truth.shape[:2], bool) if mask is None else mask)


def figures(octaves) -> np.ndarray:
    """Rows of error and gain of brightness, error and gain of chroma."""
    return np.array([[o.brightness_error, o.brightness_gain, o.chroma_error, o.chroma_gain] for o in octaves])


# --- the bands ---


def test_bands_of_a_full_frame_are_differences_of_plain_gaussians_far_from_its_rim():
    image = texture(1, (201, 201))[..., :1].astype(np.float32)
    bands = octave_bands(image, np.ones(image.shape[:2], bool), BandSettings(sigmas_px=(1, 2, 4)))
    for (low, high), band in zip(((1, 2), (2, 4)), bands, strict=True):
        plain = [cv2.GaussianBlur(image, (101, 101), sigma) for sigma in (low, high)]
        np.testing.assert_allclose(band[60:140, 60:140, 0], (plain[0] - plain[1])[60:140, 60:140], atol=1e-4)


def test_bands_add_up_to_what_the_widest_gaussian_takes_away():
    signals, mask = np.float32(np.log(coloured(2))), disc()
    total = sum(octave_bands(signals, mask))
    expected = smooth_inside(signals, mask, 1) - smooth_inside(signals, mask, 32)
    np.testing.assert_allclose(total, expected, atol=1e-5)


def test_a_wave_loses_in_each_gaussian_what_its_fourier_transform_says():
    """``exp(−σ²ω²/2)``: of a wave of 16 px the octaves keep these shares."""
    wave = np.float32(np.cos(2 * np.pi / 16 * np.arange(512)))
    signals = np.repeat(wave[None, :, None], 256, axis=0)
    kept = [math.exp(-((2 * math.pi / 16 * sigma) ** 2) / 2) for sigma in (1, 2, 4, 8)]
    mask = np.ones((256, 512), bool)
    for k, band in enumerate(octave_bands(signals, mask, BandSettings(sigmas_px=(1, 2, 4, 8)))):
        inner = (slice(100, 156), slice(128, 384))
        np.testing.assert_allclose(band[inner], (kept[k] - kept[k + 1]) * signals[inner], atol=2e-3)


def test_a_constant_has_no_band_up_to_the_mask_s_edge_and_the_frame_s():
    for mask in (disc(), np.ones(SHAPE, bool), np.indices(SHAPE).sum(axis=0) % 7 == 0):
        signals = np.full((*SHAPE, 2), 3.7, np.float32)
        assert max(np.abs(band).max() for band in octave_bands(signals, mask)) < 1e-5


def test_the_background_does_not_leak_whatever_it_holds():
    mask, signals = disc(), np.float32(np.log(coloured(3)))
    wild = np.where(mask[..., None], signals, np.float32(np.nan))
    for clean, dirty in zip(octave_bands(signals, mask), octave_bands(wild, mask), strict=True):
        np.testing.assert_array_equal(clean, dirty)
        assert not clean[~mask].any()


def test_erosion_takes_four_pixels_off_a_silhouette_and_nothing_where_the_frame_cuts():
    mask = np.zeros((30, 40), bool)
    mask[10:, :20] = True
    expected = np.zeros_like(mask)
    expected[14:, :16] = True
    np.testing.assert_array_equal(eroded(mask, 4), expected)


def test_log_signals_by_hand_floored_at_a_hundredth_of_the_high_quantile():
    image = np.array([[[1.0, 2, 3], [0, -1, 4e-3]]])
    floors = np.array([0.02, 0.01, 0.02, 0.03])
    found = log_signals(image, np.ones((1, 2), bool), floors)
    np.testing.assert_allclose(found[0, 0], [math.log(2), math.log(1 / 2), math.log(3 / 2)], rtol=1e-6)
    np.testing.assert_allclose(found[0, 1], np.log([0.02, 0.01 / 0.02, 0.03 / 0.02]), rtol=1e-6)
    values = np.repeat(np.linspace(0, 1, 101)[:, None], 3, axis=1) * [1, 2, 0]
    np.testing.assert_allclose(log_floors(values), [0.0099, 0.0099, 0.0198, 1])


# --- against the truth ---


def test_the_truth_itself_has_error_0_and_gain_1_in_every_octave():
    truth = coloured(4)
    found = octave_details([view(truth, truth, disc())])
    assert tuple((o.sigma_low_px, o.sigma_high_px) for o in found) == OCTAVES
    np.testing.assert_allclose(figures(found), np.tile([0, 1, 0, 1], (5, 1)), atol=1e-5)


@pytest.mark.parametrize("power", [0.25, 0.8, 1.2])
def test_gain_is_the_factor_between_the_logarithms_and_error_its_distance_from_1(power):
    """Brightness from grey textures; chroma from textures whose red and blue differ, of the same mean log."""
    grey = texture(5)
    found = figures(octave_details([view(grey**power, grey, disc())]))
    np.testing.assert_allclose(found[:, :2], np.tile([abs(1 - power), power], (5, 1)), rtol=1e-3)
    assert np.isnan(found[:, 2:]).all()
    colours = coloured(6, contrast=0.2)
    found = figures(octave_details([view(colours**power, colours, disc())]))
    np.testing.assert_allclose(found[:, 2:], np.tile([abs(1 - power), power], (5, 1)), rtol=1e-3)


@pytest.mark.parametrize("level", [0.3, 0.0])
def test_a_flat_estimate_has_error_1_and_gain_0(level):
    truth = coloured(7)
    found = figures(octave_details([view(np.full_like(truth, level), truth, disc())]))
    np.testing.assert_allclose(found, np.tile([1, 0, 1, 0], (5, 1)), atol=1e-4)


def test_texture_that_is_not_the_truth_s_has_no_gain_and_more_error_than_a_flat_estimate():
    truth, other = texture(8, (400, 400)), texture(9, (400, 400))
    found = figures(octave_details([view(truth * other, truth)]))
    np.testing.assert_allclose(found[:3, 1], 1, atol=0.1)
    np.testing.assert_allclose(found[:3, 0], 1, atol=0.15)
    alone = figures(octave_details([view(other, truth)]))
    np.testing.assert_allclose(alone[:3, 1], 0, atol=0.1)
    assert (alone[:3, 0] > 1.3).all()


def test_blurring_costs_the_fine_octaves_and_leaves_the_coarse_ones():
    truth = texture(10, (160, 160))
    blurred = np.exp(cv2.GaussianBlur(np.log(truth), (0, 0), 2))
    gain = figures(octave_details([view(blurred, truth)]))[:, 1]
    assert (np.diff(gain[:4]) > 0).all()
    assert gain[0] < 0.5
    assert gain[4] > 0.95


def test_one_scale_per_channel_changes_nothing():
    truth = coloured(11)
    estimate = truth**0.6 * texture(12)
    before = figures(octave_details([view(estimate, truth, disc())]))
    scaled = figures(octave_details([view(estimate * [0.2, 9, 3e-3], truth, disc())]))
    np.testing.assert_allclose(scaled, before, rtol=1e-4)
    both = figures(octave_details([view(estimate, truth * 0.01, disc())]))
    np.testing.assert_allclose(both, before, rtol=1e-4)


def test_garbage_outside_the_mask_changes_nothing_and_neither_does_anything_within_the_eroded_rim():
    truth, mask = coloured(13), disc()
    estimate = truth**0.7
    wild = np.where(mask[..., None], estimate, np.nan)
    assert octave_details([view(wild, truth, mask)]) == octave_details([view(estimate, truth, mask)])


def test_a_sparse_mask_of_crumbs_is_measured_where_erosion_leaves_something():
    truth = texture(14)
    mask = np.zeros(SHAPE, bool)
    mask[5:20, 5:20] = mask[40:60, 50:75] = True
    mask[::11, ::11] = True  # single pixels: they take part in no statistics
    found = figures(octave_details([view(truth**0.5, truth, mask)]))
    np.testing.assert_allclose(found[:4, :2], np.tile([0.5, 0.5], (4, 1)), rtol=1e-3)
    mask = np.indices(SHAPE).sum(axis=0) % 2 == 0
    nothing = octave_details([view(truth**0.5, truth, mask)])
    assert np.isnan(figures(nothing)).all()


def test_views_are_summed_before_they_are_divided():
    """A view of strong texture kept by a half, one of weak texture kept whole: energies weigh them."""
    strong, weak = texture(15, contrast=0.4), texture(16, contrast=0.1)
    views = [view(strong**0.5, strong, name="a"), view(weak, weak, name="b")]
    gain = figures(octave_details(views))[0, 1]
    energy = []
    for truth in (strong, weak):
        mask = np.ones(SHAPE, bool)
        signals = log_signals(truth, mask, log_floors(np.concatenate([strong, weak]).reshape(-1, 3)))
        energy.append(float((next(octave_bands(signals, mask))[..., 0] ** 2).sum()))
    assert gain == pytest.approx((0.5 * energy[0] + energy[1]) / sum(energy), abs=5e-3)


def test_octaves_without_energy_in_the_truth_are_null_in_json_and_named_in_a_remark():
    flat = np.full((*SHAPE, 3), 0.5)
    scores = score_albedo([view(texture(17), flat)])
    assert scores.as_json()["detail"] == [
        {
            "sigma_low_px": low,
            "sigma_high_px": high,
            "brightness_error": None,
            "brightness_gain": None,
            "chroma_error": None,
            "chroma_gain": None,
        }
        for low, high in OCTAVES
    ]
    assert sum("the truth's band is below 0.001 log units" in remark for remark in scores.remarks()) == 2


def test_scores_hold_the_detail():
    truth = coloured(18)
    scores = score_albedo([view(truth, truth)])
    assert all(isinstance(octave, OctaveDetail) for octave in scores.detail)
    assert not any(remark.startswith("detail") for remark in scores.remarks())


# --- against the photos ---


def shaded_left_textured_right() -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Albedo that varies on the right half, shading that varies on the left, and the mask."""
    rng = np.random.default_rng(19)
    shape = (120, 200)
    noise = [np.exp(0.2 * cv2.GaussianBlur(rng.standard_normal(shape), (0, 0), 1)) for _ in range(2)]
    right = np.arange(shape[1]) >= 100
    albedo = np.where(right, noise[0], 1.0)
    shading = np.where(right, 1.0, noise[1] ** 3)
    return *(np.repeat(x[..., None], 3, axis=-1) for x in (albedo, shading)), np.ones(shape, bool)


def test_pixels_where_the_shading_has_the_detail_do_not_count():
    """The estimate keeps half the texture, and an edge of shading on the left: only the right half counts."""
    albedo, shading, mask = shaded_left_textured_right()
    estimate = albedo**0.5 * shading**0.9
    found = photo_octaves([PhotoView("a", albedo * shading, estimate, shading, mask)])
    for octave in found[:3]:
        assert octave.brightness_gain == pytest.approx(0.5, abs=0.02)
        assert octave.brightness_share == pytest.approx(0.5, abs=0.1)
        assert math.isnan(octave.chroma_gain)
        assert octave.chroma_share == 0


def test_detail_that_all_went_into_the_shading_leaves_no_pixel_to_count():
    photo = coloured(20)
    found = photo_octaves([PhotoView("a", photo, np.ones_like(photo), photo, disc())])
    assert all(math.isnan(o.brightness_gain) and o.brightness_share == 0 for o in found)
    assert all(math.isnan(o.chroma_gain) and o.chroma_share == 0 for o in found)


def test_under_even_light_the_photo_itself_keeps_everything_everywhere_whatever_its_scale():
    photo = coloured(21)
    wild = np.where(disc()[..., None], photo, np.inf)
    even = np.full_like(photo, 0.7)
    for octave in photo_octaves([PhotoView("a", wild, photo * [2, 3, 0.4], even, disc())]):
        assert octave.brightness_gain == pytest.approx(1, abs=1e-4)
        assert octave.chroma_gain == pytest.approx(1, abs=1e-4)
        assert (octave.brightness_share, octave.chroma_share) == (1, 1)


def test_photos_of_which_erosion_leaves_nothing_have_neither_gain_nor_share():
    photo, mask = texture(22), np.zeros(SHAPE, bool)
    mask[10:14, 10:14] = True
    for octave in photo_octaves([PhotoView("a", photo, photo, np.ones_like(photo), mask)]):
        assert math.isnan(octave.brightness_gain) and math.isnan(octave.brightness_share)


# --- under two lights ---


def test_two_scaled_copies_do_not_differ():
    values = coloured(23).reshape(-1, 3)
    assert relative_difference(values, values * [0.5, 2, 7]) == pytest.approx((0, 0, 0), abs=1e-12)


def test_relative_difference_by_hand():
    """a = (1, 2), b = (2, 1): s = 4/5, residual (−0.6, 1.2), √0.9 over the mean 1.5."""
    first = np.repeat([[1.0], [2.0]], 3, axis=1)
    assert relative_difference(first, first[::-1]) == pytest.approx((math.sqrt(0.9) / 1.5,) * 3)


def test_relative_difference_of_black_maps_is_not_known_and_of_a_black_second_is_the_first_s_own_size():
    black, grey = np.zeros((4, 3)), np.full((4, 3), 0.2)
    assert all(math.isnan(value) for value in relative_difference(black, grey))
    assert all(math.isnan(value) for value in relative_difference(black[:0], grey[:0]))
    assert relative_difference(grey, black) == pytest.approx((1, 1, 1))
