"""Refinement of the mesh by the agreement of the photos: laws of its parts, truth on a relief of our own."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import open3d as o3d
import pytest
import scipy.sparse as sp

import stages
from benchmarks.paper.laboratory import results_of
from pipeline.command.terminal import Terminal
from pipeline.config import check_settings
from stages import additions
from stages.formats.artefacts.camera_file import write_cameras
from stages.formats.meshes.triangle_meshes import Surface, from_open3d, read_mesh
from stages.geometry.rays import RayCaster, face_normals, vertex_normals
from stages.refine import REFINE
from stages.scene.cameras import Camera, back_project
from stages.solvers.kernels.unit_vectors import as_unit
from stages.stereo.refinement.compared_photos import Photo, _projection, _rays, _seen_by_other, radiance
from stages.stereo.refinement.displacement import HeightModel, NormalEquations, PixelEquations, Roughness
from stages.stereo.refinement.folds import without_folds
from stages.stereo.refinement.refined_surface import refine, widest_relief
from stages.stereo.refinement.settings import RefineSettings, RoughnessSettings
from stages.stereo.refinement.slivers import without_slivers
from stages.stereo.refinement.vertex_order import ordered_by_neighbours
from stages.stereo.refinement.vertex_rings import VertexRings
from stages.stereo.refinement.view_pairs import sources_of_views
from stages.synthetic.views import look_at

WIDTH, HEIGHT, FOCAL = 160, 120, 150.0
SETTINGS = RefineSettings()
SLIVERS = SETTINGS.slivers


def grid(side: int, height) -> Surface:
    """Mesh the square from −1 to 1 at a height, facing z."""
    x, y = np.meshgrid(np.linspace(-1, 1, side), np.linspace(-1, 1, side))
    vertices = np.stack([x, y, height(x, y)], axis=-1).reshape(-1, 3)
    corner = np.arange(side * side).reshape(side, side)[:-1, :-1].ravel()
    lower = np.stack([corner, corner + 1, corner + side + 1], axis=1)
    upper = np.stack([corner, corner + side + 1, corner + side], axis=1)
    return Surface(vertices, np.concatenate([lower, upper]).astype(np.int32))


def flat(x, y):
    return np.zeros_like(x)


def relief(x, y):
    return 0.02 * np.sin(14 * x) * np.cos(11 * y)


def paint(points: np.ndarray) -> np.ndarray:
    """Colour by waves of many lengths and directions: texture at every scale, (…, 3)."""
    rng = np.random.default_rng(5)
    waves = rng.normal(size=(60, 2)) * rng.uniform(5, 70, (60, 1))
    total = np.sin(points[..., :2] @ waves.T + rng.uniform(0, 7, 60)).sum(axis=-1) / 60
    return np.repeat(np.exp(1.2 * total)[..., None], 3, axis=-1) * 0.4


def cameras(count: int = 5) -> list[Camera]:
    intrinsics = np.array([[FOCAL, 0, WIDTH / 2], [0, FOCAL, HEIGHT / 2], [0, 0, 1.0]])
    found = []
    for number in range(count):
        angle = np.deg2rad(18) * (number - (count - 1) / 2)
        centre = np.array([2.0 * np.sin(angle), 0.3 + 0.4 * (number % 2), 2.0 * np.cos(angle)])
        found.append(Camera(f"{number}", WIDTH, HEIGHT, intrinsics, look_at(centre, np.zeros(3))))
    return found


def photographs(surface: Surface, views: list[Camera], noise: float = 0.0, even: bool = False):
    """Render linear photos, (h, w, 3), by camera name; paint is averaged over nine rays of a pixel."""
    caster, photos = RayCaster(surface), {}
    for number, camera in enumerate(views):
        large = camera.scaled(3 * WIDTH, 3 * HEIGHT)
        seen = caster.see(large)
        colours = np.where(seen.mask[..., None], paint(back_project(large, seen.depth)), 0.0)
        colours = np.where(seen.mask[..., None], 0.4, 0.0) * np.ones(3) if even else colours
        image = colours.reshape(HEIGHT, 3, WIDTH, 3, 3).mean(axis=(1, 3))
        rng = np.random.default_rng(number)
        photos[camera.name] = np.maximum(image + noise * rng.normal(size=image.shape), 0).astype(np.float32)
    return photos


def refined(given: Surface, views: list[Camera], photos, settings=SETTINGS, kept=None, threads=1):
    """The last round's result."""

    def read(camera: Camera) -> np.ndarray:
        side = WIDTH // camera.width
        blocks = photos[camera.name].reshape(camera.height, side, camera.width, side, 3)
        mask = np.ones(camera.shape, bool) if kept is None else kept[::side, ::side]
        return radiance(blocks.mean(axis=(1, 3)), mask, settings.errors)

    sources = sources_of_views(given, views, settings.neighbours, settings.pairs, 1)
    widest = widest_relief(given, views, settings)
    return list(refine(given, widest, views, sources, read, settings, threads))[-1]


