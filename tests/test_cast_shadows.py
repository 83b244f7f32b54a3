"""Shadows of what the mesh does not have: cuts are minimal, edges of light are told from edges of paint."""

from __future__ import annotations

from dataclasses import replace
from itertools import product

import numpy as np
import pytest
import scipy.sparse as sp

from stages.photometry.light_search.light_estimate import LightEstimate
from stages.photometry.light_search.settings import PairSettings
from stages.photometry.sun.cast_shadows import cast_shadows, with_visibility
from stages.photometry.sun.pixel_rays import WHOLE
from stages.photometry.sun.settings import ShadowSettings
from stages.photometry.sun.shadow_labels import (
    Choice,
    SunlitView,
    beside_edges,
    edges_decided,
    minimum_cut,
    sun_seen,
    texture_scales,
)
from stages.photometry.transport.directional_transport import even_directions
from stages.photometry.transport.lit_scenes import LitScene
from stages.photometry.transport.transfer_vectors import Occlusion, Proxy

WARM = np.array([1.6, 1.2, 0.9], np.float32)  # irradiance by the sun over that by the sky


def view_of(radiance: np.ndarray, free: np.ndarray | None = None) -> SunlitView:
    """A plane under a sky of 1 in all channels, and a sun that may reach it where it is free."""
    shape = radiance.shape[:2]
    free = np.ones(shape, bool) if free is None else free
    gain = (free[..., None] * WARM).astype(np.float32)
    return SunlitView(
        np.log(radiance).astype(np.float32), gain, np.ones(shape, np.float32), free, float(np.sqrt(free.size))
    )


def lit(seen: np.ndarray, albedo: np.ndarray | float = 0.4) -> np.ndarray:
    """Radiance of a plane that sees a share of the sun."""
    return albedo * (1 + seen[..., None] * WARM)


def textured(shape: tuple[int, int], deviation: float, seed: int = 0) -> np.ndarray:
    """Albedo that varies from pixel to pixel, grey."""
    grain = np.random.default_rng(seed).normal(0, deviation, shape)
    return np.repeat(0.4 * np.exp(grain)[..., None], 3, axis=2)


def found_by_default(view: SunlitView) -> np.ndarray:
    return sun_seen(view, texture_scales(view, ShadowSettings()), ShadowSettings())


def energy_of(choice: Choice, changed: np.ndarray) -> float:
    unlike = ~changed[choice.first] & changed[choice.second]
    return float(choice.change[changed].sum() + choice.unlike[unlike].sum())


@pytest.mark.parametrize("seed", range(8))
def test_a_choice_is_made_at_the_least_cost_of_all(seed):
    rng = np.random.default_rng(seed)
    view = view_of(np.exp(rng.normal(0, 0.8, (3, 4, 3))))
    how = ShadowSettings(distances=(1, 2), shade=0.02)
    stay = np.ones((3, 4), np.float32)
    every = np.ones((3, 4), bool)
    choice = Choice.between(view, stay, np.zeros_like(stay), stay, every, [(0.3, 0.05)] * 2, how)
    least = min(energy_of(choice, np.array(each, bool)) for each in product((0, 1), repeat=12))
    assert energy_of(choice, minimum_cut(choice)) == pytest.approx(least, abs=12 / 1000)


@pytest.mark.parametrize("seed", range(4))
def test_pixels_that_may_not_change_count_as_they_are(seed):
    """Fixing pixels equals a choice of all in which they are made to stay."""
    rng = np.random.default_rng(seed)
    view = view_of(np.exp(rng.normal(0, 0.5, (4, 4, 3))))
    how, stay = ShadowSettings(distances=(1,)), np.ones((4, 4), np.float32)
    free = rng.random((4, 4)) < 0.6
    none, scales = np.zeros_like(stay), [(0.3, 0.05)]
    every = Choice.between(view, stay, none, stay, np.ones((4, 4), bool), scales, how)
    some = Choice.between(view, stay, np.where(free, np.float32(0), stay), stay, free, scales, how)
    for _ in range(5):
        changed = free & (rng.random((4, 4)) < 0.5)
        all_stay = np.zeros(16, bool)
        by_all = energy_of(every, changed.ravel()) - energy_of(every, all_stay)
        by_some = energy_of(some, changed[free]) - energy_of(some, all_stay[: free.sum()])
        assert by_some == pytest.approx(by_all, abs=1e-6)


