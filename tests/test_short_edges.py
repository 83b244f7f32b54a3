"""Large faces are cut until what vertices see tells what faces see; nothing else about the mesh changes."""

from __future__ import annotations

from contextlib import contextmanager
from types import SimpleNamespace

import numpy as np
import pytest

from stages import transfer
from stages.formats.artefacts.camera_file import write_cameras
from stages.formats.artefacts.transfer_file import read_transfer
from stages.formats.meshes.triangle_meshes import Surface, read_mesh, write_mesh
from stages.geometry.decimation.proxy import roughly_decimated, roughness_of, short_edged_with_proxy
from stages.geometry.settings import ProxySettings
from stages.geometry.short_edges import with_short_edges
from stages.geometry.vertex_interpolation import pixels_on_proxy
from stages.photometry.transport.directional_transport import even_directions
from tests.bowls import bowl
from tests.sphere_scene import camera_looking_at_origin

PROXY = ProxySettings()
TETRAHEDRON = Surface(
    np.array([[0.0, 0, 0], [3, 0, 0], [0.5, 2, 0], [1, 0.3, 5]]),
    np.array([[0, 2, 1], [0, 1, 3], [1, 2, 3], [2, 0, 3]], np.int32),
)


def square(side: float, height: float) -> Surface:
    """Two triangles that look up."""
    half = side / 2
    corners = [[-half, -half, height], [half, -half, height], [half, half, height], [-half, half, height]]
    return Surface(np.array(corners), np.array([[0, 1, 2], [0, 2, 3]], np.int32))


def together(*surfaces: Surface) -> Surface:
    first = np.cumsum([0, *(len(surface.vertices) for surface in surfaces)])
    faces = [surface.faces + begin for surface, begin in zip(surfaces, first, strict=False)]
    return Surface(
        np.concatenate([surface.vertices for surface in surfaces]), np.concatenate(faces).astype(np.int32)
    )


def edges(surface: Surface) -> np.ndarray:
    """Their ends, (3 F, 2), sorted."""
    ends = np.stack([surface.faces, np.roll(surface.faces, -1, axis=1)], axis=2)
    return np.sort(ends.reshape(-1, 2), axis=1)


def lengths(surface: Surface) -> np.ndarray:
    ends = surface.vertices[edges(surface)]
    return np.linalg.norm(ends[:, 1] - ends[:, 0], axis=1)


def twice_areas(surface: Surface) -> np.ndarray:
    """Vectors along the faces' normals, (F, 3)."""
    a, b, c = (surface.vertices[surface.faces[:, corner]] for corner in range(3))
    return np.cross(b - a, c - a)


def places(surface: Surface, faces: np.ndarray, uv: np.ndarray) -> np.ndarray:
    shares = np.column_stack([1 - uv.sum(axis=1), uv])
    return np.einsum("nc,nck->nk", shares, surface.vertices[surface.faces[faces]])


def some_points(surface: Surface, count: int = 2000) -> tuple[np.ndarray, np.ndarray]:
    rng = np.random.default_rng(1)
    return rng.integers(0, len(surface.faces), count), rng.dirichlet([1, 1, 1], count)[:, 1:]


def test_no_edge_stays_too_long_and_no_crack_opens():
    short = with_short_edges(TETRAHEDRON, 0.3)
    assert short.longest == 0.3
    assert 0.1 < lengths(short.surface).max() <= 0.3
    ends, faces_of_edge = np.unique(edges(short.surface), axis=0, return_counts=True)
    assert (faces_of_edge == 2).all()
    assert len(short.surface.vertices) - len(ends) + len(short.surface.faces) == 2


def test_the_surface_itself_stays_where_it_is_and_looks_the_same_way():
    short = with_short_edges(TETRAHEDRON, 0.3)
    faces, uv = some_points(TETRAHEDRON)
    (new_faces,), (new_uv,) = short.carried([faces], [uv])
    assert np.allclose(places(short.surface, new_faces, new_uv), places(TETRAHEDRON, faces, uv), atol=1e-9)
    assert new_uv.min() >= 0 and new_uv.sum(axis=1).max() <= 1 + 1e-9
    assert len(np.unique(new_faces)) > len(short.surface.faces) / 4
    one_way, whole = twice_areas(short.surface)[new_faces], twice_areas(TETRAHEDRON)[faces]
    assert (np.einsum("nk,nk->n", one_way, whole) > 0).all()
    area = np.linalg.norm(twice_areas(short.surface), axis=1).sum()
    assert area == pytest.approx(np.linalg.norm(twice_areas(TETRAHEDRON), axis=1).sum())


def test_points_stay_with_their_views():
    short = with_short_edges(TETRAHEDRON, 0.5)
    faces, uv = some_points(TETRAHEDRON)
    parts = [slice(0, 700), slice(700, 700), slice(700, 2000)]
    views = short.carried([faces[part] for part in parts], [uv[part] for part in parts])
    (whole,), (of_whole,) = short.carried([faces], [uv])
    assert [len(view) for view in views[0]] == [700, 0, 1300]
    assert np.array_equal(np.concatenate(views[0]), whole)
    assert np.array_equal(np.concatenate(views[1]), of_whole)


def test_a_mesh_of_short_edges_is_left_alone():
    surface = bowl(0.5)
    short = with_short_edges(surface, 10.0)
    assert short.surface is surface
    faces, uv = some_points(surface)
    (same_faces,), (same_uv,) = short.carried([faces], [uv])
    assert same_faces is faces and same_uv is uv


