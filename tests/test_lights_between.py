"""One light for all views, or one for each: by degrees, with no step on the way."""

from __future__ import annotations

import numpy as np
import pytest
from pydantic import ValidationError

from stages.photometry.lighting.settings import LightingSettings, LightSharingSettings
from stages.photometry.lighting.shared_or_own_lights import weight_of_own_lights
from tests.by_sky import decompose_by_sky
from tests.test_sky_light import HOW, lit, photo_of, viewing  # noqa: F401

MATTE = 1.0
HALF = LightingSettings(still_light=0.2, moving_light=0.3)
BETWEEN = LightingSettings().sharing


def test_lights_part_by_degrees_as_views_differ_more():
    weights = [weight_of_own_lights(spread, MATTE, HALF) for spread in (0.0, 0.2, 0.25, 0.3, 0.7)]
    assert weights == pytest.approx([0, 0, 0.5, 1, 1])
    more, less = (weight_of_own_lights(spread, MATTE, HALF) for spread in (0.2501, 0.2499))
    assert abs(more - less) < 0.01


def test_gloss_keeps_views_in_one_light_by_degrees_as_well():
    matte, glossy = BETWEEN.matte_brightening, BETWEEN.glossy_brightening
    assert weight_of_own_lights(0.5, matte, HALF) == 1
    assert weight_of_own_lights(0.5, (matte + glossy) / 2, HALF) == pytest.approx(0.5)
    assert weight_of_own_lights(0.5, glossy, HALF) == 0


def test_gloss_begins_above_what_is_matt():
    with pytest.raises(ValidationError, match="matte_brightening less than glossy_brightening"):
        LightSharingSettings(matte_brightening=1.1)


def test_what_is_asked_for_is_done_whatever_views_show():
    assert weight_of_own_lights(0.9, MATTE, HALF.model_copy(update={"lights": "shared"})) == 0
    assert weight_of_own_lights(0.0, MATTE, HALF.model_copy(update={"lights": "per-view"})) == 1


def test_a_light_between_lies_between_and_goes_over_into_both_ends(lit):  # noqa: F811
    views, sky, albedo, shading, _ = lit
    image = photo_of(albedo, shading) * np.repeat([1.0, 1.3, 0.8], np.diff(views.starts))[:, None]
    dim = np.arange(len(image)) < views.starts[1]
    image[dim & (views.positions()[:, 1] > np.quantile(views.positions()[:, 1], 0.6))] *= 0.7  # a cloud
    images = [np.ascontiguousarray(image[:, c], np.float32) for c in range(3)]

    def found(lights: str, still: float = 0.2, moving: float = 0.3):
        how = HOW.with_light(lights=lights, still_light=still, moving_light=moving).with_specular(False)
        light = decompose_by_sky(views, images, [sky], viewing(np.ones(len(albedo), bool)), how).light
        return light, light.light.shading

    one, of_one = found("shared")
    _, of_each = found("per-view")
    spread = one.gains.spread
    assert one.brightening < BETWEEN.matte_brightening
    apart = np.abs(of_each - of_one).mean()
    assert apart > 0.02
    halfway, between = found("auto", 0.5 * spread, 1.5 * spread)
    assert halfway.apart == pytest.approx(0.5)
    assert halfway.light.radiance.shape[0] == 3
    assert np.allclose(between, (of_one + of_each) / 2, atol=0.02)
    for towards, weight in ((of_one, 0.002), (of_each, 0.998)):
        still = spread - 0.1 * weight  # (spread − still) / 0.1 is the weight
        _, nearly = found("auto", still, still + 0.1)
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
    trusting = viewing(np.ones(len(albedo), bool))
    spread = decompose_by_sky(views, images, [sky], trusting, HOW).light.gains.spread

    def found(apart: float) -> np.ndarray:
        still = spread - 0.1 * apart
        how = HOW.with_light(still_light=still, moving_light=still + 0.1)
        return decompose_by_sky(views, images, [sky], trusting, how).albedo

    steps = [np.abs(np.log(found(at + 0.01) / found(at))).mean() for at in (0.3, 0.495)]
    assert max(steps) < 0.02


def test_still_light_is_less_than_moving_light_whichever_of_the_two_is_given():
    assert LightingSettings().still_up_to == pytest.approx(0.2)
    assert LightingSettings(moving_light=0.15).still_up_to == pytest.approx(0.1)
    assert LightingSettings(still_light=0.0).still_up_to == 0
    for given in ({"still_light": 0.3}, {"still_light": 0.1, "moving_light": 0.1}):
        with pytest.raises(ValidationError, match="less than moving_light"):
            LightingSettings(**given)
