"""Dense stereo's parts on shapes whose answer is known: planes, sweep, aggregation, refinement, agreement."""

from __future__ import annotations

import itertools
from dataclasses import replace

import numpy as np
import pytest

from stages.scene.cameras import back_project, normals_in_world, project
from stages.solvers.kernels.threading_layer import use_threads
from stages.stereo.depth.dense_stereo import Scene, fuse_views, padded, sources_of
from stages.stereo.depth.geometric_consistency import confirmed, consistent_views
from stages.stereo.depth.inverse_depth import (
    depth_from_planes,
    fit_planes,
    j_from_i,
    normals_from_planes,
    resample_planes,
)
from stages.stereo.depth.patch_match import refine
from stages.stereo.depth.plane_sweep import (
    WORST,
    inverse_depth_planes,
    matching_costs,
    pixels_per_inverse_depth,
)
from stages.stereo.depth.semi_global import aggregate, winner
from stages.stereo.mvs_settings import (
    MvsSettings,
    PlaneSweepSettings,
    PosePointsSettings,
    ViewSelectionSettings,
)
from stages.stereo.sparse_surface import oriented_normals
from stages.stereo.view_selection import (
    SparsePoints,
    angle_weight,
    depth_range,
    pair_scores,
    points_from_poses,
    select_sources,
)
from tests import stereo_scene

VIEWS = stereo_scene.cameras()
TRACED = [stereo_scene.trace(camera) for camera in VIEWS]
REFINEMENT = MvsSettings(
    photometric_iterations=3,
    patch_radius_px=4,
    best_sources=2,
    patch_grey_sigma=0.1,
    noise=0.004,
    smoothness=0.02,
    geometric_weight=0.2,
    geometric_cap_px=3.0,
)
PLANES = MvsSettings(sweep_step_px=1.0, sweep_planes=160)
QUARTILE = 0.75
SWEEP = PlaneSweepSettings(parallax_quantile=QUARTILE)


def true_planes(view: int) -> np.ndarray:
    """Inverse depth and slopes from the traced depth and normals (1/z = −(K⁻ᵀ n)·(x, y, 1) / distance)."""
    camera, traced = VIEWS[view], TRACED[view]
    seen = traced.depth > 0
    inverse = np.where(seen, 1 / np.where(seen, traced.depth, 1), 0)
    normals = traced.normals @ camera.rotation.T
    x_in_cam = (back_project(camera, traced.depth) - camera.centre_in_world) @ camera.rotation.T
    distance = np.sum(normals * x_in_cam, axis=-1)
    a = normals @ np.linalg.inv(camera.intrinsics) / np.where(seen, distance, 1)[..., None]
    return np.stack([inverse, a[..., 0], a[..., 1]], axis=-1).astype(np.float32)


@pytest.fixture(scope="module")
def scene() -> Scene:
    """The scene with true planes and no costs."""
    colours = [np.repeat((traced.grey * 255)[..., None], 3, axis=2).astype(np.uint8) for traced in TRACED]
    found = Scene(VIEWS, lambda view: colours[view], stereo_scene.plans(VIEWS))
    for view in range(len(VIEWS)):
        found.planes[view] = true_planes(view)
        found.costs[view] = np.zeros(VIEWS[view].shape, np.float32)
    return found


def test_eq_7_twice_takes_a_pixel_and_its_depth_into_another_view():
    i, j = VIEWS[1], VIEWS[4]
    x_in_world = np.array([0.2, -0.3, 4.1])
    (xy_i, z_i), (xy_j, z_j) = project(i, x_in_world), project(j, x_in_world)
    q = j_from_i(i, j) @ np.array([*(xy_i - 0.5), 1.0, 1 / z_i])
    np.testing.assert_allclose(q[:2] / q[2], xy_j - 0.5, atol=1e-9)
    np.testing.assert_allclose(q[2], z_j / z_i)


def test_planes_know_their_normals_and_depths():
    traced, planes = TRACED[2], true_planes(2)
    normals = normals_in_world(VIEWS[2], normals_from_planes(planes, VIEWS[2]))
    np.testing.assert_allclose(normals, traced.normals, atol=2e-4)
    np.testing.assert_allclose(depth_from_planes(planes), traced.depth, rtol=1e-6)


