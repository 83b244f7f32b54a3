"""Paints as in the world: contrast as stated, detail as fine as stated, the same for the same seed."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.ndimage import minimum_filter

from stages.formats.meshes.triangle_meshes import Surface
from stages.synthetic.lights import Dome, Light
from stages.synthetic.paints.natural_paint import (
    NATURAL_PAINTS,
    TEXTURES,
    names_of_quilt,
    natural_paint,
    quilt,
)
from stages.synthetic.paints.solid_noise import cell_borders, fractal_noise, octave_wavelengths, smooth_noise
from stages.synthetic.paints.textures.pattern import Scale
from stages.synthetic.render import Quality, Scene
from stages.synthetic.render_settings import RenderSettings
from stages.synthetic.subjects.architecture import build_courtyard, build_relief
from stages.synthetic.subjects.subdivision import subdivided
from stages.synthetic.truth import PaintedSurface
from tests.rendered_scene import ball, towards_origin

SCALE = Scale(finest=0.02, largest=1.0)
TEXTURED = sorted(set(TEXTURES) - {"plaster"})


def on_a_ball(count: int = 20000) -> np.ndarray:
    directions = np.random.default_rng(0).standard_normal((count, 3))
    return directions / np.linalg.norm(directions, axis=1, keepdims=True)


def on_a_plane(side: int, step: float) -> np.ndarray:
    """A square grid of points, oblique to all axes, row by row."""
    u, v = np.array([0.6, 0.5, 0.62]), np.array([-0.64, 0.77, 0.0])
    u, v = u / np.linalg.norm(u), v / np.linalg.norm(v)
    v = v - (v @ u) * u
    grid = np.arange(side) * step
    return (grid[:, None, None] * u + grid[None, :, None] * v / np.linalg.norm(v)).reshape(-1, 3)


def log_brightness(albedo: np.ndarray) -> np.ndarray:
    return np.log(albedo.astype(float)).mean(axis=1)


@pytest.mark.parametrize("name", TEXTURED)
@pytest.mark.parametrize("contrast", [0.05, 0.2, 0.6])
def test_the_contrast_is_the_one_stated_and_the_albedo_is_one(name, contrast):
    albedo = natural_paint(name, on_a_ball(), SCALE, contrast, seed=4)
    assert albedo.dtype == np.float32
    assert albedo.min() >= 0.02
    assert albedo.max() <= 0.9
    clipped = 0.04 if contrast > 0.5 else 0.005  # by the range of albedos
    assert log_brightness(albedo).std() == pytest.approx(contrast, rel=clipped)


def test_plaster_is_one_paint():
    albedo = natural_paint("plaster", on_a_ball(100), SCALE, 0.3, seed=1)
    assert len(np.unique(albedo, axis=0)) == 1


@pytest.mark.parametrize("name", TEXTURED)
def test_a_seed_gives_one_paint_whatever_the_order_and_another_seed_another(name):
    x = on_a_ball(3000)
    albedo = natural_paint(name, x, SCALE, 0.2, seed=7)
    order = np.random.default_rng(1).permutation(len(x))
    np.testing.assert_allclose(natural_paint(name, x[order], SCALE, 0.2, seed=7), albedo[order], rtol=1e-5)
    other = natural_paint(name, x, SCALE, 0.2, seed=8)
    assert np.abs(other / albedo - 1).mean() > 0.05


def test_colour_changes_with_brightness_and_on_its_own():
    albedo = natural_paint("fractal", on_a_ball(), SCALE, 0.3, seed=2)
    tone, warm = log_brightness(albedo), np.log(albedo[:, 0] / albedo[:, 2])
    assert 0.02 < warm.std() < tone.std()
    assert 0.3 < np.corrcoef(tone, warm)[0, 1] < 0.9


def test_fractal_noise_has_amplitudes_proportional_to_one_over_frequency():
    """The mean spectrum of planes through it: slope −1 in amplitude, −2 in power."""
    side, step = 256, 0.01
    frequency = np.hypot(*np.meshgrid(np.fft.fftfreq(side, step), np.fft.fftfreq(side, step)))
    window = np.hanning(side)[:, None] * np.hanning(side)
    planes = [fractal_noise(on_a_plane(side, step), 1.0, 0.02, s) for s in (0, 100, 200, 300)]
    power = np.mean([np.abs(np.fft.fft2(one.reshape(side, side) * window)) ** 2 for one in planes], axis=0)
    edges = np.geomspace(1.5, 12, 10)
    bins = [(frequency >= low) & (frequency < high) for low, high in zip(edges, edges[1:], strict=False)]
    x = np.log([frequency[one].mean() for one in bins])
    y = np.log([power[one].mean() for one in bins])
    assert np.polyfit(x, y, 1)[0] == pytest.approx(-2, abs=0.35)


def test_fractal_noise_is_standardised_and_has_nothing_finer_than_stated():
    x = np.random.default_rng(3).uniform(-20, 20, (40000, 3))
    noise = fractal_noise(x, 1.0, 0.03, 5)
    assert noise.mean() == pytest.approx(0, abs=0.05)
    assert noise.std() == pytest.approx(1, rel=0.05)
    assert octave_wavelengths(1.0, 0.125) == [1.0, 0.5, 0.25, 0.125]
    assert octave_wavelengths(0.1, 1.0) == [0.1]
    near = fractal_noise(x + [0.001, 0, 0], 1.0, 0.03, 5)
    assert np.abs(near - noise).max() < 0.2
    finest, beside = (fractal_noise(x + [shift, 0, 0], 0.03, 0.03, 5) for shift in (0, 0.03))
    assert np.corrcoef(finest, beside)[0, 1] < 0.5


def test_borders_of_cells_are_where_the_nearest_point_changes():
    x = np.random.default_rng(2).uniform(-1, 1, (4000, 3))
    step = np.array([0.004, 0, 0])
    distance, value = cell_borders(x, 0.2, 3)
    _, beside = cell_borders(x + step, 0.2, 3)
    assert (distance[value != beside] * 0.2 <= 0.004).all()
    assert 5 < (value != beside).sum() < 400
    assert distance.min() >= 0
    assert smooth_noise(x, 0.2, 3).shape == value.shape


def test_a_quilt_has_plain_plaster_beside_textures():
    x = on_a_ball(4000)
    parts = (x[:, 2] > 0).astype(np.uint8) + 2 * (x[:, 0] > 0).astype(np.uint8)
    albedo, plain = quilt(x, parts, SCALE, 0.2, seed=2)
    assert 0 < plain.sum() < len(x)
    for part in range(4):
        here = parts == part
        assert plain[here].all() or not plain[here].any()
        contrast = log_brightness(albedo[here]).std()
        assert contrast == pytest.approx(0 if plain[here].all() else 0.2, rel=0.01, abs=1e-6)


@pytest.mark.parametrize("seed", range(8))
def test_the_textures_of_a_quilt_come_once_before_they_come_again(seed):
    names = names_of_quilt(4, seed)
    assert "plaster" in names
    others = [name for name in names if name != "plaster"]
    assert len(set(others)) == len(others)
    assert set(names_of_quilt(40, seed)) == set(TEXTURES)


def test_every_paint_of_the_world_is_one_that_render_knows():
    known = RenderSettings.model_fields["paint"].annotation.__args__
    assert set(NATURAL_PAINTS) == set(known) - {"parts", "stripes", "texture", "vertex"}


def test_subdivision_keeps_the_surface_and_halves_its_edges_without_cracks():
    whole = ball(0.1)
    fine, origin = subdivided(whole, 0.03)
    np.testing.assert_array_equal(fine.vertices[: len(whole.vertices)], whole.vertices)
    corners = fine.vertices[fine.faces]
    edges = np.linalg.norm(corners - np.roll(corners, 1, axis=1), axis=-1)
    assert edges.max() <= 0.03
    directed = np.concatenate([fine.faces[:, [0, 1]], fine.faces[:, [1, 2]], fine.faces[:, [2, 0]]])
    key = directed.astype(np.int64) @ [len(fine.vertices), 1]
    back = directed.astype(np.int64) @ [1, len(fine.vertices)]
    assert len(np.unique(key)) == len(key)
    np.testing.assert_array_equal(np.sort(key), np.sort(back))
    normal = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    old = whole.vertices[whole.faces]
    before = np.cross(old[:, 1] - old[:, 0], old[:, 2] - old[:, 0])
    assert np.linalg.norm(normal, axis=1).sum() == pytest.approx(np.linalg.norm(before, axis=1).sum())
    volume = [np.einsum("fk,fk->", c[:, 0], np.cross(c[:, 1], c[:, 2])) for c in (corners, old)]
    assert volume[0] == pytest.approx(volume[1])
    assert np.linalg.norm(fine.vertices - whole.vertices[origin], axis=1).max() < 0.2


def test_paint_on_vertices_half_a_pixel_apart_is_the_paint_itself():
    """The mean over pixels of what vertices carry, against the texture at the points seen by 64 rays each."""
    camera = towards_origin(20.0, 10.0, 60, 150.0)
    footprint = 3 / 150
    scale = Scale(2 * footprint, 0.9)
    fine, _ = subdivided(ball(0.06), 0.75 * footprint)
    shown = PaintedSurface(fine, natural_paint("masonry", fine.vertices, scale, 0.3, 1)).truth(camera)
    dense, _ = subdivided(ball(0.06), 0.2 * footprint)
    reference = PaintedSurface(dense, natural_paint("masonry", dense.vertices, scale, 0.3, 1))
    expected = reference.truth(camera, samples_per_side=8)
    both = shown.mask & expected.mask
    ratio = shown.albedo[both] / expected.albedo[both]
    assert np.abs(np.log(ratio)).mean() < 0.01
    assert np.log(expected.albedo[expected.mask]).mean(axis=1).std() > 0.25


@pytest.mark.parametrize("build", [build_relief, build_courtyard])
def test_architecture_is_closed_faces_outwards_and_has_four_parts(build):
    built = build(0.012)
    faces = built.surface.faces.astype(np.int64)
    directed = np.concatenate([faces[:, [0, 1]], faces[:, [1, 2]], faces[:, [2, 0]]])
    count = len(built.surface.vertices)
    np.testing.assert_array_equal(np.sort(directed @ [count, 1]), np.sort(directed @ [1, count]))
    corners = built.surface.vertices[faces]
    assert np.einsum("fk,fk->", corners[:, 0], np.cross(corners[:, 1], corners[:, 2])) > 0
    share = np.bincount(built.parts, minlength=4) / len(built.parts)
    assert len(built.part_names) == len(share) == 4
    assert (share > 0.02).all()
    assert isinstance(built.surface, Surface)


def test_a_photo_under_an_even_dome_is_the_true_albedo_whatever_the_texture():
    """I = ρ S with S = 1: path tracer and truth average the same paint over the same pixels."""
    camera = towards_origin(20.0, 10.0, 40, 100.0)
    footprint = 3 / 100
    fine, _ = subdivided(ball(0.06), 0.75 * footprint)
    paint = natural_paint("rubble", fine.vertices, Scale(2 * footprint, 0.9), 0.5, 3)
    even = Light(Dome((1.0, 1.0, 1.0), (1.0, 1.0, 1.0)))
    image = Scene(fine, paint, even).photograph(camera, Quality(1024, reflections=1), seed=0)
    truth = PaintedSurface(fine, paint).truth(camera)
    inside = minimum_filter(truth.mask, 3)  # slivers of background at the rim are no question of paint
    error = image[inside] / truth.albedo[inside] - 1
    assert np.abs(error.mean()) < 0.002
    assert error.std() < 0.02
