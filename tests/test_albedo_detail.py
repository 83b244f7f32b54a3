"""What the light cannot have made is albedo: octaves, how uncertain the shading is, and what comes back."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
import scipy.sparse as sp

from stages.photometry.detail.albedo_detail import Detail, sampled_detail, with_detail
from stages.photometry.detail.detail_scene import DetailScene, whole_scene
from stages.photometry.detail.noise_estimation import (
    noise_between_views,
    relative_noise,
    relative_noise_variance,
)
from stages.photometry.detail.octaves import KnownPixels, gaussian_mean, response_to_noise
from stages.photometry.detail.other_views import OtherViews
from stages.photometry.detail.scene_statistics import DetailStatistics
from stages.photometry.detail.settings import DetailSettings
from stages.photometry.detail.shading_uncertainty import ShownChange, error_of_change, log_shading
from stages.photometry.detail.texture_limit import TextureLimit, limit_for_mean
from stages.photometry.stack import StackedViews, stack_views

SHAPE = (160, 200)
HOW = DetailSettings()
SIGMAS_PX = HOW.sigmas_px
PAINT = np.array([0.5, 0.35, 0.25])


def fractal(seed: int, deviation: float, finest_px: float = 1.5) -> np.ndarray:
    """1/f noise, (h, w), of this standard deviation."""
    rng = np.random.default_rng(seed)
    frequency = np.hypot(np.fft.fftfreq(SHAPE[0])[:, None], np.fft.fftfreq(SHAPE[1]))
    amplitude = np.where(frequency > 0, 1 / np.maximum(frequency, 1e-9), 0) * (frequency < 0.5 / finest_px)
    field = np.fft.ifft2(np.fft.fft2(rng.normal(size=SHAPE)) * amplitude).real
    return (field / field.std() * deviation).astype(np.float32)


def one_view(mask: np.ndarray | None = None) -> StackedViews:
    mask = np.ones(SHAPE, bool) if mask is None else mask
    return StackedViews(np.array([0, mask.sum()]), np.zeros((mask.sum(), 0), np.float32), (mask,), {})


def several_views(count: int) -> StackedViews:
    """Views of the same pixels, each linked to all others."""
    pixels, everywhere = SHAPE[0] * SHAPE[1], np.ones(SHAPE, bool)
    same = sp.csr_array(sp.identity(pixels, dtype=np.float32))
    correspondences = {(i, j): same for j in range(count) for i in range(j)}
    starts = pixels * np.arange(count + 1)
    return StackedViews(
        starts, np.zeros((count * pixels, 0), np.float32), (everywhere,) * count, correspondences
    )


def apart(count: int) -> StackedViews:
    """Views that share nothing."""
    together = several_views(count)
    return StackedViews(together.starts, together.basis, together.masks, {})


def relief(seed: int = 5, strength: float = 0.2) -> np.ndarray:
    """Shading of a rough thing, (N, 3), half of it even."""
    logs = fractal(seed, strength)
    logs[:, : SHAPE[1] // 2] *= 0.1
    return np.repeat(np.exp(logs).reshape(-1, 1), 3, axis=1).astype(np.float32)


def noisy(image: np.ndarray, share: float, seed: int = 9) -> np.ndarray:
    return image * (1 + share * np.random.default_rng(seed).normal(size=image.shape)).astype(np.float32)


def found_in(image: np.ndarray, shading: np.ndarray, smooth: np.ndarray = PAINT, **how) -> Detail:
    trusted = how.get("trusted", np.ones(len(image), bool))
    albedo = np.broadcast_to(smooth, image.shape).astype(np.float32)
    return with_detail(DetailScene.of(how.get("views", one_view()), albedo, image, shading, trusted, HOW))


def detail_of(image: np.ndarray, shading: np.ndarray, smooth: np.ndarray = PAINT, **how) -> np.ndarray:
    return found_in(image, shading, smooth, **how).albedo


def octaves(values: np.ndarray, weight: np.ndarray):
    """Octaves of a map, (h, w), as maps."""
    known = np.ones(values.shape, bool)
    pixels = KnownPixels((known,), np.array([0, known.size]), weight.ravel() > 0)
    return (
        (band.reshape(values.shape), sigma_px) for band, sigma_px in pixels.octaves(values.ravel(), SIGMAS_PX)
    )


def gains(estimate: np.ndarray, truth: np.ndarray) -> list[tuple[float, float]]:
    """Gain and error of the estimate's brightness in the octaves from σ = 1 px on."""
    everywhere = np.ones(SHAPE, np.float32)
    maps = (np.log(each.mean(axis=1)).reshape(SHAPE).astype(np.float32) for each in (estimate, truth))
    bands = list(zip(*(octaves(one, everywhere) for one in maps), strict=True))[2:6]
    inner = (slice(12, -12),) * 2
    pairs = [(one[0][inner], two[0][inner]) for one, two in bands]
    return [((e * t).sum() / (t * t).sum(), np.sqrt(((e - t) ** 2).sum() / (t * t).sum())) for e, t in pairs]


