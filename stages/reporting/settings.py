"""Settings of the `report` stage."""

from __future__ import annotations

from pipeline import Settings, group, setting
from stages.geometry.settings import ProxySettings
from stages.scene.upright_settings import UPRIGHT_WITHIN_DEG
from stages.texturing.settings import GatheringSettings


class PictureSettings(Settings):
    """Settings of the pictures in the page: `stages.reporting.content.pictures`, `picture_size`."""

    largest_px: int = setting(
        1280, "Longest side of a picture, at most: what fills a screen.", unit="px", ge=64, le=8192
    )
    megabytes: float = setting(
        18.0,
        "All pictures of all views together, at most; of many views, each is smaller. A third more is in the "
        "page, for it holds them as text.",
        unit="MB",
        gt=0,
        le=500,
    )
    quality: int = setting(82, "Quality of the WebP compression.", ge=1, le=100)
    effort: int = setting(
        2,
        "Effort of the WebP compression: 4 takes up to half as long again, and leaves 5 to 8 % fewer bytes "
        "at the same quality.",
        ge=0,
        le=6,
    )
    tried_views: int = setting(
        5, "Views whose pictures are compressed to learn how many bytes a pixel takes.", unit="views", ge=1
    )
    thumbnail_px: int = setting(
        144, "Longest side of the small pictures that choose a view.", unit="px", ge=16, le=1024
    )
    sheet_white: float = setting(
        3.0,
        "White of photos that exceed 1, which linear ones may, as a multiple of their mean.",
        unit="mean values",
        gt=0,
    )
    white_quantile: float = setting(
        0.99,
        "Quantile of a view's values that is white in maps for which the export has chosen no white.",
        gt=0,
        le=1,
    )
    residual_stops: float = setting(
        0.5,
        "Ratio of photo to albedo × shading at which the picture of the residual has its full colour: half "
        "a stop is 40 % too bright.",
        unit="stops",
        gt=0,
        le=10,
    )
    depth_quantile: float = setting(
        0.01,
        "Share of a view's nearest and farthest pixels outside the range of colours of its depth.",
        ge=0,
        lt=0.5,
    )
    ball_px: int = setting(192, "Diameter of the white ball that shows a light.", unit="px", ge=16, le=1024)
    lights: int = setting(
        12, "Lights that are shown where views have lights of their own, evenly chosen.", ge=1, le=1000
    )
    light_quantile: float = setting(
        0.98,
        "Quantile of the directions' radiance that is white in pictures of light, all lights together.",
        gt=0,
        le=1,
    )


class FigureSettings(Settings):
    """Settings of the figures: `stages.reporting.content.view_figures`, `link_samples`."""

    pixels: int = setting(20_000, "Pixels of a view that figures are computed of.", unit="pixels", ge=100)
    pairs: int = setting(
        24, "Pairs of views whose agreement is measured, evenly chosen.", unit="pairs", ge=1, le=10_000
    )
    links: int = setting(20_000, "Corresponding pixels of a pair that are compared.", unit="links", ge=100)
    log_offset: float = setting(
        0.001,
        "Added to photo and albedo before logarithms, so that black pixels do not decide how much was light.",
        unit="mean values",
        gt=0,
    )
    confident: float = setting(
        0.5, "Confidence from which a pixel counts as known: its expected error is below 10 %.", ge=0, le=1
    )


