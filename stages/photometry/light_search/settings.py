"""Settings of the light search, by phase."""

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
        "Albedo edges under a known light are defined by the decomposition's `chroma_step` instead.",
        unit="logarithm of red and blue over green",
        gt=0,
    )
    square_sides: tuple[Positive, ...] = setting(
        (0.03, 0.06, 0.12),
        "Sides of the squares in which pixels are paired as near: small ones for smoothly varying albedo, "
        "and larger ones, since shading hardly differs between nearer pixels of smooth surface.",
        unit="share of a view's side",
        min_length=1,
    )
    smallest_square: int = setting(
        3,
        "Smallest side of a square: in smaller ones pixels share their shading as well as their albedo.",
        unit="px",
        ge=1,
    )
    partners: int = setting(
        4,
        "Partners of each pixel within its chromaticity cell, and within its square of every size.",
        ge=1,
        le=100,
    )
    outline_distance: float = setting(
        3.0,
        "Near pairs that are farther apart on the surface lie on two sides of an occluding contour, and are "
        "left out.",
        unit="median distances of near pairs in their view",
        gt=0,
    )
    thin_share: float = setting(
        0.1,
        "Pixels are drawn from those with four neighbours in their mask; from all, where these are no more "
        "than this share of them (thin structures).",
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
        "Lower bound of intensity under the logarithm; also added to shading.",
        unit="of the scaled image, or of shading",
        gt=0,
    )
    chroma_weight: float = setting(
        2.0,
        "Weight of a difference of chromaticity relative to one of brightness: shadows change brightness "
        "much and chromaticity little.",
        ge=0,
    )
    chromaticity_share: float = setting(
        0.2,
        "Largest share of the weight that pairs of equal chromaticity have in the light search: albedos of "
        "equal chromaticity may differ in brightness, grey ones above all.",
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
        "Fewest pairs in the smallest squares for their loss to be the reference of the others' reliability; "
        "with fewer, the next larger squares are.",
        unit="pairs",
        ge=1,
    )


