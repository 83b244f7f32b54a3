"""Settings of the `triangulate` stage."""

from __future__ import annotations

from pipeline import Settings, setting


class TriangulationSettings(Settings):
    """Settings of the `triangulate` stage: `stages.motion.known_poses.triangulation`."""

    max_size_px: int = setting(
        1600, "Features are sought in copies of the views with this longest side at most.", unit="px", ge=128
    )
    max_features: int = setting(
        4096,
        "Features per view, at most. Points tell in which distances surface lies, and which views share it; "
        "poses are not found from them.",
        unit="features",
        ge=100,
    )
    neighbours: int = setting(
        12, "Views that each is matched with: the nearest that look the same way.", unit="views", ge=1
    )
    widest_deg: float = setting(
        60.0,
        "Angle between the optical axes of two views beyond which they are not matched: features do not "
        "resemble each other then.",
        unit="deg",
        gt=0,
        le=180,
    )
    fewest_points: int = setting(
        30,
        "Of fewer points none is kept: stereo then guesses distances from the poses (mvs.pose_points).",
        unit="points",
        ge=0,
    )
    seed: int = setting(0, "Of COLMAP's random samples.", ge=0)
