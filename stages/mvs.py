"""Multi-view stereo ("MVS" in the paper): depth and normals per view, and a fused cloud."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import TYPE_CHECKING, Literal

from pipeline import Artefact, Job, Settings, Stage, UserError, setting
from stages.scene.distributions import OPEN3D, PYCOLMAP

if TYPE_CHECKING:
    from stages.stereo.depth.fusion import FusedPoints
    from stages.stereo.workspace import Workspace


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


def engine_of(settings: Settings) -> Mapping[str, str]:
    """Which engine computes depth on this machine: part of the key."""
    if settings.engine != "auto":
        return {"engine": settings.engine}
    import pycolmap

    return {"engine": "cuda" if pycolmap.has_cuda else "cpu"}


def run(job: Job) -> None:
    """Open the workspace, let the chosen engine work, save depth maps and the fused cloud."""
    from stages.formats.meshes.point_clouds import write_points
    from stages.stereo import sparse_points
    from stages.stereo.workspace import open_workspace

    settings: MvsSettings = job.settings
    engine = job.machine["engine"]
    workspace = open_workspace(job.inputs["workspace"])
    if len(workspace.cameras) < 2:
        raise UserError(
            f"The workspace holds {len(workspace.cameras)} posed view(s); stereo needs at least 2. "
            "Add photos that overlap with the others."
        )
    cloud = compute_with(engine)(job, workspace)
    if settings.engine == "auto" and len(cloud.x_in_world) < settings.fewest_points:
        job.warn(
            f"Dense stereo agreed on {len(cloud.x_in_world)} points only, fewer than mvs.fewest_points = "
            f"{settings.fewest_points}: falling back to the sparse points."
        )
        engine, cloud = "sparse", sparse_points.compute(job, workspace)
    write_points(job.outputs["fused"], cloud.x_in_world, cloud.normals, cloud.colours)
    job.note(engine=engine, fused_points=len(cloud.x_in_world))


def compute_with(engine: str) -> Callable[[Job, Workspace], FusedPoints]:
    """The engine's function: from a job and its opened workspace to the fused cloud; it writes the maps."""
    if engine == "cuda":
        from stages.stereo import colmap_stereo

        return colmap_stereo.compute
    if engine == "sparse":
        from stages.stereo import sparse_points

        return sparse_points.compute
    from stages.stereo import own_stereo

    return own_stereo.compute


MVS = Stage(
    name="mvs",
    version=2,
    about="Depth and normals per view by multi-view stereo, fused into one oriented cloud.",
    settings=MvsSettings,
    takes=("workspace",),
    gives=(
        Artefact("depth_maps", "depth and normal maps in COLMAP's stereo layout"),
        Artefact("fused", "fused points with normals and colours, world axes", file="fused.ply"),
    ),
    run=run,
    tools=("numpy", "scipy", "numba", "opencv-python-headless", *PYCOLMAP, *OPEN3D),
    machine=engine_of,
)
