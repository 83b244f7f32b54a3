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


class SurfaceGapSettings(Settings):
    """Settings of gaps of the cloud that Poisson's surface closes: `stages.geometry.trimming`."""

    reach_footprints: float = setting(
        25.0,
        "A gap within the surface, without points, stays closed if it is no farther than this from them, and "
        "the views do not look through it. 0: none does.",
        unit="footprints of the pixels that a point was found with",
        ge=0,
    )
    most_through: float = setting(
        0.05,
        "Share of the sightings of a gap that may see surface behind it: some depths are wrong. Of panels of "
        "doors it was below .02, of what is open above .1.",
        ge=0,
        le=1,
    )
    most_background: float = setting(
        0.5,
        "Share of them that may show even background: plain surface passes for it in views whose border it "
        "touches, in a seventh of them; sky does in all.",
        ge=0,
        le=1,
    )
    fewest_views: float = setting(
        2.0, "Views that see a gap, on average over its vertices: what none sees stays empty.", gt=0
    )
    margin: float = setting(
        0.01,
        "What a view shows is behind a gap, or in front, if its depth differs by more than this.",
        unit="of the depth",
        gt=0,
        lt=1,
    )
