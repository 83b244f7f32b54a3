"""Settings of the smooth albedo under a known light, and of the confidence."""

from __future__ import annotations

from typing import Annotated

from pydantic import AfterValidator

from pipeline import Settings, group, setting
from stages.photometry.specular.settings import LinkedPatchSettings

REFERENCE_SIDE_PX = 180.0  # of the views that every λ of `mode: transfer` is stated for: a unit, no choice


def _ascending(ends: tuple[float, float]) -> tuple[float, float]:
    """Refuse the ends of a rise from 0 to 1 that are not one below the other."""
    if not 0 <= ends[0] < ends[1]:
        raise ValueError("two numbers of at least 0, the smaller first")
    return ends


Rise = Annotated[tuple[float, float], AfterValidator(_ascending)]


class AppearanceSettings(Settings):
    """Settings of the classification of neighbourhoods: textured, or inconsistent between views."""

    residual_tolerance: float = setting(
        0.06,
        "An edge counts as one of albedo where the photo changes by more than the shading explains: by more "
        "than the shading's own change and this together.",
        unit="of the logarithm",
        gt=0,
    )
    textured_share: Rise = setting(
        (0.44, 0.56),
        "Share of a neighbourhood's edges that are the albedo's, from where it begins to count as textured "
        "to where it is texture altogether.",
    )
    view_difference: float = setting(
        0.05,
        "Difference between views' quotients of photo and shading, averaged over a neighbourhood, from which "
        "they count as inconsistent: they see gloss, or the light is wrong.",
        unit="of the logarithm",
        gt=0,
    )
    least_shading: float = setting(
        0.1,
        "Views are compared where there is more light than this: quotients by less are noise.",
        unit="of the median shading",
        ge=0,
    )
    patches: LinkedPatchSettings = group(
        LinkedPatchSettings, "The squares whose linked pixels are compared between views."
    )


class SoftTextureSettings(Settings):
    """Settings of the search for albedo that varies gradually all over, as marble does."""

    largest_change: float = setting(
        0.1,
        "Change of albedo between neighbouring pixels that a larger one is cut to: it is an edge, no slope.",
        unit="of the logarithm",
        gt=0,
    )
    slopes: Rise = setting(
        (1.1, 2.2),
        "Mean slope of the albedo in a patch, from what noise and errors of the light make to what is surely "
        "the albedo's.",
        unit="of the logarithm, over a view's side",
    )
    shares: Rise = setting(
        (0.4, 0.7),
        "Share of the patches around that have such a slope, from slopes here and there, as any material "
        "has, to slopes all over.",
    )
    shrinkage: float = setting(
        0.3,
        "Added to the mean weight of a pixel's neighbours, of which it has two across and two down: takes "
        "the slope towards 0 where few of them are evenly lit.",
        unit="neighbours",
        gt=0,
    )


class EdgeSettings(Settings):
    """Settings of the weights λ and μ, edge by edge, of the smooth albedo that `albedo` begins with."""

    coarse_lambda: float = setting(
        10.0,
        "λ at edges that are likely to be the light's, where the shading changes and the colour does not; "
        "stated for views of 180 × 180 pixels. Never less than `fine_lambda`.",
        ge=0,
        le=1e6,
    )
    fine_lambda: float = setting(
        0.15,
        "λ at all other edges. 0.15 leaves lines of a pixel's width, and single pixels where they are well "
        "lit; 0.3 takes these away, as noise.",
        unit="px",
        ge=0,
        le=1e6,
    )
    shading_step: float = setting(
        0.02,
        "Change of shading between neighbouring pixels that makes an edge likely to be the light's.",
        unit="of its logarithm",
        ge=1e-4,
    )
    chroma_step: float = setting(
        0.12,
        "Change of colour between neighbouring pixels that makes an edge likely to be the albedo's.",
        unit="of the logarithms of red and blue over green",
        ge=1e-4,
    )
    residual_tolerance: float = setting(
        0.1,
        "An edge is the albedo's as well where the photo changes by more than the shading does: by more than "
        "the shading's own change and this together. Where there is no texture, an error of the light is "
        "the likelier reason.",
        unit="of the logarithm",
        gt=0,
    )
    textured_residual_tolerance: float = setting(
        0.05,
        "The same on textured surface: what its photo may differ by without a reason.",
        unit="of the logarithm",
        gt=0,
    )
    soft_texture_factor: float = setting(
        0.3,
        "What is left of `coarse_lambda` where the albedo varies gradually all over: λ takes more from it "
        "than errors of the light are.",
        ge=0,
        le=1,
    )
    inconsistency_gain: float = setting(
        4.0,
        "By how many times itself μ is raised where views contradict each other: a pixel's own photo then "
        "counts less than what the other views say.",
        ge=0,
    )
    appearance: AppearanceSettings = group(
        AppearanceSettings,
        "The classification of neighbourhoods: textured, inconsistent between views, or neither.",
    )
    soft_texture: SoftTextureSettings = group(
        SoftTextureSettings, "The search for albedo that varies gradually all over, as marble does."
    )

    def coarse_at(self, side: float) -> float:
        """Scale `coarse_lambda` to views of a side, px, were they squares.

        The data count pixels and the smoothness lengths, so the same balance takes λ in proportion to the
        side.
        """
        return max(self.fine_lambda, self.coarse_lambda * side / REFERENCE_SIDE_PX)


class ConfidenceSettings(Settings):
    """Settings of the confidence of every pixel's albedo, 0 to 1."""

    half_error: float = setting(
        0.1,
        "`light: directions`: expected error of the albedo at which half of the confidence is left.",
        unit="of the albedo",
        gt=0,
    )
    half_shading: float = setting(
        0.1,
        "`light: harmonics`: shading at which half of the confidence is left.",
        unit="of the median shading",
        gt=0,
    )
    half_residual: float = setting(
        0.3,
        "`light: harmonics`: share of the photo that albedo and shading leave unexplained, at which half of "
        "the confidence is left.",
        gt=0,
    )
