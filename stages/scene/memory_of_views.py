"""Memory of the stages that hold views: its constant part, that of pixels, and settings that lower it."""

BYTES_OF_LIBRARIES = 250_000_000
BYTES_HELD_BEFORE = 700_000_000  # of the libraries of earlier stages, by the time that the light is estimated
BYTES_PER_PIXEL_OF_CLUSTER = 480  # that takes part, its correspondences included
PART_FOR_MESH = 5  # of the memory, one part in so many: the mesh, visibility and form factors of its vertices
FEWER_PIXELS = "set raycast.reduce=2, or choose fewer views (raycast.views)"
FEWER_OR_SMALLER_VIEWS = (
    "set raycast.reduce=2, choose fewer views (raycast.views), or lower undistort.max_size_px"
)
LEAST_PART_FOR_PIXELS = 4  # of the memory, one part in so many, whatever the process holds


def left_for_pixels(memory: int) -> int:
    """Compute what libraries, of earlier stages too, leave of the memory, bytes."""
    return max(memory - BYTES_HELD_BEFORE - BYTES_OF_LIBRARIES, memory // LEAST_PART_FOR_PIXELS)
