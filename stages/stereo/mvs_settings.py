"""Settings of the `mvs` stage."""

from __future__ import annotations

from typing import Literal

from pipeline import Settings, group, setting


class ViewSelectionSettings(Settings):
    """Settings of the choice of source views and of depth ranges: `stages.stereo.view_selection`."""

    angle_below: float = setting(
        0.4,
        "Standard deviation of a point's weight where its triangulation angle is below `angle_deg`. Depth "
        "blurs quickly there.",
        unit="of `angle_deg`",
        gt=0,
        le=10,
    )
    angle_above: float = setting(
        1.5,
        "And where it is above: views grow unlike only slowly.",
        unit="of `angle_deg`",
        gt=0,
        le=10,
    )
    smallest_angle_deg: float = setting(
        1e-4,
        "Points seen under a smaller angle do not count: two views in one place tell no depth.",
        unit="deg",
        ge=0,
        le=1,
    )
    range_fewest_points: int = setting(
        10,
        "A view that observes fewer sparse points takes its depth range from all points in front of it.",
        unit="points",
        ge=1,
    )


class PosePointsSettings(Settings):
    """Settings of the stand-ins for sparse points: `stages.stereo.view_selection.points_from_poses`."""

    rays_per_side: int = setting(8, "Rays per view along either side of its image.", ge=2, le=64)
    depths_per_ray: int = setting(8, "Points on each ray, evenly spaced in inverse depth.", ge=2, le=64)
    nearest: float = setting(
        0.5, "The first of them, as a share of the view's middle depth.", unit="middle depths", gt=0, le=1
    )
    farthest: float = setting(2.0, "And the last.", unit="middle depths", ge=1, le=100)
    converging_share: float = setting(
        0.8,
        "Optical axes meet if their common point lies in front of this share of the views, farther than the "
        "nearest other view. The middle depth is the distance to it.",
        gt=0,
        le=1,
    )
    parallel_distance: float = setting(
        20.0,
        "The middle depth where they do not meet. Twenty baselines are a parallax of some 3°.",
        unit="distances to the nearest other view",
        gt=1,
    )
    rank_tolerance: float = setting(
        1e-3,
        "Directions along which the axes differ by less, as a relative singular value, do not place their "
        "common point: axes that are almost parallel would meet anywhere.",
        gt=0,
        lt=1,
    )


class PlaneSweepSettings(Settings):
    """Settings of the plane sweep: `stages.stereo.depth.plane_sweep` and the fit to its winner."""

    parallax_quantile: float = setting(
        0.75,
        "Inverse depth is measured in pixels of disparity of the source at this quantile of the sources' "
        "speeds: the fastest of all may be an oblique view.",
        ge=0,
        le=1,
    )
    speed_places: int = setting(
        9,
        "The speed of a source is the median over so many places across the image and down it: where the "
        "camera went straight ahead, nothing moves at the middle.",
        unit="places",
        ge=1,
        le=100,
    )
    fewest_planes: int = setting(
        8, "At least so many planes, however small the disparities: a parabola needs neighbours.", ge=3, le=64
    )
    fit_radius_px: int = setting(
        2, "Half size of the window that the first slopes are fitted in.", unit="px", ge=1, le=10
    )
    fit_tolerance: float = setting(
        0.5,
        "A neighbour r pixels away belongs to the same surface, and to the fit, while its disparity differs "
        "by less than this plus r. Half a plane is the rounding of the sweep; r admits slopes of a plane per "
        "pixel.",
        unit="planes",
        ge=0,
        le=10,
    )


class PatchMatchSettings(Settings):
    """Settings of the refinement's search: `stages.stereo.depth.patch_match`."""

    patch_sigmas: float = setting(
        1.5,
        "Reach of the patch in standard deviations of its Gaussian weight by distance.",
        unit="standard deviations",
        gt=0,
        le=10,
    )
    propagation_px: tuple[int, ...] = setting(
        (1, 3, 7),
        "Distances to the neighbours above, below, left and right whose planes are tried: on each side, of "
        "the neighbour that matches best.",
        unit="px",
        min_length=1,
        max_length=8,
    )
    first_change_px: float = setting(
        1.0,
        "Largest random change of disparity in the first round. The sweep is right to about a plane.",
        unit="px",
        gt=0,
        le=100,
    )
    change_decay: float = setting(0.5, "And as a share of it from round to round.", gt=0, le=1)
    slope_change: float = setting(
        0.3,
        "Largest random change of the slopes, as a share of that of disparity, per pixel.",
        ge=0,
        le=10,
    )
    same_disparity_px: float = setting(
        0.02,
        "Planes that differ by less, and by less than `same_slope`, are not compared: it saves time.",
        unit="px",
        ge=0,
        le=1,
    )
    same_slope: float = setting(
        0.005, "Difference of their slopes.", unit="px of disparity per px", ge=0, le=1
    )
    bending_cap: float = setting(
        1.0,
        "Square of the gap to a neighbour's plane at which the charge for bending stops growing, lest it "
        "smooth depth edges.",
        unit="px² of disparity",
        gt=0,
    )


