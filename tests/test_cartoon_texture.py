"""The baseline's laws: transposes, duality, the limits of λ, invariance, a disc, the same bits everywhere."""

from concurrent.futures import ThreadPoolExecutor

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.ndimage import label

from benchmarks.cartoon.cartoon_texture import cartoon_texture
from benchmarks.cartoon.primal_dual import (
    CartoonOutcome,
    CartoonSettings,
    cartoon,
    divergence,
    dual_bound,
    gradient,
    neighbours_within,
    primal_energy,
)

SEEDS = st.integers(0, 2**32 - 1)
FEW = settings(deadline=None, max_examples=25, derandomize=True)
WELL = {"primal_step": 3.5, "dual_step": 0.035, "gap_tolerance": 2e-5, "max_iterations": 40_000}


def random_mask(rng: np.random.Generator) -> np.ndarray:
    """Odd and even sizes, down to one pixel, with holes; never empty."""
    mask = rng.random(tuple(rng.integers(1, 12, 2))) < 0.7
    mask[rng.integers(mask.shape[0]), rng.integers(mask.shape[1])] = True
    return mask


def random_image(rng: np.random.Generator, mask: np.ndarray) -> np.ndarray:
    return np.where(mask, rng.uniform(0, 255, mask.shape), 0).astype(np.float32)


def random_dual(rng: np.random.Generator, shape: tuple[int, ...]) -> np.ndarray:
    """A field (2, h, w) of length ≤ 1, some of it exactly 1."""
    p = 2 * rng.standard_normal((2, *shape))
    return p / np.maximum(1, np.hypot(*p))


@pytest.fixture(scope="module")
def blobs() -> tuple[np.ndarray, np.ndarray]:
    """Two flat halves under a gradient and noise, 41 × 53, in a masked ellipse with a hole."""
    y, x = np.mgrid[:41, :53].astype(float)
    image = 60 + 90 * (x + 0.3 * y > 30) + 0.8 * y + 6 * np.random.default_rng(3).standard_normal(x.shape)
    mask = ((x - 26) / 25) ** 2 + ((y - 20) / 19) ** 2 < 1
    mask[10:13, 20:24] = False
    return np.where(mask, image, 7e4).astype(np.float32), mask


@given(SEEDS)
@FEW
def test_divergence_is_minus_the_transpose_of_the_gradient(seed):
    rng = np.random.default_rng(seed)
    mask = random_mask(rng)
    inside = neighbours_within(mask)
    u, p = 5 + rng.standard_normal(mask.shape), rng.standard_normal((2, *mask.shape))
    left = sum(float((d * q).sum()) for d, q in zip(gradient(u, *inside), p, strict=True))
    assert left == pytest.approx(-float((u * divergence(*p, *inside)).sum()), abs=1e-10)


def test_differences_join_only_pixels_of_the_mask():
    mask = np.array([[True, True, False], [True, False, True]])
    d_x, d_y = gradient(np.array([[1.0, 4.0, 90.0], [9.0, 70.0, 16.0]]), *neighbours_within(mask))
    assert d_x.tolist() == [[3, 0, 0], [0, 0, 0]]
    assert d_y.tolist() == [[8, 0, 0], [0, 0, 0]]


@given(SEEDS, st.floats(0.01, 5))
@FEW
def test_weak_duality_at_random_points(seed, fidelity):
    """No u, inside the range of g or far outside, has less energy than any p's bound."""
    rng = np.random.default_rng(seed)
    mask = random_mask(rng)
    g, inside = random_image(rng, mask), neighbours_within(mask)
    u = np.where(mask, g + rng.choice([0.1, 30, 900]) * rng.standard_normal(mask.shape), g)
    energy = primal_energy(u, g, *inside, fidelity)
    assert dual_bound(*random_dual(rng, mask.shape), g, *inside, fidelity) <= energy * (1 + 1e-12)