@pytest.mark.parametrize("size", [100, 260])
def test_the_shadow_of_a_tower_across_a_wall_is_found(size):
    across = np.arange(size)
    truth = np.ones((size, size), np.float32)
    truth[:, (across > 0.4 * size) & (across < 0.7 * size)] = 0
    seen = found_by_default(view_of(lit(truth, textured(truth.shape, 0.1))))
    assert np.mean(np.abs(seen - truth) < 0.3) > 0.995


def test_half_a_shadow_is_half_a_shadow():
    truth = np.ones((180, 300), np.float32)
    truth[:, 140:], truth[:, 144:] = 0.5, 0
    seen = found_by_default(view_of(lit(truth, textured(truth.shape, 0.05))))
    beside = np.abs(seen - truth)[:, 140:144]
    assert beside.mean() < 0.15 and np.abs(seen - truth).mean() < 0.01


@pytest.mark.parametrize("paint", [[0.3, 0.3, 0.3], [0.9, 0.4, 0.15], [0.7, 0.75, 0.7]])
def test_paint_is_not_shadow(paint):
    """A dark grey, a warm and a pale patch: none has the colour of the sun's edge."""
    albedo = textured((100, 120), 0.05)
    albedo[30:70, 30:80] *= paint
    seen = found_by_default(view_of(lit(np.ones((100, 120), np.float32), albedo)))
    assert (seen == 1).all()


def test_an_edge_of_shadow_that_the_mesh_explains_stays_and_no_pixel_behind_it_is_lit():
    free = np.ones((100, 100), bool)
    free[:, :50] = False
    truth = free.astype(np.float32)
    seen = found_by_default(view_of(lit(truth, textured(truth.shape, 0.1)), free))
    np.testing.assert_array_equal(seen, truth)
    brighter = lit(truth, textured(truth.shape, 0.1))
    brighter[20:60, 10:30] *= 1 + WARM
    assert not found_by_default(view_of(brighter, free))[:, :50].any()


@pytest.mark.parametrize("off_px", [-2, -1, 0, 1, 2])
def test_an_edge_of_shadow_lies_where_the_photo_has_it_and_not_some_pixels_beside(off_px):
    """Mesh and sun are known to some pixels: a mesh that shades too much leaves no bright line."""
    truth, known = np.ones((2, 60, 480), np.float32)
    truth[:, :200], known[:, : 200 + off_px] = 0, 0
    radiance, how = lit(truth, textured(truth.shape, 0.1)), ShadowSettings()
    by_mesh = view_of(radiance, known > 0)
    scales = texture_scales(by_mesh, how)
    share = known * sun_seen(by_mesh, scales, how)
    beside = beside_edges(known, np.ones(known.shape, bool), 400, how)
    found = edges_decided(view_of(radiance), share, known, beside, scales, how)
    assert np.abs(found - truth).sum(axis=1).mean() < 0.2  # px
    np.testing.assert_array_equal(found[~beside], share[~beside])


def test_stains_beside_the_edge_of_a_shadow_are_paint():
    truth = np.ones((100, 120), np.float32)
    truth[:, :60] = 0
    albedo = textured(truth.shape, 0.05)
    albedo[30:36, 50:70] *= 0.5
    albedo[60:66, 50:70] *= [0.9, 0.5, 0.3]
    how, every = ShadowSettings(), view_of(lit(truth, albedo))
    scales = texture_scales(view_of(lit(truth, albedo), truth > 0), how)
    beside = beside_edges(truth, np.ones(truth.shape, bool), 100, how)
    found = edges_decided(every, truth, truth, beside, scales, how)
    assert np.abs(found - truth).mean() < 0.001


def test_what_is_not_trusted_decides_nothing():
    truth = np.ones((100, 100), np.float32)
    view = view_of(lit(truth, textured(truth.shape, 0.1)))
    black = view.shaded.copy()
    black[40:60, 40:60] -= 5
    untrusted = view.weight.copy()
    untrusted[40:60, 40:60] = 0
    seen = found_by_default(replace(view, shaded=black, weight=untrusted))
    assert (seen == 1).all()


SIDE = 80
SUNS = np.array([[0.0, 0.6, 0.8], [0.6, 0.0, 0.8]], np.float32)
FLUX = np.array([[1.6, 1.2, 0.9], [0.4, 0.9, 1.5]])  # irradiance that faces them


