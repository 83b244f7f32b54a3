"""The light found by pairs of like paint, and the albedo under it, on spheres whose truth is known."""

from __future__ import annotations

import itertools
from dataclasses import replace

import numpy as np
import pytest
import scipy.sparse as sp

from stages.formats.artefacts.view_files import ways_to_cameras
from stages.photometry.albedo import albedo_given_light as sky_decomposition
from stages.photometry.albedo.albedo_edges import agreement_of_correspondences, smoothness_of_edges
from stages.photometry.albedo.appearance import appearance_of
from stages.photometry.albedo.settings import REFERENCE_SIDE_PX, EdgeSettings
from stages.photometry.albedo.smooth_albedo import albedo_under_light
from stages.photometry.albedo.soft_texture import soft_texture
from stages.photometry.chromaticity import DARK, colour_change, in_white_light
from stages.photometry.joint.fast_alternation import FastSolver
from stages.photometry.joint.problem_assembly import ALIKE, EdgeWeights, graph_of
from stages.photometry.joint.settings import USUAL, FastSettings, Stopping
from stages.photometry.light_search.light_estimate import LightEstimate
from stages.photometry.light_search.light_from_pairs import (
    PairLoss,
    PairObjective,
    Sample,
    weighted_by_reliability,
)
from stages.photometry.light_search.pair_sampling import COLOUR, Pairs, alike_pairs, sample_of
from stages.photometry.light_search.sampled_shading import SampledShading
from stages.photometry.light_search.search import Search, disagreements, estimate_light
from stages.photometry.lighting.estimate_illumination import explained_best, find_illumination
from stages.photometry.lighting.observations import Observations
from stages.photometry.lighting.settings import LightingSettings
from stages.photometry.lighting.trusted_pixels import Viewing
from stages.photometry.lighting.view_gains import view_gains
from stages.photometry.paper.energy import EnergyWeights
from stages.photometry.specular import highlights
from stages.photometry.specular.highlights import (
    LinkedPatches,
    brightening,
    darker_outliers,
    without_highlights,
)
from stages.photometry.specular.settings import DarkOutlierSettings, HighlightSettings
from stages.photometry.stack import StackedViews, stack_views
from stages.photometry.transport.directional_transport import even_directions
from stages.photometry.transport.lit_scenes import LitScene
from stages.photometry.transport.transfer_vectors import Occlusion, Proxy
from stages.solvers.kernels.threading_layer import use_threads
from tests.by_sky import BySky, decompose_by_sky
from tests.sphere_scene import SphereScene, sphere_scene

DIRECTIONS = 128
MOVING = 0.1, 0.2
FEW = LightingSettings(samples=3000, bounces=0, still_light=MOVING[0], moving_light=MOVING[1])


def edges_at(views: StackedViews, coarse: float, **others: float) -> EdgeSettings:
    """Settings by which the coarse λ is this at the size of the views."""
    return EdgeSettings(coarse_lambda=coarse * REFERENCE_SIDE_PX / views.side, **others)


HOW = BySky(
    light=FEW,
    edges=edges_at(sphere_scene(view_count=3).stacked(), coarse=2.0),
    descent=FastSolver(EnergyWeights(0.7, 0.3), replace(USUAL["paper"], max_rounds=20)),
)


def viewing(trusted: np.ndarray) -> Viewing:
    """At three views of the sphere."""
    scene = sphere_scene(view_count=3)
    return Viewing(trusted, ways_to_cameras(scene.cameras, scene.masks), ~trusted)


def normals_of(scene: SphereScene) -> np.ndarray:
    return np.concatenate([n[m] for n, m in zip(scene.normals, scene.masks, strict=True)])


def open_scene(normals: np.ndarray) -> LitScene:
    """Every pixel a point that sees everything."""
    of_none = sp.csr_array((len(normals), 1), dtype=np.float32)
    return scene_of(normals, of_none, np.zeros((1, DIRECTIONS), bool))


def in_shadow_of(direction: int, shaded: np.ndarray, normals: np.ndarray) -> LitScene:
    """Every pixel a point that sees everything; those that are shaded, (N,), all but one direction."""
    seen = np.ones((2, DIRECTIONS), bool)
    seen[1, direction] = False
    return scene_of(normals, sp.csr_array(np.stack([~shaded, shaded], axis=1).astype(np.float32)), seen)


def scene_of(normals: np.ndarray, blend: sp.csr_array, seen: np.ndarray) -> LitScene:
    """Of vertices (P, DIRECTIONS) that see the sky and nothing else."""
    count = len(seen)
    nothing = sp.csr_array((count, count), dtype=np.float32)
    return LitScene.of(
        normals,
        blend,
        Proxy(
            np.zeros((count, 3)),
            np.tile(np.array([[0.0, 0, 1]], np.float32), (count, 1)),
            Occlusion(np.zeros((count, 9), np.float32), nothing, nothing),
        ),
        np.packbits(seen, axis=1),
        DIRECTIONS,
        None,
    )


def photo_of(albedo: np.ndarray, shading: np.ndarray) -> np.ndarray:
    """Scaled as the stage does it."""
    return (albedo * shading / np.percentile(albedo * shading, 99)).astype(np.float32)


def on_relief(normals: np.ndarray, height: float, frequency: float):
    """A sphere in waves, a broad light from above on it, and a grey paint that changes softly."""
    waves = normals + height * np.sin(frequency * normals[:, [1, 2, 0]] + [0, 1, 2])
    relief = (waves / np.linalg.norm(waves, axis=1, keepdims=True)).astype(np.float32)
    sky = open_scene(relief)
    radiance = 0.3 + 2.5 * np.maximum(even_directions(DIRECTIONS) @ [0.4, 0.5, 0.77], 0) ** 6
    shading = sky.pixels.shading(np.tile(radiance[:, None], 3))
    soft = np.exp(0.5 * np.sin(normals @ [[3.0], [2.0], [0.0]] + 1)) * [0.5, 0.48, 0.45]
    return sky, shading, soft


@pytest.fixture(scope="module")
def lit():
    """Views of a sphere in patches of three colours, lit by a broad light from above over an even one."""
    scene = sphere_scene(view_count=3)
    views, normals = scene.stacked(), normals_of(scene)
    sky = open_scene(normals)
    radiance = 0.3 + 2.5 * np.maximum(even_directions(DIRECTIONS) @ [0.4, 0.5, 0.77], 0) ** 6
    shading = sky.pixels.shading(np.tile(radiance[:, None], 3))
    albedo = np.stack(scene.true_channels(), axis=1)
    return views, sky, albedo, shading, normals


