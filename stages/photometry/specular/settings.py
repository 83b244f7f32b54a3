"""Settings of the comparison of views: highlights, dark outliers, specular reflection."""

from __future__ import annotations

from typing import Annotated

from pydantic import Field

from pipeline import Settings, group, setting

Roughness = Annotated[float, Field(gt=0, le=1)]


class LinkedPatchSettings(Settings):
    """Settings of the comparison of corresponding pixels over small squares; see `LinkedPatches`."""

    patch_px: int = setting(
        5,
        "Side of the square over whose correspondences view differences are averaged: the smallest highlight "
        "that is distinguished from fine texture, misregistered by half a pixel.",
        unit="px",
        ge=1,
        le=101,
    )
    min_linked_share: float = setting(
        0.2,
        "Smallest share of a square with correspondences; with less, views are not compared there.",
        ge=0,
        le=1,
    )
    log_floor: float = setting(
        0.02,
        "Added under the logarithm, so that darker values, which are noise, hardly differ.",
        unit="of the scaled image",
        gt=0,
        le=1,
    )


class HighlightSettings(LinkedPatchSettings):
    """Settings of `without_highlights`."""

    rounds: int = setting(
        3,
        "Rounds of highlight removal: in each, the brightest views of a place are reduced towards the rest.",
        ge=0,
        le=20,
    )
    tolerance: float = setting(
        0.02,
        "Excess of a view over the others, beyond their misfit, that is attributed to noise.",
        unit="of the logarithm",
        ge=0,
        le=1,
    )
    min_negative_share: float = setting(
        0.05,
        "The misfit of the views is the root mean square of the negative differences in a neighbourhood. "
        "Where their share is less than this, it is reduced: it would be estimated from a few pixels.",
        gt=0,
        le=1,
    )


class DarkOutlierSettings(Settings):
    """Settings of `darker_outliers`."""

    ratio: float = setting(
        3.0,
        "Brightness ratio of most other views to a view from which on that view is distrusted as showing a "
        "shadow or a passer-by; gloss hardly ever gives as much.",
        gt=1,
        le=100,
    )
    min_correspondences_per_pixel: float = setting(
        1.5,
        "Squares are used where their pixels have more correspondences than this on average: of two views "
        "alone, either may be wrong.",
        unit="correspondences per pixel",
        ge=0,
        le=100,
    )
    black: float = setting(
        0.002,
        "A pixel up to this is black, and needs no agreement of a square: the value of a background painted "
        "black, after compression, is a few steps of eight bits.",
        unit="of the scaled image",
        ge=0,
        le=1,
    )


class ViewDifferenceSettings(Settings):
    """Settings of `Differences`: view differences along correspondences, and the mirrored light in them."""

    roughnesses: tuple[Roughness, ...] = setting(
        (0.15, 0.2, 0.3),
        "Roughnesses α of GGX that are compared, sorted. A lobe sharper than 0.15 is narrower than the "
        "spacing of 256 directions.",
        min_length=1,
        max_length=16,
    )
    correspondences: int = setting(
        15_000,
        "Correspondences that are sampled, or up to twice as many.",
        unit="correspondences",
        ge=100,
        le=1_000_000,
    )
    min_correspondences: int = setting(
        200,
        "Fewest correspondences for a strength of the reflection: fewer are explained by chance as well.",
        unit="correspondences",
        ge=1,
    )
    min_correspondences_per_direction: float = setting(
        10.0,
        "Fewest correspondences per direction for a light of its own in the reflection: as many unknowns as "
        "correspondences would fit noise.",
        unit="correspondences per direction",
        ge=0,
    )
    resolved_directions: int = setting(
        256,
        "Directions that lobes of these roughnesses resolve: of more, only so many count for "
        "`min_correspondences_per_direction`.",
        unit="directions",
        ge=1,
    )
    min_shading: float = setting(
        0.1,
        "Least shading in each channel of both corresponding pixels, lest one of them lies in shadow.",
        unit="of the mean shading",
        ge=0,
        le=1,
    )
    max_shading_ratio: float = setting(
        5.0,
        "Correspondences with a larger ratio of shading are mismatches, and are left out.",
        gt=1,
    )
    noise: float = setting(
        0.02,
        "Differences below this are noise, and have a quadratic cost; larger ones a linear one.",
        unit="of the scaled image",
        gt=0,
        le=1,
    )
    min_difference: float = setting(
        1e-3,
        "Views whose mean difference is less count as equal, and do not constrain reflection.",
        unit="of `noise`",
        ge=0,
        le=1,
    )
    evenness: float = setting(
        1e-3,
        "Weight of the prior that light in the reflection is uniform over directions; it determines "
        "directions that views do not constrain.",
        ge=0,
    )
    max_iterations: int = setting(
        60,
        "Most iterations of L-BFGS-B for the light in the reflection.",
        unit="iterations",
        ge=1,
        le=10_000,
    )
    slope_tolerance: float = setting(
        1e-5,
        "The iterations end where no partial derivative by a radiance is larger.",
        gt=0,
    )
    reweighting_rounds: int = setting(
        10,
        "Rounds of iteratively reweighted least squares for the strength under a known light.",
        unit="rounds",
        ge=1,
        le=1000,
    )
    explained_residual: float = setting(
        0.7,
        "Share of the differences left by mirrored light below which it explains them, and all surface is "
        "taken to be specular.",
        ge=0,
        le=1,
    )
    hopeless_residual: float = setting(
        0.9,
        "Share of the differences left by the middle roughness from which on the other roughnesses are not "
        "tried: they would not explain much more.",
        ge=0,
        le=1,
    )

    @property
    def middle_roughness(self) -> int:
        """Index of the roughness that is tried first."""
        return len(self.roughnesses) // 2


