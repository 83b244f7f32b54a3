"""Whether COLMAP's stereo can run here: pycolmap with CUDA, and a card."""

from __future__ import annotations

import pycolmap


def count_cards() -> int:
    """Count the NVIDIA cards that this pycolmap can compute on; 0 where it was built without CUDA."""
    if not pycolmap.has_cuda:
        return 0
    return int(pycolmap.get_num_cuda_devices())  # type: ignore[attr-defined]  # not there without CUDA