def error(found: np.ndarray, truth: np.ndarray) -> float:
    """Relative, after one scale per channel."""
    scale = (found * truth).sum(axis=0) / (found**2).sum(axis=0)
    return float(np.sqrt(((found * scale - truth) ** 2).sum() / (truth**2).sum()))


def light_and_shading(lit, image: np.ndarray):
    views, sky = lit[:2]
    one_light = np.zeros(views.view_count, int)
    light = estimate_light(sky, views, image, np.ones(len(image), bool), one_light, FEW)
    return light, light.shading(sky, views.starts, one_light)


def test_the_light_of_a_painted_sphere_is_found(lit):
    views, sky, albedo, shading, _ = lit
    image = (albedo * shading).astype(np.float32)
    light, found = light_and_shading(lit, image)
    assert light.radiance.min() >= 0
    assert error(found, shading) < 0.05 < 0.15 < error(np.ones_like(shading), shading)
    assert error(image / found, albedo) < 0.25 * error(image, albedo)


def test_a_suns_shadow_is_told_from_paint_however_dark_it_is():
    """Thirty times darker than the sun's light: what begins with fine scales takes for paint."""
    scene = sphere_scene(view_count=3)
    views, normals = scene.stacked(), normals_of(scene)
    albedo = np.stack(scene.true_channels(), axis=1)
    sun = int(np.argmax(even_directions(DIRECTIONS) @ [0.4, 0.5, 0.77]))
    sky = in_shadow_of(sun, normals @ [0.8, -0.6, 0.0] > 0.2, normals)
    radiance = np.full(DIRECTIONS, 0.03)
    radiance[sun] += DIRECTIONS / 4
    shading = sky.pixels.shading(np.tile(radiance[:, None], 3))
    image = photo_of(albedo, shading)
    found = light_and_shading((views, sky), image)[1]
    assert error(image, albedo) > 0.7
    assert error(image / found, albedo) < 0.03


def test_as_many_lights_as_views_are_found_as_well_as_a_few():
    """A lamp that moves from view to view: each of many lights has little to say in the whole."""
    scene, seen = sphere_scene(view_count=24), {}
    albedo = np.stack(scene.true_channels(), axis=1)
    normals, starts = normals_of(scene), scene.stacked().starts
    for count in (3, 24):
        own = slice(0, int(starts[count]))
        masks, maps = scene.masks[:count], scene.normals[:count]
        views, sky = stack_views(masks, maps, {}), open_scene(normals[own])
        towards = np.random.default_rng(0).normal(size=(count, 3)) + [0, 0, 2]
        lamps = np.maximum(even_directions(DIRECTIONS) @ towards.T / np.linalg.norm(towards, axis=1), 0) ** 6
        radiance = np.repeat((0.3 + 2.5 * lamps).T[:, :, None], 3, axis=2)
        rows = [slice(int(a), int(b)) for a, b in zip(views.starts, views.starts[1:], strict=False)]
        shading = np.concatenate([sky.pixels.shading(e, r) for e, r in zip(radiance, rows, strict=True)])
        image, everything = photo_of(albedo[own], shading), np.ones(len(shading), bool)
        light = estimate_light(sky, views, image, everything, np.arange(count), FEW)
        seen[count] = error(light.shading(sky, views.starts, np.arange(count)), shading)
    assert seen[24] < 0.02 and seen[24] < 1.5 * seen[3], seen


def test_coloured_lamps_are_not_taken_for_paint(lit):
    """A red one from the left, a blue one from the right: whoever holds light to be neutral, blames paint."""
    views, sky, albedo, _, _ = lit
    towards = even_directions(DIRECTIONS) @ np.array([[0.8, 0.5, 0.3], [-0.8, 0.4, 0.4]]).T
    lamps = np.maximum(towards / np.array([0.99, 0.98]), 0) ** 12
    shading = sky.pixels.shading(0.1 + 6 * lamps @ np.array([[1.0, 0.3, 0.1], [0.1, 0.3, 1.0]]))
    image, everything = photo_of(albedo, shading), np.ones(len(albedo), bool)
    one_light, found = np.zeros(views.view_count, int), {}
    for price in (FEW.neutrality, 3.0):
        draws = [FEW.search.model_copy(update={"seed": k}) for k in range(3)]
        hows = [FEW.model_copy(update={"neutrality": price, "search": draw}) for draw in draws]
        lights = [estimate_light(sky, views, image, everything, one_light, how) for how in hows]
        shadings = [light.shading(sky, views.starts, one_light) for light in lights]
        found[price] = np.mean([error(image / shading, albedo) for shading in shadings])
    free, held = found.values()
    assert free < 0.05 < 0.2 < held, found


def test_ground_of_another_colour_is_not_lit_by_a_sky_of_that_colour():
    """Red wall above grey ground, both nearly flat: hardly any surface lies between, and tells."""
    rng = np.random.default_rng(2)
    side, seen = 60, 3
    row = np.arange(side)[:, None] + np.zeros(side)
    ground = row >= side // 2
    facing = np.where(ground[..., None], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0])
    rough = facing + 0.3 * rng.normal(size=(side, side, 3))
    normals = (rough / np.linalg.norm(rough, axis=2, keepdims=True)).astype(np.float32)
    mask = np.ones((side, side), bool)
    views = stack_views([mask] * seen, [normals] * seen, {})
    sky = open_scene(np.tile(normals.reshape(-1, 3), (seen, 1)))
    radiance = 0.5 + np.maximum(even_directions(DIRECTIONS) @ [0.0, 1.0, 0.2], 0)
    shading = sky.pixels.shading(np.tile(radiance[:, None], 3))
    albedo = np.tile(np.where(ground[..., None], 0.3, [0.45, 0.25, 0.2]).reshape(-1, 3), (seen, 1))
    found = light_and_shading((views, sky), photo_of(albedo, shading))[1]
    tinge = np.log(found[:, 0] / found[:, 2])
    apart = np.median(tinge[: side**2][ground.ravel()]) - np.median(tinge[: side**2][~ground.ravel()])
    assert abs(apart) < 0.1


def test_grey_paint_that_changes_softly_is_told_from_light_where_there_is_relief(lit):
    """All of it is of one colour: whoever takes that for one paint, makes the light explain it."""
    sky, shading, soft = on_relief(lit[4], 0.5, 25)
    found = light_and_shading((lit[0], sky), photo_of(soft, shading))[1]
    assert error(found, shading) < 0.06 < 0.2 < error(np.ones_like(shading), shading)