class RemarkSettings(Settings):
    """Settings of the report's own warnings: `stages.reporting.document.remarks`."""

    least_coverage: float = setting(
        0.25, "Share of a picture with surface below which the view is named.", ge=0, le=1
    )
    least_confident: float = setting(
        0.5, "Share of a view's pixels that are known below which it is named.", ge=0, le=1
    )
    most_residual: float = setting(
        0.1, "Median residual of a view, over its brightness, above which it is named.", gt=0
    )
    most_gain_stops: float = setting(
        0.5,
        "Gain of a view, from the middle of all, above which its exposure is said to differ.",
        unit="stops",
        gt=0,
    )
    most_albedo_stops: float = setting(
        0.2,
        "Brightness of a view's albedo beside that of the other views, at the points that they share, above "
        "which it is named: 15 % more, 13 % less, which one sees where views are compared.",
        unit="stops",
        gt=0,
    )
    most_albedo_spread_stops: float = setting(
        0.06,
        "How much a view's albedo may be brighter than the other views' in some places and darker in others "
        "(median of the difference), whatever the other views do.",
        unit="stops",
        gt=0,
    )
    most_albedo_spread_ratio: float = setting(
        3.0,
        "How many times as much as in the middle one of the views that must be as well for a view to be "
        "named: a lamp that was moved for it leaves shading in its albedo, errors of the mesh leave as much "
        "in all views.",
        gt=1,
    )
    photo_every_deg: float = setting(
        15.0,
        "Angle between photos around a subject that is advised where a side is missing: each overlaps its "
        "neighbours, and texture is found again.",
        unit="°",
        gt=0,
        le=45,
    )
    widest_gap_deg: float = setting(
        120.0,
        "Angle between neighbouring views around the surface, seen from above, from which on the side "
        "between them is said to be shown by none.",
        unit="°",
        gt=0,
        le=360,
    )
    least_roundness: float = setting(
        0.2,
        "How far a surface must turn outward from its middle, if it is to be missed from behind: 1 for an "
        "upright cylinder, 0.4 for a bust seen from the front, 0 for a wall, less for a room.",
        ge=-1,
        le=1,
    )
    most_named: int = setting(8, "Views that are named for one reason.", unit="views", ge=1)


class SurfaceSettings(Settings):
    """Settings of the model in the page: `stages.reporting.content.vertex_maps`, `textured_surface`."""

    most_vertices: int = setting(
        60_000,
        "A mesh of more vertices is decimated, and one of fewer is cut into as many: colours are of "
        "vertices. So many are 3 MB in the page, and turn smoothly on a phone.",
        ge=100,
        le=2_000_000,
    )
    most_textured_faces: int = setting(
        400_000,
        "A textured model of more faces is not shown; the page then has colours of vertices, as where there "
        "is no texture. So many are 10 MB in the page.",
        unit="faces",
        ge=1,
    )
    texture_px: int = setting(
        2048,
        "Side of the model's texture in the page, at most; several are as large together. Twice as much is "
        "four times the bytes, and a phone's card may not hold it.",
        unit="px",
        ge=64,
        le=8192,
    )
    view_px: int = setting(
        960, "Longest side to which views are reduced before vertices take their values.", unit="px", ge=32
    )
    footprint_vertices: int = setting(
        20_000, "Vertices of the mesh at which the size of a pixel is found, evenly chosen.", ge=100
    )
    compared_vertices: int = setting(
        5_000, "Vertices at which the albedo of each view is compared with the others'.", ge=100
    )
    fewest_compared: int = setting(
        100, "Vertices that a view must share with two others, if its albedo is compared with theirs.", ge=1
    )
    bright_quantile: float = setting(
        0.995, "Quantile of the vertices' photo and shading that is white.", gt=0, le=1
    )
    gathering: GatheringSettings = group(GatheringSettings, "What each view tells of a vertex.")
    proxy: ProxySettings = group(ProxySettings, "The decimation.")


class ReportSettings(Settings):
    """Settings of the `report` stage."""

    upright_within_deg: float = UPRIGHT_WITHIN_DEG
    pictures: PictureSettings = group(PictureSettings, "The pictures in the page.")
    figures: FigureSettings = group(FigureSettings, "The figures of each view and of all.")
    remarks: RemarkSettings = group(RemarkSettings, "What the report warns of by itself.")
    surface: SurfaceSettings = group(SurfaceSettings, "The model in the page.")


class ComparisonSettings(Settings):
    """Settings of `unshade compare`: `stages.reporting.comparison`."""

    pixels: int = setting(
        20_000, "Pixels of a view by which the scale between two albedos is estimated.", unit="pixels", ge=100
    )
    quantile: float = setting(
        0.98, "Quantile of the difference that has its full colour: few exceed it.", gt=0, le=1
    )
    least_stops: float = setting(
        0.05,
        "Difference that has its full colour at least: 3 %, below which it is hardly seen.",
        unit="stops",
        gt=0,
    )
    most_shift_px: float = setting(
        0.5, "Distance of the same point in both results above which the page says so.", unit="px", gt=0
    )