def test_one_sweep_is_the_scheme_as_printed(blobs):
    """Three iterations against the three lines of the docstring's Notes, written with the operators."""
    image, mask = blobs
    found = cartoon(image, mask, CartoonSettings(0.8, max_iterations=3))
    inside, g = neighbours_within(mask), np.where(mask, image, 0).astype(float)
    u, ahead, p = g, g, np.zeros((2, *mask.shape))
    for _ in range(3):
        p = p + 0.35 * np.stack(gradient(ahead, *inside))
        p = p / np.maximum(1, np.hypot(*p))
        offset = u + 0.35 * divergence(*p, *inside) - g
        new = g + np.sign(offset) * np.maximum(np.abs(offset) - 0.35 * 0.8, 0)
        u, ahead = new, 2 * new - u
    assert np.allclose(found.cartoon, np.where(mask, u, 0), atol=1e-3)
    assert np.allclose(found.dual_x, p[0], atol=1e-5)
    assert np.allclose(found.dual_y, p[1], atol=1e-5)
    assert found.iterations == 3
    assert found.outcome is CartoonOutcome.LIMIT_REACHED


def test_the_gap_is_never_negative_and_goes_to_zero(blobs):
    image, mask = blobs
    steps = [cartoon(image, mask, CartoonSettings(0.6, n, 0.0)) for n in (1, 10, 100, 1000, 10_000)]
    well = cartoon(image, mask, CartoonSettings(0.6, **WELL))
    gaps = [solution.relative_gap for solution in (*steps, well)]
    assert min(gaps) > -1e-6
    assert all(later < earlier for earlier, later in zip(gaps[:-1], gaps[1:], strict=True))
    assert gaps[-1] < 2e-5
    assert all(solution.outcome is CartoonOutcome.LIMIT_REACHED for solution in steps)
    assert well.outcome is CartoonOutcome.CONVERGED


def test_it_stops_once_the_gap_is_small_and_says_so(blobs):
    image, mask = blobs
    solution = cartoon(image, mask, CartoonSettings(0.6, 20_000, 1e-3))
    assert solution.outcome is CartoonOutcome.CONVERGED
    assert solution.relative_gap <= 1e-3
    assert solution.iterations < 20_000


def test_other_steps_come_to_the_same_energy(blobs):
    image, mask = blobs
    paper = cartoon(image, mask, CartoonSettings(0.6, 20_000, 1e-5))
    assert cartoon(image, mask, CartoonSettings(0.6, **WELL)).energy == pytest.approx(paper.energy, rel=2e-5)
    with pytest.raises(ValueError, match="8τσ ≤ 1"):
        CartoonSettings(0.6, primal_step=0.35, dual_step=0.4)


def test_a_large_weight_leaves_the_image(blobs):
    """|div p| ≤ 4 < λ: nothing can move."""
    image, mask = blobs
    solution = cartoon(image, mask, CartoonSettings(4.5, 500, 0.0))
    assert np.array_equal(solution.cartoon[mask], image[mask])
    assert not solution.cartoon[~mask].any()


def test_a_small_weight_leaves_the_median_of_every_connected_region():
    rng = np.random.default_rng(5)
    mask = np.ones((7, 11), bool)
    mask[:, 5] = False  # two regions of 35 pixels: an odd number, so that the median is one value
    image = random_image(rng, mask)
    found = cartoon(image, mask, CartoonSettings(0.02, 60_000, 0.0, 3.5, 0.035)).cartoon
    regions, count = label(mask)
    assert count == 2
    for region in (1, 2):
        inside = regions == region
        assert np.allclose(found[inside], np.median(image[inside]), atol=0.05)


def test_scaling_and_shifting_the_contrast_scales_and_shifts_the_cartoon(blobs):
    image, mask = blobs
    plain = cartoon(image, mask, CartoonSettings(0.7, **WELL))
    moved = cartoon(1.7 * image + 20, mask, CartoonSettings(0.7, **WELL))
    assert moved.energy == pytest.approx(1.7 * plain.energy, rel=4e-5)
    # The energy is flat around its least value: cartoons agree more loosely than energies.
    assert np.abs(moved.cartoon - (1.7 * plain.cartoon + 20))[mask].mean() < 0.1
    negative = cartoon(255 - image, mask, CartoonSettings(0.7, **WELL))
    assert negative.energy == pytest.approx(plain.energy, rel=4e-5)


