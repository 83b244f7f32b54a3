"""Averaging linear light over larger pixels."""

import numpy as np
import pytest

from stages.formats.images.resize import reduce_by_area


def test_whole_blocks_are_averaged():
    image = np.arange(16, dtype=np.float32).reshape(4, 4)
    assert reduce_by_area(image, (2, 2)).tolist() == [[2.5, 4.5], [10.5, 12.5]]
    assert reduce_by_area(image, (2, 4)).tolist() == [[2, 3, 4, 5], [10, 11, 12, 13]]


def test_colour_channels_stay_apart_and_dtype_stays_float32():
    image = np.random.default_rng(0).random((6, 9, 3), np.float32)
    reduced = reduce_by_area(image, (2, 3))
    assert reduced.dtype == np.float32
    assert np.allclose(reduced[1, 2], image[3:, 6:].mean(axis=(0, 1)))


@pytest.mark.parametrize("shape", [(3, 5), (7, 8), (5, 6)])
def test_uneven_sizes_keep_the_mean_light(shape):
    image = np.random.default_rng(1).random((7, 11, 3), np.float32)
    reduced = reduce_by_area(image, shape)
    assert reduced.shape == (*shape, 3)
    assert np.allclose(reduced.mean(axis=(0, 1)), image.mean(axis=(0, 1)), rtol=1e-4)


def test_the_same_size_is_the_image_itself():
    image = np.random.default_rng(2).random((3, 4), np.float32)
    assert reduce_by_area(image, (3, 4)) is image


def test_growing_is_refused():
    with pytest.raises(ValueError, match="cannot be reduced"):
        reduce_by_area(np.zeros((4, 4), np.float32), (5, 2))