def angles_deg(surface: Surface, truth: Surface) -> np.ndarray:
    """Angles between normals of vertices that lie well inside."""
    inside = (np.abs(truth.vertices[:, :2]) < 0.6).all(axis=1)
    own, true = (vertex_normals(one.vertices, one.faces)[inside] for one in (surface, truth))
    return np.rad2deg(np.arccos(np.clip(np.einsum("vk,vk->v", own, true), -1, 1)))


def test_rings_are_the_umbrella_operator():
    surface = grid(6, flat)
    count = len(surface.vertices)
    rings = VertexRings.of(surface.faces, count + 1)  # the last vertex is in no face
    adjacent = np.zeros((count + 1, count + 1))
    for a, b, c in surface.faces:
        for one, other in ((a, b), (b, c), (c, a)):
            adjacent[one, other] = adjacent[other, one] = 1
    degree = adjacent.sum(axis=1)
    umbrella = np.diag(degree > 0) - adjacent / np.maximum(degree, 1)[:, None]
    rng = np.random.default_rng(0)
    values, weights = rng.normal(size=count + 1), rng.uniform(size=count + 1)
    np.testing.assert_allclose(rings.curvature(values), umbrella @ values, atol=1e-12)
    np.testing.assert_allclose(rings.transposed_curvature(values), umbrella.T @ values, atol=1e-12)
    squared = umbrella.T @ np.diag(weights) @ umbrella
    np.testing.assert_allclose(rings.squared_curvature(weights, values), squared @ values, atol=1e-12)
    np.testing.assert_allclose(rings.squared_curvature_diagonal(weights), np.diag(squared), atol=1e-12)


def test_ordering_by_neighbours_keeps_the_surface_and_brings_neighbours_together():
    rng = np.random.default_rng(3)
    given = grid(40, relief)
    mixed = rng.permutation(len(given.vertices)).astype(np.int32)
    faces = rng.permutation(np.argsort(mixed).astype(np.int32)[given.faces])
    shuffled = Surface(given.vertices[mixed], faces)
    ordered = ordered_by_neighbours(shuffled)

    def triangles(surface: Surface) -> np.ndarray:
        return np.unique(surface.vertices[surface.faces].reshape(-1, 9), axis=0)

    def apart(surface: Surface) -> int:
        return int(np.ptp(surface.faces, axis=1).max())

    np.testing.assert_array_equal(triangles(shuffled), triangles(ordered))
    assert apart(ordered) <= 2 * 40 < 10 * 80 < apart(shuffled)


def scattered(surface: Surface, share: float) -> Surface:
    """Move the inner vertices of a grid sideways, by up to a share of its spacing."""
    side = int(np.sqrt(len(surface.vertices)))
    inner = np.zeros((side, side), bool)
    inner[1:-1, 1:-1] = True
    way = np.random.default_rng(8).uniform(-1, 1, (inner.sum(), 2)) * share * 2 / (side - 1)
    vertices = surface.vertices.copy()
    vertices[inner.ravel(), :2] += way
    return Surface(vertices, surface.faces)


