"""Settings of the search for the light, by phase."""

from __future__ import annotations

from typing import Annotated, TypeVar

from pydantic import Field, field_validator

from pipeline import Settings, group, setting

Positive = Annotated[float, Field(gt=0)]
Reflectance = Annotated[float, Field(gt=0, lt=1)]
Own = TypeVar("Own", bound="LightSearchSettings")


class PairSettings(Settings):
    """Settings of the pairs of pixels that are likely to be of equal albedo: drawing them, weighting them."""

    chromaticity_cell: float = setting(
        0.12,
        "Pixels whose log chromaticities lie in one cell of this size are paired as of equal chromaticity. "
        "What passes for an edge of the albedo under a known light is the decomposition's `chroma_step`.",
        unit="logarithm of red and blue over green",
        gt=0,
    )
    square_sides: tuple[Positive, ...] = setting(
        (0.03, 0.06, 0.12),
        "Sides of the squares in which pixels are paired as near: small ones for albedo that changes softly, "
        "and larger ones, since within smooth surface what is nearer hardly differs by its shading.",
        unit="share of a view's side",
        min_length=1,
    )
    smallest_square: int = setting(
        3,
        "Side of a square, at least: in smaller ones pixels share their shading as well as their albedo.",
        unit="px",
        ge=1,
    )
    partners: int = setting(
        4,
        "Partners of each pixel, within its cell of chromaticity and within its square of every size.",
        ge=1,
        le=100,
    )
    outline_distance: float = setting(
        3.0,
        "Near pairs that are farther apart on the surface lie at two sides of an outline, and are left out.",
        unit="median distances of near pairs in their view",
        gt=0,
    )
    thin_share: float = setting(
        0.1,
        "Pixels are drawn from those with four neighbours in their mask; from all, where these are no more "
        "than this share of them (thin things).",
        ge=0,
        le=1,
    )
    noise: float = setting(
        0.01,
        "Noise level n of the images: a pixel of intensity I has the reliability (I / (I + 2 n))².",
        unit="of the scaled image",
        gt=0,
    )
    darkest: float = setting(
        1e-4,
        "Logarithms of intensity are taken of this at least, and those of shading of this more.",
        unit="of the scaled image, or of shading",
        gt=0,
    )
    chroma_weight: float = setting(
        2.0,
        "How many times as much as one of brightness a difference of chromaticity tells of another albedo: "
        "shadows are deep, but hardly of another colour.",
        ge=0,
    )
    chromaticity_share: float = setting(
        0.2,
        "Share of the weight that pairs of equal chromaticity have at most while the light is sought: there "
        "is darker material of the same colour, grey above all.",
        ge=0,
        le=1,
    )
    compared_share: float = setting(
        0.5,
        "The same where several lights (distances, reflectances) are compared by their loss on the same "
        "pairs: these are not weighted by reliability.",
        ge=0,
        le=1,
    )
    fewest: int = setting(
        200,
        "Pairs in the smallest squares from which on their loss is the measure of the others' reliability; "
        "of fewer, the next larger squares are.",
        unit="pairs",
        ge=1,
    )


class SearchSettings(Settings):
    """Settings of the descent to the light, from coarse to fine, and of its bounces between the steps."""

    scales: tuple[Positive, ...] = setting(
        (2.4, 1.2, 0.6, 0.4, 0.4),
        "Differences of log albedo, one descent each, from which on a pair counts as of different albedo: "
        "coarse first, as bounces find their place, and so that a sun's shadow, e times darker and more, is "
        "not at once taken for another albedo; then finer.",
        unit="logarithm",
        min_length=1,
    )
    refined_scales: int = setting(
        2, "How many of them, the last, are used to go on from a light that is nearly known.", ge=1
    )
    max_steps: int = setting(200, "Steps of L-BFGS-B per scale, at most.", ge=1)
    slope_tolerance: float = setting(
        1e-5,
        "A descent ends where the slope by no radiance is larger (per light): further on, light explains "
        "differences of albedo.",
        gt=0,
    )
    further_light_share: float = setting(
        0.25, "Further pixels for every light beyond the first.", unit="share of `samples`", ge=0, le=1
    )
    bounce_pixels: int = setting(
        300_000,
        "Pixels, at most, that the albedo of the mesh's vertices is averaged from while light is sought; the "
        "cost does not grow beyond.",
        unit="pixels",
        ge=1000,
    )
    bounce_rounds: int = setting(
        3, "Rounds in which albedo and bounces are computed from each other under one light.", ge=1, le=100
    )
    brightest_quantile: float = setting(
        0.98,
        "Quantile of the vertices' albedo, weighted by their light, that counts as the brightest material.",
        gt=0,
        le=1,
    )
    seed: int = setting(0, "Of the random choice of pixels and pairs.", ge=0)


