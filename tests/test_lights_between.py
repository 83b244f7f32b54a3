"""One light for all views, or one for each: by degrees, with no step on the way."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from pydantic import ValidationError

from stages.photometry.lighting_settings import LightingSettings
from stages.photometry.sky_photos import GLOSSY, MATT, Lighting
from tests.by_sky import decompose_by_sky
from tests.test_sky_light import HOW, lit, looks, photo_of  # noqa: F401

MATTE = 1.0


def test_lights_part_by_degrees_as_views_differ_more():
    lighting = Lighting("auto", 0.2, 0.3)
    assert [lighting.apart(spread, MATTE) for spread in (0.0, 0.2, 0.25, 0.3, 0.7)] == pytest.approx(
        [0, 0, 0.5, 1, 1]
    )
    assert abs(lighting.apart(0.2501, MATTE) - lighting.apart(0.2499, MATTE)) < 0.01


def test_gloss_keeps_views_in_one_light_by_degrees_as_well():
    lighting = Lighting("auto", 0.2, 0.3)
    assert lighting.apart(0.5, MATT) == 1
    assert lighting.apart(0.5, (MATT + GLOSSY) / 2) == pytest.approx(0.5)
    assert lighting.apart(0.5, GLOSSY) == 0


def test_what_is_asked_for_is_done_whatever_views_show():
    assert Lighting("shared", 0.2, 0.3).apart(0.9, MATTE) == 0
    assert Lighting("per-view", 0.2, 0.3).apart(0.0, MATTE) == 1


def test_a_light_between_lies_between_and_goes_over_into_both_ends(lit):  # noqa: F811
    views, sky, albedo, shading, _ = lit
    image = photo_of(albedo, shading) * np.repeat([1.0, 1.3, 0.8], np.diff(views.starts))[:, None]
    dim = np.arange(len(image)) < views.starts[1]
    image[dim & (views.positions()[:, 1] > np.quantile(views.positions()[:, 1], 0.6))] *= 0.7  # a cloud
    images = [np.ascontiguousarray(image[:, c], np.float32) for c in range(3)]

    def found(lighting: Lighting):
        how = replace(HOW, lighting=lighting, sheen=False)
        light = decompose_by_sky(views, images, [sky], looks(np.ones(len(albedo), bool)), how).light
        return light, light.light.shading

    one, of_one = found(Lighting("shared", 0.2, 0.3))
    _, of_each = found(Lighting("per-view", 0.2, 0.3))
    spread = one.gains.spread
    assert one.brightening < MATT
    apart = np.abs(of_each - of_one).mean()
    assert apart > 0.02
    halfway, between = found(Lighting("auto", 0.5 * spread, 1.5 * spread))
    assert halfway.apart == pytest.approx(0.5)
    assert halfway.light.radiance.shape[0] == 3
    assert np.allclose(between, (of_one + of_each) / 2, atol=0.02)
    for towards, weight in ((of_one, 0.002), (of_each, 0.998)):
        still = spread - 0.1 * weight  # (spread − still) / 0.1 is the weight
        _, nearly = found(Lighting("auto", still, still + 0.1))
        assert np.abs(nearly - towards).mean() < 0.02 * apart


def test_light_moves_from_where_it_no_longer_stands_still():
    with pytest.raises(ValidationError, match="more than still_light"):
        LightingSettings(still_light=0.3, moving_light=0.3)
