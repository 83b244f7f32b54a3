"""Which pixels count: the bounds are settings, and a linear image beyond 1 has no white."""

from __future__ import annotations

import numpy as np

from stages.photometry.lighting.settings import TrustedPixelSettings
from stages.photometry.lighting.trusted_pixels import Viewing, unclipped, unlit

HOW = TrustedPixelSettings()


def test_a_pixel_is_clipped_by_one_channel_unless_the_image_has_no_white():
    photo = np.array([[0.2, 0.3, 0.4], [0.2, 0.99, 0.4], [0.0, 0.97, 0.0]], np.float32)
    assert unclipped(photo, HOW).tolist() == [True, False, True]
    assert unclipped(photo, TrustedPixelSettings(saturation=0.9)).tolist() == [True, False, False]
    assert unclipped(np.vstack([photo, [[0, 0, 1.5]]]), HOW).all()
    assert unclipped(photo[:0], HOW).size == 0
    red_beyond_srgb = np.vstack([photo, [[1.2, 0, 0]]])
    assert unclipped(red_beyond_srgb, HOW, has_white=True).tolist() == [True, False, True, False]


def test_surface_seen_at_a_grazing_angle_does_not_count():
    normals, cosines = np.tile([[0.0, 0, 1]], (4, 1)), np.array([-0.5, 0.05, 0.2, 0.9])
    towards = np.stack([np.sqrt(1 - cosines**2), 0 * cosines, cosines], axis=1)
    seen = np.array([True, True, True, False])
    assert Viewing.of(seen, normals, towards, HOW).trusted.tolist() == [False, False, True, False]
    steeper = TrustedPixelSettings(grazing_cosine=0.0)
    assert Viewing.of(seen, normals, towards, steeper).trusted.tolist() == [False, True, True, False]


def test_surface_with_hardly_any_light_does_not_count():
    shading = np.outer([0.001, 0.1, 1.0, 1.0, 1.2], np.ones(3))
    assert unlit(shading, 1.0, HOW).tolist() == [True, False, False, False, False]
    assert unlit(shading, 1.0, TrustedPixelSettings(unlit=0.2)).tolist() == [
        True,
        True,
        False,
        False,
        False,
    ]