def lowest(surface: Surface) -> np.ndarray:
    """Compute the smallest height of each triangle over its longest edge, (F,)."""
    edges = np.diff(surface.vertices[surface.faces[:, [0, 1, 2, 0]]], axis=1)
    double_area = np.linalg.norm(face_normals(surface.vertices, surface.faces), axis=1)
    return double_area / np.max(np.sum(edges**2, axis=2), axis=1)


def test_vertices_of_slivers_are_spaced_evenly_on_their_surface():
    given = scattered(grid(40, flat), 0.45)
    spaced = without_slivers(given, SLIVERS)
    assert np.quantile(lowest(given), 0.01) < 0.05
    assert np.quantile(lowest(spaced), 0.01) > 0.2
    assert (face_normals(spaced.vertices, spaced.faces)[:, 2] > 0).all()
    border = np.abs(given.vertices[:, :2]).max(axis=1) == 1
    np.testing.assert_array_equal(spaced.vertices[border], given.vertices[border])
    np.testing.assert_allclose(spaced.vertices[:, 2], 0, atol=1e-12)
    np.testing.assert_array_equal(
        without_slivers(given, SLIVERS.model_copy(update={"steps": 0})).vertices, given.vertices
    )


def test_a_mesh_without_slivers_stays_as_it_is():
    given = scattered(grid(40, relief), 0.1)
    np.testing.assert_array_equal(without_slivers(given, SLIVERS).vertices, given.vertices)


def test_vertices_of_slivers_stay_on_a_curved_surface():
    sphere = o3d.geometry.TriangleMesh.create_sphere(1.0, resolution=40)
    given = from_open3d(sphere)
    spaced = without_slivers(given, SLIVERS)
    edge = np.pi / 40
    off = np.abs(np.linalg.norm(spaced.vertices, axis=1) - 1)
    assert np.abs(spaced.vertices - given.vertices).max() > 0.25 * edge  # towards the equator, from the poles
    assert np.quantile(off, 0.99) < 0.05 * edge


def test_slivers_at_a_seam_stay_closed():
    given = scattered(grid(20, flat), 0.45)
    column = np.arange(400) % 20 == 10
    copies = np.arange(400)
    copies[column] = 400 + np.arange(20)
    right = (given.faces % 20).max(axis=1) > 10
    faces = np.where(right[:, None], copies[given.faces], given.faces).astype(np.int32)
    cut = Surface(np.concatenate([given.vertices, given.vertices[column]]), faces)
    spaced, whole = without_slivers(cut, SLIVERS), without_slivers(given, SLIVERS)
    np.testing.assert_allclose(spaced.vertices[:400], whole.vertices, atol=1e-12)
    np.testing.assert_array_equal(spaced.vertices[400:], spaced.vertices[:400][column])


def test_relief_turns_no_slivers_over():
    """A mesh of marching cubes has slivers: refined as it is, some of them lie on their backs."""
    views, truth, given = cameras(), grid(60, relief), scattered(grid(60, flat), 0.45)
    photos = photographs(truth, views)

    def turned_over(surface: Surface) -> int:
        normals = face_normals(surface.vertices, surface.faces)
        return int(np.sum(normals[:, 2] < 0))

    spaced = without_slivers(given, SLIVERS)
    assert turned_over(refined(given, views, photos).surface) > 5
    assert turned_over(refined(spaced, views, photos).surface) == 0


