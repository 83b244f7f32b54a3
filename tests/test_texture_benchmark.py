"""The benchmark of textured models: planted seams and errors come out as they were planted."""

from __future__ import annotations

import numpy as np
import pytest

from benchmarks.texture.rerendering import error_of, outlines, rendered
from benchmarks.texture.seams import OUTSIDE, chart_borders, chart_image, random_lines, steps_of
from stages.formats.meshes.triangle_meshes import Surface
from stages.scene.cameras import Camera, back_project
from stages.synthetic.views import look_at
from stages.texturing.rendering import TexturedSurface
from stages.texturing.unwrapping import ChartedMesh

SIDE, WHITE = 128, 0.8
K = np.array([[100.0, 0, 40], [0, 100, 30], [0, 0, 1]])


@pytest.fixture
def book() -> ChartedMesh:
    """Two pages that meet at x = 0, each a chart of its own; the right one is turned in the atlas."""
    vertices = np.array(
        [[-1, 0, 0], [0, 0, 0], [0, 1, 0], [-1, 1, 0], [0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0]], float
    )
    left = np.array([[0.05, 0.05], [0.45, 0.05], [0.45, 0.45], [0.05, 0.45]])
    right = np.array([[0.95, 0.55], [0.95, 0.95], [0.55, 0.95], [0.55, 0.55]])
    return ChartedMesh(
        vertices,
        np.tile([0.0, 0, 1], (8, 1)),
        np.array([[0, 1, 2], [0, 2, 3], [4, 5, 6], [4, 6, 7]], np.int32),
        np.concatenate([left, right]),
        np.array([0, 1, 2, 3, 1, 4, 5, 2]),
    )


