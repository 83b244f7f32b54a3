"""One light for all views, or one for each: by degrees, with no step on the way."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from pydantic import ValidationError

from stages.photometry.lighting.settings import LightingSettings
from stages.photometry.lighting.shared_or_own_lights import GLOSSY, MATT, LightSharing
from tests.by_sky import decompose_by_sky
from tests.test_sky_light import HOW, lit, looks, photo_of  # noqa: F401

MATTE = 1.0


def test_lights_part_by_degrees_as_views_differ_more():
    lighting = LightSharing("auto", 0.2, 0.3)
    assert [lighting.apart(spread, MATTE) for spread in (0.0, 0.2, 0.25, 0.3, 0.7)] == pytest.approx(
        [0, 0, 0.5, 1, 1]
    )
    assert abs(lighting.apart(0.2501, MATTE) - lighting.apart(0.2499, MATTE)) < 0.01


def test_gloss_keeps_views_in_one_light_by_degrees_as_well():
    lighting = LightSharing("auto", 0.2, 0.3)
    assert lighting.apart(0.5, MATT) == 1
    assert lighting.apart(0.5, (MATT + GLOSSY) / 2) == pytest.approx(0.5)
    assert lighting.apart(0.5, GLOSSY) == 0


def test_what_is_asked_for_is_done_whatever_views_show():
    assert LightSharing("shared", 0.2, 0.3).apart(0.9, MATTE) == 0
    assert LightSharing("per-view", 0.2, 0.3).apart(0.0, MATTE) == 1


def test_a_light_between_lies_between_and_goes_over_into_both_ends(lit):  # noqa: F811
    views, sky, albedo, shading, _ = lit
    image = photo_of(albedo, shading) * np.repeat([1.0, 1.3, 0.8], np.diff(views.starts))[:, None]
    dim = np.arange(len(image)) < views.starts[1]
    image[dim & (views.positions()[:, 1] > np.quantile(views.positions()[:, 1], 0.6))] *= 0.7  # a cloud
    images = [np.ascontiguousarray(image[:, c], np.float32) for c in range(3)]

    def found(lighting: LightSharing):
        how = replace(HOW, lighting=lighting, specular=False)
        light = decompose_by_sky(views, images, [sky], looks(np.ones(len(albedo), bool)), how).light
        return light, light.light.shading

    one, of_one = found(LightSharing("shared", 0.2, 0.3))
    _, of_each = found(LightSharing("per-view", 0.2, 0.3))
    spread = one.gains.spread
    assert one.brightening < MATT
    apart = np.abs(of_each - of_one).mean()
    assert apart > 0.02
    halfway, between = found(LightSharing("auto", 0.5 * spread, 1.5 * spread))
    assert halfway.apart == pytest.approx(0.5)
    assert halfway.light.radiance.shape[0] == 3
    assert np.allclose(between, (of_one + of_each) / 2, atol=0.02)
    for towards, weight in ((of_one, 0.002), (of_each, 0.998)):
        still = spread - 0.1 * weight  # (spread − still) / 0.1 is the weight
        _, nearly = found(LightSharing("auto", still, still + 0.1))
        assert np.abs(nearly - towards).mean() < 0.02 * apart


def test_the_albedo_makes_no_step_either_where_something_lies_in_a_photo(lit):  # noqa: F811
    """What one photo darkens is left out by degrees as well, as far as one light serves all."""
    views, sky, albedo, shading, _ = lit
    image = photo_of(albedo, shading)
    dim = np.arange(len(image)) < views.starts[1]
    rows, columns = views.positions().T
    image[dim & (columns > np.quantile(columns, 0.6))] *= 0.7
    image[dim & (np.abs(rows - np.median(rows)) < 8) & (np.abs(columns - np.median(columns)) < 8)] *= 0.2
    images = [np.ascontiguousarray(image[:, c], np.float32) for c in range(3)]
    trusting = looks(np.ones(len(albedo), bool))
    spread = decompose_by_sky(views, images, [sky], trusting, HOW).light.gains.spread

    def found(apart: float) -> np.ndarray:
        still = spread - 0.1 * apart
        return decompose_by_sky(
            views, images, [sky], trusting, replace(HOW, lighting=LightSharing("auto", still, still + 0.1))
        ).albedo

    steps = [np.abs(np.log(found(at + 0.01) / found(at))).mean() for at in (0.3, 0.495)]
    assert max(steps) < 0.02


def test_still_light_is_less_than_moving_light_whichever_of_the_two_is_given():
    assert LightingSettings().still_up_to == pytest.approx(0.2)
    assert LightingSettings(moving_light=0.15).still_up_to == pytest.approx(0.1)
    assert LightingSettings(still_light=0.0).still_up_to == 0
    for given in ({"still_light": 0.3}, {"still_light": 0.1, "moving_light": 0.1}):
        with pytest.raises(ValidationError, match="less than moving_light"):
            LightingSettings(**given)