def test_paint_that_changes_softly_is_told_from_one_paint_and_from_patches(lit):
    """Told by I/S under a light that is a little wrong, on relief that leaves some surface evenly lit."""
    views, _, patches, _, normals = lit
    _, shading, soft = on_relief(normals, 0.3, 8)
    rng, edges, trusted = np.random.default_rng(1), HOW.edges, np.ones(len(soft), bool)
    grain = np.exp(rng.normal(0, 0.02, (len(soft), 1)))
    wrong = shading**1.1
    how_soft = {
        name: soft_texture(views, (grain * paint * shading).astype(np.float32), wrong, trusted, edges).mean()
        for name, paint in (("soft", soft), ("one", 0 * soft + 0.4), ("patches", patches))
    }
    assert how_soft["soft"] > 0.4
    assert how_soft["one"] < 0.05 and how_soft["patches"] < 0.05


def test_pairs_count_less_where_they_disagree_more_than_who_is_nearest():
    """As many nearest pairs, alike, as of another kind, at twice the depth; then the other way round."""
    image, times = np.repeat([[0.4], [0.4], [0.8], [0.8]], 3, axis=1), FEW.pairs.fewest
    first, second = (np.tile(np.array(side, np.int32), times) for side in ([0, 2, 0, 1], [1, 3, 2, 3]))

    def weights(*kinds: int) -> np.ndarray:
        """Of each of the four, all its copies together."""
        kind = np.tile(np.array(kinds, np.int32), times)
        pairs = Pairs(first, second, np.full(kind.size, 1 / kind.size), kind)
        return (
            weighted_by_reliability(image, np.ones((4, 3)), pairs, 0.4, FEW.pairs)
            .weight.reshape(-1, 4)
            .sum(axis=0)
        )

    assert weights(1, 1, 0, 0) == pytest.approx([0.5, 0.5, 0, 0])
    assert weights(0, 0, 1, 1) == pytest.approx([0.1, 0.1, 0.4, 0.4])
    assert weights(1, 1, 2, 2) == pytest.approx([0.5, 0.5, 0, 0])
    assert weights(2, 2, 1, 1) == pytest.approx([0.25, 0.25, 0.25, 0.25])
    for kind in (0, 2):
        assert weights(kind, kind, kind, kind) == pytest.approx([0.25, 0.25, 0.25, 0.25])


def test_few_pairs_are_no_measure_of_the_others():
    """One nearest pair that is alike, and many in larger squares that are not, nor can be."""
    image = np.repeat([[0.4], [0.4], [0.5], [0.5]], 3, axis=1)
    first = np.array([0] + [0, 2] * FEW.pairs.fewest, np.int32)
    second, kind = (
        np.array([1] + [2, 0] * FEW.pairs.fewest, np.int32),
        np.array([1] + [2] * 2 * FEW.pairs.fewest, np.int32),
    )
    pairs = Pairs(first, second, np.full(first.size, 1 / first.size), kind)
    alone = weighted_by_reliability(image, np.ones((4, 3)), pairs, 0.4, FEW.pairs).weight[0]
    assert alone == pytest.approx(1 / first.size)


def test_a_kind_of_few_pairs_has_no_more_than_their_share():
    image = np.repeat([[0.4], [0.4], [0.5], [0.5]], 3, axis=1)
    places = np.array([0, 2] * 50, np.int32)
    pairs = Pairs(places, places + 1, np.full(100, 0.01), np.array([1] + [2] * 99, np.int32))
    assert weighted_by_reliability(image, np.ones((4, 3)), pairs, 0.4, FEW.pairs).weight == pytest.approx(
        np.full(100, 0.01)
    )


