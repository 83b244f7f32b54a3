"""Suns: their shadows at the pixels, and that the search finds them, or none."""

from __future__ import annotations

import numpy as np
import pytest
import scipy.sparse as sp
import trimesh
from PIL import Image

import stages
from benchmarks.paper.laboratory import results_of
from pipeline.command.terminal import Terminal
from stages.formats.artefacts.light_npz import read_light
from stages.formats.artefacts.view_files import write_pictures_of_light
from stages.formats.images.exr import read_exr
from stages.formats.meshes.triangle_meshes import Surface
from stages.geometry.smooth_surface import SmoothSurface
from stages.photometry.sun.pixel_rays import WHOLE, PixelRays
from stages.photometry.sun.settings import SunSettings
from stages.photometry.sun.sun_search import directions_around
from stages.photometry.transport.directional_transport import (
    DirectionalTransport,
    Sphere,
    arriving,
    even_directions,
)
from stages.photometry.transport.environment import picture_of_light
from stages.photometry.transport.settings import LightPictureSettings
from stages.synthetic.lights import direction_at

UP = np.array([0.0, 0, 1])


def of_unit(vectors: np.ndarray) -> np.ndarray:
    return (vectors / np.linalg.norm(vectors, axis=-1, keepdims=True)).astype(np.float32)