def test_normal_equations_are_those_of_their_pixels():
    surface = grid(5, flat)
    rings, rng = VertexRings.of(surface.faces, 25), np.random.default_rng(1)
    faces = rng.integers(0, len(surface.faces), 200)
    shares, curvature, slope = rng.uniform(size=(200, 3)), rng.uniform(size=200), rng.normal(size=200)
    equations = NormalEquations.none(rings)
    corners = surface.faces[faces]
    edges = rings.edges_of_faces[faces]
    equations.add(PixelEquations(corners, edges, shares, curvature, slope, np.ones(200)))
    rise = sp.coo_array((shares.ravel(), (np.arange(200).repeat(3), corners.ravel())), (200, 25)).tocsr()
    values = rng.normal(size=25)
    product = rings.product(equations.diagonal, equations.of_edges[rings.edges], values)
    np.testing.assert_allclose(product, rise.T @ (curvature * (rise @ values)), rtol=1e-10)
    np.testing.assert_allclose(equations.slope, rise.T @ slope, rtol=1e-10)
    np.testing.assert_allclose(equations.sample, rise.T @ np.sqrt(curvature), rtol=1e-10)


def test_samples_have_the_variance_that_the_photos_leave_open():
    surface = grid(7, flat)
    rings, count = VertexRings.of(surface.faces, 49), 49
    rng = np.random.default_rng(2)
    diagonal = rng.uniform(0.5, 2, count)
    model = HeightModel(
        rings,
        NormalEquations(diagonal, np.zeros(rings.edge_count), np.zeros(count), np.zeros(count)),
        Roughness(3.0, rng.uniform(0.5, 1.5, count), 2.0),
        SETTINGS,
    )
    samples = [
        replace(
            model, equations=replace(model.equations, sample=np.sqrt(diagonal) * rng.normal(size=count))
        ).sample(np.random.default_rng([4, k]))
        for k in range(4000)
    ]
    umbrella = np.stack([rings.curvature(one) for one in np.eye(count)], axis=1)
    system = (
        np.diag(diagonal + SETTINGS.hold + 3.0 * model.roughness.weights / 2.0**4)
        + 3.0 * umbrella.T @ np.diag(model.roughness.weights) @ umbrella
    )
    np.testing.assert_allclose(np.var(samples, axis=0), np.diag(np.linalg.inv(system)), rtol=0.12)


def test_roughness_is_found_from_heights_that_are_known():
    surface = grid(60, flat)
    rings = VertexRings.of(surface.faces, 3600)
    heights = np.random.default_rng(3).normal(size=3600)
    rough, nothing_open, known = Roughness(1.0, np.ones(3600), np.inf), np.zeros(3600), np.ones(3600, bool)
    alike = RoughnessSettings(tail=1e9)
    for _ in range(9):
        rough = rough.measured(rings, heights, nothing_open, known, alike)
    assert rough.stiffness == pytest.approx(1 / np.mean(rings.curvature(heights) ** 2), rel=1e-6)
    np.testing.assert_allclose(rough.weights, 1, rtol=1e-6)


def test_faces_do_not_fold():
    surface = grid(20, flat)
    up = np.tile([0, 0, 1.0], (400, 1))
    up_faces = np.tile([0, 0, 1.0], (len(surface.faces), 1))
    heights = np.random.default_rng(4).normal(0, 0.01, 400)
    np.testing.assert_array_equal(without_folds(surface, up_faces, up, heights, SETTINGS.folds), heights)
    heights[210] = 0.6  # six edges: faces around it stand up
    smoother = without_folds(surface, up_faces, up, heights, SETTINGS.folds)
    normals = face_normals(surface.vertices + smoother[:, None] * up, surface.faces)
    turned = np.rad2deg(np.arccos(normals[:, 2] / np.linalg.norm(normals, axis=1)))
    assert turned.max() < SETTINGS.folds.largest_turn_deg
    changed = np.flatnonzero(smoother != heights)
    assert 210 in changed
    assert len(changed) < 20


