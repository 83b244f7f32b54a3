"""Clusters of the surface: the cuts, the margins, and the same albedo as of all at once."""

from __future__ import annotations

import json
from dataclasses import replace
from itertools import pairwise

import numpy as np
import pytest
import scipy.sparse as sp
from hypothesis import given
from hypothesis import settings as examples
from hypothesis import strategies as st

import stages
from benchmarks.paper.laboratory import results_of
from pipeline import UserError
from pipeline.command.terminal import Terminal
from stages import lighting
from stages.command.arguments import Run
from stages.command.machine import memory_of, memory_to_fit
from stages.command.request import request_of
from stages.decomposition_under_light import within
from stages.formats.artefacts.camera_file import read_cameras
from stages.formats.artefacts.correspondence_files import CorrespondenceFiles, numbered_correspondences
from stages.formats.artefacts.transfer_file import read_transfer
from stages.formats.images.exr import read_exr
from stages.formats.images.photos import read_mask
from stages.formats.meshes.triangle_meshes import read_mesh
from stages.geometry.short_edges import with_short_edges
from stages.lighting import LIGHTING, LightingSettings, Scene
from stages.photometry.clusters.cluster_views import (
    divided_surface,
    open_cluster,
    sampled_surface,
    surface_points,
    view_graph,
)
from stages.photometry.clusters.settings import AlbedoClusterSettings, ClusterSettings
from stages.photometry.clusters.surface_clusters import (
    Cluster,
    SampledSurface,
    clusters_of,
    size_of,
    tell_too_large,
)
from stages.photometry.clusters.typical_views import ViewGraph, parts_of, typical_views
from stages.photometry.decomposition_settings import DecompositionSettings
from stages.photometry.detail.detail_scene import PartOfScene, TypicalPixel, stride
from stages.photometry.detail.scene_statistics import (
    DetailStatistics,
    SampledDetail,
    SampledOctave,
    SampledViews,
)
from stages.photometry.detail.settings import DetailSettings
from stages.photometry.detail.shading_uncertainty import ShownChange
from stages.photometry.further_views.lit_clusters import further_pixels
from stages.photometry.lighting.estimate_illumination import find_illumination
from stages.photometry.lighting.opened_views import ViewFiles
from stages.photometry.lighting.view_gains import PairRatio, log_gains
from stages.scene.memory_of_views import BYTES_PER_PIXEL_OF_CLUSTER


