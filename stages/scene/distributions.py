"""Names under which the libraries of many stages are installed: for `Stage.tools`.

Of a line with several names one is installed; the others count as absent.
"""

from __future__ import annotations

PYCOLMAP = ("pycolmap", "pycolmap-cuda12")
OPEN3D = ("open3d-cpu", "open3d")
PICTURES = ("opencv-python-headless", "openexr", "pillow")  # what `photos` and `exr` read and write by