def rays_on_ground(x: np.ndarray, **how: float) -> PixelRays:
    """Points at x on a ground of y = z = 0, of one view each half; a roof 1 above it where x < 0."""
    corners = [[-9, -9, 0], [9, -9, 0], [9, 9, 0], [-9, 9, 0], [-9, -9, 1], [0, -9, 1], [0, 9, 1], [-9, 9, 1]]
    mesh = Surface(np.array(corners, float), np.array([[0, 1, 2], [0, 2, 3], [4, 5, 6], [4, 6, 7]], np.int32))
    starts = np.array([0, len(x) // 2, len(x)])

    def points_of(view: int) -> tuple[np.ndarray, np.ndarray]:
        own = x[starts[view] : starts[view + 1]]
        on_the_right = own > 0  # of the ground's diagonal, at y = 0
        on_first = np.stack([own / 18, np.full(len(own), 0.5)], axis=1)
        on_second = np.stack([np.full(len(own), 0.5) + own / 18, -own / 18], axis=1)
        barycentric = np.where(on_the_right[:, None], on_first, on_second).astype(np.float32)
        return np.where(on_the_right, 0, 1), barycentric

    return PixelRays(lambda: SmoothSurface(mesh, 1), points_of, starts, SunSettings(**how))


def test_the_shadow_of_a_roof_ends_where_the_sun_says_with_a_penumbra_of_its_disc():
    x = np.linspace(-1.5, 1.5, 3001)
    sun = of_unit(np.array([[0.5, 0, 1.0]]))  # the roof's edge at x = 0, 1 up, throws its shadow to x = −.5
    normals = np.tile(UP.astype(np.float32), (len(x), 1))
    seen = rays_on_ground(x, radius_deg=2.0).see(sun, None, normals)[:, 0] / WHOLE
    assert 1.5 - seen.sum() * 0.001 == pytest.approx(-0.5, abs=0.005)
    assert (seen[x < -0.5 - 0.06] == 0).all() and (seen[x > -0.5 + 0.06] == 1).all()
    assert ((seen > 0) & (seen < 1)).sum() * 0.001 == pytest.approx(np.deg2rad(2.0) * 1.25, rel=0.5)


def test_a_lamp_on_a_sphere_throws_its_shadow_from_where_it_is():
    x = np.linspace(-1.5, 1.5, 601)
    normals = np.tile(UP.astype(np.float32), (len(x), 1))
    lamp = of_unit(np.array([[0.0, 0, 1.0]]))  # straight above x = 1, on a sphere of radius 3 around it
    seen = rays_on_ground(x).see(lamp, Sphere((1.0, 0.0, 0.0), 3.0), normals)[:, 0]
    edge = x[np.argmax(seen == WHOLE)]  # through (1, 3) and the roof's edge at (0, 1)
    assert edge == pytest.approx(-0.5, abs=0.02)


def test_some_pixels_see_what_all_see_and_no_sun_behind_them_is_seen():
    x = np.linspace(-1.5, 1.5, 400)
    normals = np.tile(UP.astype(np.float32), (len(x), 1))
    suns = of_unit(np.array([[0.5, 0, 1.0], [0.3, 0.2, -0.4]]))
    rays = rays_on_ground(x)
    every, some = rays.see(suns, None, normals), np.array([3, 199, 200, 390])
    np.testing.assert_array_equal(rays.see(suns, None, normals[some], some), every[some])
    assert not every[:, 1].any() and every[:, 0].any()
    assert rays.see(suns[:0], None, normals).shape == (400, 0)


@pytest.mark.parametrize("offset", [0.0, 0.4])
def test_light_arrives_as_in_the_compiled_loops(offset):
    rng = np.random.default_rng(0)
    normals = of_unit(rng.normal(size=(50, 3)))
    offsets = np.float32(offset) * of_unit(rng.normal(size=(50, 3)))
    sees_all = sp.csr_array((50, 1), dtype=np.float32)
    pixels = DirectionalTransport.of(normals, offsets, sees_all, np.zeros((1, 8), np.uint8), 64)
    by_loop = pixels.shares(np.arange(50)) / (4 * pixels.cells)
    np.testing.assert_allclose(arriving(normals, offsets, pixels.directions), by_loop, rtol=1e-3, atol=1e-5)


def test_directions_cover_a_circle_evenly():
    around = directions_around(np.array([0.6, 0, 0.8]), 6.0, 1.0)
    angles = np.rad2deg(np.arccos(np.clip(around @ around.T, -1, 1)))
    np.fill_diagonal(angles, 9)
    assert angles.min(axis=1) == pytest.approx(np.ones(len(around)), rel=0.03)
    assert len(around) == pytest.approx(np.pi * 36 / (np.sqrt(3) / 2), rel=0.1)
    assert around @ [0.6, 0, 0.8] == pytest.approx(np.ones(len(around)), abs=1 - np.cos(np.deg2rad(6.1)))


def test_the_picture_of_the_light_holds_the_sun():
    directions, light = even_directions(256), np.ones((256, 3))
    polar = np.pi * (np.arange(64) + 0.5) / 64
    solid = np.repeat(np.sin(polar), 128)[:, None] / (128 * np.sin(polar).sum())
    for towards in ([0, 0, 1.0], [0.6, 0, 0.8], [1.0, 0, 0]):
        cells = np.append(np.full(256, 1 / 256), 5e-6)
        picture = picture_of_light(
            np.vstack([directions, [towards]]),
            np.vstack([light, [[2e4, 1e4, 0]]]),
            LightPictureSettings(),
            cells,
            suns=1,
        )
        held = (solid * picture.reshape(-1, 3)).sum(axis=0)
        assert held == pytest.approx(np.array([1.1, 1.05, 1.0]), rel=1e-3)


def test_a_picture_of_few_pixels_takes_no_cell_for_a_sun():
    directions, light = even_directions(256), np.ones((256, 3))
    picture = picture_of_light(directions, light, LightPictureSettings(rows=4), np.full(256, 1 / 256))
    np.testing.assert_allclose(picture, 1, rtol=1e-6)


def test_the_picture_for_people_shows_the_sky_beside_the_sun(tmp_path):
    sky = np.linspace(0.5, 1, 64 * 128).reshape(64, 128, 1).repeat(3, axis=2)
    sky[20, 30] = 5000
    write_pictures_of_light(tmp_path, {"shared": sky.astype(np.float32)})
    shown = np.asarray(Image.open(tmp_path / "shared.png"))
    assert shown[20, 30].min() == 255 and 150 < np.median(shown) < 255
    np.testing.assert_allclose(read_exr(tmp_path / "shared.exr"), sky, rtol=1e-3)


def lit(workspace, light: str):
    """Light a relief; returns the light that is found, and its record."""
    given = {
        "render": {
            "subject": "relief",
            "paint": "masonry",
            "light": light,
            "views": 4,
            "arc_deg": 60.0,
            "width_px": 144,
            "height_px": 120,
            "noise": 0.05,
            "spacing": 0.016,
        },
        "lighting": {"samples": 4000, "specular": {"remove": False}},
    }
    done = results_of(stages.experiment({}), {}, given, workspace, "lighting", 2, Terminal())
    found = read_light(done.paths["found_light"])
    return found.around, done.facts["lighting"]


def test_a_sun_is_found_where_it_shines_and_none_under_a_dome(tmp_path):
    around, facts = lit(tmp_path / "w", "sun_and_sky")
    (sun,) = facts["suns"]
    off = np.rad2deg(np.arccos(around.directions[-1] @ direction_at(-40.0, 40.0)))
    assert off < 2.0  # of so few pixels
    flux = (around.radiance[0] * around.cells[:, None])[-1]
    assert flux[0] / flux[2] == pytest.approx(0.80 / 0.55, rel=0.2)  # warm, as it is
    assert sun["share_of_light"] == pytest.approx(
        flux.sum() / (around.cells @ around.radiance[0]).sum(), abs=1e-3
    )
    _, overcast = lit(tmp_path / "w", "dome")
    assert overcast["suns"] == []


def test_facets_of_a_smooth_surface_do_not_shade_each_other():
    """A ball of few faces, its normals interpolated: lit up to where the sun grazes it."""
    ball = trimesh.creation.icosphere(subdivisions=2)
    mesh = Surface(np.asarray(ball.vertices), np.asarray(ball.faces, np.int32))
    rng = np.random.default_rng(0)
    faces, barycentric = rng.integers(0, len(mesh.faces), 4000), rng.dirichlet([1, 1, 1], 4000)[:, 1:]
    shares = np.column_stack([1 - barycentric.sum(axis=1), barycentric])
    normals = of_unit(np.einsum("nc,nck->nk", shares, mesh.vertices[mesh.faces[faces]]))
    rays = PixelRays(
        lambda: SmoothSurface(mesh, 1),
        lambda _: (faces, barycentric.astype(np.float32)),
        np.array([0, 4000]),
        SunSettings(),
    )
    sun = of_unit(np.array([[0.3, 0.5, 0.8]]))
    seen, cosine = rays.see(sun, None, normals)[:, 0], normals @ sun[0]
    assert (seen[cosine > 0.02] == WHOLE).mean() > 0.99
    assert not seen[cosine <= 0].any()
