"""Light from all around: what reaches points, against what is known by hand."""

from __future__ import annotations

import numpy as np
import pytest
import scipy.sparse as sp

from stages.geometry.occluders import Occluders
from stages.geometry.rays import vertex_normals
from stages.photometry.paper.harmonics import real_harmonics, shading_basis
from stages.photometry.transport.directional_transport import (
    DirectionalTransport,
    Sphere,
    even_directions,
    offsets_in,
)
from stages.photometry.transport.environment import directions_of_picture, picture_of_light
from stages.photometry.transport.settings import LightPictureSettings, VisibilitySettings
from stages.photometry.transport.sky_visibility import visible_directions
from tests.bowls import bowl

COUNT = 1024


def unit(rng: np.random.Generator, count: int) -> np.ndarray:
    x = rng.normal(size=(count, 3))
    return x / np.linalg.norm(x, axis=1, keepdims=True)


def open_points(
    normals: np.ndarray, offsets: np.ndarray | None = None, count: int = COUNT
) -> DirectionalTransport:
    """Points that see everything."""
    nothing = sp.csr_array((len(normals), 1), dtype=np.float32)
    offsets = np.zeros(normals.shape, np.float32) if offsets is None else offsets.astype(np.float32)
    return DirectionalTransport.of(normals, offsets, nothing, np.zeros((1, -(-count // 8)), np.uint8), count)


def test_directions_are_unit_and_even():
    directions = even_directions(COUNT)
    assert np.allclose(np.linalg.norm(directions, axis=1), 1)
    assert np.allclose(directions.mean(axis=0), 0, atol=2e-3)
    moments = 4 * np.pi / COUNT * real_harmonics(directions, 3).T @ real_harmonics(directions, 3)
    assert np.allclose(moments, np.eye(16), atol=0.02)


def test_under_harmonic_light_open_points_shade_as_the_paper_has_it():
    """Eq. 1: light of degree 2, sampled in even directions, shades as the nine harmonics do."""
    rng = np.random.default_rng(1)
    normals, light = unit(rng, 200), rng.normal(size=(9, 3))
    radiance = real_harmonics(even_directions(COUNT), 2) @ light
    expected = shading_basis(normals) @ light
    assert np.allclose(open_points(normals).shading(radiance), expected, atol=0.01 * np.abs(expected).max())


def test_shares_times_light_is_the_shading():
    rng = np.random.default_rng(2)
    transport, radiance = open_points(unit(rng, 50), 0.1 * unit(rng, 50)), rng.random((COUNT, 3))
    some = np.array([3, 17, 42])
    assert np.allclose(transport.shares(some) @ radiance, transport.shading(radiance)[some], rtol=1e-4)
    assert np.array_equal(transport.shading(radiance, slice(10, 20)), transport.shading(radiance)[10:20])


def test_deep_in_a_bowl_the_open_part_of_the_sky_is_what_arrives():
    """At the bottom of a spherical bowl that opens upwards, sin² of the opening's half angle."""
    surface = bowl(0.7)
    normals = vertex_normals(surface.vertices, surface.faces).astype(np.float64)
    occluders = Occluders(surface)
    lifted = surface.vertices - occluders.origin + 1e-3 * normals
    visible = visible_directions(
        lifted, normals, occluders.blocked, even_directions(COUNT), VisibilitySettings()
    )
    own = sp.csr_array(sp.eye_array(len(lifted), dtype=np.float32, format="csr"))
    transport = DirectionalTransport.of(normals, np.zeros(lifted.shape, np.float32), own, visible, COUNT)
    arriving = transport.shading(np.ones((COUNT, 3)))[0, 0]
    rim = np.arccos((2 * 0.7 - 1 + 1) / np.linalg.norm([np.sqrt(1 - (2 * 0.7 - 1) ** 2), 2 * 0.7]))
    assert arriving == pytest.approx(np.sin(rim) ** 2, abs=0.02)


def test_points_between_vertices_see_what_both_see_in_part():
    visible = np.array([[0b10000000], [0b11000000]], np.uint8)
    blend = sp.csr_array(np.array([[0.25, 0.75]], np.float32))
    normals = np.array([[0.0, 0, 1]])
    transport = DirectionalTransport.of(normals, np.zeros((1, 3), np.float32), blend, visible, 8)
    up = np.maximum(even_directions(8)[:, 2], 0) * 4 / 8
    assert np.allclose(transport.shares(np.array([0]))[0, :2], [up[0], 0.75 * up[1]], atol=1e-6)
    assert np.allclose(transport.shares(np.array([0]))[0, 2:], 0)


def test_light_from_nearby_falls_with_the_square_and_faces_the_centre():
    """One source above: twice as near it gives four times as much; from aside, by both angles."""
    directions = even_directions(COUNT)
    up = int(np.argmax(directions[:, 2]))
    light = np.zeros((COUNT, 3))
    light[up] = COUNT / 4
    centre, half_way = np.zeros((1, 3)), 0.5 * directions[[up]]
    beside = np.array([[0.5, 0.0, 0.0]])
    normals = directions[[up]]
    values = [float(open_points(normals, place).shading(light)[0, 0]) for place in (centre, half_way, beside)]
    way = directions[up] - beside[0]
    cosine = way @ directions[up] / np.linalg.norm(way)
    assert values == pytest.approx([1, 4, cosine**2 / (way @ way)], rel=1e-3)


def test_what_is_nearer_than_the_light_is_placed_by_its_sphere():
    sphere = Sphere((1.0, 0, 0), 2.0)
    assert np.allclose(offsets_in(sphere, np.array([[2.0, 0, 0], [1, 1, 0]])), [[0.5, 0, 0], [0, 0.5, 0]])
    assert np.allclose(offsets_in(sphere, np.array([[1.0, 0, 50]])), [[0, 0, 2 / 3]])  # wide ground
    assert not offsets_in(None, np.array([[3.0, 0, 0]])).any()


def test_the_picture_of_the_light_shows_every_direction_in_its_place():
    towards = directions_of_picture(32)
    assert np.allclose(towards[0, :, 2], np.cos(np.pi * 0.5 / 32))
    middle = towards[16, 31:33].mean(axis=0)
    assert middle[1] < -0.99  # −y
    assert towards[16, 40, 0] < 0  # to the right of it lies −x
    radiance = np.maximum(even_directions(COUNT) @ np.array([[0.6], [0.0], [0.8]]), 0) ** 4
    picture = picture_of_light(even_directions(COUNT), radiance, LightPictureSettings(rows=32))[:, :, 0]
    assert np.allclose(picture, np.maximum(towards @ np.array([0.6, 0.0, 0.8]), 0) ** 4, atol=0.05)