def street(views: int, reach: int = 3, pixels: int = 100) -> ViewGraph:
    """Views in a row, each linked to the next few, less the farther they are."""
    between = np.abs(np.subtract.outer(np.arange(views), np.arange(views)))
    links = np.where((between > 0) & (between <= reach), 60 // np.maximum(between, 1), 0)
    return ViewGraph(np.full(views, pixels), sp.csr_array(links), 10.0)


@examples(deadline=None)
@given(views=st.integers(1, 40), most=st.integers(50, 5000), seed=st.integers(0, 9))
def test_every_view_is_in_one_part_and_none_is_too_large(views, most, seed):
    order = np.random.default_rng(seed).permutation(views)
    row = street(views)
    parts = parts_of(ViewGraph(row.pixels, row.links[order][:, order], row.side), most)
    assert sorted(view for part in parts for view in part) == list(range(views))
    assert all(100 * len(part) <= max(most, 100) for part in parts)


def test_a_street_is_cut_across():
    """Shuffled, 32 views in four parts: each a stretch of eight."""
    order = np.random.default_rng(0).permutation(32)
    row = street(32)
    parts = parts_of(ViewGraph(row.pixels, row.links[order][:, order], row.side), 800)
    stretches = [sorted(order[part].tolist()) for part in parts]
    assert sorted(stretches) == [list(range(first, first + 8)) for first in range(0, 32, 8)]


def test_parts_without_common_surface_are_cut_apart():
    one = street(6).links.toarray()
    graph = ViewGraph(np.full(12, 100), sp.csr_array(np.kron(np.eye(2, dtype=int), one)), 10.0)
    parts = [sorted(part.tolist()) for part in parts_of(graph, 600)]
    assert sorted(parts) == [list(range(6)), list(range(6, 12))]


def wall(seed, points=4000, views=5):
    """Samples of a long wall with some depth, of which each view sees a stretch; and whose they are."""
    rng = np.random.default_rng(seed)
    at = rng.uniform([0, 0, 0], [10, 1, 0.3], (points, 3))
    turn = np.linalg.qr(rng.normal(size=(3, 3)))[0]
    own = [at[np.abs(at[:, 0] - 2.5 * view) < 2] for view in range(views)]
    seen = np.concatenate(own) @ turn
    boxes = [[(part @ turn).min(axis=0), (part @ turn).max(axis=0)] for part in own]
    of_view = np.repeat(np.arange(views), [len(part) for part in own])
    return of_view, SampledSurface(
        seen, np.full(len(seen), 0.01), np.full(len(seen), 50.0), np.array(boxes), np.full(views, 0.01)
    )


@examples(deadline=None)
@given(seed=st.integers(0, 20), bound=st.floats(0.15, 2), margin=st.floats(0.01, 0.2))
def test_every_point_is_in_one_cluster_and_as_many_take_part_as_may(seed, bound, margin):
    _, surface = wall(seed)
    pixels = surface.weights.sum()
    how = ClusterSettings(pixels=max(1000, int(bound * pixels)), margin=margin)
    clusters = clusters_of(surface, 100.0, how)
    assert (len(clusters) == 1) == (pixels <= how.pixels)
    owned = np.array([one.owns(surface.points) for one in clusters])
    assert (owned.sum(axis=0) == 1).all()
    for one, own in zip(clusters, owned, strict=True):
        taking_part = one.reaches(surface.points, surface.footprints)
        assert size_of(one, surface) <= how.pixels and not (own & ~taking_part & (len(clusters) > 1)).any()
    assert [one.number for one in clusters] == list(range(len(clusters)))


@given(seed=st.integers(0, 20), count=st.integers(2, 9))
def test_a_margin_is_as_wide_as_asked_and_its_views_are_listed(seed, count):
    of_view, surface = wall(seed)
    how = ClusterSettings(pixels=int(1.5 * surface.weights.sum() / count), margin=0.05)
    for one in clusters_of(surface, 100.0, how):
        near = one.reaches(surface.points, surface.footprints)
        assert set(of_view[near]) <= set(one.views)
        own = surface.points[one.owns(surface.points)]
        for point in surface.points[near][::50]:
            assert np.linalg.norm(own - point, axis=1).min() < 5 * 0.01 * np.sqrt(3) + 0.3


@pytest.mark.parametrize(("side_px", "wide"), [(640, 96), (850, 127.5), (2560, 128), (4900, 128)])
def test_the_margin_of_the_albedo_is_no_wider_than_the_windows_of_its_detail_need(side_px, wide):
    """At 24 megapixels it was 735 px: a cluster of twenty million pixels was its margin for the most part."""
    how = AlbedoClusterSettings()
    assert how.margin_px(side_px) == wide == how.within(10**6).margin_px(side_px)
    assert how.widest_margin_px == 4 * DetailSettings().sigmas_px[-1]
    assert ClusterSettings(margin=0.1).margin_px(side_px) == pytest.approx(0.1 * side_px)


def test_what_would_be_margins_for_the_most_part_is_not_divided(tmp_path, make_job):
    """A margin as wide as the scene: every cluster would be all of it."""
    _, surface = wall(0)
    how = ClusterSettings(pixels=1000, margin=1.0)
    clusters = clusters_of(surface, 3000.0, how)
    assert [one.is_whole for one in clusters] == [True]
    job = make_job(tmp_path, LIGHTING, LightingSettings())
    tell_too_large(job, clusters, how)
    assert "Clusters of 321,400 pixels" in job.warnings[0] and "room for 1,000" in job.warnings[0]
    assert "(clusters.margin, now 1 of a view's side), or smaller" in job.warnings[0]
    tell_too_large(job, clusters, AlbedoClusterSettings(pixels=1000))
    assert "now 0.15 of a view's side, and clusters.widest_margin_px, 128)" in job.warnings[1]
    tell_too_large(job, clusters, ClusterSettings())
    assert len(job.warnings) == 2


def sampled(octave, size, seed):
    """An octave of a made-up scene: shading that the photos show in part, noise, texture."""
    rng = np.random.default_rng(seed)
    change = rng.normal(0, 0.2, size).astype(np.float32)
    left = rng.normal(0, 0.05, (size, 3)).astype(np.float32)
    left[:, 0] -= 0.4 * change
    return SampledOctave(
        octave,
        0.5 * 2**octave,
        change,
        left,
        left[:, 0] + rng.normal(0, 0.02, size).astype(np.float32),
        change**2 + 0.01,
        rng.normal(0, 0.03, (size // 2, 3)).astype(np.float32),
        rng.uniform(0, 0.01, size // 2).astype(np.float32),
        rng.uniform(0, 0.02, (size, 3)).astype(np.float32),
        rng.uniform(0, 0.001, (size, 3)).astype(np.float32),
        rng.uniform(0, 0.01, size).astype(np.float32),
        rng.uniform(0, 0.1, size).astype(np.float32),
        rng.normal(0, 0.001, size).astype(np.float32),
        rng.uniform(-1, 0, size).astype(np.float32),
    )


@pytest.mark.parametrize("few_links", [False, True])
def test_statistics_of_joined_parts_are_those_of_the_whole(few_links):
    how, cuts = DetailSettings(), [0, 700, 2600, 5000]
    whole = [sampled(number, 5000, number) for number in range(7)]
    rng = np.random.default_rng(9)
    sizes, quotients = rng.uniform(0.001, 1, (5, 5000)), rng.normal(0, 0.1, (5, 5000))

    def part(begin, end):
        octaves = []
        for one in whole:
            linked = slice(begin // 2, end // 2)
            arrays = {
                name: getattr(one, name)[begin:end] for name in ("change", "left", "quotient", "stated")
            }
            wide = ("energy", "wide_noise", "wide_size", "wide_stated", "wide_product", "wide_excess")
            arrays |= {name: getattr(one, name)[begin:end] for name in wide}
            arrays |= {name: getattr(one, name)[linked] for name in ("difference", "texture")}
            octaves.append(replace(one, **arrays))
        alone = SampledViews(tuple(sizes[:, begin:end]), tuple(quotients[:, begin:end]))
        links = 0 if few_links else (end - begin) // 2
        return SampledDetail(tuple(octaves), alone if few_links else None, 0.01, end - begin, links)

    once = DetailStatistics.of(part(0, 5000), how)
    joined = SampledDetail.joined([part(*ends) for ends in pairwise(cuts)])
    assert (joined.measured, joined.linked) == (5000, 0 if few_links else 2500)
    pieces = DetailStatistics.of(joined, how)
    at = np.exp(np.linspace(-10, 0, 30))
    for one, other in zip(once.octaves, pieces.octaves, strict=True):
        assert one.of_change == other.of_change and one.noise[0] > 0
        np.testing.assert_array_equal(one.noise, other.noise)
        np.testing.assert_array_equal(one.limit.at(at), other.limit.at(at))
        if one.shown is not None:
            np.testing.assert_array_equal(one.shown.at(at), other.shown.at(at))
            assert 0.6 < one.shown.shown < 0.99  # reduced by what may be chance
    assert pieces.between_views == pytest.approx(0.01)


def test_the_limit_of_texture_is_of_what_all_parts_are_shown():
    """Whatever a part's own reduction of the shading's change was: energies are converted."""
    how, rng = DetailSettings(), np.random.default_rng(3)
    size = rng.uniform(0.01, 0.3, (4000, 1))
    change = rng.normal(0, size, (4000, 50))
    residual = rng.normal(0, 0.05 + 0.5 * size, (4000, 50)) - 0.6 * change
    shown = ShownChange(np.array([-10.0, 0.0]), np.array([-0.6, -0.6]))

    def reduced(excess: float) -> SampledOctave:
        left = residual - excess * change
        means = {"energy": left**2, "product": left * change, "stated": change**2}
        wide = {name: values.mean(axis=1).astype(np.float32) for name, values in means.items()}
        return replace(
            sampled(1, 4000, 0),
            energy=np.repeat(wide["energy"][:, None], 3, axis=1),
            wide_noise=np.zeros((4000, 3), np.float32),
            wide_size=(1 + excess) ** 2 * wide["stated"],
            wide_stated=wide["stated"],
            wide_product=wide["product"],
            wide_excess=np.full(4000, excess, np.float32),
        )

    at = np.exp(np.linspace(-8, -1, 30))
    wanted = reduced(-0.6).limit(0.1, shown, how).at(at)[:, 0]
    for own in (-1.0, -0.2, 0.3):
        np.testing.assert_allclose(reduced(own).limit(0.1, shown, how).at(at)[:, 0], wanted, rtol=1e-3)
    unconverted = reduced(-0.2).limit(0.1, None, how).at(at)[:, 0]
    assert np.abs(np.log(unconverted / wanted)).max() > 0.1


SCENE = {
    "render": {
        "subject": "relief",
        "paint": "masonry",
        "light": "sun_and_sky",
        "views": 6,
        "arc_deg": 100.0,
        "width_px": 72,
        "height_px": 60,
        "noise": 0.05,
        "spacing": 0.016,
    },
    "transfer": {"max_vertices": 4000},
    "lighting": {"samples": 4000, "bounces": 0, "specular": {"remove": False}},
    "correspondence": {"neighbours": 2, "all_up_to": 3},
}


@pytest.fixture(scope="module")
def workspace(tmp_path_factory):
    return tmp_path_factory.mktemp("clusters") / "w"


def decomposed(workspace, pixels, threads=2, **settings):
    """The relief, in clusters of so many pixels: paths of all artefacts, facts of the decomposition."""
    given = SCENE | {"decomposition": {"clusters": {"pixels": pixels}, **settings}}
    done = results_of(stages.experiment({}), {}, given, workspace, "decomposition", threads, Terminal())
    return dict(done.paths), done.facts["decomposition"]


@pytest.fixture(scope="module")
def at_once(workspace):
    return decomposed(workspace, 10**6)


@pytest.fixture(scope="module")
def in_clusters(workspace):
    return decomposed(workspace, 5000)


def maps(paths, kind):
    cameras = read_cameras(paths["cameras"])
    masks = [read_mask(paths["mask"] / f"{camera.name}.png") for camera in cameras]
    return np.concatenate(
        [
            read_exr(paths[kind] / f"{camera.name}.exr")[mask]
            for camera, mask in zip(cameras, masks, strict=True)
        ]
    )


def test_an_opened_cluster_has_its_own_pixels_and_those_of_its_margin(at_once):
    paths, _ = at_once
    cameras = read_cameras(paths["cameras"])
    graph, every = view_graph(paths, cameras), numbered_correspondences(paths["correspondences"], cameras)
    clusters = divided_surface(paths, cameras, graph, ClusterSettings(pixels=5000))
    assert len(clusters) > 2
    owned = {camera.name: 0 for camera in cameras}
    sampled, pixels = [], int(graph.pixels.sum())
    for cluster in clusters:
        opened = open_cluster(paths, cameras, cluster, graph.side)
        surface = [
            surface_points(paths, one, read_mask(paths["mask"] / f"{one.name}.png")) for one in cameras
        ]
        for number, view in enumerate(opened.numbers):
            points, footprints = surface[view]
            near = cluster.reaches(points, footprints) | cluster.owns(points)
            np.testing.assert_array_equal(opened.kept[number], near)
            own = opened.own[opened.stack.view(number)]
            np.testing.assert_array_equal(own, cluster.owns(points)[near])
            owned[cameras[view].name] += cluster.owns(points)
        everything = np.concatenate(opened.kept)
        part = PartOfScene(opened.places(graph), opened.own, pixels, TypicalPixel(1.0, np.ones(3)))
        sampled.append(part.places[part.sampled(3000)])
        whole = np.concatenate(
            [
                read_exr(paths["albedo"] / f"{one.name}.exr")[read_mask(paths["mask"] / f"{one.name}.png")]
                for one in opened.cameras
            ]
        )
        np.testing.assert_array_equal(opened.maps(paths["albedo"]), whole[everything])
        kept = dict(zip(opened.numbers, opened.kept, strict=True))
        links = sum(
            np.count_nonzero(kept[i][block.nonzero()[0]] & kept[j][block.nonzero()[1]])
            for (i, j), block in every.items()
            if i in kept and j in kept
        )
        assert opened.stack.correspondence_count == links
    assert all((counts == 1).all() for counts in owned.values())
    every_one = np.arange(0, pixels, stride(pixels, 3000))  # as of one cluster of all
    np.testing.assert_array_equal(np.sort(np.concatenate(sampled)), every_one)


def test_samples_stand_for_all_pixels_and_boxes_hold_them(at_once):
    paths, _ = at_once
    cameras = read_cameras(paths["cameras"])
    graph, surface = view_graph(paths, cameras), sampled_surface(paths, cameras, 7)
    assert surface.weights.sum() == pytest.approx(graph.pixels.sum())
    assert len(surface.points) == pytest.approx(graph.pixels.sum() / 7, rel=0.01)
    for camera, box in zip(cameras, surface.boxes, strict=True):
        points, _ = surface_points(paths, camera, read_mask(paths["mask"] / f"{camera.name}.png"))
        assert (points >= box[0]).all() and (points <= box[1]).all()


def test_counts_of_links_are_those_of_the_matrices(at_once):
    paths, _ = at_once
    cameras = read_cameras(paths["cameras"])
    counts = CorrespondenceFiles.of(paths["correspondences"], cameras).counts().toarray()
    assert (counts == counts.T).all() and (np.diag(counts) == 0).all()
    for (i, j), block in numbered_correspondences(paths["correspondences"], cameras).items():
        assert counts[i, j] == block.nnz


def test_clusters_give_the_albedo_of_all_views_at_once(at_once, in_clusters):
    (whole, one), (parts, several) = at_once, in_clusters
    assert len(one["clusters"]) == 1 and len(several["clusters"]) > 2
    assert several["pixels"] == one["pixels"] == sum(several["clusters"]) < several["pixels_with_margins"]
    for kind, most in (("albedo", 0.02), ("albedo_tv", 0.03)):  # so few pixels that statistics differ
        own, other = maps(whole, kind), maps(parts, kind)
        extent = np.quantile(own, 0.999) - np.quantile(own, 0.001)
        assert np.sqrt(np.mean((own - other) ** 2)) < most * extent
    assert np.abs(maps(whole, "confidence") - maps(parts, "confidence")).mean() < 0.02


def lit(workspace, pixels, **settings):
    """The relief's light, estimated and applied with at most so many pixels at once."""
    how = {**SCENE["lighting"], "pixels": pixels, "clusters": {"pixels": pixels}, **settings}
    given = SCENE | {"lighting": how}
    done = results_of(stages.experiment({}), {}, given, workspace, "lighting", 2, Terminal())
    return dict(done.paths), done.facts["lighting"]


@pytest.mark.parametrize("gloss", [0.0, 0.4])
def test_further_views_are_lit_as_those_that_the_light_was_found_on(gloss, tmp_path, make_job):
    """All views taken for further ones: shading and data come out as they did, gloss and bounces too."""
    given = SCENE | {"render": {**SCENE["render"], "gloss": gloss, "glossy_parts": []}}
    done = results_of(stages.experiment({}), {}, given, tmp_path / "w", "transfer", 2, Terminal())
    inputs = {name: done.paths[name] for name in LIGHTING.takes}
    how = LightingSettings(samples=4000)
    job, cameras = make_job(tmp_path, LIGHTING, how, **inputs), read_cameras(done.paths["cameras"])
    graph, stored = view_graph(inputs, cameras), read_transfer(done.paths["transfer"])
    short = with_short_edges(read_mesh(done.paths["mesh"]), float(stored.longest_edge))
    files = ViewFiles(inputs, cameras, graph.side, how.trusted_pixels)
    opened = files.open(Cluster.whole(range(6), 0), None)
    scene = Scene(cameras, files, graph, stored, short, how.sun)
    scenes, rays = lighting._scenes(job, opened, scene), scene.rays(cameras, opened.views.masks, 2)
    seen = opened.views.stack, opened.images
    found = find_illumination(*seen, scenes, opened.viewing, how, 2, lambda: None, rays=rays)
    suns = found.explained.scene.suns
    shading, data, _ = further_pixels(
        found.without_pixels(),
        opened.views.stack,
        np.stack(opened.images, axis=1),
        opened.viewing,
        opened.normals,
        scenes[0].pixels.blend,
        rays.see(suns, None, opened.normals),
        found.gains.gains,
    )
    assert len(suns) == 1
    assert (found.specular is not None) == (gloss > 0)
    np.testing.assert_allclose(shading, found.light.shading, rtol=1e-5, atol=1e-7)
    np.testing.assert_allclose(data.observed, found.observations.observed, rtol=1e-5, atol=1e-7)
    np.testing.assert_allclose(data.diffuse, found.observations.diffuse, rtol=1e-5, atol=1e-7)
    np.testing.assert_array_equal(data.trusted, found.observations.trusted)


@examples(deadline=None)  # a loaded machine takes its time
@given(st.integers(2, 60), st.integers(100, 6000))
def test_the_views_that_a_light_is_found_on_have_room_and_come_from_everywhere(views, room):
    graph = street(views)
    parts = parts_of(graph, room)
    chosen = typical_views(graph, room)
    assert list(chosen) == sorted(set(chosen)) and len(chosen) >= min(2, views)
    assert graph.pixels[list(chosen)].sum() <= max(room, 200)
    if graph.pixels.sum() <= room:
        assert chosen == tuple(range(views))
    if 200 * len(parts) <= room:
        assert all(set(part.tolist()) & set(chosen) for part in parts)


def test_a_light_found_on_some_views_is_near_that_of_all(workspace, at_once):
    paths, facts = lit(workspace, 8000)
    assert 2 <= len(facts["light_found_on"]) < 6
    whole, parts = maps(at_once[0], "shading"), maps(paths, "shading")
    assert np.isfinite(parts).all() and (parts >= 0).all()
    scale = (whole * parts).sum(axis=0) / (parts**2).sum(axis=0)
    photo = np.sqrt(np.mean((whole - whole.mean(axis=0)) ** 2))
    assert np.sqrt(np.mean((whole - scale * parts) ** 2)) < 0.5 * photo  # few pixels determine it roughly


def test_beside_what_the_photos_of_all_show_light_has_their_unit(workspace):
    """No reflectance is tried: what the brightest material reflects follows from the light."""
    paths, facts = lit(workspace, 8000, bounces=4)
    assert 2 <= len(facts["light_found_on"]) < 6
    assert facts["brightest"].keys() == {"reflects"}
    true_brightest = np.quantile(maps({**paths, "albedo": paths["truth"] / "albedo"}, "albedo"), 0.98)
    assert 0.7 * true_brightest < facts["brightest"]["reflects"] < 1.4 * true_brightest


@given(st.integers(2, 12), st.integers(0, 5))
def test_gains_come_back_from_pairs_along_a_chain(views, seed):
    rng = np.random.default_rng(seed)
    true = rng.normal(0, 0.3, (views, 3))
    true -= true.mean(axis=0)
    ratios = [
        PairRatio(i, i + 1, true[i] - true[i + 1], np.full(3, rng.integers(50, 500)))
        for i in range(views - 1)
    ]
    np.testing.assert_allclose(log_gains(views, ratios), true, atol=1e-9)


def test_channels_with_too_few_correspondences_have_no_gain():
    ratios = [PairRatio(0, 1, np.array([0.2, 0.4, 0.0]), np.array([80, 80, 0]))]
    np.testing.assert_allclose(log_gains(2, ratios), [[0.1, 0.2, 0], [-0.1, -0.2, 0]], atol=1e-12)


def test_the_energies_of_clusters_are_told_one_by_one(in_clusters):
    paths, facts = in_clusters
    content = json.loads(paths["energy"].read_text(encoding="utf-8"))
    assert len(content["clusters"]) == len(facts["clusters"])
    names = [camera.name for camera in read_cameras(paths["cameras"])]
    assert sorted({name for one in content["clusters"] for name in one["views"]}) == names


def test_clusters_give_the_same_bytes_on_any_number_of_threads(in_clusters, workspace, tmp_path):
    again, _ = decomposed(tmp_path / "w", 5000, threads=1)
    for kind in ("albedo", "confidence"):
        for path in in_clusters[0][kind].iterdir():
            assert path.read_bytes() == (again[kind] / path.name).read_bytes()


@examples(deadline=None)
@given(memory=st.integers(500_000_000, 10**12), pixels=st.integers(1000, 10**8))
def test_less_memory_makes_clusters_smaller_and_more_leaves_them(memory, pixels):
    settings = DecompositionSettings(clusters={"pixels": pixels})
    now = within(settings, memory)
    assert now.clusters.pixels <= pixels
    if now.clusters.pixels < pixels:
        assert within(settings, memory // 2).clusters.pixels <= now.clusters.pixels
        assert now.clusters.pixels * BYTES_PER_PIXEL_OF_CLUSTER <= memory


@pytest.mark.parametrize(
    ("given", "size"),
    [("6GB", 6e9), ("6 gb", 6e9), ("1.5GiB", 1.5 * 2**30), ("600MB", 6e8), ("2000000000", 2e9), ("1T", 1e12)],
)
def test_memory_is_a_size(given, size):
    assert memory_of(Run(memory=given)) == pytest.approx(size)
    assert memory_of(Run()) is None


@pytest.mark.parametrize("given", ["lots", "", "0", "-6GB", "100MB", "6XB", "1e9GB", "9" * 400 + "GB"])
def test_what_is_no_size_of_memory_is_refused(given):
    with pytest.raises(UserError, match=r"--memory is .*expected a size of at least 500 MB"):
        memory_of(Run(memory=given))


def test_the_memory_that_was_given_is_in_the_settings_and_so_in_the_key(tmp_path):
    config = tmp_path / "tiny.yaml"
    config.write_text("render: {views: 2}\n", encoding="utf-8")
    usual, bounded = (
        request_of(Run(config=config, workspace=tmp_path / "w", memory=memory)) for memory in (None, "1GB")
    )
    assert (usual.memory, bounded.memory, bounded.room) == (None, 10**9, 10**9)
    assert usual.room == memory_to_fit(None)  # which local workers share
    of = [request.settings["decomposition"].clusters.pixels for request in (usual, bounded)]
    assert of[1] < of[0]


@pytest.mark.parametrize(
    ("machine", "fits"), [(None, None), (10**8, 5e8), (8 * 10**9, 5.6e9), (15_996_123_000, 11e9)]
)
def test_without_memory_that_was_given_stages_fit_into_most_of_the_machines(machine, fits, monkeypatch):
    monkeypatch.setattr("stages.command.machine.machine_bytes", lambda: machine)
    assert memory_to_fit(memory_of(Run())) == (None if fits is None else pytest.approx(fits))
    assert memory_to_fit(memory_of(Run(memory="3GB"))) == 3 * 10**9


def test_a_small_machine_has_smaller_clusters_and_a_large_one_the_default(tmp_path, monkeypatch):
    config = tmp_path / "tiny.yaml"
    config.write_text("render: {views: 2}\n", encoding="utf-8")
    pixels = []
    for gigabytes in (4, 64):
        monkeypatch.setattr("stages.command.machine.machine_bytes", lambda size=gigabytes: size * 10**9)
        request = request_of(Run(config=config, workspace=tmp_path / "w"))
        assert request.memory is None
        pixels.append(request.settings["decomposition"].clusters.pixels)
    assert (
        pixels[0] * BYTES_PER_PIXEL_OF_CLUSTER < 0.7 * 4e9
        and pixels[1] == DecompositionSettings().clusters.pixels
    )
