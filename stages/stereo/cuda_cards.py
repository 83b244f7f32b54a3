"""Whether COLMAP's stereo can run here: pycolmap with CUDA, and a card."""

from __future__ import annotations

import pycolmap

from pipeline.process.own_process import in_own_process


def count_cards() -> int:
    """Count the NVIDIA cards that this pycolmap can compute on; 0 where it was built without CUDA.

    Counted in a process of its own: CUDA, once it has looked for cards, does not work in forks.
    """
    return in_own_process("that counts cards", _count) if pycolmap.has_cuda else 0


def _count() -> int:
    return int(pycolmap.get_num_cuda_devices())  # type: ignore[attr-defined]  # not there without CUDA