def two_views_under_two_suns() -> tuple[LitScene, LightEstimate]:
    """Two views of a plane under an even sky and two suns; a vertex for each half of each view."""
    count, pixels = 64, 2 * SIDE * SIDE
    up = np.tile(np.array([0.0, 0, 1], np.float32), (pixels, 1))
    half = np.tile(np.arange(SIDE) >= SIDE // 2, 2 * SIDE) + 2 * (np.arange(pixels) >= SIDE * SIDE)
    blend = sp.csr_array((np.ones(pixels, np.float32), (np.arange(pixels), half)), shape=(pixels, 4))
    nothing = sp.csr_array((4, 4), dtype=np.float32)
    proxy = Proxy(np.zeros((4, 3)), up[:4], Occlusion(np.zeros((4, 9)), nothing, nothing))
    seen = np.packbits(np.ones((4, count), np.uint8), axis=1)
    scene = LitScene.of(up, blend, proxy, seen, count, None)
    directions = np.concatenate([even_directions(count), SUNS]).astype(np.float32)
    cells = np.append(scene.pixels.cells, [1e-5, 1e-5]).astype(np.float32)
    parts = {
        "directions": directions,
        "cells": cells,
        "visible": np.packbits(np.ones((4, count + 2), np.uint8), axis=1),
    }
    traced = np.full((pixels, 2), WHOLE, np.uint8)
    scene = replace(
        scene, pixels=replace(scene.pixels, traced=traced, **parts), vertices=replace(scene.vertices, **parts)
    )
    light = np.concatenate([np.ones((count, 3)), FLUX / 4e-5])[None]
    return scene, LightEstimate(light, np.zeros((1, 4, 3), np.float32))


def test_suns_are_hidden_one_by_one_from_pixels_and_from_the_vertices_that_most_of_them_show():
    by_mesh, light = two_views_under_two_suns()
    starts, one = np.array([0, SIDE**2, 2 * SIDE**2]), np.zeros(2, np.int64)
    truth = np.full((2, SIDE, SIDE, 2), WHOLE, np.uint8)
    truth[0, :, : SIDE // 2 - 3, 0] = 0  # most of the left half of the first view
    truth[1, 20:50, SIDE - 30 :, 1] = 0  # less than half of the right half of the second one
    as_is = replace(by_mesh, pixels=replace(by_mesh.pixels, traced=truth.reshape(-1, 2)))
    shading = light.shading(as_is, starts, one)
    image = (shading * textured((2 * SIDE, SIDE), 0.05).reshape(-1, 3)).astype(np.float32)
    framed = np.pad(np.ones((SIDE, SIDE), bool), ((3, 5), (2, 0)))
    masks, trusted = (framed, np.zeros((9, 9), bool), framed), np.ones(len(image), bool)
    seen, hidden = cast_shadows(
        by_mesh,
        light,
        light.shading(by_mesh, starts, one),
        image,
        trusted,
        masks,
        SIDE,
        PairSettings(),
        ShadowSettings(),
    )
    found = with_visibility(by_mesh, seen)
    lit_by = light.shading(found, starts, one)
    assert np.mean(hidden.reshape(truth.shape) == (truth == 0)) > 0.99
    assert np.mean(np.abs(lit_by / shading - 1) > 0.05) < 0.01
    by_vertices = np.unpackbits(found.vertices.visible, axis=1, count=66)
    np.testing.assert_array_equal(by_vertices[:, 64:], [[0, 1], [1, 1], [1, 1], [1, 1]])
    assert by_vertices[:, :64].all()


def test_a_part_of_a_view_finds_what_the_whole_view_finds():
    """Widths beside edges, and how coarse a search begins, are the view's, not those of what is cut out."""
    truth = np.ones((256, 384), np.float32)
    truth[:, 90:200] = np.linspace(1, 0, 110).round(1)
    truth[:, 200:300] = 0
    radiance = lit(truth, textured(truth.shape, 0.05))
    whole = view_of(radiance)
    part = replace(view_of(radiance[:, 64:320]), side=whole.side)
    scales, how = texture_scales(whole, ShadowSettings()), ShadowSettings()
    of_whole, of_part = (sun_seen(each, scales, how) for each in (whole, part))
    assert np.mean(of_whole[:, 64:320] != of_part) < 0.01
    narrow = slice(64, 84)
    beside = [
        beside_edges(truth[:, place], np.ones(truth[:, place].shape, bool), whole.side, how)
        for place in (slice(None), narrow)
    ]
    np.testing.assert_array_equal(beside[0][:, narrow], beside[1])
