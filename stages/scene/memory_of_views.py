"""Memory of the stages that hold views: its constant part, that of pixels, and settings that lower it."""

BYTES_OF_LIBRARIES = 250_000_000
BYTES_OF_ALBEDO = 350_000_000  # compiled loops of its solver, and what it holds at any size
BYTES_TO_SPARE = 350_000_000  # for what estimates miss, and what earlier stages of the same process keep
BYTES_PER_PIXEL_OF_CLUSTER = 480  # that takes part, its correspondences included
PART_FOR_MESH = 5  # of the memory, one part in so many: the mesh, visibility and form factors of its vertices
FEWER_PIXELS = "set raycast.reduce=2, or choose fewer views (raycast.views)"
FEWER_OR_SMALLER_VIEWS = (
    "set raycast.reduce=2, choose fewer views (raycast.views), or lower undistort.max_size_px"
)
LEAST_PART_FOR_PIXELS = 4  # of the memory, one part in so many, whatever the process holds


def left_for_pixels(memory: int) -> int:
    """Compute what is left of the memory, bytes, for what grows with the pixels."""
    taken = BYTES_OF_LIBRARIES + BYTES_OF_ALBEDO + BYTES_TO_SPARE
    return max(memory - taken, memory // LEAST_PART_FOR_PIXELS)
