"""Specular reflection: the light's image in a rough mirror, foretold, measured by views, taken off."""

from __future__ import annotations

from dataclasses import replace
from itertools import combinations

import numpy as np
import pytest
import scipy.sparse as sp

from stages.formats.artefacts.view_files import ways_to_cameras
from stages.photometry.light_search.light_estimate import LightEstimate
from stages.photometry.light_search.light_from_pairs import PairObjective
from stages.photometry.light_search.light_from_specular import light_in_gloss
from stages.photometry.lighting.observations import Observations
from stages.photometry.lighting.settings import LightingSettings
from stages.photometry.lighting.trusted_pixels import Viewing
from stages.photometry.specular.chromaticity_clusters import ChromaticityClusters
from stages.photometry.specular.ggx_lobes import lobes
from stages.photometry.specular.highlights import LinkedPatches
from stages.photometry.specular.specular_reflection import (
    Mirror,
    SpecularReflection,
    highlights_of,
    without_specular,
)
from stages.photometry.specular.view_differences import Differences, sampled_correspondences
from stages.photometry.stack import stack_views
from stages.photometry.transport.directional_transport import Sphere, even_directions, offsets_in
from stages.photometry.transport.lit_scenes import LitScene
from tests.by_sky import decompose_by_sky
from tests.sphere_scene import PAINTS, SphereScene, sphere_scene
from tests.test_sky_light import DIRECTIONS, FEW, HOW, error, in_shadow_of, normals_of, open_scene, viewing

DEFAULTS = LightingSettings()
SPECULAR = DEFAULTS.specular
STRENGTH, ROUGHNESS = np.array([0.12, 0.1, 0.08]), 0.2


@pytest.fixture(scope="module")
def glossy():
    """Views of a painted sphere, matt and specular, under a lamp and an even light; the mirror is known."""
    scene = sphere_scene(view_count=3)
    sky, mirror, shading = _lit_by_a_lamp(scene)
    diffuse = np.stack(scene.true_channels(), axis=1) * shading
    specular = STRENGTH * mirror.image(ROUGHNESS, np.arange(len(diffuse)))
    return scene.stacked(), sky, mirror, shading, *_scaled(diffuse, specular)


def _lit_by_a_lamp(scene: SphereScene) -> tuple[LitScene, Mirror, np.ndarray]:
    sky = open_scene(normals_of(scene))
    radiance = 0.3 + 12 * np.maximum(even_directions(DIRECTIONS) @ [0.7, 0.3, 0.65], 0) ** 30
    radiance = np.tile(radiance[:, None], 3)
    mirror = Mirror(sky.pixels, radiance, ways_to_cameras(scene.cameras, scene.masks))
    return sky, mirror, sky.pixels.shading(radiance)