def test_light_bounces_from_surface_that_no_pixel_shows_with_the_paint_of_its_nearest():
    """Vertex 0 sees half of its sky taken by vertex 3, which lies beside the bright one, 1."""
    scene = sphere_scene(view_count=3)
    views, normals = scene.stacked(), normals_of(scene)
    of_vertex = np.arange(len(normals)) % 3
    blend = sp.csr_array(
        (np.ones(len(normals), np.float32), (np.arange(len(normals)), of_vertex)), shape=(len(normals), 4)
    )
    takes = sp.csr_array(([np.float32(0.5)], ([0], [3])), shape=(4, 4))
    proxy = Proxy(
        np.array([[0.0], [10], [11], [10.2]]) * [1.0, 0, 0],
        np.tile(np.array([[0.0, 0, 1]], np.float32), (4, 1)),
        Occlusion(np.zeros((4, 9), np.float32), takes, 0 * takes),
    )
    open_to_all = np.full((4, DIRECTIONS // 8), 255, np.uint8)
    sky = LitScene.of(normals, blend, proxy, open_to_all, DIRECTIONS, None)
    even = np.ones((1, DIRECTIONS, 3))
    image = np.array([0.2, 0.9, 0.05])[of_vertex, None] * sky.pixels.shading(even[0])
    how, one_light = FEW.model_copy(update={"bounces": 1, "brightest": 0.9}), np.zeros(views.view_count, int)
    search = Search.of(sky, views, image, np.ones(len(image), bool), one_light, how)
    found = search.settled(even, search.even_light())
    assert found.bounced[0, 0] == pytest.approx(
        0.5 * 0.9 * sky.vertices.shading(found.radiance[0])[3], rel=0.05
    )
    assert not found.bounced[0, 1:].any()


def test_lights_are_compared_by_the_same_pairs(lit):
    """In paint of fine grain, which nobody can pair rightly, the true light still leaves a little less."""
    views, sky, albedo, shading, _ = lit
    grain = np.exp(np.random.default_rng(4).normal(0, 0.8, (len(albedo), 1)))
    image, everything = (grain * albedo * shading).astype(np.float32), np.ones(len(albedo), bool)
    towards, nothing = even_directions(DIRECTIONS) @ [0.4, 0.5, 0.77], np.zeros((1, 1, 3), np.float32)
    skies = [0.3 + peak * np.maximum(towards, 0) ** 6 for peak in (2.5, 2.0)]
    lights = [LightEstimate(np.tile(light[:, None], 3)[None], nothing) for light in skies]
    one_light = np.zeros(views.view_count, int)
    scenes, shown = [sky] * 3, [*lights, lights[0]]
    left = disagreements(scenes, shown, views, image, everything, one_light, FEW)
    assert 0 < left[0] == left[2] < left[1] < 1


def test_the_same_light_again(lit):
    views, sky, albedo, shading, _ = lit
    image = (albedo * shading).astype(np.float32)
    one, two = (light_and_shading(lit, image) for _ in range(2))
    assert np.array_equal(one[1], two[1])
    assert np.array_equal(one[0].radiance, two[0].radiance)


def test_a_light_that_is_near_is_gone_on_from(lit):
    views, sky, albedo, shading, _ = lit
    image, everything = (albedo * shading).astype(np.float32), np.ones(len(albedo), bool)
    one_light, steps = np.zeros(views.view_count, int), []
    towards = even_directions(DIRECTIONS) @ [0.4, 0.5, 0.77]
    dimmed = np.tile((0.5 + 1.5 * np.maximum(towards, 0) ** 6)[:, None], 3)
    near = LightEstimate(dimmed[None], np.zeros((1, 1, 3), np.float32))
    again = estimate_light(
        sky, views, image, everything, one_light, FEW, lambda: steps.append(1), near
    ).shading(sky, views.starts, one_light)
    assert len(steps) < len(FEW.search.scales)
    before = near.shading(sky, views.starts, one_light)
    assert error(again, shading) < 0.05 < error(before, shading)


def test_brighter_photos_of_the_same_give_a_brighter_light_and_the_same_pairs(lit):
    views, sky, albedo, shading, _ = lit
    image = (albedo * shading).astype(np.float32)
    one, two = (light_and_shading(lit, factor * image)[1] for factor in (1, 2))
    assert error(one, two) < 0.02


def test_the_slope_of_what_is_minimised_is_right():
    rng = np.random.default_rng(3)
    cells = rng.random(8)
    shares, of_light = rng.random((30, 8)).astype(np.float32), rng.integers(0, 2, 30)
    sample = Sample(0.2 + rng.random((30, 3)), shares, of_light, cells / cells.sum())
    pairs = Pairs(
        rng.integers(0, 30, 60).astype(np.int32),
        rng.integers(0, 30, 60).astype(np.int32),
        np.full(60, 1 / 60),
        np.ones(60, np.int32),
    )
    how = FEW.model_copy(update={"neutrality": 0.3, "evenness": 0.2})
    objective = PairObjective(sample, 0.1 * rng.random((30, 3)), pairs, 0.4, how)
    light = 0.5 + rng.random((2, 8, 3))
    slope = objective(light)[1]
    for direction in rng.normal(size=(5, 2, 8, 3)):
        step = 3e-3 * direction
        change = objective(light + step)[0] - objective(light - step)[0]
        assert change == pytest.approx(2 * (step * slope).sum(), rel=0.02, abs=1e-5)


def test_the_loss_of_pairs_is_that_of_their_mean_difference_and_its_variance():
    rng, how, scale = np.random.default_rng(5), FEW.pairs, 0.4
    image, shading = 0.02 + rng.random((50, 3)), 0.3 + rng.random((50, 3))
    first, second = rng.integers(0, 50, (2, 700)).astype(np.int32)
    pairs = Pairs(first, second, rng.random(700) / 350, np.ones(700, np.int32))
    trust = (image / (image + 2 * how.noise)) ** 2
    share = trust[first] * trust[second]
    share /= share.sum(axis=1, keepdims=True)
    logs = np.log(image) - np.log(shading + how.darkest)
    apart = logs[first] - logs[second]
    mean = (share * apart).sum(axis=1, keepdims=True)
    variance = (share * (apart - mean) ** 2).sum(axis=1)
    u = (mean[:, 0] ** 2 + how.chroma_weight**2 * variance) / scale**2
    loss = PairLoss(image, pairs, scale, how)
    assert loss.mean(shading) == pytest.approx((pairs.weight * u / (1 + u)).sum(), rel=1e-5)
    assert loss.mean_and_slope(shading)[0] == pytest.approx(loss.mean(shading), rel=1e-12)


def test_the_slope_of_the_loss_is_right_where_photos_are_black_and_the_same_on_any_threads():
    rng = np.random.default_rng(6)
    image = np.where(rng.random((50, 1)) < 0.5, FEW.pairs.darkest, 0.3) * (0.5 + rng.random((50, 3)))
    first, second = rng.integers(0, 50, (2, 300)).astype(np.int32)
    pairs = Pairs(first, second, np.full(300, 1 / 300), np.ones(300, np.int32))
    loss, shading = PairLoss(image, pairs, 0.4, FEW.pairs), 0.3 + rng.random((50, 3))
    found = []
    for threads in (1, 2):
        use_threads(threads)
        found.append(loss.mean_and_slope(shading))
    for direction in rng.normal(size=(5, 50, 3)):
        step = 1e-5 * direction
        change = loss.mean(shading + step) - loss.mean(shading - step)
        assert change == pytest.approx(2 * (step * found[0][1]).sum(), rel=1e-5)
    assert found[0][0] == found[1][0]
    assert np.array_equal(found[0][1], found[1][1])


def test_sampled_shading_is_a_product_of_matrices_and_so_is_its_slope():
    rng = np.random.default_rng(4)
    shares, of_light = rng.random((1300, 13)).astype(np.float32), rng.integers(0, 2, 1300)
    light, bounced, by_shading = rng.random((2, 13, 3)), rng.random((1300, 3)), rng.normal(size=(1300, 3))
    sampled = SampledShading(shares, of_light)
    found = []
    for threads in (1, 2):
        use_threads(threads)
        found.append((sampled.beside(bounced, light), sampled.slope_by_light(by_shading, 2)))
    shading = bounced + np.einsum("pd,pdc->pc", shares, light[of_light])
    slopes = [shares[of_light == own].T @ by_shading[of_light == own] for own in (0, 1)]
    assert np.allclose(found[1][0], shading, rtol=1e-5)
    assert np.allclose(found[1][1], slopes, atol=1e-4)
    assert all(np.array_equal(one, other) for one, other in zip(*found, strict=True))


def test_an_even_neutral_light_costs_nothing_beside_the_pairs():
    sample = Sample(np.ones((2, 3)), np.ones((2, 8), np.float32), np.zeros(2, int), np.full(8, 1 / 8))
    pairs = Pairs(np.array([0], np.int32), np.array([1], np.int32), np.array([1.0]), np.array([1], np.int32))
    objective = PairObjective(sample, np.zeros((2, 3)), pairs, 0.4, FEW)
    value, slope = objective(np.ones((1, 8, 1)) * np.array([1.0, 2.0, 0.5]))
    assert value == pytest.approx(0, abs=1e-12)
    assert np.allclose(slope, 0, atol=1e-9)


def test_pairs_join_what_is_near_or_of_one_colour():
    rng = np.random.default_rng(0)
    colours = np.array([[0.8, 0.2, 0.2], [0.2, 0.2, 0.8]])[np.arange(40) % 2]
    positions = np.column_stack([np.zeros(40, int), np.arange(40) // 2 * 100])
    pairs = alike_pairs(colours, np.zeros(40, int), positions, np.zeros((40, 3)), (5, 10), rng, FEW.pairs)
    same = np.arange(40)[pairs.first] % 2 == np.arange(40)[pairs.second] % 2
    near = np.abs(positions[pairs.first, 1] - positions[pairs.second, 1]) < 10
    assert np.all(same | near)
    assert pairs.weight.sum() == pytest.approx(1)
    assert pairs.weight[~same].sum() == pytest.approx(0.5)


def test_what_is_near_in_the_image_alone_is_not_paired():
    """Both sides of an outline: a wall, and what stands before it."""
    rng = np.random.default_rng(0)
    column, row = np.arange(400) % 20, np.arange(400) // 20
    before = column >= 10
    places = np.column_stack([column, row, np.where(before, 40, 0)])
    grey, positions = np.full((400, 3), 0.5), np.column_stack([row, column])
    pairs = alike_pairs(grey, np.zeros(400, int), positions, places, (3, 6), rng, FEW.pairs)
    across = before[pairs.first] != before[pairs.second]
    assert across[pairs.kind == COLOUR].any()
    assert not across[pairs.kind != COLOUR].any()
    assert np.unique(pairs.first[pairs.kind != COLOUR]).size > 350
    level = np.column_stack([column, row, np.zeros(400)])
    flat = alike_pairs(
        grey, np.zeros(400, int), positions, level, (3, 6), np.random.default_rng(0), FEW.pairs
    )
    assert (before[flat.first] != before[flat.second])[flat.kind != COLOUR].any()


def test_how_far_is_far_is_asked_of_every_view_and_not_of_what_has_no_place():
    """One view from ten times as far away; of a third the surface is seen from behind."""
    rng = np.random.default_rng(0)
    column, row = np.arange(400) % 20, np.arange(400) // 20
    positions, level = np.column_stack([row, column]), np.column_stack([column, row, np.zeros(400)])
    places = np.concatenate([level, 10 * level, np.full((400, 3), np.nan)])
    views = np.repeat(np.arange(3), 400)
    pairs = alike_pairs(
        np.full((1200, 3), 0.5), views, np.tile(positions, (3, 1)), places, (3, 6), rng, FEW.pairs
    )
    near = pairs.first[pairs.kind != COLOUR]
    counts = np.bincount(views[near], minlength=3)
    assert counts.min() > 0.9 * counts.max() > 0


def test_the_sample_lies_inside_the_masks_and_is_sorted():
    views = sphere_scene(view_count=2).stacked()
    every, thin = np.arange(views.starts[-1]), FEW.pairs.thin_share
    drawn = sample_of(views, every, 100, np.random.default_rng(0), thin)
    assert drawn.size == 100
    assert np.all(np.diff(drawn) > 0)
    everything = sample_of(views, every, 10**6, np.random.default_rng(0), thin)
    assert drawn.size < everything.size < views.starts[-1]


def test_thin_surface_is_drawn_from_as_well_as_the_knob_on_it():
    mask = np.zeros((40, 40), bool)
    mask[::3] = True
    mask[3:6, 20:23] = True
    normals = np.broadcast_to([0.0, 0.0, 1.0], (*mask.shape, 3)).astype(np.float32)
    views = stack_views([mask], [normals], {})
    drawn = sample_of(views, np.arange(mask.sum()), 10**6, np.random.default_rng(0), FEW.pairs.thin_share)
    assert drawn.size == mask.sum()


def test_gains_of_the_views_are_found_and_moving_light_is_told_from_them(lit):
    views, _, albedo, shading, _ = lit
    image = albedo * shading
    gains = np.array([[1.0, 1, 1], [1.3, 1.2, 1.1], [0.8, 0.7, 0.9]])
    of_pixel = np.repeat(gains, np.diff(views.starts), axis=0)
    found = view_gains(views, image * of_pixel, np.ones(len(image), bool), FEW.gains)
    wanted = gains / np.exp(np.log(gains).mean(axis=0))
    assert np.allclose(found.gains, wanted, rtol=0.02)
    assert found.spread < 0.03
    moving = sphere_scene(view_count=3, turn_deg=90.0)
    image = np.concatenate([i[m] for i, m in zip(moving.images, moving.masks, strict=True)])
    assert (
        view_gains(moving.stacked(), image / np.percentile(image, 99), image[:, 0] >= 0, FEW.gains).spread
        > 0.15
    )


@pytest.mark.parametrize(
    ("exposures", "blue"), [([1.0, 2, 0.5], 0.0), ([1.0, 2, 0.5], 0.02), ([1.0, 2, 0.05], 1.0)]
)
def test_a_dim_channel_or_view_does_not_hide_the_exposures(lit, exposures, blue):
    """Yellow light; or one photo far darker than the others."""
    views, _, albedo, shading, _ = lit
    gains = np.outer(exposures, [1, 1, blue])
    image = albedo * shading * np.repeat(gains, np.diff(views.starts), axis=0)
    found = view_gains(views, image / np.percentile(image, 99), np.ones(len(image), bool), FEW.gains)
    wanted = gains[:, 0] / np.exp(np.log(gains[:, 0]).mean())
    assert np.allclose(found.gains[:, :2], wanted[:, None], rtol=0.03)
    assert found.spread < 0.03


def test_views_without_links_have_no_gains():
    scene = sphere_scene(view_count=2)
    scene.correspondences = {}
    count = int(scene.stacked().starts[-1])
    found = view_gains(scene.stacked(), np.ones((count, 3)), np.ones(count, bool), FEW.gains)
    assert np.array_equal(found.gains, np.ones((2, 3)))
    assert found.spread == 0


def solved(views: StackedViews, image, shading, trusted, weights, edges=ALIKE) -> np.ndarray:
    stopping = Stopping(tolerance=1e-4, gap=1e-2, max_rounds=60)
    how = FastSolver(weights, stopping, FastSettings(coarsest_pixels=30))
    return albedo_under_light(views, image, shading, trusted, edges, how, 1, lambda: None).albedo


def test_under_the_true_light_the_true_albedo_comes_back(lit):
    """Eq. 10 under a light that stays."""
    views, _, albedo, shading, _ = lit
    everywhere = np.ones(len(albedo), bool)
    weights = EnergyWeights(0.02, 0.0)
    assert error(solved(views, albedo * shading, shading, everywhere, weights), albedo) < 0.01


def test_pixels_that_are_not_trusted_take_their_albedo_from_their_neighbours(lit):
    views, _, albedo, shading, _ = lit
    image, trusted = albedo * shading, np.ones(len(albedo), bool)
    trusted[::7] = False
    image[~trusted] = 5.0
    found = solved(views, image, shading, trusted, EnergyWeights(0.1, 0.1))
    assert error(found, albedo) < 0.1


def test_an_edge_is_the_lights_where_shading_changes_and_colour_does_not():
    scene = sphere_scene(view_count=1)
    views = scene.stacked()
    count, edges = int(views.starts[-1]), edges_at(views, 10.0, fine_lambda=0.3)
    across = views.positions()[:, 1].astype(float)
    flat, steep = np.ones((count, 3)), np.exp(0.2 * across)[:, None] * np.ones(3)
    grey, rainbow = 0.5 * np.ones((count, 3)), np.exp(0.5 * across[:, None] * [1, 0, -1]) % 3 + 0.1
    plain = np.zeros(count)
    along = np.concatenate([np.full(one.size, k) for k, (one, _) in enumerate(views.neighbours())])
    assert np.allclose(smoothness_of_edges(views, grey, flat, plain, plain, edges), 0.3)
    steep = steep / steep.max()
    lights = smoothness_of_edges(views, grey * steep, steep, plain, plain, edges)
    assert np.median(lights[along == 0]) > 7
    assert np.allclose(lights[along == 1], 0.3)
    assert (
        np.median(smoothness_of_edges(views, rainbow * steep, steep, plain, plain, edges)[along == 0]) < 0.4
    )
    softly = smoothness_of_edges(views, grey * steep, steep, plain, plain + 1, edges)
    assert np.median(softly[along == 0] / lights[along == 0]) == pytest.approx(0.3, abs=0.03)
    assert np.allclose(softly[along == 1], 0.3)
    checks = np.where(across % 2, 1.0, 0.3)[:, None] * grey
    assert np.median(smoothness_of_edges(views, checks, steep, plain, plain, edges)[along == 0]) < 0.4


def test_paint_has_one_colour_in_any_amount_of_light():
    red, pink = np.array([[1.0, 0.03, 0.0]]), np.array([[1.0, 0.5, 0.4]])
    dim = np.array([[0.05], [0.3], [1.0]])
    assert np.allclose(colour_change(red * dim, np.tile(red, (3, 1))), 0, atol=1e-12)
    assert np.all(colour_change(red * dim, np.tile(pink, (3, 1))) > 0.12**2)
    assert np.all(colour_change(0 * red, pink) < 1e-6)  # of black, nothing is known


def test_the_lights_colour_is_taken_out_and_its_brightness_stays():
    rng = np.random.default_rng(2)
    paint, grey = np.array([0.9, 0.5, 0.3]), rng.uniform(0.2, 1, (50, 1))
    shading = grey * rng.uniform(0.5, 1.5, (50, 3))
    white = in_white_light(paint * shading, shading)
    assert np.allclose(white, paint * shading.mean(axis=1, keepdims=True), rtol=1e-5)
    assert np.all(np.isfinite(in_white_light(paint * shading, 0 * shading)))


def test_a_nearer_light_is_believed_only_if_it_explains_clearly_more():
    assert explained_best([0.1000, 0.0995, 0.110], FEW.distance) == 0
    assert explained_best([0.1000, 0.0985, 0.098], FEW.distance) == 2
    assert explained_best([0.1], FEW.distance) == 0


def test_everything_together_on_the_sphere(lit):
    views, sky, albedo, shading, _ = lit
    image = photo_of(albedo, shading)
    images = [np.ascontiguousarray(image[:, c]) for c in range(3)]
    found = decompose_by_sky(views, images, [sky], viewing(np.ones(len(albedo), bool)), HOW)
    assert found.light.light_of_view.max() == 0
    assert found.light.specular is None
    assert np.allclose(found.light.light.shading.mean(axis=0), 1, atol=1e-3)
    assert error(found.albedo, albedo) < 0.25 * error(image, albedo)
    apart = HOW.with_light(lights="per-view")
    per_view = decompose_by_sky(views, images, [sky], viewing(np.ones(len(albedo), bool)), apart)
    assert per_view.light.light.radiance.shape == (3, DIRECTIONS, 3)
    assert error(per_view.albedo, albedo) < 0.5 * error(image, albedo)


def test_texture_is_told_from_relief_and_its_detail_comes_back():
    """Strong fine paint is kept, whatever it is; steep shading of one paint is no texture."""
    scene = sphere_scene(view_count=1)
    views = scene.stacked()
    rng, count = np.random.default_rng(5), int(views.starts[-1])
    across = views.positions()[:, 1].astype(float)
    shading = np.exp(0.2 * np.sin(across))[:, None] * np.ones(3)
    grain = np.exp(np.clip(rng.normal(0, 0.5, (count, 1)), -0.9, 0.9)) * np.array([0.5, 0.4, 0.3])
    edges, trusted = edges_at(views, 10.0), np.ones(count, bool)
    textured = appearance_of(views, grain * shading, shading, trusted, edges, True).textured
    plain = appearance_of(views, 0.4 * shading, shading, trusted, edges, True).textured
    assert np.mean(textured) > 0.9
    assert np.max(plain) == 0


def test_what_views_contradict_each_other_about_is_disputed_and_nothing_else(lit):
    views, _, albedo, shading, _ = lit
    everywhere, edges = np.ones(len(albedo), bool), edges_at(views, 10.0)
    linked = np.unique(np.concatenate([np.concatenate(ends) for ends in views.linked_pixels()]))

    def inconsistent(image, light=shading):
        return appearance_of(views, image, light, everywhere, edges, True).inconsistent[linked]

    image, dim = albedo * shading, np.ones((len(albedo), 1))
    dim[views.view(1)] = 0.3
    assert np.quantile(inconsistent(image), 0.95) < 0.1
    assert np.quantile(inconsistent(dim * image, dim * shading), 0.95) < 0.1  # less light, and known to be
    glossy = image.copy()
    glossy[views.view(0)] *= 1.5
    assert np.median(inconsistent(glossy)) > 0.8
    grain = np.exp(np.random.default_rng(6).uniform(-0.9, 0.9, (len(albedo), 1)))
    assert np.median(inconsistent(grain * image)) < 0.1  # fine paint that no two views see alike


def test_fine_paint_that_views_misplace_is_texture_unless_it_may_be_gloss():
    scene = sphere_scene(view_count=3, width=192, height=160)
    views, albedo = scene.stacked(), np.stack(scene.true_channels(), axis=1)
    everywhere, edges = np.ones(len(albedo), bool), edges_at(views, 10.0)
    linked = np.unique(np.concatenate([np.concatenate(ends) for ends in views.linked_pixels()]))
    grain = np.random.default_rng(6).normal(0, 0.4, (len(albedo), 1))
    image = albedo * np.exp(grain)  # no two views see it alike

    def textured(image, glossy):
        lit = np.ones_like(albedo)
        return np.median(appearance_of(views, image, lit, everywhere, edges, glossy).textured[linked])

    assert textured(image, glossy=False) > 0.4
    assert textured(image, glossy=True) < 0.15
    image[views.view(0)] *= 1.5
    assert textured(image, glossy=False) < 0.05


def test_disputed_pixels_believe_the_other_views(lit):
    """Each link has its own μ: uniform weights change nothing, and more of them outvote a view's photo."""
    views, _, albedo, shading, _ = lit
    weights, everywhere = EnergyWeights(0.02, 0.1), np.ones(len(albedo), bool)
    plain = agreement_of_correspondences(views, 0.1, np.zeros(len(albedo)), 4.0)
    firm = agreement_of_correspondences(views, 0.1, np.ones(len(albedo)), 4.0)
    assert np.allclose(plain, 0.1)
    assert np.allclose(firm, 0.5)
    one, other = (graph_of(views, weights, edges) for edges in (ALIKE, EdgeWeights(agreement=plain)))
    assert all(np.array_equal(a, b) for a, b in zip(vars(one).values(), vars(other).values(), strict=True))
    image = albedo * shading
    linked = np.concatenate([ends[0] for ends in views.linked_pixels()])
    bright = np.intersect1d(np.arange(views.view(0).start, views.view(0).stop, 5), linked)
    image[bright] *= 2
    left = [
        np.median(solved(views, image, shading, everywhere, weights, EdgeWeights(agreement=mu))[bright])
        / np.median(albedo[bright])
        for mu in (plain, firm)
    ]
    assert left[0] > 1.5
    assert left[1] < 1.1


def test_where_nothing_is_trusted_everything_is(lit):
    views, sky, albedo, shading, _ = lit
    image = photo_of(albedo, shading)
    descent = replace(HOW.descent, stopping=replace(HOW.descent.stopping, max_rounds=5))
    how = replace(HOW.with_light(lights="shared"), descent=descent)
    images = [np.ascontiguousarray(image[:, c]) for c in range(3)]
    found = decompose_by_sky(views, images, [sky], viewing(np.zeros(len(albedo), bool)), how)
    assert found.light.observations.trusted.any()
    assert found.albedo.min() > 0


def test_clipped_pixels_have_no_say_about_the_light(lit):
    views, sky, albedo, shading, _ = lit
    image, rng = (albedo * shading).astype(np.float32), np.random.default_rng(0)
    clipped = rng.random(len(image)) < 0.3
    image[clipped] = image.max()
    one_light = np.zeros(views.view_count, int)
    with_all, without = (
        estimate_light(sky, views, image, trusted, one_light, FEW).shading(sky, views.starts, one_light)
        for trusted in (np.ones(len(image), bool), ~clipped)
    )
    assert error(without, shading) < 0.05
    assert error(without, shading) < error(with_all, shading)


HIGHLIGHTS, OUTLIERS = HighlightSettings(), DarkOutlierSettings()


def linked_by(views: StackedViews, trusted: np.ndarray) -> LinkedPatches:
    return LinkedPatches.of(views, trusted, HIGHLIGHTS)


def cleaned(views: StackedViews, trusted: np.ndarray, image: np.ndarray) -> np.ndarray:
    return without_highlights(linked_by(views, trusted), image, HIGHLIGHTS)


def test_what_one_view_alone_sees_is_a_highlight_and_goes(lit):
    views, _, albedo, shading, normals = lit
    image = photo_of(albedo, shading)
    rng, linked = np.random.default_rng(1), linked_to_others(views)
    first = np.arange(len(image)) < views.starts[1]
    middle = normals[first & linked].mean(axis=0)
    highlight = 0.6 * np.maximum(normals @ (middle / np.linalg.norm(middle)), 0)[:, None] ** 60
    highlight[~first] = 0
    noise = 1 + 0.02 * rng.standard_normal(image.shape)
    glossy = (image * noise + highlight).astype(np.float32)
    everything = np.ones(len(image), bool)
    clean = cleaned(views, everything, glossy)
    assert np.all(clean <= glossy)
    lobe = linked & (highlight[:, 0] > 0.1)
    assert np.abs(np.mean(clean[lobe] - image[lobe])) < 0.3 * np.mean(highlight[lobe])
    diffuse = cleaned(views, everything, (image * noise).astype(np.float32))
    assert np.mean(np.abs(diffuse / (image * noise) - 1) < 1e-6) > 0.9
    alone = replace(
        views, correspondences={pair: block for pair, block in views.correspondences.items() if 0 not in pair}
    )
    assert np.array_equal(cleaned(alone, everything, glossy)[first], glossy[first])


def test_a_highlight_goes_without_leaving_a_colour_of_its_own(lit, monkeypatch):
    """Where views differ either way in green alone, green is hardly believed by itself."""
    views, everything = lit[0], np.ones(len(lit[2]), bool)
    image = photo_of(lit[2], lit[3])
    lobe = near_the_middle_of_the_first(lit, 20) & (np.arange(len(image)) < views.starts[1])
    image[lobe] *= 1.6
    channels = itertools.cycle([0.0, 0.2, 0.0])
    monkeypatch.setattr(highlights, "_misfit", lambda _, excess, __: np.full(len(excess), next(channels)))
    clean = cleaned(views, everything, image)
    taken = np.log((image + DARK) / (clean + DARK))[near_the_middle_of_the_first(lit, 10) & lobe]
    assert taken.mean() > 0.2
    assert np.ptp(taken.mean(axis=0)) < 0.15 * taken.mean()


def with_highlights(lit) -> np.ndarray:
    """The photos with a broad highlight in the middle of every view."""
    views, _, albedo, shading, normals = lit
    glossy = photo_of(albedo, shading)
    for view in range(views.view_count):
        own = views.view(view)
        towards = normals[own].mean(axis=0)
        glossy[own] += 2 * np.maximum(normals[own] @ (towards / np.linalg.norm(towards)), 0)[:, None] ** 12
    return glossy


def test_gloss_is_told_from_light_that_moves(lit):
    """Both make views differ; gloss only brightens, and few of the views of a place."""
    views, glossy = lit[0], with_highlights(lit)
    everything = np.ones(len(glossy), bool)
    assert view_gains(views, glossy, everything, FEW.gains).spread > MOVING[-1]
    assert brightening(linked_by(views, everything), glossy) > 1.1
    alone = replace(views, correspondences={})
    assert brightening(linked_by(alone, everything), glossy) == 1


def test_views_under_a_light_that_moves_have_one_each():
    scene = sphere_scene(view_count=3, turn_deg=90.0)
    views, sky = scene.stacked(), open_scene(normals_of(scene))
    images, everything = scene.channels(), np.ones(int(views.starts[-1]), bool)
    found = decompose_by_sky(views, images, [sky], viewing(everything), HOW)
    assert found.light.brightening < 1
    assert found.light.light_of_view.tolist() == [0, 1, 2]


def test_glossy_views_have_one_light_and_firm_links(lit, monkeypatch):
    """What the views dispute is settled by their links: the weights found reach the solver."""
    views, sky, albedo, _, _ = lit
    weighed = []

    def solve(*given):
        weighed.append(given[4])
        return albedo_under_light(*given)

    monkeypatch.setattr(sky_decomposition, "albedo_under_light", solve)
    images = list(np.ascontiguousarray(with_highlights(lit).T))
    found = decompose_by_sky(views, images, [sky], viewing(np.ones(len(albedo), bool)), HOW)
    assert found.light.gains.spread > MOVING[-1]
    assert found.light.light_of_view.max() == 0
    of_tv, of_albedo = weighed
    assert of_tv == ALIKE
    assert of_albedo.smoothness.size == sum(p.size for p, _ in views.neighbours())
    assert of_albedo.agreement.size == sum(p.size for p, _ in views.linked_pixels())
    least = HOW.descent.weights.consistency
    assert of_albedo.agreement.min() >= np.float32(least)
    assert of_albedo.agreement.max() > 2 * least


def test_clipped_pixels_do_not_drag_down_those_that_see_better(lit):
    views, _, albedo, shading, _ = lit
    image = photo_of(albedo, shading)
    first = np.arange(len(image)) < views.starts[1]
    clipped = image.copy()
    clipped[first] = np.minimum(image[first], 0.4)
    seen_well = ~(first[:, None] & (clipped == 0.4)).any(axis=1)
    dragged, dragged_by_clipped = (
        np.mean(cleaned(views, trusted, clipped)[~first] < 0.95 * image[~first])
        for trusted in (seen_well, np.ones(len(image), bool))
    )
    assert dragged < 0.03
    assert dragged_by_clipped > 2 * dragged


SHADOW = 0.15  # of its light a place keeps that the photographer's shadow lies on


def near_the_middle_of_the_first(lit, radius_deg: float) -> np.ndarray:
    """Pixels of all views, (N,) bool, around the place in the first that others see as well."""
    views, normals = lit[0], lit[4]
    first = np.arange(len(normals)) < views.starts[1]
    middle = normals[first & linked_to_others(views)].mean(axis=0)
    return normals @ (middle / np.linalg.norm(middle)) > np.cos(np.deg2rad(radius_deg))


def darkened_in_the_first(lit, to: float) -> tuple[np.ndarray, np.ndarray]:
    """Photos with a place in the first darkened, and its pixels there, (N,) bool."""
    image = photo_of(lit[2], lit[3])
    first = np.arange(len(image)) < lit[0].starts[1]
    place = first & near_the_middle_of_the_first(lit, 25)
    image[place] *= to
    return image, place


@pytest.mark.parametrize("to", [SHADOW, 0.0])
def test_a_place_that_one_photo_darkens_is_no_measure_and_darkens_no_other(lit, to):
    views, everything, image = lit[0], np.ones(len(lit[2]), bool), photo_of(lit[2], lit[3])
    shadowed, place = darkened_in_the_first(lit, to)
    how = FEW.model_copy(update={"lights": "shared"})
    linked = linked_by(views, everything)
    photos = Observations.of(linked, viewing(everything), shadowed, 0.0, how).in_one_light(linked)
    inside = place & near_the_middle_of_the_first(lit, 18) & linked_to_others(views)
    assert np.mean(photos.viewing.trusted[inside]) < 0.1
    assert np.mean(photos.viewing.trusted[~place]) > 0.99
    dragged, by_the_shadow = (
        np.mean(diffuse[~place] < 0.95 * image[~place])
        for diffuse in (photos.diffuse, cleaned(views, everything, shadowed))
    )
    assert by_the_shadow > 0.3
    assert dragged < 0.2 * by_the_shadow


def test_what_all_photos_show_black_is_believed(lit):
    image, inside = photo_of(lit[2], lit[3]), near_the_middle_of_the_first(lit, 18)
    image[near_the_middle_of_the_first(lit, 25)] = 0
    linked = linked_by(lit[0], np.ones(len(image), bool))
    assert not darker_outliers(linked, image, OUTLIERS)[inside].any()
    assert darker_outliers(linked, darkened_in_the_first(lit, 0.0)[0], OUTLIERS)[inside].any()


def test_of_two_views_neither_is_outvoted(lit):
    shadowed, place = darkened_in_the_first(lit, SHADOW)
    views, everything = lit[0], np.ones(len(shadowed), bool)
    two = replace(views, correspondences={(0, 1): views.correspondences[0, 1]})
    assert not darker_outliers(linked_by(two, everything), shadowed, OUTLIERS).any()
    assert darker_outliers(linked_by(views, everything), shadowed, OUTLIERS)[place].any()


def linked_to_others(views: StackedViews) -> np.ndarray:
    linked = np.zeros(int(views.starts[-1]), bool)
    for pair in views.linked_pixels():
        for end in pair:
            linked[end] = True
    return linked


def test_a_photo_that_is_many_stops_darker_is_not_unlit(lit):
    """A bracketed set: its gain is no lack of light, and its pixels count as before."""
    views, sky, albedo, shading, _ = lit
    image = photo_of(albedo, shading)
    stops = np.repeat([1.0, 1 / 128, 1.0], np.diff(views.starts))[:, None]
    darker = (image * stops).astype(np.float32)
    every = viewing(np.ones(len(image), bool))
    found, as_before = (
        find_illumination(views, list(each.T), [sky], every, FEW, 1, lambda: None) for each in (darker, image)
    )
    np.testing.assert_allclose(found.gains.gains[1] / found.gains.gains[0], 1 / 128, rtol=0.02)
    trusted = [np.add.reduceat(each.observations.trusted, views.starts[:-1]) for each in (found, as_before)]
    assert trusted[0][1] > 0.95 * trusted[1][1] > 0
