"""Settings of the search for suns and lamps."""

from __future__ import annotations

from typing import Annotated

from pydantic import Field

from pipeline import Settings, group, setting

Angle = Annotated[float, Field(gt=0, le=45)]
Factor = Annotated[float, Field(gt=0)]


class ShadowSettings(Settings):
    """Settings of the search for shadows of what the mesh does not have: a tree, a tower."""

    find: bool = setting(True, "Find them; else a sun is hidden by the mesh alone.")
    rounds: int = setting(
        2,
        "Rounds in which shadows, light and directions of suns are found under each other.",
        unit="rounds",
        ge=1,
        le=10,
    )
    coarsest_side: int = setting(
        60,
        "Least side of a whole view's grid that the search begins on. Its cost grows with the square of it.",
        unit="cells",
        ge=8,
    )
    distances: tuple[Annotated[int, Field(ge=1)], ...] = setting(
        (1, 2, 4, 8, 16, 32),
        "Distances of the pixels whose albedo is compared: across an edge of any width, and past the joints "
        "of masonry.",
        unit="cells",
        min_length=1,
    )
    penumbra: tuple[Annotated[float, Field(gt=0, lt=1)], ...] = setting(
        (0.5, 0.25, 0.75),
        "Shares of the sun that pixels beside the edge of a shadow may see, beside none and all. Elsewhere "
        "they would make half a shadow of any grey patch.",
        unit="share of the sun",
    )
    penumbra_width: float = setting(
        0.012,
        "How far from the edge of a shadow its penumbra reaches. The sun's disc makes it a hundredth of the "
        "way to what hides it, which is as far away as the view is wide.",
        unit="of a view's side, taken as a square",
        gt=0,
        le=0.2,
    )
    uncertain_width: float = setting(
        0.006,
        "How far beside the edge of a shadow of the mesh the photo decides where that edge is: so far are "
        "mesh and sun off.",
        unit="of a view's side, taken as a square",
        gt=0,
        le=0.1,
    )
    texture: Factor = setting(
        2.0,
        "Pairs of pixels whose log albedos differ by more, in brightness or in chromaticity, are "
        "of different albedo and say nothing.",
        unit="medians of pairs at that distance",
    )
    least_step: Factor = setting(
        0.1, "Least such difference of brightness: that of the shading that was found.", unit="logarithm"
    )
    least_chroma_step: Factor = setting(
        0.03,
        "Least such difference of chromaticity. A shadow has a colour of its own, for the sky is blue: where "
        "paint varies in brightness alone, it tells them apart.",
        unit="logarithm",
    )
    edge: float = setting(
        0.4,
        "Price of the outline of a shadow that the mesh does not explain, per cell of it, as a share of all "
        "that a cell can disagree: joints and stains are smaller than shadows.",
        ge=0,
    )
    shade: float = setting(
        0.01,
        "Price of a cell in the shadow of nothing that is known, in the same unit, where nothing else "
        "decides.",
        ge=0,
    )
    margin: int = setting(
        2, "Cells beside an edge that are decided anew on the next finer grid.", unit="cells", ge=1
    )

    def roughly(self) -> ShadowSettings:
        """Make them those of shadows without penumbra, which the light is estimated with."""
        return self.model_copy(update={"penumbra": ()})


class SunSettings(Settings):
    """Settings of the search for small sources of light: the sun, lamps."""

    most: int = setting(
        4, "Most suns and lamps. 0: light is as wide as the finest cells of directions.", ge=0, le=8
    )
    bright: float = setting(
        3.0, "Brighter directions may be those of a sun.", unit="times the mean radiance", gt=0
    )
    least_share: float = setting(
        0.05,
        "Least part of a sun in all light from everywhere: weaker ones throw no shadow that one sees.",
        unit="share of the light",
        ge=0,
        lt=1,
    )
    within_deg: Angle = setting(
        12.0,
        "Bright directions this near to their middle are tried as one sun: in cells of 5°, and with shadows "
        "that are blurred between vertices, it is up to 5° off.",
        unit="degrees",
    )
    steps_deg: tuple[Angle, ...] = setting(
        (1.5, 0.4, 0.12),
        "Distances of the directions that are tried, coarse to fine: each round covers a step of the last.",
        unit="degrees",
        min_length=1,
    )
    brightness: tuple[Factor, ...] = setting(
        (0.7, 1.0, 1.4, 2.0),
        "Brightness of a sun that is tried at first: light that was spread over several cells, whose shadows "
        "are blurred, is underestimated.",
        unit="times that of the bright directions",
        min_length=1,
    )
    gain: float = setting(
        0.01,
        "By how much less the pairs of equal albedo must disagree for a sun in place of bright directions. "
        "Without a sun, the best of some hundred tried gains .001.",
        unit="share of the disagreement",
        ge=0,
        lt=1,
    )
    rays_across: int = setting(
        2, "Rays across a sun's disc, both ways: shades of a penumbra, and its cost.", unit="rays", ge=1, le=8
    )
    radius_deg: float = setting(
        0.27,
        "Radius of a sun's disc, which makes the penumbra of shadows: our sun's.",
        unit="degrees",
        gt=0,
        le=5,
    )
    shadows: ShadowSettings = group(
        ShadowSettings, "The search for shadows of what the mesh does not have: a tree, a tower."
    )