def test_octaves_add_up_to_the_map():
    weight = (fractal(0, 1.0) > -1).astype(np.float32)
    values = fractal(1, 1.0) * weight
    total = sum(band for band, _ in octaves(values, weight))
    np.testing.assert_allclose(total, values, atol=1e-5)
    assert [sigma_px for _, sigma_px in octaves(values, weight)] == [*SIGMAS_PX, np.inf]


@pytest.mark.parametrize("sigma_px", [1.5, 5.0])
def test_means_of_views_are_those_of_their_images(sigma_px):
    """Ragged masks, of which some pixels are not known, and may be anything."""
    rng = np.random.default_rng(6)
    masks = [rng.random(shape) < 0.8 for shape in ((9, 14), (21, 6), (3, 3))]
    masks[2][:] = False
    starts = np.cumsum([0, *(np.count_nonzero(mask) for mask in masks)])
    known = rng.random(starts[-1]) < 0.7
    one, other = rng.random((starts[-1], 8)).astype(np.float32), rng.random(starts[-1]).astype(np.float32)
    other[~known] = np.nan
    pixels = KnownPixels(masks, starts, known)
    found = pixels.mean_of(lambda one, other: one * other[:, None], one, other, sigma_px=sigma_px)
    for number, mask in enumerate(masks):
        view = slice(starts[number], starts[number + 1])
        weight = np.zeros(mask.shape, np.float32)
        weight[mask] = known[view]
        for column in range(8):
            image = np.zeros(mask.shape, np.float32)
            image[mask] = np.where(known[view], one[view, column] * other[view], 0)
            mean = gaussian_mean(image, weight, sigma_px)[mask]
            np.testing.assert_allclose(found[view, column], mean, rtol=1e-5, atol=1e-7)


@pytest.mark.parametrize("sigma_px", SIGMAS_PX)
def test_means_know_nothing_of_what_is_not_known(sigma_px):
    """A constant stays one, up to the rim of a ragged mask, and is the same with a frame around it."""
    weight = (fractal(2, 1.0) > 0).astype(np.float32)
    mean = gaussian_mean(3 * weight, weight, sigma_px)
    np.testing.assert_allclose(mean[weight > 0], 3, rtol=2e-5)
    values = fractal(3, 1.0) * weight
    framed = [np.pad(one, ((0, 40), (0, 40))) for one in (values, weight)]
    if sigma_px < 4:  # coarser ones are taken of smaller images, whose pixels lie otherwise
        found = gaussian_mean(*framed, sigma_px)[: SHAPE[0], : SHAPE[1]]
        np.testing.assert_allclose(found, gaussian_mean(values, weight, sigma_px), atol=1e-5)


def test_coarse_gaussians_are_gaussians():
    import cv2

    values, everywhere = fractal(4, 1.0), np.ones(SHAPE, np.float32)
    inner = (slice(40, -40),) * 2
    for sigma_px in (4.0, 8.0):
        exact = cv2.GaussianBlur(values, (0, 0), sigma_px)[inner]
        assert np.std(gaussian_mean(values, everywhere, sigma_px)[inner] - exact) < 0.03 * np.std(exact)


def test_noise_has_in_each_octave_what_is_said_of_it():
    noise = np.random.default_rng(0).normal(size=(512, 512)).astype(np.float32)
    bands = octaves(noise, np.ones_like(noise))
    for (band, sigma_px), response in zip(bands, response_to_noise(SIGMAS_PX), strict=False):
        assert band.std() == pytest.approx(response, rel=0.02 + 0.02 * sigma_px)