def test_a_groove_whose_walls_would_meet_is_as_shallow_as_it_may_be():
    """Its normals meet: heights that are all alike fold it, and averages of them as well."""
    given = grid(41, lambda x, y: 0.15 * np.abs(x))
    directions = vertex_normals(given.vertices, given.faces).astype(np.float64)
    heights = np.where(np.abs(given.vertices[:, 0]) < 0.2, 1.5, 0.0)
    facing = as_unit(face_normals(given.vertices, given.faces))

    def turned(heights: np.ndarray) -> int:
        moved = given.vertices + heights[:, None] * directions
        cosine = np.sum(as_unit(face_normals(moved, given.faces)) * facing, axis=1)
        return int(np.sum(cosine < np.cos(np.deg2rad(SETTINGS.folds.largest_turn_deg))))

    assert turned(heights) > 100
    assert turned(without_folds(given, facing, directions, heights, SETTINGS.folds)) == 0


def test_what_is_read_again_is_the_same():
    views, truth, given = cameras(), grid(60, relief), grid(60, flat)
    photos = photographs(truth, views)
    how = SETTINGS.model_copy(update={"neighbours": 2, "rounds": 1})
    held, again = (
        refined(given, views, photos, how.model_copy(update={"most_pixels": pixels})).surface.vertices
        for pixels in (10**9, 1)
    )
    np.testing.assert_array_equal(held, again)


def test_photos_compared_at_once_give_the_same_surface():
    views, truth, given = cameras(), grid(60, relief), grid(60, flat)
    photos = photographs(truth, views)
    how = SETTINGS.model_copy(update={"neighbours": 2, "rounds": 1})
    alone, together = (refined(given, views, photos, how, threads=threads) for threads in (1, 2))
    np.testing.assert_array_equal(alone.surface.vertices, together.surface.vertices)
    assert alone.noise == together.noise


def seen_by_other(one: Photo, other: Photo, spread: float = 0.0):
    """Interpolate a photo of a plane that faces z at another's pixels: values, and changes by height."""
    up = np.broadcast_to(np.array([0, 0, 1.0]), (*one.radiance.shape, 3)).copy()
    depth = np.where(np.isfinite(one.radiance), one.hits.depth, 0)
    theirs = *_projection(other.camera), other.hits.depth, other.radiance
    return _seen_by_other(*_rays(one.camera), depth, up, *theirs, 4.0, 0.2, spread)


def test_what_another_photo_shows_changes_with_the_surface_as_is_said():
    views = cameras(3)
    surface = grid(80, flat)
    photos = photographs(surface, views)
    values = {c.name: radiance(photos[c.name], np.ones(c.shape, bool), SETTINGS.errors) for c in views}

    def differences(height: float):
        caster = RayCaster(grid(2, lambda x, y: np.full_like(x, height)))
        one, other = (Photo(c, values[c.name], caster.hits(c, 1)) for c in (views[0], views[2]))
        return seen_by_other(one, other)

    step = 1e-3
    (below, _), (_, change), (above, _) = (differences(by * step) for by in (-1, 0, 1))
    measured = (above - below) / (2 * step)
    there = np.isfinite(measured) & (np.abs(change) > 0)
    assert there.sum() > 3000
    assert np.corrcoef(measured[there], change[there])[0, 1] > 0.99
    assert np.median(measured[there] / change[there]) == pytest.approx(1, abs=0.02)


def test_photos_that_blur_a_surface_otherwise_are_compared_as_if_they_blurred_it_alike():
    """One camera looks straight, the other at a slant: each averages over its own pixels."""
    spread = (1 - 1 / 9) / 12  # of the three rays a side that `photographs` averages

    def photo(eye: tuple[float, float, float]) -> Photo:
        looking = look_at(np.array(eye), np.zeros(3))
        camera = Camera("one", WIDTH, HEIGHT, cameras(1)[0].intrinsics, looking)
        hits = RayCaster(grid(2, flat)).hits(camera, 1)
        image = photographs(grid(2, flat), [camera])["one"]
        return Photo(camera, radiance(image, hits.mask, SETTINGS.errors), hits)

    straight, slanted = photo((0, 0.01, 0.5)), photo((0.4, 0.01, 0.3))
    for one, other, least in ((straight, slanted, 0.6), (slanted, straight, 0.95)):
        as_it_is, alike = (seen_by_other(one, other, by)[0] for by in (0.0, spread))
        white = np.nanmedian(alike / one.radiance)
        there = np.isfinite(alike)
        assert there.sum() > 3000
        missing, added = (one.radiance * white - as_it_is)[there], (alike - as_it_is)[there]
        assert np.corrcoef(missing, added)[0, 1] > least  # to sharpen is harder than to blur
        assert missing @ added == pytest.approx(added @ added, rel=0.1)


