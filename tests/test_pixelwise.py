"""Arithmetic in chunks on several threads equals that of all pixels at once."""

from __future__ import annotations

import numpy as np
import pytest
import scipy.sparse as sp

from stages.formats.artefacts.correspondence_files import write_matrix
from stages.solvers.kernels import pixelwise as module
from stages.solvers.kernels.pixelwise import on_threads, pixelwise


@pytest.mark.parametrize("count", [0, 1, 6, 7, 8, 100])
def test_chunks_give_what_all_pixels_give(monkeypatch, count):
    monkeypatch.setattr(module, "CHUNK", 7)
    chance = np.random.default_rng(0)
    colour, grey = chance.random((count, 3), np.float32), chance.random(count)

    def work(colour, grey):
        return np.log1p(colour) * grey[:, None], grey > 0.5

    for own, whole in zip(pixelwise(work, colour, grey), work(colour, grey), strict=True):
        np.testing.assert_array_equal(own, whole)
        assert own.dtype == whole.dtype
    np.testing.assert_array_equal(pixelwise(np.square, colour), np.square(colour))


def test_errors_of_a_thread_are_raised():
    with pytest.raises(ZeroDivisionError):
        on_threads(lambda number: 1 / number, [1, 0])


def test_scipy_reads_matrices_as_they_were(tmp_path):
    matrix = sp.csr_array(sp.random_array((50, 40), density=0.1, format="csr", rng=1) > 0)
    write_matrix(tmp_path / "pair.npz", matrix)
    again = sp.load_npz(tmp_path / "pair.npz")
    assert isinstance(again, sp.csr_array) and again.dtype == bool and (again != matrix).nnz == 0