def test_slopes_are_exact_on_a_plane_and_stop_at_a_depth_edge():
    y, x = np.mgrid[:20, :30].astype(np.float32)
    inverse = 0.2 + 0.001 * x - 0.0005 * y
    inverse[:, 15:] += 0.1
    planes = fit_planes(inverse.astype(np.float32), 0.002, 2, 0.5)
    np.testing.assert_allclose(planes[..., 1], 0.001, atol=1e-6)
    np.testing.assert_allclose(planes[..., 2], -0.0005, atol=1e-6)


def test_resampled_planes_are_the_same_plane():
    y, x = np.mgrid[:40, :60] + 0.5
    fine = np.stack([0.2 + 0.001 * x - 0.0005 * y, np.full_like(x, 0.001), np.full_like(x, -0.0005)], axis=-1)
    y, x = (np.mgrid[:20, :30] + 0.5) * 2
    coarse = np.stack(
        [0.2 + 0.001 * x - 0.0005 * y, np.full_like(x, 0.002), np.full_like(x, -0.001)], axis=-1
    )
    np.testing.assert_allclose(resample_planes(coarse.astype(np.float32), (40, 60)), fine, atol=1e-6)


def sweep(view: int, grey=None, sources=None, radius: int = 2):
    """Costs of a view's sweep over its plan's range, and the inverse depths."""
    chosen = stereo_scene.plans(VIEWS)[view].sources
    projections = np.stack([j_from_i(VIEWS[view], VIEWS[j]) for j in chosen])
    depths = inverse_depth_planes(projections, VIEWS[view].shape, 2.5, 7.5, PLANES)
    images = padded([TRACED[j].grey for j in chosen]) if sources is None else sources
    sizes = np.array([VIEWS[j].shape for j in chosen], np.int32)
    grey = TRACED[view].grey if grey is None else grey
    costs = matching_costs(grey, images, sizes, projections, depths, radius=radius, best=2, noise=0.004)
    return costs, depths


