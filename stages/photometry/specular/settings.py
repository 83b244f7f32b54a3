"""Settings of the phases that compare views: highlights, dark outliers, specular reflection."""

from __future__ import annotations

from typing import Annotated

from pydantic import Field

from pipeline import Settings, group, setting

Roughness = Annotated[float, Field(gt=0, le=1)]


class LinkedPatchSettings(Settings):
    """Settings of the comparison of linked pixels, which is by small squares; see `LinkedPatches`."""

    patch_px: int = setting(
        5,
        "Side of the square over whose links differences between views are averaged: the smallest highlight "
        "that is told from fine texture, which half a pixel of misregistration makes differ both ways.",
        unit="px",
        ge=1,
        le=101,
    )
    min_linked_share: float = setting(
        0.2,
        "Share of a square that has to be linked to other views; with less, views are not compared there.",
        ge=0,
        le=1,
    )
    log_floor: float = setting(
        0.02,
        "Added under the logarithm: values darker than that are noise, and hardly differ.",
        unit="of the scaled image",
        gt=0,
        le=1,
    )


class HighlightSettings(LinkedPatchSettings):
    """Settings of `without_highlights`."""

    rounds: int = setting(
        3,
        "How often highlights are taken off: in each round the brighter of the views that are left come down "
        "to the rest.",
        ge=0,
        le=20,
    )
    tolerance: float = setting(
        0.02,
        "By how much a view may exceed the others beyond their misfit: noise.",
        unit="of the logarithm",
        ge=0,
        le=1,
    )
    min_negative_share: float = setting(
        0.05,
        "Misfit of the views is the root mean square of what is negative in a neighbourhood. Where less than "
        "this share of it is, that counts for less: it would be the figure of a few pixels.",
        gt=0,
        le=1,
    )


class DarkOutlierSettings(Settings):
    """Settings of `darker_outliers`."""

    ratio: float = setting(
        3.0,
        "How many times as bright most other views must see a place that something lies on in one view, a "
        "shadow or a passer-by, for that view to be distrusted there; gloss hardly ever does as much.",
        gt=1,
        le=100,
    )
    min_correspondences_per_pixel: float = setting(
        1.5,
        "Squares are asked where their pixels have more links than this on average: of two views alone, "
        "either may be the one that is wrong.",
        unit="links per pixel",
        ge=0,
        le=100,
    )
    black: float = setting(
        0.002,
        "A pixel up to this is black, and needs no square that agrees: what compression leaves of a painted "
        "background, a few steps of eight bits.",
        unit="of the scaled image",
        ge=0,
        le=1,
    )