class SearchSettings(Settings):
    """Settings of the coarse-to-fine optimisation of the light, and of its interreflection between steps."""

    scales: tuple[Positive, ...] = setting(
        (2.4, 1.2, 0.6, 0.4, 0.4),
        "Differences of log albedo, one descent each, from which on a pair counts as of different albedo. "
        "Coarse first, while interreflection is inaccurate, and lest a sun's shadow, darker by e or more, be "
        "taken for another albedo; then finer.",
        unit="logarithm",
        min_length=1,
    )
    refined_scales: int = setting(
        2, "Number of the last scales that are used when an initial light is given.", ge=1
    )
    max_steps: int = setting(200, "Steps of L-BFGS-B per scale, at most.", ge=1)
    slope_tolerance: float = setting(
        1e-5,
        "A descent ends where no partial derivative by a radiance is larger (per light): beyond, light "
        "explains differences of albedo.",
        gt=0,
    )
    further_light_share: float = setting(
        0.25, "Further pixels for every light beyond the first.", unit="share of `samples`", ge=0, le=1
    )
    bounce_pixels: int = setting(
        300_000,
        "Most pixels that the albedo of the mesh's vertices is averaged from during the light search; the "
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
    seed: int = setting(0, "Seed of the random choice of pixels and pairs.", ge=0)


class RefinementSettings(Settings):
    """Settings of the refinement of directions where light is bright: suns and lamps lie between them."""

    bright: float = setting(
        3.0, "Brighter cells of directions are subdivided into seven.", unit="times the mean", gt=0
    )
    max_cells: int = setting(
        24,
        "Most cells that are subdivided, those of the largest flux: each adds six directions, and lamps are "
        "few.",
        ge=0,
    )


class ReflectanceSettings(Settings):
    """Settings of the search for the reflectance of the brightest material."""

    usual: float = setting(
        0.6,
        "Typical reflectance of the brightest material of a scene (stone .3 to .6, plaster and paper .8): "
        "initial value of the search, and of light beside interreflection that photos of all views show.",
        gt=0,
        lt=1,
    )
    unusual_price: float = setting(
        0.005,
        "Penalty of twice or half the usual reflectance, as a share of the disagreement of pairs; it grows "
        "with the square of the octaves, and decides where the loss is flat.",
        ge=0,
    )
    tried: tuple[Reflectance, ...] = setting(
        (0.08, 0.12, 0.18, 0.27, 0.4, 0.6, 0.9),
        "Ascending reflectances, a factor of 1.5 apart, that are tried in descent from the usual one. The "
        "result is interpolated.",
        min_length=1,
    )
    sample_divisor: int = setting(
        3, "Divisor of `samples` for the light under each reflectance.", ge=1, le=100
    )

    @field_validator("tried")
    @classmethod
    def _ascending(cls, tried: tuple[float, ...]) -> tuple[float, ...]:
        if list(tried) != sorted(set(tried)):
            raise ValueError("reflectances that ascend")
        return tried


class SpecularLightSettings(Settings):
    """Settings of `light_in_gloss`: pairs and view differences of glossy surface, jointly."""

    residual_weight: float = setting(
        0.3,
        "Weight of the share of view differences that the mirrored light leaves, against the loss of pairs "
        "of equal albedo.",
        ge=0,
    )
    max_steps: int = setting(100, "Steps of L-BFGS-B, at most.", ge=1)


class LightSearchSettings(Settings):
    """Settings of the search for non-negative light that minimises the loss of pairs of equal albedo."""

    samples: int = setting(
        20_000,
        "Pixels that the light is estimated from; a quarter as many more for every further light. More "
        "changes little.",
        unit="pixels",
        ge=1000,
        le=300_000,
    )
    neutrality: float = setting(
        0.005,
        "Weight of the prior that light has one colour from all directions. More keeps the colour of albedo "
        "out of the light where all surface of one orientation has one colour (moss on the ground); less is "
        "for coloured lamps.",
        ge=0,
    )
    evenness: float = setting(
        1e-3,
        "Weight of the prior that light is uniform over directions; determines directions that the surface "
        "does not see. A sun's cost is linear in its radiance, not quadratic.",
        ge=0,
    )
    bounces: int = setting(
        4,
        "Number of interreflections between surfaces; 0: none. Where light is found on some views, photos of "
        "all show the sum of all, whatever this is beyond 0.",
        ge=0,
        le=100,
    )
    brightest: float | None = setting(
        None,
        "Reflectance of the brightest material; it sets the scale of interreflection. none: estimated as "
        "that under which equal albedos in concavities and outside agree best.",
        ge=0.01,
        le=0.95,
    )
    pairs: PairSettings = group(
        PairSettings,
        "Drawing and weighting of pairs of pixels that are likely to be of equal albedo.",
    )
    search: SearchSettings = group(
        SearchSettings, "The coarse-to-fine optimisation of the light, and its interreflection between steps."
    )
    refinement: RefinementSettings = group(
        RefinementSettings, "Finer directions where light is bright, re-estimated with sharper shadows."
    )
    reflectance: ReflectanceSettings = group(
        ReflectanceSettings,
        "The search for the reflectance of the brightest material, where it is not given.",
    )
    specular_light: SpecularLightSettings = group(
        SpecularLightSettings,
        "The optimisation of the light by pairs and by view differences of glossy surface, jointly.",
    )

    @property
    def reflectance_is_found(self) -> bool:
        """Whether the brightest material's reflectance is estimated: without bounces it has no effect."""
        return self.brightest is None and self.bounces > 0

    @property
    def finest_scale(self) -> float:
        """Difference of log albedo at which lights are compared."""
        return self.search.scales[-1]

    def reflecting(self: Own, brightest: float) -> Own:
        """Set the reflectance of the brightest material."""
        return self.model_copy(update={"brightest": brightest})

    @property
    def initial_brightest(self) -> float:
        """Reflectance that a search begins with: `brightest`, else the usual one."""
        return self.brightest or self.reflectance.usual

    def to_begin_with(self: Own) -> Own:
        """Set the usual reflectance as the initial value, unless one is given."""
        return self.reflecting(self.initial_brightest)

    def to_compare_reflectances(self: Own) -> Own:
        """Reduce the search to fewer pixels and the finest scale."""
        finest = self.search.model_copy(update={"scales": self.search.scales[-1:]})
        samples = self.samples // self.reflectance.sample_divisor
        return self.model_copy(update={"samples": samples, "search": finest})