def test_neighbouring_planes_are_a_pixel_apart():
    projections = np.stack([j_from_i(VIEWS[2], VIEWS[j]) for j in (1, 3, 4)])
    many = MvsSettings(sweep_step_px=1.0, sweep_planes=1000)
    depths = inverse_depth_planes(projections, VIEWS[2].shape, 2.5, 7.5, many)
    centre = np.array([[59.5, 44.5, 1, depths[k]] for k in (len(depths) // 2, len(depths) // 2 + 1)])
    q = np.einsum("sij,kj->ski", projections, centre)
    moved = np.linalg.norm(np.diff(q[..., :2] / q[..., 2:], axis=1)[:, 0], axis=1)
    assert np.quantile(moved, QUARTILE) == pytest.approx(1, rel=0.05)
    speed = pixels_per_inverse_depth(projections, VIEWS[2].shape, float(depths[len(depths) // 2]), 9)
    np.testing.assert_allclose(speed * np.diff(depths).mean(), moved, rtol=0.05)


def test_the_true_plane_wins_the_sweep():
    costs, depths = sweep(2)
    inner = np.zeros(VIEWS[2].shape, bool)
    inner[8:-8, 8:-8] = True
    inner &= TRACED[2].depth > 0
    gap = np.abs(depths[costs.argmin(axis=-1)] - 1 / np.where(inner, TRACED[2].depth, 1))[inner]
    assert np.median(gap) < 0.6 * np.diff(depths).mean()
    assert np.mean(gap < 2 * np.diff(depths).mean()) > 0.85


def test_brightness_and_contrast_do_not_matter_to_the_sweep():
    costs, _ = sweep(2)
    chosen = stereo_scene.plans(VIEWS)[2].sources
    brighter = padded([(0.6 * TRACED[j].grey + 0.1 * k).astype(np.float32) for k, j in enumerate(chosen)])
    changed, _ = sweep(2, sources=brighter)
    textured = costs.min(axis=-1) < 100
    assert np.quantile(np.abs(costs.astype(int) - changed)[textured], 0.99) <= 3


def test_an_even_image_matches_nothing():
    costs, _ = sweep(2, grey=np.full(VIEWS[2].shape, 0.5, np.float32))
    assert costs.min() == WORST


def test_one_spoilt_source_does_not_spoil_the_sweep():
    chosen = stereo_scene.plans(VIEWS)[2].sources
    images = padded([TRACED[j].grey for j in chosen])
    images[0] = np.random.default_rng(0).random(images[0].shape, np.float32)
    spoilt, depths = sweep(2, sources=images)
    inner = np.s_[20:-20, 40:-20]
    gap = np.abs(depths[spoilt.argmin(axis=-1)] - 1 / TRACED[2].depth.clip(1))[inner]
    assert np.median(gap) < np.diff(depths).mean()


def brute_force_path(costs, guide, direction, small, large, edge):
    """Hirschmüller's recursion, one pixel and plane at a time."""
    height, width, planes = costs.shape
    result = np.zeros(costs.shape)
    dy, dx = direction
    for y in range(height) if dy >= 0 else range(height - 1, -1, -1):
        for x in range(width) if dx >= 0 else range(width - 1, -1, -1):
            before_y, before_x = y - dy, x - dx
            result[y, x] = costs[y, x]
            if not (0 <= before_y < height and 0 <= before_x < width):
                continue
            before = result[before_y, before_x]
            ratio = abs(float(guide[y, x]) - float(guide[before_y, before_x])) / edge
            jump = max(np.floor(large / (1 + ratio)), small + 1)
            for d in range(planes):
                options = [before[d], before.min() + jump]
                options += [before[k] + small for k in (d - 1, d + 1) if 0 <= k < planes]
                result[y, x, d] += min(options) - before.min()
    return result


@pytest.mark.parametrize("paths", [4, 8])
def test_aggregation_equals_the_recursion_done_by_hand(paths):
    rng = np.random.default_rng(1)
    costs = rng.integers(0, 255, (5, 7, 6)).astype(np.uint8)
    guide = np.round(rng.random((5, 7)) * 8).astype(np.float32) / 8
    directions = [(0, 1), (0, -1), (1, 0), (-1, 0), (1, 1), (-1, -1), (1, -1), (-1, 1)][:paths]
    expected = sum(brute_force_path(costs, guide, r, 10, 60, 0.25) for r in directions)
    penalties = MvsSettings(sgm_small=10, sgm_large=60, sgm_edge=0.25, sgm_paths=paths)
    np.testing.assert_array_equal(aggregate(costs, guide, penalties), expected)


def test_on_a_chain_the_two_directions_find_the_exact_optimum():
    costs = np.random.default_rng(2).integers(0, 255, (1, 6, 4)).astype(np.uint8)
    guide = np.zeros((1, 6), np.float32)
    penalties = MvsSettings(sgm_small=20, sgm_large=70, sgm_edge=1.0, sgm_paths=4)
    total = aggregate(costs, guide, penalties).astype(int)
    # Up and down, each path is one pixel long and adds C; left + right − C is a chain's min-marginal.
    marginal = (total - 3 * costs.astype(int))[0]

    def energy(labels):
        steps = np.abs(np.diff(labels))
        return costs[0, np.arange(6), labels].sum() + np.sum(np.select([steps == 0, steps == 1], [0, 20], 70))

    best = min(itertools.product(range(4), repeat=6), key=lambda labels: energy(np.array(labels)))
    np.testing.assert_array_equal(marginal.argmin(axis=1), best)


def test_the_winner_sits_at_the_parabola_s_foot():
    d = np.arange(7)
    total = np.rint(100 * (d - 3.3) ** 2).astype(np.uint16)[None, None]
    assert winner(total)[0, 0] == pytest.approx(3.3, abs=0.01)


def refined(view: int, threads: int = 2, settings: MvsSettings = REFINEMENT):
    """Refinement from planes that are wrong by up to 1.5 pixels of disparity and know no slope."""
    use_threads(threads)
    scene = Scene(
        VIEWS, lambda j: np.repeat(np.rint(255 * TRACED[j].grey)[..., None], 3, 2), stereo_scene.plans(VIEWS)
    )
    step = scene.step(view, SWEEP)
    start = true_planes(view)
    start[..., 0] += np.random.default_rng(4).uniform(-1.5, 1.5, start.shape[:2]) * step
    start[..., 1:] = 0
    planes, costs = refine(
        TRACED[view].grey,
        sources_of(scene, view, with_depth=False),
        start,
        settings,
        step,
        (1 / 7.5, 1 / 2.5),
    )
    return planes, costs, step


def test_refinement_finds_depth_to_a_fraction_of_a_pixel_and_normals_to_a_few_degrees():
    planes, costs, step = refined(2)
    inner = np.zeros(VIEWS[2].shape, bool)
    inner[6:-6, 6:-6] = True
    inner &= (TRACED[2].depth > 0) & (costs < 0.3)
    assert inner.mean() > 0.5
    gap = np.abs(planes[..., 0] - true_planes(2)[..., 0])[inner] / step
    assert np.median(gap) < 0.1
    normals = normals_in_world(VIEWS[2], normals_from_planes(planes, VIEWS[2]))
    angle = np.rad2deg(np.arccos(np.clip(np.sum(normals * TRACED[2].normals, axis=-1), -1, 1)))[inner]
    assert np.median(angle) < 7.5


def test_refinement_gives_the_same_bits_on_any_number_of_threads():
    one, two = refined(3, threads=1), refined(3, threads=2)
    np.testing.assert_array_equal(one[0], two[0])
    np.testing.assert_array_equal(one[1], two[1])


def test_an_even_sky_costs_what_nothing_costs():
    _, costs, _ = refined(0)
    sky = TRACED[0].depth == 0
    far_inside = sky & np.roll(sky, 8, 0) & np.roll(sky, -8, 0) & np.roll(sky, 8, 1) & np.roll(sky, -8, 1)
    assert far_inside.sum() > 100
    assert costs[far_inside].min() >= 0.9


def test_true_depth_is_confirmed_and_false_depth_is_not(scene):
    sources = sources_of(scene, 2, with_depth=True)
    truth = np.ascontiguousarray(scene.planes[2][..., 0])
    count = consistent_views(truth, sources, 1.0)
    seen = TRACED[2].depth > 0
    assert np.mean(count[seen] >= 2) > 0.8
    assert not count[~seen].any()
    wrong = np.where(truth > 0, truth + 6 * np.float32(scene.step(2, SWEEP)), np.float32(0)).astype(
        np.float32
    )
    assert np.mean(consistent_views(wrong, sources, 1.0) > 0) < 0.03


def test_a_kept_pixel_matches_and_is_confirmed():
    inverse = np.array([[0.2, 0.2, 0.2, 0.0]], np.float32)
    costs, count = np.array([[0.1, 0.9, 0.1, 0.1]], np.float32), np.array([[2, 2, 1, 2]], np.uint8)
    kept = confirmed(inverse, costs, count, highest_cost=0.5, fewest=2)
    np.testing.assert_array_equal(kept, [[True, False, False, False]])


def agreeing(views: int) -> MvsSettings:
    return MvsSettings(consistent_px=1.0, fusion_depth_share=0.02, fusion_normal_deg=20.0, fusion_views=views)


def test_fused_points_lie_on_the_surface_once_each(scene):
    kept = {view: TRACED[view].depth > 0 for view in range(len(VIEWS))}
    agreement = agreeing(3)
    cloud = fuse_views(scene, agreement, kept, {}, lambda: None)
    on_ball = np.abs(np.linalg.norm(cloud.x_in_world - stereo_scene.CENTRE, axis=1) - stereo_scene.RADIUS)
    on_wall = np.abs(cloud.x_in_world @ stereo_scene.WALL_NORMAL - stereo_scene.WALL_OFFSET)
    assert np.quantile(np.minimum(on_ball, on_wall), 0.99) < 0.01
    pixels = sum(mask.sum() for mask in kept.values())
    assert 0.15 * pixels < len(cloud.x_in_world) < 0.45 * pixels  # each element once, though six views see it
    wall = on_wall < 1e-3
    np.testing.assert_allclose(cloud.normals[wall] @ stereo_scene.WALL_NORMAL, 1, atol=0.05)


def test_fusion_leaves_out_what_a_single_view_says(scene):
    lying = Scene(scene.cameras, scene.colour_of, scene.plans, dict(scene.planes), scene.costs)
    lying.planes[2] = scene.planes[2] * np.float32(1.1)
    kept = {2: TRACED[2].depth > 0, 1: TRACED[1].depth > 0, 3: TRACED[3].depth > 0}
    agreement = agreeing(2)
    cloud = fuse_views(lying, agreement, kept, {}, lambda: None)
    on_ball = np.abs(np.linalg.norm(cloud.x_in_world - stereo_scene.CENTRE, axis=1) - stereo_scene.RADIUS)
    on_wall = np.abs(cloud.x_in_world @ stereo_scene.WALL_NORMAL - stereo_scene.WALL_OFFSET)
    assert np.mean(np.minimum(on_ball, on_wall) > 0.05) < 0.03


def surface_points() -> SparsePoints:
    """Points of the middle view, seen by every view that they fall into."""
    x_in_world = back_project(VIEWS[2], TRACED[2].depth)[TRACED[2].depth > 0][::50]
    inside = []
    for camera in VIEWS:
        xy, depth = project(camera, x_in_world)
        inside.append((depth > 0) & np.all((xy >= 0) & (xy < [camera.width, camera.height]), axis=-1))
    return SparsePoints(x_in_world, np.stack(inside))


def around(best_deg: float, below_deg: float, above_deg: float, sources: int = 5) -> MvsSettings:
    spread = ViewSelectionSettings(angle_below=below_deg / best_deg, angle_above=above_deg / best_deg)
    return MvsSettings(angle_deg=best_deg, sources=sources, views=spread)


def test_the_angle_s_weight_by_hand():
    weights = angle_weight(np.array([10.0, 6.0, 25.0]), around(10.0, 4.0, 15.0))
    np.testing.assert_allclose(weights, [1, np.exp(-0.5), np.exp(-0.5)])


def test_sources_are_those_of_the_wanted_angle():
    settings = around(8.0, 3.0, 4.0, sources=2)  # views are 8° apart
    assert set(select_sources(VIEWS, surface_points(), 2, settings)) == {1, 3}
    assert pair_scores(VIEWS, surface_points(), 2, settings)[2] == 0


def test_views_that_share_nothing_are_no_sources():
    points = surface_points()
    seen = points.seen.copy()
    seen[5] = False
    assert 5 not in select_sources(VIEWS, SparsePoints(points.x_in_world, seen), 2, around(8.0, 3.0, 4.0))


def test_the_depth_range_holds_the_scene_with_and_without_points():
    depth = TRACED[2].depth[TRACED[2].depth > 0]
    for points in (surface_points(), points_from_poses(VIEWS, PosePointsSettings())):
        near, far = depth_range(VIEWS[2], points.x_in_world[points.seen[2]], 0.01, 0.25)
        assert near < depth.min() < depth.max() < far
        assert far / near < 12


def test_parallel_cameras_have_a_range_too():
    views = stereo_scene.cameras()[:3]
    same = [
        type(c)(c.name, c.width, c.height, c.intrinsics, np.column_stack([np.eye(3), [-0.2 * i, 0, 0]]))
        for i, c in enumerate(views)
    ]
    points = points_from_poses(same, PosePointsSettings())
    near, far = depth_range(same[0], points.x_in_world, 0.01, 0.25)
    assert 0.1 < near < 4 < far < 40


def test_views_from_one_place_have_finite_stand_ins_and_no_sources():
    centre = VIEWS[0].centre_in_world
    turned = [replace(c, cam_from_world=np.column_stack([c.rotation, -c.rotation @ centre])) for c in VIEWS]
    points = points_from_poses(turned, PosePointsSettings())
    assert np.isfinite(points.x_in_world).all() and points.seen.any(axis=1).all()
    for view in range(len(turned)):
        assert select_sources(turned, points, view, around(8.0, 3.0, 4.0)) == []


def test_sparse_normals_look_at_their_cameras():
    rng = np.random.default_rng(5)
    directions = rng.normal(size=(3000, 3))
    directions /= np.linalg.norm(directions, axis=1, keepdims=True)
    directions = directions[directions[:, 2] < -0.5]
    points = SparsePoints(stereo_scene.CENTRE + 0.7 * directions, np.ones((6, len(directions)), bool))
    normals = oriented_normals(VIEWS, points, 12)
    assert np.median(np.rad2deg(np.arccos(np.clip(np.sum(normals * directions, axis=1), -1, 1)))) < 6
