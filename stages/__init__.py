"""The craft."""

# Before everything else: pycolmap exports a zlib of its own. Loaded first, it takes half of the calls that
# OpenCV's PNG writer means for the system's, and the mixture corrupts the heap (pycolmap 4.2 with OpenCV 5).
import zlib  # noqa: F401
