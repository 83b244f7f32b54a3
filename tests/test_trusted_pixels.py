"""Which pixels count: the bounds are settings, and a linear image beyond 1 has no white."""

from __future__ import annotations

import numpy as np

from stages.photometry.lighting.settings import TrustedPixelSettings
from stages.photometry.lighting.trusted_pixels import Viewing, on_outline, unclipped, unlit
from stages.scene.cameras import Camera

HOW = TrustedPixelSettings()
BESIDE = TrustedPixelSettings(outline_px=1)


def test_a_pixel_is_clipped_by_one_channel_unless_the_image_has_no_white():
    photo = np.array([[0.2, 0.3, 0.4], [0.2, 0.99, 0.4], [0.0, 0.97, 0.0]], np.float32)
    assert unclipped(photo, HOW).tolist() == [True, False, True]
    assert unclipped(photo, TrustedPixelSettings(saturation=0.9)).tolist() == [True, False, False]
    assert unclipped(np.vstack([photo, [[0, 0, 1.5]]]), HOW).all()
    assert unclipped(photo[:0], HOW).size == 0


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


def outline_before_a_wall(front: np.ndarray, mask: np.ndarray, how=BESIDE) -> np.ndarray:
    """Find the outline where surface 2 away, at the pixels `front`, hides a slanted wall; (h, w), bool."""
    intrinsics = np.array([[20.0, 0, 10], [0, 20, 8], [0, 0, 1]])
    camera = Camera("view", 20, 16, intrinsics, np.eye(3, 4))
    wall = 3 + 0.1 * np.arange(20) * np.ones((16, 1))  # 0.1 of depth is 0.5 footprints and more
    depth = np.where(front, 2.0, wall).astype(np.float32)
    outline = np.zeros(mask.shape, bool)
    outline[mask] = on_outline(camera, mask, depth, np.where(front, 1.0, 0.9)[mask], how)
    return outline


def test_pixels_beside_another_surface_or_none_do_not_count_on_either_side():
    front = np.zeros((16, 20), bool)
    front[4:12, 5:15] = True
    mask = np.ones_like(front)
    mask[:, 18:] = False
    expected = np.zeros_like(front)
    expected[3:13, 4:16] = True  # the wall beside the front, and the front's own border
    expected[5:11, 6:14] = False
    expected[:, 17] = True
    assert (outline_before_a_wall(front, mask) == expected).all()
    assert not outline_before_a_wall(front, mask, HOW).any()
    twice = outline_before_a_wall(front, mask, TrustedPixelSettings(outline_px=2))
    assert twice[2, 3] and twice[5, 6] and not twice[6, 7] and not twice[1, 1]


def test_surface_too_thin_to_have_an_inside_keeps_its_pixels():
    front = np.zeros((16, 20), bool)
    front[:, 9:11] = True
    outline = outline_before_a_wall(front, np.ones_like(front))
    assert not outline[:, 9:11].any()
    assert outline[:, 8].all() and outline[:, 11].all()


def test_the_frame_of_the_image_and_slanted_surface_are_no_outline():
    none, every = np.zeros((16, 20), bool), np.ones((16, 20), bool)
    assert not outline_before_a_wall(none, every).any()
    flat = TrustedPixelSettings(outline_px=1, outline_slope=1e-6)
    assert not outline_before_a_wall(none, every, flat).any()