@pytest.mark.parametrize(("ratio", "stays"), [(0.7, False), (1.4, True)])
@pytest.mark.parametrize("radius", [6, 11])
def test_a_disc_goes_below_two_over_its_radius(radius, ratio, stays):
    """Taking it away costs λπr² and saves 2πr, in a plane large enough not to matter."""
    y, x = np.mgrid[:61, :63]
    disc = (x - 30) ** 2 + (y - 31) ** 2 < radius**2
    image = np.where(disc, 200.0, 100.0).astype(np.float32)
    found = cartoon(image, np.ones(disc.shape, bool), CartoonSettings(ratio * 2 / radius, **WELL)).cartoon
    inner = (x - 30) ** 2 + (y - 31) ** 2 < (0.6 * radius) ** 2
    assert np.allclose(found[inner], 200 if stays else 100, atol=1)
    assert np.allclose(found[:8], 100, atol=1)


def test_a_curve_of_the_image_gives_nearly_that_curve_of_the_cartoon(blobs):
    """Why linear light will do: level sets are treated one by one, so that sRGB would hardly differ."""
    image, mask = blobs
    curve = lambda values: 255 * (np.maximum(values, 0) / 255) ** (1 / 2.2)  # noqa: E731
    plain = cartoon(image, mask, CartoonSettings(0.7, **WELL)).cartoon
    curved = cartoon(curve(image).astype(np.float32), mask, CartoonSettings(0.7, **WELL)).cartoon
    assert np.abs(curved - curve(plain))[mask].mean() < 0.3
    assert np.abs(curved - curve(image))[mask].mean() > 1  # and something was taken away


def scene(rng: np.random.Generator) -> tuple[list[np.ndarray], list[np.ndarray]]:
    masks = [np.zeros((31, 45), bool) for _ in range(3)]
    for k, mask in enumerate(masks):
        mask[3 + k : 27, 5 : 40 - k] = True
    return [rng.uniform(0, 0.7, (31, 45, 3)).astype(np.float32) for _ in masks], masks


def test_threads_change_no_bit():
    images, masks = scene(np.random.default_rng(8))
    results = []
    for threads in (1, 4):
        with ThreadPoolExecutor(threads) as executor:
            results.append(cartoon_texture(images, masks, CartoonSettings(0.9, 100), executor))
    for one, four in zip(results[0].albedos, results[1].albedos, strict=True):
        assert np.array_equal(one, four)
    assert results[0].reports == results[1].reports


def test_the_set_has_one_scale_that_is_taken_back():
    """Twice the light: twice the albedo. One view twice as bright as another: still so in its cartoon."""
    images, masks = scene(np.random.default_rng(9))
    with ThreadPoolExecutor(2) as executor:
        plain = cartoon_texture(images, masks, CartoonSettings(5.0, 50), executor)
        bright = cartoon_texture([4 * image for image in images], masks, CartoonSettings(5.0, 50), executor)
    for image, mask, albedo, brighter in zip(images, masks, plain.albedos, bright.albedos, strict=True):
        assert np.allclose(albedo[mask], image[mask], rtol=1e-5)  # λ > 4 leaves the image
        assert not albedo[~mask].any()
        assert np.allclose(brighter, 4 * albedo, rtol=1e-5)


def test_what_did_not_converge_is_counted():
    images, masks = scene(np.random.default_rng(10))
    with ThreadPoolExecutor(2) as executor:
        cartoons = cartoon_texture(images, masks, CartoonSettings(0.3, 5), executor)
    assert cartoons.unconverged == 9
    assert cartoons.worst_gap > 1e-3
    assert {report.iterations for view in cartoons.reports for report in view} == {5}


def test_black_images_stay_black():
    masks = [np.ones((5, 4), bool)]
    with ThreadPoolExecutor(1) as executor:
        cartoons = cartoon_texture(
            [np.zeros((5, 4, 3), np.float32)], masks, CartoonSettings(0.3, 5), executor
        )
    assert not cartoons.albedos[0].any()
    assert cartoons.unconverged == 0