@pytest.mark.parametrize("noise", [0.0, 0.004])
def test_relief_that_the_mesh_lacks_is_found(noise):
    views, truth, given = cameras(), grid(120, relief), grid(120, flat)
    found = refined(given, views, photographs(truth, views, noise)).surface
    before, after = angles_deg(given, truth), angles_deg(found, truth)
    assert np.median(after) < 0.45 * np.median(before), (np.median(before), np.median(after))


def test_a_mesh_that_is_exact_stays_where_it_is():
    views, truth = cameras(), grid(120, relief)
    last = refined(truth, views, photographs(truth, views, 0.01))
    assert last.moved < 0.2
    assert np.median(angles_deg(last.surface, truth)) < 1.5


def test_a_mesh_that_is_cut_at_a_seam_stays_closed():
    views, truth, given = cameras(), grid(60, relief), grid(60, flat)
    row = np.flatnonzero(np.isclose(given.vertices[:, 0], given.vertices[30, 0]))
    copies = np.arange(len(given.vertices))
    copies[row] = len(given.vertices) + np.arange(len(row))
    right = (given.vertices[given.faces, 0].mean(axis=1) > given.vertices[30, 0])[:, None]
    cut = Surface(
        np.concatenate([given.vertices, given.vertices[row]]),
        np.where(right, copies[given.faces], given.faces),
    )
    found = refined(cut, views, photographs(truth, views)).surface
    np.testing.assert_array_equal(found.vertices[row], found.vertices[len(given.vertices) :])
    assert np.abs(found.vertices - cut.vertices).max() > 0.005


def test_a_mesh_that_is_inside_out_is_refined_too():
    views, truth, given = cameras(), grid(60, relief), grid(60, flat)
    photos = photographs(truth, views)
    inside_out = Surface(given.vertices, given.faces[:, ::-1].copy())
    one, other = (refined(mesh, views, photos).surface for mesh in (given, inside_out))
    np.testing.assert_allclose(one.vertices, other.vertices, atol=1e-3)


def test_photos_without_texture_hardly_move_anything():
    views, given = cameras(), grid(60, flat)
    last = refined(given, views, photographs(given, views, 0.0, even=True))
    inside = (np.abs(given.vertices[:, :2]) < 0.8).all(axis=1)
    step = 2.0 / FOCAL
    assert np.abs(last.surface.vertices[inside, 2]).max() < 0.2 * step


def test_a_view_alone_moves_nothing():
    views, given = cameras(1), grid(40, flat)
    last = refined(given, views, photographs(grid(40, relief), views))
    np.testing.assert_array_equal(last.surface.vertices, given.vertices)
    assert last.known == 0


