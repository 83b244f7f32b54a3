"""Settings of geometry's phases."""

from __future__ import annotations

from pipeline import Settings, setting


class ProxySettings(Settings):
    """Settings of the smaller mesh in place of a large one: `stages.geometry.decimation.proxy`."""

    aggressiveness: float = setting(
        3.0,
        "Power by which the bound on the quadric error rises from pass to pass of rough decimation: from "
        "1/60 of an edge to three edges. With 7, the library's default, it rises far too soon, and without "
        "end.",
        gt=0,
        le=10,
    )
    unit_edges: float = setting(
        100.0,
        "Length of a unit in which the mesh is decimated: the bound is one of lengths, so it begins at 1/60 "
        "of an edge.",
        unit="mean edges",
        gt=0,
    )
    extra_vertices: float = setting(
        0.5,
        "By cutting long edges a mesh may have so many more vertices, as a share of what it has or may have.",
        ge=0,
        le=10,
    )
    sheet_offset: float = setting(
        1.0,
        "Of a thin sheet the nearest face may be that of the other side; then the face nearest to a point "
        "this far above the vertex is taken.",
        unit="mean edges",
        ge=0,
    )
