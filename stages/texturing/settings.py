"""Settings of the `texture` stage."""

from __future__ import annotations

from pipeline import Settings, group, setting
from stages.geometry.settings import ProxySettings
from stages.scene.upright_settings import UPRIGHT_WITHIN_DEG


class ChartSettings(Settings):
    """Settings of the mesh that carries the texture, and of its charts: `stages.texturing.unwrapping`."""

    most_faces: int = setting(
        150_000,
        "A mesh of more faces is decimated to about as many; what is finer goes into the normal map. "
        "Unwrapping takes half a minute for so many.",
        ge=100,
        le=2_000_000,
    )
    most_px: int = setting(4096, "Side of the textures, at most.", unit="texels", ge=64, le=16384)
    least_px: int = setting(256, "And at least.", unit="texels", ge=16, le=16384)
    texels_per_pixel: float = setting(
        1.0,
        "Texels for each pixel of the nearest view, by length, if `most_px` permits: fewer lose detail.",
        gt=0,
        le=8,
    )
    expected_use: float = setting(
        0.7,
        "Share of an atlas that charts cover, by which its side is chosen at first; where they turn out to "
        "cover so little that texels are larger than asked, they are laid out again in a larger one.",
        gt=0,
        le=1,
    )
    padding_px: int = setting(
        4, "Texels between charts, so that smaller copies of the texture do not mix them.", ge=0, le=64
    )
    large_face: float = setting(
        0.01,
        "A face of more than this share of all surface, of which there are few, is looked for in views at "
        "many places: no photo may show its middle.",
        unit="of the mesh's area",
        gt=0,
        le=1,
    )
    places_along: int = setting(24, "Those places, along each of its sides.", unit="places", ge=2, le=256)
    proxy: ProxySettings = group(ProxySettings, "The decimation.")


class GivenUVSettings(Settings):
    """Settings of a mesh that is given with texture coordinates: `stages.texturing.given_charts`."""

    keep: bool = setting(
        True,
        "A given mesh that has texture coordinates is textured on them, all its faces as they are: the "
        "textures then fit what was made for that mesh. False: new charts, as for every other mesh.",
    )
    most_textures: int = setting(
        100,
        "Materials, and UDIM tiles of each, at most: every one has images of its own, and opens all views.",
        ge=1,
        le=1000,
    )
    most_layers: float = setting(
        8.0,
        "Faces that lie on one another in a texture, on average over it, at most: where a pattern repeats "
        "over a wall, its image has no place for the albedo of the wall; and all layers are held in memory.",
        ge=1,
        le=64,
    )
    shared_share: float = setting(
        0.01,
        "A warning tells of texels that several faces share, if they are more than this share.",
        ge=0,
        le=1,
        changes_result=False,
    )


class GatheringSettings(Settings):
    """Settings of what each view tells of a texel: `stages.texturing.gathering`."""

    min_cosine: float = setting(
        0.15, "Cosine of the angle between normal and ray below which a view tells nothing.", ge=0, lt=1
    )
    depth_footprints: float = setting(
        3.0,
        "A texel is visible where it is no farther than this from the view's depth, for surface that faces "
        "the camera.",
        unit="pixel footprints",
        gt=0,
    )
    jump_footprints: float = setting(
        8.0,
        "Neighbouring depths that differ by more are of different surfaces.",
        unit="pixel footprints",
        gt=0,
    )
    border_px: float = setting(
        6.0,
        "A view's weight rises from none at the borders of its mask and of surfaces to all at this distance.",
        unit="working px",
        gt=0,
    )
    sharpness: float = setting(
        2.0,
        "Power of the weight by pixels per surface: the sharpest view counts most, but the others still "
        "average what they disagree in.",
        ge=0,
        le=8,
    )
    tolerance: float = setting(
        0.2,
        "Difference from the mean of all views at which a view's weight falls to 1/e, in the second pass: "
        "what one view alone shows is not the surface.",
        unit="of the logarithm",
        gt=0,
    )
    log_offset: float = setting(0.02, "Added to albedo before logarithms.", unit="of `bright_quantile`", gt=0)
    bright_quantile: float = setting(0.99, "Quantile of the albedo that counts as bright.", gt=0, le=1)


class CompletionSettings(Settings):
    """Settings of surface that no view shows: `stages.texturing.completion`."""

    rounds: int = setting(
        400, "Rounds in which unseen vertices take the mean of their neighbours.", ge=1, le=100_000
    )


class TextureSettings(Settings):
    """Settings of the `texture` stage."""

    upright_within_deg: float = UPRIGHT_WITHIN_DEG
    charts: ChartSettings = group(ChartSettings, "The mesh that carries the texture, and its charts.")
    given_uv: GivenUVSettings = group(GivenUVSettings, "Texture coordinates that the mesh is given with.")
    gathering: GatheringSettings = group(GatheringSettings, "What each view tells of a texel.")
    completion: CompletionSettings = group(CompletionSettings, "Surface that no view shows.")