class GapSettings(Settings):
    """Settings of stereo at smaller sizes, for what none was found at the full one: `stages.stereo.gaps`."""

    least_px: int = setting(
        400,
        "Stereo is repeated at half of the size, and half of that, while the longest side of the images has "
        "so many pixels; a large number: never.",
        unit="px",
        ge=64,
    )
    reach_footprints: float = setting(
        3.0,
        "A point found at a smaller size is used where no other is within this distance.",
        unit="pixel footprints at full size",
        gt=0,
    )
    behind: float = setting(
        0.01,
        "And where no depth map shows surface behind it by more than this share of its depth: space in front "
        "of surface is free.",
        unit="of the depth",
        gt=0,
    )


class DepthEdgeSettings(Settings):
    """Settings of the borders of depth maps: `stages.stereo.depth.depth_edges`."""

    reach_px: int = setting(
        5,
        "Depth this near to even background is dropped where an edge of the photo lies between it and the "
        "surface: a patch across an outline before such a background matches as the outline does. 0: never.",
        unit="px",
        ge=0,
        le=50,
    )
    thinnest_px: float = setting(
        5.0,
        "Things narrower than twice that reach have no pixels beyond it: their middle counts as surface from "
        "this width on.",
        unit="px",
        gt=0,
    )


class ColmapStereoSettings(Settings):
    """Settings of COLMAP's PatchMatch and fusion, the engine cuda: `stages.stereo.colmap_stereo`."""

    cache_gb: float = setting(
        8.0,
        "Memory of the machine in which images and maps are held; what is beyond is read again.",
        unit="GB",
        changes_result=False,
        gt=0,
    )


class MvsSettings(Settings):
    """Settings of the `mvs` stage."""

    engine: Literal["auto", "cpu", "cuda", "sparse"] = setting(
        "auto",
        "What computes depth: our own stereo (cpu), COLMAP's PatchMatch (cuda), or nothing: the sparse "
        "points are taken as they are (sparse). auto: cpu, or sparse where that finds too little; also where "
        "there is a card, for cuda took 2.5 times as long, and does not tell background.",
    )
    within_masks: bool = setting(
        False,
        "Depth and points outside of the masks (--masks, alpha channels) are dropped, and the mesh has no "
        "surface there. Else what is around the object stays in the mesh: it shades the object, and "
        "reflects light onto it.",
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
        1, "Rounds that also compare with the other views' depth maps; a second changed nothing.", ge=0, le=20
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
    views: ViewSelectionSettings = group(
        ViewSelectionSettings, "Which views each view is matched with, and over which depths."
    )
    pose_points: PosePointsSettings = group(
        PosePointsSettings,
        "What stands for sparse points where a model has none: a grid of every view's rays over plausible "
        "depths.",
    )
    sweep: PlaneSweepSettings = group(PlaneSweepSettings, "The plane sweep, where depth begins.")
    patch_match: PatchMatchSettings = group(
        PatchMatchSettings, "The refinement of depth and normal by planes of neighbours and random changes."
    )
    edges: DepthEdgeSettings = group(
        DepthEdgeSettings, "Borders of depth maps, which follow the edges of the photos."
    )
    gaps: GapSettings = group(
        GapSettings,
        "Points from smaller images, where the full size has none: even surface matches only in larger "
        "patches.",
    )
    colmap: ColmapStereoSettings = group(
        ColmapStereoSettings, "What COLMAP's PatchMatch and fusion may use, with the engine cuda."
    )

    @property
    def counted_sources(self) -> int:
        """`best_sources`, but no more than there are."""
        return min(self.best_sources, self.sources)