@pytest.mark.parametrize("share", [0.05, 0.25])
@pytest.mark.parametrize("texture", [0.0, 0.1])
def test_the_shadings_error_is_told_from_the_scene(share, texture):
    """A shading that is wrong by a share of its own change, over one paint or a stone of many greys."""
    lit, wrong = log_shading(relief()).reshape(SHAPE), fractal(8, 0.2 * share)
    wrong[:, : SHAPE[1] // 2] *= 0.1  # as little as that half is in relief
    everywhere = np.ones(SHAPE, np.float32)
    left = wrong + fractal(7, texture)
    bands = zip(octaves(lit, everywhere), octaves(left, everywhere), strict=True)
    (change, sigma_px), (rest, _) = list(bands)[3]
    size = gaussian_mean(change**2, everywhere, sigma_px).ravel()
    found = error_of_change(size, rest.ravel(), rest.ravel(), HOW)
    if texture == 0:
        assert found == pytest.approx(0.8 * share, rel=0.3)
    else:
        assert found < 0.8 * share + 0.35 * texture / 0.2  # texture hides it, or passes for it in part


@pytest.mark.parametrize("shown", [0.0, 0.4, 1.0])
def test_what_the_photos_show_of_the_shading_is_found(shown):
    """Change that a noisy mesh made up is not in the photos, paint or no paint."""
    everywhere = np.ones(SHAPE, np.float32)
    for number in (0, 2):
        maps = (fractal(5, 0.2, 1.0), fractal(7, 0.1, 1.0))
        (change, sigma_px), (paint, _) = (list(octaves(one, everywhere))[number] for one in maps)
        size = gaussian_mean(change**2, everywhere, sigma_px).ravel()
        left = (shown - 1) * change + paint
        found = ShownChange.of(change.ravel(), left.ravel(), size, sigma_px / 2 if number else 0.0, HOW)
        assert found.shown == pytest.approx(shown, abs=0.12)
        assert np.abs(1 + found.at(size) - shown).mean() < 0.15


def test_bumps_that_the_photos_do_not_show_do_not_get_into_the_albedo():
    """Stereo's bumps in the shading of a flat stone: divided by it, the photo would have them all."""
    stone, bumps = np.exp(fractal(11, 0.1)).reshape(-1, 1), fractal(5, 0.1, 1.0).reshape(-1, 1)
    shading = np.repeat(np.exp(bumps), 3, axis=1).astype(np.float32)
    truth = (PAINT * stone).astype(np.float32)
    found = found_in(truth, shading)
    assert max(found.statistics.uncertainty.shown[:3]) < 0.3
    divided = gains(truth / shading, truth)
    for (gain, error), (_, before) in zip(gains(found.albedo, truth)[:2], divided, strict=False):
        assert 0.85 < gain < 1.1
        assert error < 0.4 and 2 * error < before


@pytest.mark.parametrize("noise", [0.01, 0.04])
@pytest.mark.parametrize("texture", [0.0, 0.1])
def test_noise_is_what_views_do_not_share_whatever_they_show(noise, texture):
    views, stone = several_views(3), np.exp(fractal(7, texture)).reshape(-1, 1)
    exact = np.tile((PAINT * stone).astype(np.float32), (3, 1))
    found = found_in(noisy(exact, noise), np.ones_like(exact), views=views)
    found = found.statistics.uncertainty
    assert found.noise[0] == pytest.approx(noise / np.sqrt(3), rel=0.2)
    assert found.noise[1:] == pytest.approx([noise * np.sqrt(2)] * 2, rel=0.2)


def test_texture_that_views_see_a_pixel_off_is_not_all_noise():
    """Two views of one stone, the second half a pixel beside: they differ most where texture is bold."""
    rng, bold = np.random.default_rng(3), np.exp(fractal(2, 1.0)).ravel()
    difference = rng.normal(size=bold.size) * np.sqrt(0.02**2 + 0.1 * (0.1 * bold) ** 2)
    assert noise_between_views(difference, (0.1 * bold) ** 2, HOW.classes) == pytest.approx(0.02, rel=0.35)
    assert noise_between_views(difference, np.full(bold.size, 0.01), HOW.classes) > 0.03


def test_other_views_are_asked_where_they_are_trusted():
    views = several_views(3)
    pixels = len(views.masks[0].ravel())
    trusted = np.ones(3 * pixels, bool)
    trusted[:pixels:2] = False
    others = OtherViews.of(views, trusted)
    assert not others.count[:pixels:2].any() and (others.count[1:pixels:2] == 2).all()
    assert set(others.count[pixels:].tolist()) == {1, 2}
    values = np.repeat(np.array([1, 2, 6], np.float32), pixels)[:, None]
    assert (others.mean(values)[1:pixels:2] == 4).all() and (others.with_own(values)[1:pixels:2] == 3).all()
    assert (others.mean(values)[pixels : 2 * pixels : 2] == 6).all()


def test_means_over_other_views_are_those_of_the_matrices():
    """Three views at different sizes: several pixels of one may correspond to a pixel of another."""
    rng, masks = np.random.default_rng(5), [np.ones((6, width), bool) for width in (12, 7, 4)]
    sizes = [mask.size for mask in masks]
    links = {}
    for i, j in ((0, 1), (0, 2), (1, 2)):
        rows = np.flatnonzero(rng.random(sizes[i]) < 0.6)
        ends = rows, rng.integers(0, sizes[j], len(rows))
        links[i, j] = sp.csr_array((np.ones(len(rows)), ends), shape=(sizes[i], sizes[j]))
    blocks = [[None if i == j else links.get((i, j)) for j in range(3)] for i in range(3)]
    for (i, j), block in links.items():
        blocks[j][i] = block.T
    both, trusted = sp.block_array(blocks).toarray(), rng.random(sum(sizes)) < 0.7
    values = rng.random((sum(sizes), 2)).astype(np.float32)
    seen = np.where(trusted[:, None], values, np.nan)
    others = OtherViews.of(stack_views(masks, None, links), trusted)
    count, total = both @ trusted, both @ np.nan_to_num(seen)
    np.testing.assert_array_equal(others.correspondences, count)
    mean = total / np.maximum(count, 1)[:, None]
    np.testing.assert_allclose(others.mean(seen), mean, rtol=1e-5)
    together = np.where(trusted[:, None], (seen + total) / (1 + count)[:, None], seen)
    np.testing.assert_allclose(others.with_own(seen), together, rtol=1e-5)
    filled, has_value = others.filled_in(seen)
    np.testing.assert_array_equal(has_value, trusted | (count > 0))
    np.testing.assert_allclose(
        filled[has_value], np.where(trusted[:, None], seen, mean)[has_value], rtol=1e-5
    )
    bright = values[:, :1] > 0.5
    share = both @ (bright & trusted[:, None]) / np.maximum(count, 1)[:, None]
    np.testing.assert_allclose(others.mean(bright), share, rtol=1e-6)


def test_statistics_that_are_given_filter_as_those_that_were_measured():
    views, stone, shading = several_views(3), np.exp(fractal(11, 0.1)).reshape(-1, 1), relief()
    light = np.tile(shading, (3, 1))
    image = noisy((PAINT * np.tile(stone, (3, 1)) * light).astype(np.float32), 0.02)
    smooth, trusted = np.broadcast_to(PAINT, image.shape).astype(np.float32), np.ones(len(image), bool)
    scene = DetailScene.of(views, smooth, image, light, trusted, HOW)
    own, given = with_detail(scene), with_detail(scene, DetailStatistics.of(sampled_detail(scene), HOW))
    np.testing.assert_array_equal(given.albedo, own.albedo)
    np.testing.assert_array_equal(given.variance, own.variance)


def test_views_together_show_texture_that_each_alone_hides_in_noise():
    views, stone = several_views(6), np.exp(fractal(11, 0.1)).reshape(-1, 1)
    truth = (PAINT * stone).astype(np.float32)
    image = noisy(np.tile(truth, (6, 1)), 0.06)
    together = detail_of(image, np.ones_like(image), views=views)[: len(truth)]
    alone = detail_of(image[: len(truth)], np.ones_like(truth))
    finest = [gains(each, truth)[0][1] for each in (together, alone)]
    assert finest[0] < 0.7 * finest[1]


@pytest.mark.parametrize("noise", [0.01, 0.03, 0.06])
def test_noise_on_one_paint_is_no_texture(noise):
    shading = relief()
    image = noisy((PAINT * shading).astype(np.float32), noise)
    plain = np.log(detail_of(image, shading) / PAINT)
    assert plain.std() < 0.3 * noise


def test_where_light_is_uneven_paint_is_no_bolder_than_elsewhere():
    """One paint under a shading whose shadow, in the right half, lies four pixels beside the photo's.

    A limit by the bold tenth of texture on even surface left .29, twice its mean .12, three times .17.
    """
    columns = np.arange(SHAPE[1])
    shadow, beside = (np.where((columns > x) & (columns < x + 40), -0.7, 0.0) for x in (130, 134))
    lit, shading = (
        np.repeat(np.exp(np.tile(each, (SHAPE[0], 1))).reshape(-1, 1), 3, axis=1) for each in (shadow, beside)
    )
    image = noisy((PAINT * lit).astype(np.float32), 0.01)
    found = np.log(detail_of(image, shading.astype(np.float32)) / PAINT).reshape(*SHAPE, 3)
    assert found.std() < 0.2 * np.log(lit / shading).std()


@pytest.mark.parametrize("seed", range(5))
def test_the_limit_gives_the_mean(seed):
    rng = np.random.default_rng(seed)
    values = rng.exponential(size=rng.integers(1, 300))
    for share in (0.01, 0.5, 0.99):
        limit = limit_for_mean(values, share * values.mean())
        assert np.minimum(values, limit).mean() == pytest.approx(share * values.mean(), rel=1e-9)
    assert limit_for_mean(values, 2 * values.mean()) == values.max()


def test_texture_is_limited_where_there_is_more_with_the_lights_change_and_nowhere_else():
    """Two axes: the first has ten times the energy where the light changes most, the second has the same."""
    rng = np.random.default_rng(4)
    change = np.sort(rng.exponential(size=60_000))
    energy = rng.exponential(size=(60_000, 2))
    energy[-20_000:, 0] *= 10
    limited = np.minimum(energy, TextureLimit.of(energy, change, HOW).at(change))
    assert limited[:30_000].mean(axis=0) == pytest.approx(energy[:30_000].mean(axis=0), rel=1e-3)
    assert limited[-20_000:, 0].mean() == pytest.approx(HOW.texture_factor, rel=0.1)  # a class has both
    assert limited[-18_000:, 0].mean() == pytest.approx(HOW.texture_factor, rel=0.05)
    assert limited[-20_000:, 1].mean() == pytest.approx(energy[-20_000:, 1].mean(), rel=1e-3)


@pytest.mark.parametrize("contrast", [0.1, 0.3])
@pytest.mark.parametrize("noise", [0.0, 0.01])
def test_texture_comes_back_at_every_size(contrast, noise):
    shading, stone = relief(), np.exp(fractal(11, contrast)).reshape(-1, 1)
    truth = (PAINT * stone).astype(np.float32)
    found = detail_of(noisy(truth * shading, noise), shading)
    for gain, error in gains(found, truth):
        assert 0.9 < gain < 1.1
        assert error < 0.35


def test_what_the_shading_may_have_done_is_taken_off_and_texture_elsewhere_stays():
    """The right half: one paint under a shading that is 10 % too weak. The left: stone, evenly lit."""
    logs, stone = fractal(5, 0.5), fractal(11, 0.1)
    logs[:, :100] = 0
    stone[:, 100:] = 0
    lit, shading = (np.repeat(np.exp(k * logs).reshape(-1, 1), 3, axis=1) for k in (1.1, 1.0))
    image = (PAINT * np.exp(stone).reshape(-1, 1) * lit).astype(np.float32)
    found = np.log(detail_of(image, shading.astype(np.float32)) / PAINT)[:, 1].reshape(SHAPE)
    quotient = np.log(image / shading / PAINT)[:, 1].reshape(SHAPE)
    assert found[:, 110:].std() < 0.6 * quotient[:, 110:].std()
    inner = found[10:-10, 10:90]
    assert np.corrcoef(inner.ravel(), stone[10:-10, 10:90].ravel())[0, 1] > 0.97
    assert inner.std() > 0.9 * stone[10:-10, 10:90].std()


def test_colour_of_texture_comes_back():
    shading = relief()
    rust = np.exp(np.stack([fractal(21, 0.1), fractal(22, 0.1), fractal(23, 0.1)], axis=-1)).reshape(-1, 3)
    truth = (PAINT * rust).astype(np.float32)
    found = detail_of(truth * shading, shading)
    for k in (0, 2):
        one, two = (np.log(each[:, k] / each[:, 1]) for each in (found, truth))
        assert np.corrcoef(one, two)[0, 1] > 0.95


def test_behind_a_highlight_is_what_the_other_views_see_there():
    views, stone = several_views(3), np.exp(fractal(11, 0.2)).reshape(-1, 1)
    shading = np.tile(relief(), (3, 1))
    truth = (PAINT * stone).astype(np.float32)
    image = np.tile(truth, (3, 1)) * shading
    glare = np.zeros(SHAPE, bool)
    glare[40:80, 30:90] = True
    own = np.flatnonzero(glare)
    image[own] = 40.0
    trusted = np.ones(len(image), bool)
    trusted[own] = False
    found = detail_of(image, shading, views=views, trusted=trusted)
    error = [np.std(np.log(found[at + own, 1] / truth[own, 1])) for at in (0, len(truth))]
    assert error[0] < 1.2 * error[1]  # as well as the view that shows it
    assert error[0] < 0.3 * np.std(np.log(truth[own, 1]))


@pytest.mark.parametrize(("count", "untrusted"), [(2, 1), (3, 3)])
def test_what_is_lent_bears_no_witness(count, untrusted):
    """Of noise, of the shading's error, of what trusted pixels show: as if it had not been lent."""
    views, rng = several_views(count), np.random.default_rng(4)
    image = noisy(np.tile(PAINT.astype(np.float32), (count * np.prod(SHAPE), 1)), 0.1)
    blobs = rng.random((untrusted, 8, 8)).repeat(SHAPE[0] // 8, 1).repeat(SHAPE[1] // 8 + 1, 2) < 0.1
    trusted = np.ones((count, *SHAPE), bool)
    trusted[:untrusted] = ~blobs[:, : SHAPE[0], : SHAPE[1]]
    trusted = trusted.ravel()
    alone = StackedViews(views.starts, views.basis, views.masks, {})
    linked, unlinked = (
        found_in(image, np.ones_like(image), views=each, trusted=trusted) for each in (views, alone)
    )
    assert linked.statistics.uncertainty.noise[0] > 0.8 * unlinked.statistics.uncertainty.noise[0] > 0.02
    off = np.std(np.log(linked.albedo[:, 1] / PAINT[1])[trusted])
    assert off < 0.35 * np.std(np.log(image[:, 1]))
    assert np.std(np.log(linked.albedo[:, 1] / PAINT[1])[~trusted]) < 1.5 * off


def test_what_is_not_trusted_keeps_its_albedo_and_says_nothing():
    shading, rng = relief(), np.random.default_rng(1)
    trusted = rng.random(len(shading)) > 0.2
    image = (PAINT * np.exp(fractal(11, 0.2)).reshape(-1, 1) * shading).astype(np.float32)
    wild = np.where(trusted[:, None], image, rng.random(image.shape) * 50).astype(np.float32)
    one, two = (detail_of(each, shading, trusted=trusted) for each in (image, wild))
    np.testing.assert_array_equal(one, two)
    np.testing.assert_allclose(one[~trusted], np.broadcast_to(PAINT, (int((~trusted).sum()), 3)), rtol=1e-6)


def test_views_do_not_mix_and_a_mask_is_a_frame():
    """Two views of other sizes, one after the other, are what each is by itself, but for common estimates."""
    mask = np.zeros(SHAPE, bool)
    mask[20:140, 30:170] = True
    shading = np.ones((mask.sum(), 3), np.float32)
    stone = np.exp(fractal(11, 0.2))[mask].reshape(-1, 1)
    image = (PAINT * stone).astype(np.float32)
    once = detail_of(image, shading, views=one_view(mask))
    starts = np.array([0, len(image), 2 * len(image)])
    twice = StackedViews(starts, np.zeros((2 * len(image), 0), np.float32), (mask, mask), {})
    both = detail_of(np.concatenate([image] * 2), np.concatenate([shading] * 2), views=twice)
    np.testing.assert_array_equal(both[: len(once)], both[len(once) :])
    np.testing.assert_allclose(both, np.concatenate([once] * 2), rtol=0.03)  # more to estimate it from
    assert np.corrcoef(once[:, 1], image[:, 1])[0, 1] > 0.99


def test_nothing_to_go_by_changes_nothing():
    """All dark, all untrusted, hardly a pixel: the smooth albedo, finite."""
    shading = relief()
    for image, trusted in (
        (np.zeros_like(shading), np.ones(len(shading), bool)),
        (shading, np.zeros(len(shading), bool)),
        (shading, np.arange(len(shading)) < 3),
    ):
        found = detail_of(image, shading, trusted=trusted)
        assert np.isfinite(found).all() and (found >= 0).all()
        np.testing.assert_allclose(found[~trusted], np.broadcast_to(PAINT, found[~trusted].shape), rtol=1e-6)


def test_noise_is_that_of_median_brightness_and_larger_in_the_dark():
    """Shot noise: twice the deviation of the logarithm in a quarter of the light."""
    light = np.where(np.arange(SHAPE[0])[:, None] < 80, 1.0, 0.25) * np.ones(SHAPE)
    shading = np.repeat(light.reshape(-1, 1), 3, axis=1).astype(np.float32)
    exact = (PAINT * shading).astype(np.float32)
    rng = np.random.default_rng(2)
    image = (exact + 0.02 * np.sqrt(exact) * rng.normal(size=exact.shape)).astype(np.float32)
    variance = relative_noise_variance(exact, HOW.log_offset)
    grain = relative_noise(variance, np.median(variance, axis=0), HOW.noise)
    assert grain.max(axis=0) / grain.min(axis=0) == pytest.approx(2, rel=0.1)
    found = np.log(detail_of(image, shading) / PAINT)[:, 1].reshape(SHAPE)
    for rows in (slice(10, 70), slice(90, 150)):
        assert found[rows].std() < 0.35 * np.log(image / exact)[:, 1].reshape(SHAPE)[rows].std()


def test_where_more_error_is_expected_there_is_more():
    """A shading that is wrong where it changes, over a stone: errors by expected variance, in eighths."""
    stone, wrong = np.exp(fractal(11, 0.1)).reshape(-1, 1), fractal(8, 0.06)
    wrong[:, : SHAPE[1] // 2] *= 0.1
    truth = (PAINT * stone).astype(np.float32)
    found = found_in(truth * relief() * np.exp(wrong).reshape(-1, 1).astype(np.float32), relief())
    squared = np.square(np.log(found.albedo / truth)).mean(axis=1)
    eighths = np.array_split(squared[np.argsort(found.variance)], 8)
    measured = np.sqrt([one.mean() for one in eighths])
    expected = np.sqrt([one.mean() for one in np.array_split(np.sort(found.variance), 8)])
    assert measured[-1] > 1.5 * measured[0]
    assert ((expected / measured > 0.5) & (expected / measured < 5)).all()


def test_a_view_that_is_darker_is_divided_by_no_more_than_its_light():
    """Least light is of the photo as bright as the view shows it."""
    shading = relief()
    truth = PAINT * np.exp(fractal(1, 0.2)).reshape(-1, 1)
    pixels, gains = len(shading), np.array([1, 1 / 128], np.float32)
    both = np.repeat(gains, pixels)[:, None]
    image, light = (np.concatenate([each, each]) * both for each in (truth * shading, shading))
    seen = image.astype(np.float32), light.astype(np.float32)
    part = replace(whole_scene(shading, seen[0][:pixels], HOW.log_offset, 10**6), of_scene=2 * pixels)
    smooth = np.broadcast_to(PAINT, image.shape).astype(np.float32)
    trusted, views = np.ones(2 * pixels, bool), apart(2)
    part = replace(part, places=np.arange(2 * pixels), own=trusted)
    albedo = with_detail(DetailScene.of(views, smooth, *seen, trusted, HOW, part, gains=gains)).albedo
    means = np.log(albedo.reshape(2, pixels, 3)).mean(axis=(1, 2))
    assert abs(means[0] - means[1]) < 0.05