class ClusterSettings(Settings):
    """Settings of `chromaticity_clusters`."""

    count: int = setting(
        10,
        "Most clusters of albedo; more would split one where the light is slightly wrong.",
        unit="clusters",
        ge=1,
        le=1000,
    )
    brightness_weight: float = setting(
        0.2,
        "Weight of the albedo's log brightness relative to its log chromaticity: errors of the light mostly "
        "affect brightness.",
        ge=0,
        le=1,
    )
    log_floor: float = setting(
        0.04,
        "Added to the albedo under the logarithm: the chromaticity of darker albedo is noise.",
        unit="of the median albedo",
        gt=0,
        le=1,
    )
    min_shading: float = setting(
        0.01,
        "Lower bound of the shading in the quotient image / shading: less would amplify noise.",
        unit="of the scaled shading",
        gt=0,
        le=1,
    )
    samples: int = setting(
        20_000,
        "Pixels that the clusters are computed from, or up to twice as many; others join the nearest.",
        unit="pixels",
        ge=100,
    )
    runs: int = setting(
        5,
        "Runs of k-means from random seeds, of which the best is used.",
        unit="runs",
        ge=1,
        le=1000,
    )


class SpecularSettings(Settings):
    """Settings of specular reflection: its estimation, acceptance and removal."""

    remove: bool = setting(
        True,
        "One light for all views: remove the mirror image of the light in a rough (GGX) surface where it "
        "explains the view differences, on all surface or on the clusters of albedo where it does. These "
        "differences then constrain the light, too.",
    )
    alternations: int = setting(
        2,
        "Alternations of removing the reflection and estimating light and reflection jointly.",
        unit="alternations",
        ge=1,
        le=20,
    )
    cluster_residual: float = setting(
        0.98,
        "Share of the differences left by the reflection of the light estimated from shading below which a "
        "cluster of albedo is specular: one strength per channel explains less than a light of its own.",
        ge=0,
        le=1,
    )
    min_strength: float = setting(
        0.01,
        "Least strength, in the strongest channel, for a reflection to be accepted: less is invisible.",
        unit="of the light's mean in the lobe",
        ge=0,
    )
    max_strength: float = setting(
        1.0,
        "Largest strength, in the strongest channel, for a reflection to be accepted: more results from "
        "baselines too short to constrain it.",
        unit="of the light's mean in the lobe",
        gt=0,
    )
    kept_share: float = setting(
        0.2,
        "Least share of a pixel's value that is kept, where highlights are slightly misplaced.",
        ge=0,
        le=1,
    )
    overshot_share: float = setting(
        0.01,
        "Share of the glossy pixels that may show less radiance than the reflection alone would have; the "
        "strength is lowered until no more do. Errors of the mesh leave some (.5 % of the fountain's wet "
        "ground); where there are more, it is dark paint that differs between views, not gloss.",
        unit="of their number",
        ge=0,
        le=1,
    )
    bounding_samples: int = setting(
        20_000,
        "Pixels that `overshot_share` is measured on, or up to twice as many.",
        unit="pixels",
        ge=100,
    )
    min_brightness: float = setting(
        0.01,
        "Lower bound of the brightness that the specular share of a pixel is relative to.",
        unit="of the scaled image",
        gt=0,
        le=1,
    )
    highlight_share: float = setting(
        0.25,
        "Specular share of a pixel's brightness from which on the pixel is distrusted, if another view has "
        "far less: `highlight_ratio`.",
        ge=0,
    )
    highlight_ratio: float = setting(
        3.0,
        "Least ratio of that share to the smallest one among the corresponding pixels of other views.",
        ge=1,
    )
    differences: ViewDifferenceSettings = group(
        ViewDifferenceSettings,
        "Differences between corresponding pixels, and their explanation by mirrored light.",
    )
    clusters: ClusterSettings = group(
        ClusterSettings,
        "Clusters of pixels of about equal albedo, where only some surface is specular.",
    )
