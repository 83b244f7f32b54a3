"""Settings of the `sfm` stage."""

from __future__ import annotations

from typing import Literal

from pydantic import ValidationInfo, field_validator

from pipeline import Settings, group, setting

CAMERA_PARAMS = {  # by COLMAP's camera model, in its order
    "SIMPLE_PINHOLE": "f, cx, cy",
    "PINHOLE": "fx, fy, cx, cy",
    "SIMPLE_RADIAL": "f, cx, cy, k",
    "RADIAL": "f, cx, cy, k1, k2",
    "OPENCV": "fx, fy, cx, cy, k1, k2, p1, p2",
    "FULL_OPENCV": "fx, fy, cx, cy, k1, k2, p1, p2, k3, k4, k5, k6",
    "OPENCV_FISHEYE": "fx, fy, cx, cy, k1, k2, k3, k4",
}


class MappingSettings(Settings):
    """Settings of COLMAP's incremental mapper: `stages.motion.mapping`."""

    init_inliers: tuple[int, ...] = setting(
        (100, 100, 50, 30, 20),
        "Matches that the first pair must share, attempt by attempt; the last holds for those that follow. "
        "COLMAP's own first, then another seed, then looser: few photos share few features.",
        unit="matches",
        min_length=1,
    )
    init_angle_deg: tuple[float, ...] = setting(
        (16.0, 16.0, 8.0, 4.0, 2.0),
        "Median angle between the first pair's rays that it must have, attempt by attempt.",
        unit="deg",
        min_length=1,
    )
    pose_inliers: tuple[int, ...] = setting(
        (30, 30, 20, 15, 12),
        "Points that a further photo must see, attempt by attempt.",
        unit="points",
        min_length=1,
    )
    two_view_points: tuple[bool, ...] = setting(
        (False, False, True),
        "Whether points that only two photos see take part, attempt by attempt: none others may be there.",
        min_length=1,
    )
    local_tolerance: float = setting(
        1e-5,
        "Bundle adjustments around a new photo end where the cost falls by a smaller share. COLMAP's 0 runs "
        "each to the last digit; one adjustment at the end does that.",
        ge=0,
        lt=1,
    )
    global_tolerance: float = setting(1e-6, "And those of all photos.", ge=0, lt=1)


class RetrievalSettings(Settings):
    """Settings of the choice of pairs by appearance: `stages.motion.retrieval`."""

    neighbours: int = setting(
        40, "Photos that each is compared with: those that look most like it.", unit="photos", ge=1, le=1000
    )
    words: int = setting(
        16384,
        "Visual words that a sample of all descriptors is clustered into, at most. With few, unlike photos "
        "look alike; the time to find them grows with the square.",
        unit="words",
        ge=16,
    )
    features_per_word: int = setting(
        2,
        "Descriptors that the clusters are made from, per word; of fewer there are fewer words. More take "
        "longer, and make the words coarser where the photos are few.",
        unit="descriptors",
        ge=1,
    )
    indexed_features: int = setting(
        2000, "Features of each photo, largest first, that it is compared by.", unit="features", ge=1
    )
    iterations: int = setting(10, "Rounds of the clustering.", ge=1, le=1000)


class PairSettings(Settings):
    """Settings of the tests of whether photos can be placed: `stages.motion.placeable`."""

    tried: int = setting(60, "Matching pairs that are tried, spread evenly over all.", unit="pairs", ge=1)
    still: float = setting(
        1e-3,
        "A match that moved less stands still: two pixels of 1600, above the noise of features.",
        unit="longest sides",
        ge=0,
    )
    still_part: float = setting(
        0.2,
        "A pair with this share of its matches still has a part that stands still. Where the camera moves, "
        "only points around the one that it moves to or turns about do.",
        gt=0,
        le=1,
    )
    still_pairs: float = setting(
        0.5, "More such pairs than this share of those tried, and the photos are refused.", ge=0, le=1
    )
    parallax: float = setting(
        1e-3,
        "A turn of the camera that leaves more of a pair's median match does not explain it.",
        unit="longest sides",
        ge=0,
    )
    plane_ratio: float = setting(
        1.5,
        "Neither does one that leaves this many times what a plane leaves: a wall photographed square on. A "
        "panorama has 0.9 to 1.1.",
        ge=1,
    )
    parallax_pairs: float = setting(
        0.1,
        "With a smaller share of pairs that show depth, the photos are refused: the mapper makes models of "
        "panoramas, without a word.",
        ge=0,
        le=1,
    )
    matches: int = setting(300, "Matches of a pair that are compared, about.", unit="matches", ge=8)
    shortest_focal: float = setting(
        0.4,
        "Bound of the focal length of a turning camera, where EXIF has none.",
        unit="longest sides",
        gt=0,
    )
    longest_focal: float = setting(4.0, "And from above.", unit="longest sides", gt=0)
    focal_guesses: int = setting(2, "Focal lengths to start from, between them.", ge=1)


class FocalSettings(Settings):
    """Settings of the checks of the focal length: `stages.motion.focal_lengths`."""

    largest_deviation: float = setting(
        0.05,
        "A focal length with a larger standard deviation is warned of. Poses and relief follow its error: on "
        "rendered sets, it was off by 0.1 to 6 % where this is 0.4 to 8 %.",
        unit="focal lengths",
        gt=0,
    )
    spread: float = setting(
        0.02,
        "If a photo, by itself, would move the focal length that it shares by more, all are also "
        "placed with a camera each, for comparison: a zoom may have been turned. Two zooms: 0.04, 0.05.",
        unit="focal lengths",
        gt=0,
    )
    gain: float = setting(
        0.7,
        "A camera for each photo is kept if it lowers the mean reprojection error to less than this share of "
        "the shared one's: 0.2 to 0.5 where one to half of the photos are zoomed, 1.0 with one focal length.",
        gt=0,
        lt=1,
    )