class RefinementSettings(Settings):
    """Settings of finer directions where light is bright: suns and lamps lie between those of the search."""

    bright: float = setting(
        3.0, "Cells of directions that are brighter are divided into seven.", unit="times the mean", gt=0
    )
    max_cells: int = setting(
        24,
        "Cells that are divided, at most, those that send most light: each adds six directions, and lamps "
        "are few.",
        ge=0,
    )


class ReflectanceSettings(Settings):
    """Settings of the search for the reflectance of the brightest material."""

    usual: float = setting(
        0.6,
        "What the brightest material of a scene often reflects (stone .3 to .6, plaster and paper .8): the "
        "search begins there.",
        gt=0,
        lt=1,
    )
    unusual_price: float = setting(
        0.005,
        "Price of twice or half of the usual reflectance, as a share of the disagreement of pairs; it grows "
        "with the square of the octaves. Flat curves tell little.",
        ge=0,
    )
    tried: tuple[Reflectance, ...] = setting(
        (0.08, 0.12, 0.18, 0.27, 0.4, 0.6, 0.9),
        "Reflectances, ascending, that the light is found under, downhill from the usual: a factor of 1.5 "
        "apart. The result is interpolated.",
        min_length=1,
    )
    sample_divisor: int = setting(
        3, "How many times fewer than `samples` pixels the light is found from under each.", ge=1, le=100
    )

    @field_validator("tried")
    @classmethod
    def _ascending(cls, tried: tuple[float, ...]) -> tuple[float, ...]:
        if list(tried) != sorted(set(tried)):
            raise ValueError("reflectances that ascend")
        return tried


class SpecularLightSettings(Settings):
    """Settings of `light_in_gloss`: pairs and differences of views on glossy surface, both at once."""

    residual_weight: float = setting(
        0.3,
        "Weight of the share of the views' differences that the light in the mirror leaves, against the "
        "loss of pairs of equal albedo.",
        ge=0,
    )
    max_steps: int = setting(100, "Steps of L-BFGS-B, at most.", ge=1)


class LightSearchSettings(Settings):
    """Settings of the search for light of at least 0, under which pixels of equal albedo come out alike."""

    samples: int = setting(
        20_000,
        "Pixels that the light is found from; a quarter as many more for every further light. More changes "
        "little.",
        unit="pixels",
        ge=1000,
        le=300_000,
    )
    neutrality: float = setting(
        0.005,
        "The price of channels that disagree about where the light comes from. More keeps the colour of "
        "paint out of the light where all that faces one way is of one colour (moss on the ground); less is "
        "for coloured lamps.",
        ge=0,
    )
    evenness: float = setting(
        1e-3,
        "The price of light that differs from direction to direction; settles what the surface does not "
        "see. A sun costs what it is bright, not the square.",
        ge=0,
    )
    bounces: int = setting(4, "How often light is passed on between surfaces; 0: not at all.", ge=0, le=100)
    brightest: float | None = setting(
        None,
        "What the brightest material reflects: it says how much light bounces. none: found, as that under "
        "which like surface in hollows and outside comes out most alike.",
        ge=0.01,
        le=0.95,
    )
    pairs: PairSettings = group(
        PairSettings,
        "Pairs of pixels that are likely to be of equal albedo: how they are drawn and weighted.",
    )
    search: SearchSettings = group(
        SearchSettings, "The descent to the light, from coarse to fine, and its bounces between the steps."
    )
    refinement: RefinementSettings = group(
        RefinementSettings, "Finer directions where light is bright, found anew with sharper shadows."
    )
    reflectance: ReflectanceSettings = group(
        ReflectanceSettings,
        "The search for the reflectance of the brightest material, where it is not given.",
    )
    specular_light: SpecularLightSettings = group(
        SpecularLightSettings,
        "The descent to the light by pairs and by how views of glossy surface differ, both at once.",
    )

    @property
    def reflectance_is_found(self) -> bool:
        """Whether the reflectance of the brightest material is sought: without bounces it says nothing."""
        return self.brightest is None and self.bounces > 0

    @property
    def finest_scale(self) -> float:
        """Difference of log albedo at which lights are compared."""
        return self.search.scales[-1]

    def reflecting(self: Own, brightest: float) -> Own:
        """Take the brightest material to reflect so much."""
        return self.model_copy(update={"brightest": brightest})

    def to_begin_with(self: Own) -> Own:
        """Take the usual reflectance until it is known better."""
        return self if self.brightest is not None else self.reflecting(self.reflectance.usual)

    def to_compare_reflectances(self: Own) -> Own:
        """Use fewer pixels, at the finest scale alone."""
        finest = self.search.model_copy(update={"scales": self.search.scales[-1:]})
        samples = self.samples // self.reflectance.sample_divisor
        return self.model_copy(update={"samples": samples, "search": finest})