def test_where_there_would_be_too_many_vertices_all_edges_stay_longer():
    everything = with_short_edges(TETRAHEDRON, 0.1)
    most = len(everything.surface.vertices) // 3
    some = with_short_edges(TETRAHEDRON, 0.1, most)
    assert most / 4 < len(some.surface.vertices) <= most
    assert 0.1 < lengths(some.surface).max() <= some.longest < 0.3
    again = with_short_edges(TETRAHEDRON, some.longest)
    assert np.array_equal(again.surface.faces, some.surface.faces)
    assert np.array_equal(again.surface.vertices, some.surface.vertices)


def test_what_decimation_has_made_large_is_cut_again():
    """A floor with one bump in it: nearly all of the faces that are kept lie there."""
    flat = with_short_edges(square(2.0, 0.0), 0.02).surface
    away = np.linalg.norm(flat.vertices[:, :2], axis=1)
    bump = np.exp(-((away / 0.2) ** 2)) + 1e-4 * np.random.default_rng(2).normal(size=len(away))
    floor = Surface(flat.vertices + bump[:, None] * [0, 0, 0.3], flat.faces)
    _, uncut = short_edged_with_proxy(floor, 10.0, 2000, PROXY)
    assert lengths(uncut).max() > 0.15
    _, proxy = short_edged_with_proxy(floor, 0.1, 2000, PROXY)
    assert lengths(proxy).max() <= 0.1 and len(proxy.vertices) <= 3000


def test_a_fine_flat_floor_is_decimated_to_faces_of_even_size():
    floor = with_short_edges(square(2.0, 0.0), 0.02).surface
    small = roughly_decimated(floor, len(floor.faces) // 16, PROXY)
    assert len(small.faces) <= len(floor.faces) // 16
    assert lengths(small).max() < 12 * lengths(floor).mean()
    up = twice_areas(small)[:, 2]
    assert (up > 0).all() and up.sum() / 2 == pytest.approx(4.0, rel=0.01)


def test_decimation_knows_no_units():
    """A thousand times as large, as a mesh in millimetres is, it is the same mesh."""
    hollow = with_short_edges(bowl(0.7), 0.03).surface
    small = roughly_decimated(hollow, 1000, PROXY)
    large = roughly_decimated(Surface(1024 * hollow.vertices, hollow.faces), 1000, PROXY)
    assert 900 < len(small.faces) <= 1000 and np.array_equal(large.faces, small.faces)
    assert np.allclose(large.vertices, 1024 * small.vertices, atol=0, rtol=1e-9)
    off, its_own = (np.abs(np.linalg.norm(one.vertices, axis=1) - 1).max() for one in (small, hollow))
    assert off < 1.1 * its_own  # facets are cut where they are: inside of the sphere


def test_a_mesh_that_is_not_too_large_is_cut_and_not_decimated():
    """Though with the halves of the floor's faces it has more vertices than a mesh may have uncut."""
    both = together(bowl(0.5), square(4.0, -0.6))
    most = len(both.vertices) + 1
    short, proxy = short_edged_with_proxy(both, 0.2, most, PROXY)
    assert proxy is short.surface
    assert most < len(proxy.vertices) <= most + most // 2
    assert np.array_equal(proxy.vertices[: len(both.vertices)], both.vertices)


def test_rays_begin_no_nearer_to_halves_of_faces_than_to_whole_ones():
    """Facets of a coarse bowl hide as much of the sky from each other when they are cut."""
    coarse = bowl(0.5)
    _, halves = short_edged_with_proxy(coarse, lengths(coarse).mean() / 4, 10**6, PROXY)
    assert lengths(halves).mean() < lengths(coarse).mean() / 2
    assert roughness_of(coarse, halves, longest_edge=1.0) == roughness_of(coarse, coarse, longest_edge=1.0)


def test_rays_begin_near_a_floor_of_two_triangles():
    """Mean edges of what is mostly floor tell nothing of how rough the rest is."""
    floor = square(4.0, 0.0)
    _, halves = short_edged_with_proxy(floor, 0.1, 10**6, PROXY)
    assert roughness_of(floor, halves, longest_edge=0.1) == 0.1


def test_a_floor_of_two_triangles_knows_what_is_above_it(tmp_path):
    """A plate over its middle hides the sky there, and not at the floor's rim."""
    write_mesh(tmp_path / "mesh.ply", together(square(4.0, 0.0), square(1.0, 0.4)))
    run_transfer(tmp_path)
    stored = read_transfer(tmp_path / "transfer.npz")
    faces = np.array([0, 0, 1])
    uv = np.array([[0.0, 0.5], [0.5, 0.02], [0.48, 0.02]])  # the middle; near the rim; nearly the middle
    blend = pixels_on_proxy(stored, read_mesh(tmp_path / "mesh.ply"), ([faces], [uv]))
    upwards = int(np.argmax(even_directions(64)[:, 2]))
    sees_up = blend @ np.unpackbits(stored.visible[0], axis=1)[:, upwards].astype(np.float32)
    assert sees_up.tolist() == pytest.approx([0, 1, 0], abs=1e-5)


def run_transfer(folder) -> None:
    """The stage on `mesh.ply` of a folder, as its runner calls it."""

    @contextmanager
    def progress(_label, _steps):
        yield lambda: None

    write_cameras(
        folder / "cameras.json", [camera_looking_at_origin("0", np.array([3.0, 0, 1]), 40, 30, 40.0)]
    )
    transfer.run(
        SimpleNamespace(
            settings=transfer.TransferSettings(directions=16, sky_directions=64),
            inputs={"mesh": folder / "mesh.ply", "cameras": folder / "cameras.json"},
            outputs={"transfer": folder / "transfer.npz"},
            threads=1,
            executor=None,
            progress=progress,
            note=lambda **_: None,
        )
    )