class SfmSettings(Settings):
    """Settings of the `sfm` stage."""

    max_size_px: int = setting(
        1600,
        "Longest side at which features are sought; full resolution gained nothing on fountain-P11.",
        unit="px",
        ge=200,
        le=8192,
    )
    max_features: int = setting(8192, "Features kept per photo, COLMAP's default.", ge=256, le=65536)
    within_masks: bool = setting(
        False,
        "Features outside of the masks (--masks, alpha channels) are left out. For what moves before a "
        "background that does not move with it, as on a turntable. Else the background is kept: it helps to "
        "place the photos.",
    )
    alpha: bool = setting(
        True, "With within_masks: pixels that an alpha channel says are less than half opaque are masked too."
    )
    linear_white_percentile: float = setting(
        99.0,
        "Linear photos (EXR, HDR) are scaled so that this percentile of the set becomes white.",
        gt=50,
        le=100,
    )
    linear_white_samples: int = setting(
        4096, "Values of each linear photo that this percentile is taken of.", unit="values", ge=16
    )
    cameras: Literal["shared", "per_folder", "per_image"] = setting(
        "shared",
        "Who shares a lens. Photos of another size, orientation or EXIF focal length never do.",
    )
    camera_model: Literal[
        "SIMPLE_PINHOLE", "PINHOLE", "SIMPLE_RADIAL", "RADIAL", "OPENCV", "FULL_OPENCV", "OPENCV_FISHEYE"
    ] = setting("SIMPLE_RADIAL", "COLMAP camera model; one radial coefficient suffices for most lenses.")
    camera_params: list[float] | None = setting(
        None,
        "Known intrinsics, in COLMAP's order for camera_model, in pixels of the upright photo; held fixed.",
    )
    refine_camera: bool = setting(False, "Refine camera_params instead of holding them.")
    focal_factor: float = setting(
        1.2, "First guess of the focal length without EXIF, in longest sides.", gt=0.1, le=10
    )
    matching: Literal["auto", "exhaustive", "positions", "retrieval", "sequential"] = setting(
        "auto",
        "Which photos are compared: all pairs, those taken nearest to one another by the positions in their "
        "EXIF data, those that look alike, or neighbours in name order. auto: all pairs; of many photos, by "
        "positions if these tell all apart (`position_error_m`), else those that look alike.",
    )
    exhaustive_up_to: int = setting(
        200,
        "With matching: auto, of more photos than this only those that are near or look alike are compared.",
        unit="photos",
        ge=2,
        le=5000,
    )
    near: int = setting(
        40,
        "With matching: positions, photos that each is compared with: those taken nearest to it.",
        unit="photos",
        ge=1,
        le=1000,
    )
    position_error_m: float = setting(
        15.0,
        "Receivers of satellites are off by as much. Where half of all photos have the `near` nearest to "
        "them within it, as around a statue or with one position for a whole set, positions do not tell "
        "which photos are neighbours.",
        unit="m",
        gt=0,
    )
    retrieval: RetrievalSettings = group(RetrievalSettings, "How photos that look alike are found.")
    overlap: int = setting(
        10, "Neighbours each photo of a sequence is compared with; powers of two besides.", ge=1, le=20
    )
    mapper: Literal["incremental", "global"] = setting(
        "incremental", "COLMAP's incremental mapper, or its global one, which pays for large sets."
    )
    attempts: int = setting(
        4,
        "Starts of the incremental mapper, with other seeds and looser thresholds, before giving up.",
        ge=1,
        le=20,
    )
    enough: float = setting(
        0.9, "An attempt that places this share of the photos is good enough to stop.", gt=0, le=1
    )
    guided_matching: bool = setting(
        True,
        "Photos that the first attempt leaves out are compared again with those that they share matches "
        "with, along epipolar lines: half as many matches again, or more. Of all pairs, it takes up to six "
        "times as long.",
    )
    free_principal_point: bool = setting(
        True, "A last bundle adjustment moves the principal point off the centre."
    )
    largest_principal_shift: float = setting(
        0.03, "A larger shift of the principal point is refused.", unit="image width or height", gt=0, le=0.5
    )
    principal_point_views: int = setting(
        6, "Cameras with fewer photos keep their principal point: it would trade against the poses.", ge=3
    )
    pairs: PairSettings = group(PairSettings, "Tests of whether photos can be placed at all.")
    focal: FocalSettings = group(FocalSettings, "Checks of the focal lengths that were found.")
    seed: int = setting(0, "Start of every random generator.", ge=0, le=2**31 - 100)
    mapping: MappingSettings = group(
        MappingSettings, "What the incremental mapper asks of photos, and how exactly it adjusts on its way."
    )

    @field_validator("camera_params")
    @classmethod
    def _fit_the_model(cls, params: list[float] | None, others: ValidationInfo) -> list[float] | None:
        model = others.data.get("camera_model", "")  # missing where it is refused itself
        names = CAMERA_PARAMS.get(model, "")
        count = names.count(",") + 1
        if params is not None and model and len(params) != count:
            raise ValueError(f"the {count} numbers of {model}, in pixels of the upright photo: {names}")
        return params

    @property
    def holds_cameras(self) -> bool:
        """Whether the intrinsics are known and stay as given."""
        return self.camera_params is not None and not self.refine_camera