def test_pixels_that_are_not_kept_are_not_compared():
    views, truth, given = cameras(), grid(120, relief), grid(120, flat)
    photos, kept = photographs(truth, views), np.ones((HEIGHT, WIDTH), bool)
    kept[:, : WIDTH // 2] = False
    for image in photos.values():
        image[:, : WIDTH // 2] = 7.0  # something in front of the wall
    found = refined(given, views, photos, kept=kept)
    assert found.known < 0.8
    assert np.median(angles_deg(found.surface, truth)) < 0.9 * np.median(angles_deg(given, truth))


def test_all_stages_behind_it_take_its_mesh_and_none_before():
    plain = additions.with_texture(stages.dataflow(["images", "colmap", "mesh_file"]))
    shaded = additions.with_shading_normals(plain)
    flow = {stage.name: stage for stage in additions.with_report(additions.with_refinement(shaded))}
    for name in ("raycast", "transfer", "shading_normals", "texture"):
        assert "refined_mesh" in flow[name].takes, name
        assert "mesh" not in flow[name].takes, name
    assert "mesh" in flow["refine"].takes
    assert "mesh_file" not in flow["texture"].may_take
    shown = [one.name for stage in flow.values() for one in stage.gives if one.output == "mesh.ply"]
    assert shown == ["refined_mesh"]


@pytest.mark.parametrize(
    ("given", "settings", "refined"),
    [
        (["images"], {}, True),
        (["images", "colmap"], {}, True),
        (["images", "colmap", "points_file"], {}, True),
        (["images", "colmap", "mesh_file"], {}, False),
        (["images", "colmap", "mesh_file"], {"refine": {"refine": True}}, True),
        (["images"], {"refine": {"refine": False}}, False),
        (["images"], {"decomposition": {"mode": "paper"}}, False),
    ],
)
def test_a_mesh_that_is_made_here_is_refined_unasked(given, settings, refined):
    checked = check_settings({stage.name: stage.settings for stage in stages.ALL_STAGES}, settings)
    flow = stages.dataflow(given, stages.kind_of_light(checked, given))
    names = [stage.name for stage in additions.as_asked_for(flow, checked)]
    assert ("refine" in names) == refined
    assert "refine" not in names or names.index("refine") + 1 == names.index("raycast")


def test_less_memory_lets_it_divide_less_and_hold_fewer_views():
    tight = REFINE.within(SETTINGS, 2 * 10**9)
    assert tight.most_vertices < SETTINGS.most_vertices
    assert tight.most_pixels < SETTINGS.most_pixels
    assert REFINE.within(SETTINGS, 10**12) == SETTINGS
    assert REFINE.within(SETTINGS, 1).most_vertices == 1000


def test_as_many_photos_are_compared_at_once_as_there_are_threads_views_and_memory_for():
    sizes = [2_000_000] * 10
    assert SETTINGS.photos_at_once(sizes, 4) == 4
    assert SETTINGS.photos_at_once(sizes, 64) == 10
    tight = REFINE.within(SETTINGS, 4 * 10**9)
    assert 1 <= tight.photos_at_once(sizes, 64) < 4
    assert REFINE.within(SETTINGS, 1).photos_at_once(sizes, 64) == 1
    assert SETTINGS.photos_at_once([], 2) == 1


def test_memory_is_estimated_from_its_mesh(tmp_path):
    flow = {stage.name: stage for stage in additions.with_refinement(stages.dataflow(["images"]))}
    (tmp_path / "mesh.ply").write_bytes(bytes(5_000_000))
    write_cameras(tmp_path / "cameras.json", cameras())
    transfer = flow["transfer"]
    inputs = {"refined_mesh": tmp_path / "mesh.ply", "cameras": tmp_path / "cameras.json"}
    assert transfer.memory(transfer.settings(), inputs, 2) > 0


def test_a_rendered_scene_with_a_smoothed_mesh(tmp_path):
    scene = {
        "render": {"views": 4, "width_px": 64, "height_px": 64, "spacing": 0.05, "paint": "masonry"},
        "known_geometry": {"smoothing": 3},
        "refine": {"refine": True, "scales": (1,), "rounds": 2},
    }
    flow = additions.with_refinement(stages.experiment({}))
    done = [
        results_of(flow, {}, scene, tmp_path / f"w{threads}", "raycast", threads, Terminal())
        for threads in (1, 2)
    ]
    one, two = (results.paths["refined_mesh"].read_bytes() for results in done)
    assert one == two
    mesh = read_mesh(done[0].paths["refined_mesh"])
    assert np.isfinite(mesh.vertices).all()
    assert done[0].facts["refine"]["vertices"] == len(mesh.vertices)
    assert done[0].facts["refine"]["known"] > 0.3