def pages(left: float, right: float) -> np.ndarray:
    """An atlas whose upper half, with the left page, has another albedo than the lower."""
    atlas = np.full((SIDE, SIDE, 3), left, np.float32)
    atlas[SIDE // 2 :] = right
    return atlas


def camera(width: int = 80) -> Camera:
    """Before the pages, which fill less than its view."""
    return Camera("view", width, 60, K, look_at(np.array([0.1, 0.4, 4.0]), np.array([0, 0.5, 0])))


def textured(mesh: ChartedMesh, atlas: np.ndarray) -> TexturedSurface:
    return TexturedSurface.of_atlas(Surface(mesh.vertices, mesh.faces), mesh.uv, atlas)


def half_dark(points: np.ndarray, normals: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """What views show of the pages: .4 left of their middle, .2 right of it; all of it."""
    assert np.allclose(normals, [0, 0, 1]) and np.allclose(points[:, 2], 0, atol=1e-6)
    albedo = np.where(points[:, :1] < 0, 0.4, 0.2) * np.ones(3)
    return albedo, np.ones(len(points), bool)


def steps(mesh: ChartedMesh, atlas: np.ndarray):
    seen = np.ones(atlas.shape[:2], bool)
    return steps_of(mesh, atlas, seen, WHITE, half_dark, np.random.default_rng(0))


def test_a_planted_seam_is_measured(book):
    """The logarithm has an offset of .02 of white: (.4 + .016) / (.2 + .016)."""
    planted = steps(book, pages(0.4, 0.2))
    assert planted.border == pytest.approx(np.log(0.416 / 0.216), rel=1e-5)
    assert planted.inside == 0
    assert planted.surface == pytest.approx(planted.border, rel=1e-5), "the paint itself ends there"
    assert planted.border_places == round(0.4 * SIDE), "the one edge between the pages, a place a texel"
    assert planted.inside_places > 1000


def test_a_texture_without_a_seam_has_none(book):
    """A ramp over the surface, charts or not: it rises by as much at the border as along x anywhere."""
    x, y = np.meshgrid(*2 * [(np.arange(SIDE) + 0.5) / SIDE])
    along = np.where(y < 0.5, (x - 0.05) / 0.4 - 1, (y - 0.55) / 0.4)  # x of the surface
    ramp = WHITE * (np.exp(0.3 * along) - 0.02)
    same = steps(book, np.repeat(ramp[..., None], 3, axis=2).astype(np.float32))
    texel = 1 / (0.4 * SIDE)
    assert same.border == pytest.approx(0.3 * 2 * texel, rel=0.02)
    assert same.inside == pytest.approx(0.3 * 2 * texel * 2 / np.pi, rel=0.05), "of random directions"


def test_unseen_texels_do_not_count(book):
    seen = np.ones((SIDE, SIDE), bool)
    seen[: SIDE // 2] = False
    measured = steps_of(book, pages(0.4, 0.2), seen, WHITE, half_dark, np.random.default_rng(0))
    assert measured.border_places == 0 and np.isnan(measured.border)


def test_borders_are_those_edges_alone_that_are_apart_in_the_atlas(book):
    borders = chart_borders(book, SIDE)
    assert borders.begin.shape == (2, 1, 2)
    np.testing.assert_allclose(np.linalg.norm(borders.end - borders.begin, axis=2), 0.4 * SIDE)
    centres = [SIDE * 0.25, SIDE * 0.75]
    for side in range(2):
        middle = (borders.begin[side, 0] + borders.end[side, 0]) / 2
        inwards = np.array([min(centres, key=lambda c: abs(c - middle.min()))] * 2) - middle
        assert borders.away[side, 0] @ inwards > 0


def test_random_lines_are_as_long_as_asked_and_in_charts(book):
    charts = chart_image(book, SIDE)
    assert len(np.unique(charts[charts != OUTSIDE])) == 2
    lines = random_lines(charts, np.array([3.0, 7.0, 11.0]), np.random.default_rng(1))
    np.testing.assert_allclose(np.linalg.norm(lines.end[0] - lines.begin[0], axis=1), [3, 7, 11])
    column, row = ((lines.begin[0] + lines.end[0]) / 2).astype(int).T
    assert (charts[row, column] != OUTSIDE).all()


def test_a_known_error_has_its_psnr_and_equal_albedo_none(book):
    shown, every = rendered(textured(book, pages(0.4, 0.2)), camera()), np.ones((60, 80))
    assert 0.1 < shown.hit.mean() < 0.9
    np.testing.assert_allclose(shown.albedo[30, [28, 50]], [[0.4] * 3, [0.2] * 3], rtol=1e-5)
    equal = error_of("view", shown, shown.albedo, shown.hit, every, WHITE)
    assert equal.encoded.psnr == equal.linear.psnr == np.inf and equal.missed == 0
    off = error_of("view", shown, shown.albedo + 0.01 * WHITE, every > 0, every, WHITE)
    assert off.linear.psnr == pytest.approx(40, abs=1e-3)
    slope = [1.055 / 2.4 * (albedo / WHITE) ** (1 / 2.4 - 1) for albedo in (0.4, 0.2)]  # of sRGB
    sides = [(shown.albedo[..., 0] > 0.3).sum(), (shown.hit & (shown.albedo[..., 0] < 0.3)).sum()]
    expected = -20 * np.log10(0.01 * np.sqrt(np.average(np.square(slope), weights=sides)))
    assert off.encoded.psnr == pytest.approx(expected, abs=0.15)
    assert off.missed == (~shown.hit).sum() and off.encoded.weight == shown.hit.sum()
    both = off + equal
    assert both.name == "all" and both.linear.psnr == pytest.approx(40 + 10 * np.log10(2), abs=1e-3)


def test_errors_at_outlines_are_told_apart_and_so_is_what_a_view_does_not_know(book):
    shown = rendered(textured(book, pages(0.4, 0.2)), camera())
    albedo = np.where(shown.outline[..., None], 0, shown.albedo)
    error = error_of("view", shown, albedo, shown.hit, ~shown.outline, WHITE)
    assert error.inner.psnr == error.known.psnr == np.inf and error.encoded.psnr < 30


def test_an_outline_is_where_surface_ends_or_another_begins():
    view = Camera("view", 12, 9, np.diag([100.0, 100, 1]), np.eye(3, 4))
    depth = np.full((9, 12), 2.0, np.float32)
    depth[:, 7:] = 5.0
    depth[0] = 0
    found = outlines(view, depth > 0, depth)
    assert found[1, 1:-1].all() and not found[0].any()
    np.testing.assert_array_equal(np.flatnonzero(found[4, 1:-1]) + 1, [6, 7])


def test_the_texture_is_looked_up_between_texels_at_pixel_centres(book):
    """A ramp along v of the atlas is a ramp of the picture: no half texel off."""
    y = (np.arange(SIDE) + 0.5) / SIDE
    ramp = np.repeat(np.repeat(y[:, None, None], SIDE, axis=1), 3, axis=2).astype(np.float32)
    view = Camera("view", 80, 60, K, look_at(np.array([-0.5, 0.3, 2.0]), np.array([-0.5, 0.5, 0])))
    shown = rendered(textured(book, ramp), view)
    points = back_project(view, textured(book, ramp).seen_by(view).depth)
    left = shown.hit & ~shown.outline & (points[..., 0] < -0.05)
    np.testing.assert_allclose(shown.albedo[left][:, 0], 0.05 + 0.4 * points[left][:, 1], atol=1e-3)
