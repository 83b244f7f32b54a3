"""Names of the distributions of libraries that many stages use, for `Stage.tools`.

Of alternative distributions of one library one is installed; the others count as absent.
"""

from __future__ import annotations

PYCOLMAP = ("pycolmap", "pycolmap-cuda12")
OPEN3D = ("open3d-cpu", "open3d")
PICTURES = ("opencv-python-headless", "openexr", "pillow", "pi-heif", "rawpy")  # the last two are extras
