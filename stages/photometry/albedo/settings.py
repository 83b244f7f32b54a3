"""Settings of the smooth albedo under a known light, and of the confidence."""

from __future__ import annotations

from typing import Annotated

from pydantic import AfterValidator

from pipeline import Settings, group, setting
from stages.photometry.specular.settings import LinkedPatchSettings

REFERENCE_SIDE_PX = 180.0  # side of the views that λ of `mode: transfer` is stated for: a unit, not a choice


def _ascending(ends: tuple[float, float]) -> tuple[float, float]:
    """Refuse ends of a rise from 0 to 1 that do not ascend."""
    if not 0 <= ends[0] < ends[1]:
        raise ValueError("two numbers of at least 0, the smaller first")
    return ends


Rise = Annotated[tuple[float, float], AfterValidator(_ascending)]


class AppearanceSettings(Settings):
    """Settings of the classification of neighbourhoods: textured, or inconsistent between views."""

    residual_tolerance: float = setting(
        0.06,
        "An edge counts as one of albedo where the photo changes by more than the sum of the shading's own "
        "change and this.",
        unit="of the logarithm",
        gt=0,
    )
    textured_share: Rise = setting(
        (0.44, 0.56),
        "Share of a neighbourhood's edges that are edges of the albedo: from the first, it begins to count "
        "as textured; from the second, it is fully textured.",
    )
    view_difference: float = setting(
        0.05,
        "Difference between views in the quotient of photo and shading, averaged over a neighbourhood, from "
        "which they count as inconsistent: gloss, or an error of the light.",
        unit="of the logarithm",
        gt=0,
    )
    least_shading: float = setting(
        0.1,
        "Least shading at which views are compared: quotients by less are noise.",
        unit="of the median shading",
        ge=0,
    )
    patches: LinkedPatchSettings = group(
        LinkedPatchSettings, "The squares whose corresponding pixels are compared between views."
    )


class SoftTextureSettings(Settings):
    """Settings of the search for albedo that varies gradually all over, as marble does."""

    largest_change: float = setting(
        0.1,
        "Changes of albedo between neighbouring pixels are clipped to this: larger ones are edges.",
        unit="of the logarithm",
        gt=0,
    )
    slopes: Rise = setting(
        (1.1, 2.2),
        "Mean slope of the albedo in a patch: up to the first, it may come from noise and errors of the "
        "light; from the second, it is albedo.",
        unit="of the logarithm, over a view's side",
    )
    shares: Rise = setting(
        (0.4, 0.7),
        "Share of the surrounding patches that have such a slope: up to the first, slopes are isolated, as "
        "on any material; from the second, they are everywhere.",
    )
    shrinkage: float = setting(
        0.3,
        "Added to the mean weight of a pixel's neighbours, two across and two down: shrinks the slope "
        "towards 0 where few of them are evenly lit.",
        unit="neighbours",
        gt=0,
    )


class EdgeSettings(Settings):
    """Settings of the weights λ and μ, edge by edge, of the smooth albedo that `albedo` begins with."""

    coarse_lambda: float = setting(
        10.0,
        "λ at probable edges of the shading, where the shading changes and the colour does not; stated for "
        "views of 180 × 180 pixels. Never less than `fine_lambda`.",
        ge=0,
        le=1e6,
    )
    fine_lambda: float = setting(
        0.15,
        "λ at all other edges. 0.15 keeps lines of a pixel's width, and single well-lit pixels; 0.3 removes "
        "these as noise.",
        unit="px",
        ge=0,
        le=1e6,
    )
    shading_step: float = setting(
        0.02,
        "Change of shading between neighbouring pixels that makes an edge a probable edge of the shading.",
        unit="of its logarithm",
        ge=1e-4,
    )
    chroma_step: float = setting(
        0.12,
        "Change of colour between neighbouring pixels that makes an edge a probable edge of the albedo.",
        unit="of the logarithms of red and blue over green",
        ge=1e-4,
    )
    residual_tolerance: float = setting(
        0.1,
        "An edge is also one of albedo where the photo changes by more than the sum of the shading's own "
        "change and this. Without texture, an error of the light is the likelier cause.",
        unit="of the logarithm",
        gt=0,
    )
    textured_residual_tolerance: float = setting(
        0.05,
        "The same on textured surface.",
        unit="of the logarithm",
        gt=0,
    )
    soft_texture_factor: float = setting(
        0.3,
        "Factor of `coarse_lambda` where the albedo varies gradually all over: there, the full λ would "
        "remove more albedo than errors of the light.",
        ge=0,
        le=1,
    )
    inconsistency_gain: float = setting(
        4.0,
        "μ grows by so many times itself where views are inconsistent: a pixel's own observation then weighs "
        "less than those of other views.",
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
        """Scale `coarse_lambda` to views of a side, px, taken as squares.

        The data term grows with the area and the smoothness with the side, so λ is proportional to the side.
        """
        return max(self.fine_lambda, self.coarse_lambda * side / REFERENCE_SIDE_PX)


class ClippedSettings(Settings):
    """Settings of `raised_where_clipped`."""

    agreeing_share: float = setting(
        0.5,
        "Share of the corresponding pixels of other views that must be clipped as well, for a clipped pixel "
        "to show bright paint: a highlight moves from view to view.",
        unit="of their number",
        ge=0,
        le=1,
    )


class ConfidenceSettings(Settings):
    """Settings of the confidence of the albedo per pixel, 0 to 1."""

    half_error: float = setting(
        0.1,
        "`light: directions`: expected error of the albedo at which confidence is one half.",
        unit="of the albedo",
        gt=0,
    )
    half_shading: float = setting(
        0.1,
        "`light: harmonics`: shading at which confidence is halved.",
        unit="of the median shading",
        gt=0,
    )
    half_residual: float = setting(
        0.3,
        "`light: harmonics`: relative residual of the photo at which confidence is halved.",
        gt=0,
    )