class ViewDifferenceSettings(Settings):
    """Settings of `Differences`: how views differ along links, and what light in a mirror explains that."""

    roughnesses: tuple[Roughness, ...] = setting(
        (0.15, 0.2, 0.3),
        "Roughnesses α of GGX that are compared, sorted. A lobe sharper than 0.15 falls between 256 "
        "directions.",
        min_length=1,
        max_length=16,
    )
    correspondences: int = setting(
        15_000,
        "Links that are looked at, or up to twice as many.",
        unit="links",
        ge=100,
        le=1_000_000,
    )
    min_correspondences: int = setting(
        200,
        "Fewest links for a strength of the reflection: what fewer differ by is as well explained by chance.",
        unit="links",
        ge=1,
    )
    min_correspondences_per_direction: float = setting(
        10.0,
        "Fewest links for a light of its own in the reflection, per direction: as many numbers as links "
        "explain noise.",
        unit="links per direction",
        ge=0,
    )
    resolved_directions: int = setting(
        256,
        "Directions that lobes of these roughnesses tell apart: of more, only so many count for "
        "`min_correspondences_per_direction`.",
        unit="directions",
        ge=1,
    )
    min_shading: float = setting(
        0.1,
        "Shading in each channel that both ends of a link must have, lest one of them lies in shadow.",
        unit="of the mean shading",
        ge=0,
        le=1,
    )
    max_shading_ratio: float = setting(
        5.0,
        "Links whose ends differ by more in shading do not show one surface: they are left out.",
        gt=1,
    )
    noise: float = setting(
        0.02,
        "Differences below this are noise, and count by their square; larger ones by their size.",
        unit="of the scaled image",
        gt=0,
        le=1,
    )
    min_difference: float = setting(
        1e-3,
        "Views whose mean difference is less do not differ, and tell no reflection.",
        unit="of `noise`",
        ge=0,
        le=1,
    )
    evenness: float = setting(
        1e-3,
        "The price of light in the reflection that differs from direction to direction; settles what views "
        "do not tell.",
        ge=0,
    )
    max_iterations: int = setting(
        60,
        "Iterations of L-BFGS-B for the light in the reflection, at most.",
        unit="iterations",
        ge=1,
        le=10_000,
    )
    slope_tolerance: float = setting(
        1e-5,
        "They end where the slope by no radiance is larger.",
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
        "Share of the differences that light in a reflection leaves, below which it explains them, and all "
        "surface is taken to be specular.",
        ge=0,
        le=1,
    )
    hopeless_residual: float = setting(
        0.9,
        "Share of the differences left by the middle roughness from which on the other roughnesses are not "
        "tried: what it hardly explains no other does.",
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
        "Clusters of albedo at most; more would part one where the light is a little wrong.",
        unit="clusters",
        ge=1,
        le=1000,
    )
    brightness_weight: float = setting(
        0.2,
        "What a step of the albedo's brightness counts of an equal step of its chromaticity: errors of the "
        "light look like brightness.",
        ge=0,
        le=1,
    )
    log_floor: float = setting(
        0.04,
        "Added to the albedo under the logarithm: the colour of what is darker is noise.",
        unit="of the median albedo",
        gt=0,
        le=1,
    )
    min_shading: float = setting(
        0.01,
        "Least shading that the albedo is divided by: a quotient by less says nothing.",
        unit="of the scaled shading",
        gt=0,
        le=1,
    )
    samples: int = setting(
        20_000,
        "Pixels that the clusters are made from, or up to twice as many; all others then join the nearest.",
        unit="pixels",
        ge=100,
    )
    runs: int = setting(
        5,
        "Runs of k-means from random seeds, of which the best one counts.",
        unit="runs",
        ge=1,
        le=1000,
    )


class SpecularSettings(Settings):
    """Settings of specular reflection: whether it is looked for, when it is believed, how it is removed."""

    remove: bool = setting(
        True,
        "One light for all views: whether the light's image in the surface, which is taken for a rough "
        "mirror, is taken off where it explains how views differ: on all of it, or else on the paints where "
        "it does. How views differ there then has a say in the light, too.",
    )
    alternations: int = setting(
        2,
        "How often the reflection is taken off the photos and light and reflection are then found together.",
        unit="alternations",
        ge=1,
        le=20,
    )
    cluster_residual: float = setting(
        0.98,
        "Share of the differences that the reflection of a light known by shading leaves, below which a "
        "cluster of albedo is specular: one number per channel knows less than a light of its own does.",
        ge=0,
        le=1,
    )
    min_strength: float = setting(
        0.01,
        "Least strength, in the strongest channel, that a reflection is believed with: less is not seen.",
        unit="of the light's mean in the lobe",
        ge=0,
    )
    max_strength: float = setting(
        1.0,
        "Largest strength, in the strongest channel, that a reflection is believed with: more comes of "
        "views too near one another to tell.",
        unit="of the light's mean in the lobe",
        gt=0,
    )
    kept_share: float = setting(
        0.2,
        "Share of a pixel's value that is kept at least, where highlights lie a little beside where they are "
        "expected.",
        ge=0,
        le=1,
    )
    min_brightness: float = setting(
        0.01,
        "Least brightness that the reflection's share of a pixel is stated by: of less it says nothing.",
        unit="of the scaled image",
        gt=0,
        le=1,
    )
    highlight_share: float = setting(
        0.25,
        "Share of a pixel's brightness that is specular from which on the pixel is distrusted, if another "
        "view knows better: `highlight_ratio`.",
        ge=0,
    )
    highlight_ratio: float = setting(
        3.0,
        "And how many times the least share that any other view has there it must be.",
        ge=1,
    )
    differences: ViewDifferenceSettings = group(
        ViewDifferenceSettings,
        "How views differ about what they both see, and which light in a mirror would make them differ so.",
    )
    clusters: ClusterSettings = group(
        ClusterSettings,
        "Which pixels are of about the same albedo, where only some of the surface is specular.",
    )
