"""Sheen: the light's image in a rough mirror, foretold, measured by how views differ, and taken off."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from stages.photometry.paints import PALETTE, paints_of
from stages.photometry.sheen import (
    NO_SHEEN,
    NOT_SOUGHT,
    Differences,
    Mirror,
    PaintedSheen,
    Sheen,
    highlights_of,
    without_sheen,
)
from stages.photometry.sky import Sphere, even_directions, offsets_in
from stages.photometry.sky_decomposition import decompose_by_sky
from stages.photometry.sky_light import SkyScene
from stages.photometry.sky_photos import Looks
from stages.scene.view_files import ways_to_cameras
from tests.sphere_scene import PAINTS, SphereScene, sphere_scene
from tests.test_sky_light import DIRECTIONS, HOW, error, in_shadow_of, looks, normals_of, open_scene

STRENGTH, ROUGHNESS = np.array([0.12, 0.1, 0.08]), 0.2


@pytest.fixture(scope="module")
def glossy():
    """Views of a painted sphere, matt and with sheen, under a lamp and an even light; the mirror is known."""
    scene = sphere_scene(view_count=3)
    sky, mirror, shading = _lit_by_a_lamp(scene)
    matt = np.stack(scene.true_channels(), axis=1) * shading
    sheen = STRENGTH * mirror.image(ROUGHNESS, np.arange(len(matt)))
    return scene.stacked(), sky, mirror, shading, *_scaled(matt, sheen)


def _lit_by_a_lamp(scene: SphereScene) -> tuple[SkyScene, Mirror, np.ndarray]:
    sky = open_scene(normals_of(scene))
    radiance = 0.3 + 12 * np.maximum(even_directions(DIRECTIONS) @ [0.7, 0.3, 0.65], 0) ** 30
    radiance = np.tile(radiance[:, None], 3)
    mirror = Mirror(sky.pixels, radiance, ways_to_cameras(scene.cameras, scene.masks))
    return sky, mirror, sky.pixels.shading(radiance)


def _scaled(matt: np.ndarray, sheen: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    scale = np.percentile(matt + sheen, 99)
    return (matt / scale).astype(np.float32), (sheen / scale).astype(np.float32)


def sheen_of_all(*given) -> Sheen:
    return Differences.of(*given).sheen


def everything(image: np.ndarray) -> np.ndarray:
    return np.ones(len(image), bool)


def test_a_mirror_under_even_light_shows_that_light_but_for_what_is_hidden(glossy):
    mirror = glossy[2]
    even = replace(mirror, radiance=np.full((DIRECTIONS, 3), 0.7))
    some = np.arange(0, len(mirror.towards), 7)
    assert np.allclose(even.image(ROUGHNESS, some), 0.7, rtol=1e-4)
    hidden = int(np.argmax(mirror.radiance[:, 0]))
    only = replace(even, radiance=even.radiance * (np.arange(DIRECTIONS) == hidden)[:, None])
    behind = in_shadow_of(hidden, np.ones(len(mirror.towards), bool), mirror.pixels.normals)
    dimmed = replace(even, pixels=behind.pixels).image(ROUGHNESS, some)
    assert np.allclose(dimmed, 0.7 - only.image(ROUGHNESS, some), atol=1e-5)
    assert dimmed.min() < 0.6


@pytest.mark.parametrize("sphere", [None, Sphere((0.3, 0.1, -0.2), 3.0)])
def test_the_lobe_is_that_of_facets_and_smiths_shadowing(glossy, sphere):
    """Against GGX as Walter et al. 2007 write it: D(h) G1(l) G1(v) / (4 n·v), Eq. 20, 33, 34.

    Near sources face the sphere's centre, and their light falls with the square of the way.
    """
    mirror = glossy[2]
    some = np.arange(3, len(mirror.towards), 101)
    offsets = offsets_in(sphere, mirror.pixels.normals)
    mirror = replace(mirror, pixels=replace(mirror.pixels, offsets=offsets))
    n, v = (values[some].astype(float) for values in (mirror.pixels.normals, mirror.towards))
    sources = mirror.pixels.directions.astype(float)
    ways = sources[None] - offsets[some][:, None]
    distance = np.linalg.norm(ways, axis=2)
    l = ways / distance[..., None]  # noqa: E741 — the usual letter
    half = l + v[:, None]
    cos_h = np.einsum("pdk,pk->pd", half / np.linalg.norm(half, axis=2, keepdims=True), n)
    cos_l, cos_v = np.einsum("pdk,pk->pd", l, n), np.einsum("pk,pk->p", n, v)[:, None]
    arriving = np.einsum("pdk,dk->pd", l, sources) / distance**2

    def g1(cosine):
        tan2 = 1 / cosine**2 - 1
        return 2 / (1 + np.sqrt(1 + ROUGHNESS**2 * tan2))

    tan4 = (1 / cos_h**2 - 1 + ROUGHNESS**2) ** 2
    lobe = (
        ROUGHNESS**2
        / (np.pi * cos_h**4 * tan4)
        * g1(cos_l)
        * g1(cos_v)
        / (4 * cos_v)
        * (cos_l > 0)
        * arriving
    )
    facing = cos_v[:, 0] > 0.05
    expected = (lobe / lobe.sum(axis=1, keepdims=True)) @ mirror.radiance
    assert np.allclose(mirror.image(ROUGHNESS, some)[facing], expected[facing], rtol=2e-3)


def test_strength_and_roughness_are_found_by_how_views_differ(glossy):
    views, _, mirror, shading, matt, sheen = glossy
    found = sheen_of_all(views, matt + sheen, shading, everything(matt), mirror)
    scale = np.median(sheen / mirror.image(ROUGHNESS, np.arange(len(matt))), axis=0) / STRENGTH
    assert found.believed is True  # a plain one: it goes into the record
    assert found.roughness == ROUGHNESS
    assert np.allclose(found.strength, STRENGTH * scale, rtol=0.05)
    added = PaintedSheen.of_all(found, len(matt)).image(mirror)
    seen, share = without_sheen(matt + sheen, added)
    assert error(seen, matt) < 0.2 * error(matt + sheen, matt)
    below = np.where(np.arange(len(matt))[:, None] % 5, matt + sheen, -0.01).astype(np.float32)
    assert np.all(without_sheen(below, added)[0] <= below)
    assert np.corrcoef(share, (sheen / (matt + sheen)).mean(axis=1))[0, 1] > 0.95


def test_matt_surface_has_none_nor_has_what_no_other_view_sees(glossy):
    views, _, mirror, shading, matt, sheen = glossy
    assert not sheen_of_all(views, matt, shading, everything(matt), mirror).believed
    alone = replace(views, links={})
    assert sheen_of_all(alone, matt + sheen, shading, everything(matt), mirror) is NO_SHEEN
    nobody = np.zeros(len(matt), bool)
    assert sheen_of_all(views, matt + sheen, shading, nobody, mirror) is NO_SHEEN
    lamp = np.zeros_like(shading)
    lamp[0] = 1  # all else is dark beside it
    assert sheen_of_all(views, matt + sheen, lamp, everything(matt), mirror) is NO_SHEEN


@pytest.fixture(scope="module")
def glossy_in_part():
    """As before, larger, and only the second of the three paints has sheen; also which pixels those are."""
    scene = sphere_scene(view_count=3, width=240, height=200)
    sky, mirror, shading = _lit_by_a_lamp(scene)
    albedo = np.stack(scene.true_channels(), axis=1)
    part = np.all(albedo == PAINTS[1], axis=1)
    sheen = part[:, None] * STRENGTH * mirror.image(ROUGHNESS, np.arange(len(albedo)))
    return scene.stacked(), mirror, shading, *_scaled(albedo * shading, sheen), part


def test_a_paint_is_what_has_one_albedo_whatever_light_and_sheen_make_of_it(glossy_in_part):
    views, _, shading, matt, sheen, _ = glossy_in_part
    paint = paints_of(views, matt + sheen, shading, everything(matt))
    assert 3 <= len(np.unique(paint)) <= PALETTE
    true = np.unique(np.round(matt / shading, 3), axis=0, return_inverse=True)[1].ravel()
    mixed = sum(len(of) - np.bincount(of).max() for of in (true[paint == k] for k in np.unique(paint)))
    assert mixed < 0.02 * len(paint)
    few = np.arange(len(paint)) % (len(paint) // 3) == 0
    assert len(np.unique(paints_of(views, matt + sheen, shading, few))) <= few.sum()
    nothing = np.zeros_like(matt)
    assert len(np.unique(paints_of(views, nothing, nothing, everything(matt)))) == 1


def test_what_is_matt_hides_no_sheen_of_other_paint(glossy_in_part):
    views, mirror, shading, matt, sheen, part = glossy_in_part
    seen, trusted = matt + sheen, everything(matt)
    differences = Differences.of(views, seen, shading, trusted, mirror)
    found = differences.sheen_of(paints_of(views, seen, shading, trusted))
    assert found.believed
    added = found.image(mirror)
    assert np.count_nonzero(added[~part].any(axis=1)) < 0.001 * len(part)  # where paints meet
    assert error(added[part], sheen[part]) < 0.05
    assert sum(one["pixels"] for one in found.as_json()) == pytest.approx(part.sum(), rel=0.01)
    two = differences.sheen_of((~part).astype(np.int32))
    assert [one.believed for one in two.of_paint] == [True, False]


def test_a_few_links_or_views_side_by_side_prove_nothing(glossy):
    """Noise is explained by any three numbers if there is little of it, or by an endless strength."""
    views, _, mirror, shading, matt, _ = glossy
    rng = np.random.default_rng(0)
    noisy = (matt * rng.normal(1, 0.2, matt.shape)).astype(np.float32)
    for count in (1, 3, 10, 30):
        some = np.zeros(len(matt), bool)
        one, other = next(iter(views.linked_pixels()))
        some[one[:count]] = some[other[:count]] = True
        assert not sheen_of_all(views, noisy, shading, some, mirror).believed
    assert not Sheen(np.array([0.1, 0.1, 4.8]), ROUGHNESS, 0.5).believed


def test_some_pixels_always_stay_trusted():
    trusted = np.array([True, False, True])
    looks_so_far = Looks(trusted, np.zeros((3, 3), np.float32))
    assert looks_so_far.without(np.array([True, True, False])).trusted.tolist() == [False, False, True]
    assert looks_so_far.without(trusted).trusted.tolist() == trusted.tolist()


def test_where_another_view_has_far_less_it_knows_better(glossy):
    views = glossy[0]
    share = np.full(int(views.starts[-1]), 0.1, np.float32)
    one, other = next(iter(views.linked_pixels()))
    share[one[0]] = 0.5
    for pixels in (everything(share), np.arange(len(share)) != other[0]):
        marked = highlights_of(views, share, pixels)
        others = {int(q) for p, q in _both_ways(views) if p == one[0] and pixels[q]}
        assert marked[one[0]] == bool(others)
        assert marked.sum() == marked[one[0]]
    assert not highlights_of(views, np.full_like(share, 0.9), everything(share)).any()


def _both_ways(views):
    for one, other in views.linked_pixels():
        yield from zip(one, other, strict=True)
        yield from zip(other, one, strict=True)


def test_the_albedo_comes_nearer_the_paint(glossy):
    views, sky, _, shading, matt, sheen = glossy
    images = [np.ascontiguousarray((matt + sheen)[:, c]) for c in range(3)]
    albedo = matt / shading
    with_it, without = (
        decompose_by_sky(
            views, images, [sky], looks(everything(matt)), replace(HOW, sheen=sheen), 1, lambda: None
        )
        for sheen in (True, False)
    )
    assert with_it.sheen.believed
    assert without.sheen is NOT_SOUGHT
    assert error(with_it.albedo, albedo) < 0.8 * error(without.albedo, albedo)
    assert error(with_it.seen, matt) < error(without.seen, matt)
    two_threads = decompose_by_sky(views, images, [sky], looks(everything(matt)), HOW, 2, lambda: None)
    assert np.array_equal(two_threads.albedo, with_it.albedo)
