"""Memory of the stages that hold all views at once: its constant part, and the settings that lower it."""

BYTES_OF_LIBRARIES = 250_000_000
FEWER_PIXELS = "set raycast.reduce=2, or choose fewer views (raycast.views)"
FEWER_OR_SMALLER_VIEWS = (
    "set raycast.reduce=2, choose fewer views (raycast.views), or lower undistort.max_size_px"
)
