"""Settings of the `mvs` stage."""

from __future__ import annotations

from typing import Literal

from pipeline import Settings, setting


class MvsSettings(Settings):
    """Settings of the `mvs` stage."""

    engine: Literal["auto", "cpu", "cuda", "sparse"] = setting(
        "auto",
        "Who computes depth: our own stereo (cpu), COLMAP's PatchMatch (cuda), or nobody, the sparse points "
        "being taken as they are (sparse). auto: cuda where pycolmap has it, else cpu.",
    )
    sources: int = setting(
        5, "Views that each view is matched with; more cost time, fewer leave holes.", ge=1, le=20
    )
    best_sources: int = setting(
        3, "How many of them, the best per pixel, count: the others may be hidden there.", ge=1, le=20
    )
    angle_deg: float = setting(
        10.0,
        "Triangulation angle that a pair of views should have: depth is sharp, views still alike.",
        unit="deg",
        gt=0,
        lt=90,
    )
    range_outliers: float = setting(
        0.01, "Share of sparse points at either end that do not count for a view's depth range.", ge=0, lt=0.5
    )
    range_margin: float = setting(
        0.25,
        "Depth range beyond the sparse points, as a share: surface goes on where features end.",
        ge=0,
        le=4,
    )
    sweep_scale: float = setting(
        0.667, "Size of the images in the plane sweep; refinement works at full size.", gt=0, le=1
    )
    sweep_longest_px: int = setting(
        768,
        "And at most so many pixels along the longer side: bounds the cost volume.",
        unit="px",
        ge=64,
        le=4096,
    )
    sweep_step_px: float = setting(1.0, "Disparity between neighbouring planes.", unit="px", gt=0, le=8)
    sweep_planes: int = setting(160, "At most so many planes; memory and time grow with it.", ge=8, le=1024)
    sweep_radius_px: int = setting(3, "Half size of the sweep's matching window.", unit="px", ge=1, le=15)
    sgm_paths: Literal[4, 8] = setting(8, "Directions of semi-global aggregation; eight leave no streaks.")
    sgm_small: int = setting(
        10, "P1: price of moving to the next plane, where no correlation at all costs 254.", ge=0, le=254
    )
    sgm_large: int = setting(60, "P2: price of a depth jump on an even image.", ge=1, le=2000)
    sgm_edge: float = setting(0.05, "Grey-value step (of 1) that halves the price of a jump.", gt=0, le=1)
    photometric_iterations: int = setting(
        4,
        "Rounds of refinement by matching alone, each visiting every pixel once. Steep ground needs four: "
        "slopes begin flat and spread.",
        ge=0,
        le=20,
    )
    geometric_iterations: int = setting(
        1, "Rounds that also look at the other views' depth maps; a second changed nothing.", ge=0, le=20
    )
    patch_radius_px: int = setting(
        4,
        "Reach of the refinement's patch; smaller shows finer relief and more noise.",
        unit="px",
        ge=3,
        le=20,
    )
    patch_grey_sigma: float = setting(
        0.1,
        "Grey-value difference (of 1) at which patch pixels lose their say: keeps depth edges sharp.",
        gt=0,
    )
    noise: float = setting(
        0.004,
        "Grey-value deviation (of 1) not worth matching, about one step of 8 bits: flat sky matches nothing.",
        gt=0,
        lt=0.5,
    )
    smoothness: float = setting(
        0.02,
        "Charge, on the scale of 1 − ZNCC, for bending away from all four neighbours by a pixel. Against "
        "truth more of it only hurts: 0.1 makes depth a fifth worse.",
        ge=0,
    )
    geometric_weight: float = setting(
        0.2, "Charge per pixel of forward-backward reprojection error in the geometric rounds.", ge=0
    )
    geometric_cap_px: float = setting(
        3.0, "Reprojection error at which that charge stops growing.", unit="px", gt=0
    )
    highest_cost: float = setting(
        0.6, "Pixels that cost more are dropped; 1 is no correlation at all.", gt=0, le=2
    )
    consistent_px: float = setting(
        1.0, "Reprojection error up to which another view confirms a pixel.", unit="px", gt=0
    )
    consistent_views: int = setting(
        2, "Views that must confirm a pixel, where it has so many sources.", ge=1, le=20
    )
    fusion_depth_share: float = setting(
        0.01, "Relative depth difference up to which two pixels are one surface element.", gt=0, lt=1
    )
    fusion_normal_deg: float = setting(30.0, "And the angle between their normals.", unit="deg", gt=0, le=180)
    fusion_views: int = setting(3, "Views that must agree on a fused point, itself included.", ge=1, le=20)
    fewest_points: int = setting(
        1000,
        "With engine auto, fewer fused points than this make the stage fall back to the sparse points.",
        ge=0,
    )
    sparse_neighbours: int = setting(
        12, "Neighbours that a sparse point's normal is estimated from.", ge=3, le=200
    )