def _scaled(diffuse: np.ndarray, specular: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    scale = np.percentile(diffuse + specular, 99)
    return (diffuse / scale).astype(np.float32), (specular / scale).astype(np.float32)


def differences_of(views, seen, shading, trusted, mirror) -> Differences:
    return Differences.of(
        views,
        seen,
        trusted,
        mirror.towards,
        mirror.pixels,
        lambda some: shading[some],
        SPECULAR.differences,
    )


def photos_of(views, seen, mirror) -> Observations:
    looked = Viewing(everything(seen), mirror.towards, ~everything(seen))
    linked = LinkedPatches.of(views, looked.trusted, DEFAULTS.highlights)
    how = FEW.model_copy(update={"lights": "shared"})
    return Observations.of(linked, looked, seen, 0.0, how).in_one_light(linked)


def light_of(mirror: Mirror) -> LightEstimate:
    return LightEstimate(mirror.radiance[None], np.zeros((1, 1, 3), np.float32))


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


def test_lobes_are_what_the_mirrored_image_is_made_of(glossy):
    mirror = glossy[2]
    some = np.arange(0, len(mirror.towards), 31)
    of_directions = lobes(mirror.pixels, mirror.towards, ROUGHNESS, some)
    assert np.allclose(of_directions @ mirror.radiance, mirror.image(ROUGHNESS, some), rtol=1e-4)


def test_how_views_differ_tells_the_mirror_and_what_is_seen_in_it(glossy):
    """Without any light to begin with; what all views have in common of it is not told."""
    views, _, mirror, shading, diffuse, specular = glossy
    differences = differences_of(views, diffuse + specular, shading, everything(diffuse), mirror)
    found = differences.mirrored
    assert found.roughness == ROUGHNESS
    assert found.left < 0.2
    assert np.argmax(found.radiance.sum(axis=1)) == np.argmax(mirror.radiance.sum(axis=1))
    assert found.radiance.min() >= 0


def test_the_slope_of_what_a_light_leaves_is_that_of_its_value(glossy):
    views, _, mirror, shading, diffuse, specular = glossy
    differences = differences_of(views, diffuse + specular, shading, everything(diffuse), mirror)
    rng = np.random.default_rng(0)
    light, way = 0.1 * rng.random((2, DIRECTIONS, 3))
    rough = differences.in_mirror(ROUGHNESS)
    _, slope = rough.left(light)
    ahead, behind = (rough.left(light + side * 1e-2 * way)[0] for side in (1, -1))
    assert (ahead - behind) / 2e-2 == pytest.approx((slope * way).sum(), rel=1e-2)
    assert rough.left(0 * light)[0] == pytest.approx(1)


def test_light_and_specular_reflection_are_found_together(glossy):
    """From a light that is wrong by half: wherever it should be dim it is three times as bright."""
    views, sky, mirror, shading, diffuse, specular = glossy
    photos, wrong = photos_of(views, diffuse + specular, mirror), light_of(mirror)
    wrong = replace(wrong, radiance=np.maximum(wrong.radiance, 1.0))
    differences = photos.differences(sky, wrong)
    found, light = photos.specular(sky, wrong, differences, lambda: None)
    assert found.glossy.all()
    assert found.roughness == ROUGHNESS
    foretold, before = (
        replace(mirror, radiance=one.radiance[0]).image(ROUGHNESS, np.arange(len(diffuse)))
        for one in (light, wrong)
    )
    assert error(foretold, specular) < 0.1
    assert error(before, specular) > 3 * error(foretold, specular)


def test_no_surface_reflects_more_than_it_shows(glossy):
    """Of dark paint, all of whose radiance is reflected but a tenth; of bright paint the strength stays."""
    mirror, everywhere = glossy[2], everything(glossy[4])
    reflected = STRENGTH * mirror.image(ROUGHNESS, np.arange(len(everywhere)))
    true = SpecularReflection(STRENGTH, ROUGHNESS, 0.5, everywhere)
    threefold = replace(true, strength=3 * STRENGTH)
    dark, bright = 1.1 * reflected, 4 * reflected
    assert true.bounded(dark, everywhere, mirror, SPECULAR) is true
    assert threefold.bounded(bright, everywhere, mirror, SPECULAR) is threefold
    assert np.allclose(threefold.bounded(dark, everywhere, mirror, SPECULAR).strength, 1.1 * STRENGTH)


def test_some_pixels_may_show_less_than_a_reflection(glossy):
    """As many as the settings allow, where the mesh lacks what hides the light; distrusted ones as well."""
    mirror, everywhere = glossy[2], everything(glossy[4])
    reflected = STRENGTH * mirror.image(ROUGHNESS, np.arange(len(everywhere)))
    rng = np.random.default_rng(0)
    few, many = (rng.random(len(everywhere)) < share for share in (0.005, 0.2))
    true = SpecularReflection(STRENGTH, ROUGHNESS, 0.5, everywhere)
    for hidden in (few, many):
        reflected_or_hidden = np.where(hidden[:, None], 0.5, 1.5) * reflected
        assert true.bounded(reflected_or_hidden, ~hidden, mirror, SPECULAR) is true
        expected = 1.0 if hidden is few else 0.5
        found = true.bounded(reflected_or_hidden, everywhere, mirror, SPECULAR)
        assert np.allclose(found.strength, expected * STRENGTH)


def test_both_witnesses_are_heard(glossy):
    """What pairs and differences are left with together falls, and neither is left as it was."""
    views, sky, mirror, shading, diffuse, specular = glossy
    photos, start = photos_of(views, diffuse + specular, mirror), np.ones((1, DIRECTIONS, 3))
    even = LightEstimate(start, np.zeros((1, 1, 3), np.float32))
    objective = photos.search(sky).objective(even)
    assert isinstance(objective, PairObjective)
    rough, strength = photos.differences(sky, light_of(mirror)).in_mirror(ROUGHNESS), 0.1 * np.ones(3)
    light = light_in_gloss(objective, rough, strength, start, FEW)
    assert light.min() >= 0
    for loss in (lambda e: objective(e)[0], lambda e: rough.left(strength * e[0])[0]):
        assert loss(light) < loss(start)


def test_what_is_taken_off_is_the_reflection_and_never_adds(glossy):
    _, _, mirror, _, diffuse, specular = glossy
    scale = np.median(specular / mirror.image(ROUGHNESS, np.arange(len(diffuse))), axis=0)
    known = SpecularReflection(scale, ROUGHNESS, 0.1, everything(diffuse))
    added = known.image(mirror)
    assert error(added, specular) < 1e-3
    seen, share = without_specular(diffuse + specular, added, SPECULAR)
    assert error(seen, diffuse) < 0.2 * error(diffuse + specular, diffuse)
    below = np.where(np.arange(len(diffuse))[:, None] % 5, diffuse + specular, -0.01).astype(np.float32)
    assert np.all(without_specular(below, added, SPECULAR)[0] <= below)
    assert np.corrcoef(share, (specular / (diffuse + specular)).mean(axis=1))[0, 1] > 0.95
    half = replace(known, glossy=np.arange(len(diffuse)) % 2 == 0)
    assert not half.image(mirror)[1::2].any()
    assert half.as_json()["pixels"] == half.glossy.sum()


def test_matt_surface_has_none(glossy):
    views, sky, mirror, shading, diffuse, _ = glossy
    differences = differences_of(views, diffuse, shading, everything(diffuse), mirror)
    assert differences.mirrored.left > 0.95
    photos = photos_of(views, diffuse, mirror)
    assert photos.specular(sky, light_of(mirror), differences, lambda: None) is None


def test_what_no_other_view_sees_tells_nothing(glossy):
    views, sky, mirror, shading, diffuse, specular = glossy
    seen, trusted = diffuse + specular, everything(diffuse)
    lamp = np.full_like(shading, 1e-6)
    lamp[0] = 1  # all else is dark beside it
    for untold in (
        differences_of(replace(views, correspondences={}), seen, shading, trusted, mirror),
        differences_of(views, seen, shading, ~trusted, mirror),
        differences_of(views, seen, lamp, trusted, mirror),
    ):
        assert untold.p.size == 0
        assert untold.mirrored is None
        assert untold.strength(mirror.radiance) is None
        photos = photos_of(views, seen, mirror)
        assert photos.specular(sky, light_of(mirror), untold, lambda: None) is None


def test_as_many_links_are_looked_at_however_many_views_share_them():
    masks = [np.ones((1, 6), bool)] * 20
    normals = [np.broadcast_to([0.0, 0.0, 1.0], (1, 6, 3)).astype(np.float32)] * 20
    every = {pair: sp.eye_array(6, format="csr") for pair in combinations(range(20), 2)}
    views, trusted = stack_views(masks, normals, every), np.ones(120, bool)
    one, other = sampled_correspondences(views, trusted, 60)
    assert 60 <= one.size < 120
    assert np.all(one % 6 == other % 6)
    assert len({*(one // 6), *(other // 6)}) == 20
    trusted[0] = False
    assert not np.any(sampled_correspondences(views, trusted, 60)[0] == 0)
    assert sampled_correspondences(replace(views, correspondences={}), trusted, 60)[0].size == 0


def test_views_that_do_not_differ_show_no_mirror(glossy):
    views, _, mirror, shading, _, _ = glossy
    for noise in (0, 1e-7, 1e-6):
        flat = 0.5 + noise * np.random.default_rng(0).normal(size=shading.shape)
        same = differences_of(views, flat.astype(np.float32), np.ones_like(shading), everything(flat), mirror)
        assert same.p.size > 1000
        assert same.mirrored is None


@pytest.fixture(scope="module")
def glossy_in_part():
    """As before, larger, and only the second of the three paints is specular; also which pixels those are."""
    scene = sphere_scene(view_count=3, width=240, height=200)
    sky, mirror, shading = _lit_by_a_lamp(scene)
    albedo = np.stack(scene.true_channels(), axis=1)
    part = np.all(albedo == PAINTS[1], axis=1)
    specular = part[:, None] * STRENGTH * mirror.image(ROUGHNESS, np.arange(len(albedo)))
    return scene.stacked(), sky, mirror, shading, *_scaled(albedo * shading, specular), part


def clustered(views, image, shading, trusted):
    """The cluster of every pixel."""
    return ChromaticityClusters.of(views, image, shading, trusted, SPECULAR.clusters)[1]


def test_a_paint_is_what_has_one_albedo_whatever_light_and_gloss_make_of_it(glossy_in_part):
    views, _, _, shading, diffuse, specular, _ = glossy_in_part
    paint = clustered(views, diffuse + specular, shading, everything(diffuse))
    assert 3 <= len(np.unique(paint)) <= SPECULAR.clusters.count
    true = np.unique(np.round(diffuse / shading, 3), axis=0, return_inverse=True)[1].ravel()
    mixed = sum(len(of) - np.bincount(of).max() for of in (true[paint == k] for k in np.unique(paint)))
    assert mixed < 0.02 * len(paint)
    few = np.arange(len(paint)) % (len(paint) // 3) == 0
    assert len(np.unique(clustered(views, diffuse + specular, shading, few))) <= few.sum()
    nothing = np.zeros_like(diffuse)
    assert len(np.unique(clustered(views, nothing, nothing, everything(diffuse)))) == 1


def test_paints_are_found_again_in_other_pixels(glossy_in_part):
    """Clusters of all views, assigned to them again, and in half the light."""
    views, _, _, shading, diffuse, specular, _ = glossy_in_part
    image, trusted = diffuse + specular, everything(diffuse)
    clusters, paint = ChromaticityClusters.of(views, image, shading, trusted, SPECULAR.clusters)
    np.testing.assert_array_equal(clusters.assigned(views, image, shading, trusted), paint)
    dimmed = clusters.assigned(views, 0.5 * image, 0.5 * shading, trusted)
    assert np.mean(dimmed != paint) < 0.01


def test_what_is_matt_hides_no_gloss_of_other_paint(glossy_in_part):
    views, sky, mirror, shading, diffuse, specular, part = glossy_in_part
    seen = diffuse + specular
    photos, light = photos_of(views, seen, mirror), light_of(mirror)
    differences = differences_of(views, seen, shading, everything(diffuse), mirror)
    assert differences.mirrored.left > SPECULAR.differences.explained_residual
    found, again = photos.specular(sky, light, differences, lambda: None)
    assert np.mean(found.glossy == part) > 0.99
    assert found.roughness == ROUGHNESS
    added = found.image(replace(mirror, radiance=again.radiance[0]))
    assert error(added[part], specular[part]) < 0.1
    assert differences.within(~part).strength(mirror.radiance).left > 0.99


def test_noise_is_no_mirror_however_few_links_there_are(glossy):
    views, sky, mirror, shading, diffuse, _ = glossy
    rng = np.random.default_rng(0)
    noisy = (diffuse * rng.normal(1, 0.1, diffuse.shape)).astype(np.float32)
    differences = differences_of(views, noisy, shading, everything(diffuse), mirror)
    assert differences.p.size > 2000
    photos = photos_of(views, noisy, mirror)
    for count in (30, 200, 300, 500, 1000, 2000, differences.p.size):
        ends = np.zeros(len(diffuse), bool)
        ends[differences.p[:count]] = ends[differences.q[:count]] = True
        few = differences.within(ends)
        assert photos.specular(sky, light_of(mirror), few, lambda: None) is None


def test_some_pixels_always_stay_trusted():
    trusted = np.array([True, False, True])
    looks_so_far = Viewing(trusted, np.zeros((3, 3), np.float32), ~trusted)
    assert looks_so_far.without(np.array([True, True, False])).trusted.tolist() == [False, False, True]
    assert looks_so_far.without(trusted).trusted.tolist() == trusted.tolist()


def test_where_another_view_has_far_less_it_knows_better(glossy):
    views = glossy[0]
    share = np.full(int(views.starts[-1]), 0.1, np.float32)
    one, other = next(iter(views.linked_pixels()))
    share[one[0]] = 0.5
    for pixels in (everything(share), np.arange(len(share)) != other[0]):
        marked = highlights_of(views, share, pixels, SPECULAR)
        others = {int(q) for p, q in _both_ways(views) if p == one[0] and pixels[q]}
        assert marked[one[0]] == bool(others)
        assert marked.sum() == marked[one[0]]
    assert not highlights_of(views, np.full_like(share, 0.9), everything(share), SPECULAR).any()


def _both_ways(views):
    for one, other in views.linked_pixels():
        yield from zip(one, other, strict=True)
        yield from zip(other, one, strict=True)


def test_the_albedo_comes_nearer_the_paint(glossy):
    views, sky, _, shading, diffuse, specular = glossy
    images = [np.ascontiguousarray((diffuse + specular)[:, c]) for c in range(3)]
    albedo = diffuse / shading
    with_it, without = (
        decompose_by_sky(views, images, [sky], viewing(everything(diffuse)), HOW.with_specular(remove))
        for remove in (True, False)
    )
    assert with_it.light.specular is not None
    assert without.light.specular is None
    assert error(with_it.albedo, albedo) < 0.8 * error(without.albedo, albedo)
    assert error(with_it.light.observations.observed, diffuse) < error(
        without.light.observations.observed, diffuse
    )
    two_threads = decompose_by_sky(views, images, [sky], viewing(everything(diffuse)), HOW, threads=2)
    assert np.array_equal(two_threads.albedo, with_it.albedo)
