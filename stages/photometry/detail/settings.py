"""Settings of the albedo's detail: the shading's uncertainty, the noise, and the filter between them."""

from __future__ import annotations

from typing import Annotated

from pydantic import Field

from pipeline import Settings, group, setting

Relative = Annotated[float, Field(ge=0, le=4)]
Positive = Annotated[float, Field(gt=0)]


class UncertaintySettings(Settings):
    """Settings of the standard uncertainty of log shading, octave by octave."""

    least: tuple[Relative, ...] = setting(
        (0.34, 0.26, 0.17, 0.13, 0.085, 0.05, 0.025),
        "Standard uncertainty of the shading at least, in each octave from below σ = 0.5 px to 32 px, as a "
        "share of its own local change there, as on renders of known truth; how much more it is, is "
        "estimated from the scene, and recorded. What the photo shows beyond that and beyond noise is "
        "albedo. More takes more shading out, then fine texture where there is relief.",
        unit="of the local change of log shading",
        min_length=7,
        max_length=7,
    )
    most: float = setting(
        0.5,
        "The same at most, in any octave. Bumps of stereo that the photos do not show are left out of the "
        "shading before.",
        unit="of the local change of log shading",
        ge=0,
        le=4,
    )
    chroma: float = setting(
        0.3,
        "Uncertainty of the shading's colour over that of its brightness: light is nearly of one colour.",
        ge=0,
        le=1,
    )
    level: float = setting(
        0.03,
        "Standard uncertainty of the shading over more than the coarsest octave, 32 px.",
        unit="of its logarithm",
        ge=0,
        le=1,
    )
    estimate_factor: float = setting(
        0.8,
        "Share of the error that is estimated from the scene which counts as the shading's: the rest of it "
        "is albedo, as renders of known truth show.",
        ge=0,
        le=1,
    )
    compared_octaves: int = setting(
        4,
        "In so many of the finest octaves the shading's own change is reduced to what the photos show of "
        "it; in coarser ones, albedo would pass for shading.",
        unit="octaves",
        ge=0,
        le=7,
    )
    outlier_deviations: float = setting(
        3.0,
        "In that comparison, residuals of more standard deviations than this do not count: they are borders "
        "of materials.",
        unit="standard deviations",
        gt=0,
    )
    standard_errors: float = setting(
        2.0,
        "A slope of the photos' change on the shading's counts by what it is more than this, in squares: "
        "less may be chance.",
        unit="standard errors",
        ge=0,
    )
    largest_excess: float = setting(
        0.5,
        "By how much more of the shading's change the photos may show at most.",
        unit="of the shading's own change",
        ge=0,
    )

    @property
    def of_axes(self) -> tuple[float, float, float]:
        """Uncertainty of mean logarithm, log R/G and log B/G over that of the first."""
        return 1.0, self.chroma, self.chroma


class NoiseSettings(Settings):
    """Settings of the estimate of the camera's noise."""

    compared_octaves: int = setting(
        2,
        "In so many of the finest octaves views are compared for noise; beyond, it is taken for white.",
        unit="octaves",
        ge=1,
        le=7,
    )
    linked_share: float = setting(
        0.2,
        "Share of the pixels that other views must see as well for noise to be estimated from differences "
        "between views; with fewer, it is estimated from the octaves of every view by itself.",
        ge=0,
        le=1,
    )
    texture_spectrum: tuple[Positive, ...] = setting(
        (0.6, 1.0, 1.0, 1.0, 1.0),
        "In one view by itself, standard deviations of texture in so many of the finest octaves: of 1/f "
        "brightness, a little blurred. White noise halves from one octave to the next, by which it is "
        "distinguished.",
        min_length=2,
        max_length=7,
    )
    even_share: float = setting(
        0.125,
        "In one view by itself, share of the classes, the most evenly lit first, that noise is estimated in.",
        gt=0,
        le=1,
    )
    least_scale: float = setting(
        0.5,
        "Standard deviation of noise at the brightest pixels over that at median brightness, at least.",
        gt=0,
        le=1,
    )
    most_scale: float = setting(
        8.0,
        "And at the darkest pixels, at most. Between, its variance goes with that of photons.",
        ge=1,
    )


class ClassSettings(Settings):
    """Settings of classes: pixels in groups of equal number, sorted by local shading change or texture."""

    most: int = setting(
        16,
        "Classes at most. A line is fitted through their variances.",
        unit="classes",
        ge=3,
    )
    fewest_pixels: int = setting(
        100,
        "Pixels of a class at least; with fewer there are fewer classes.",
        unit="pixels",
        ge=1,
    )


class VarianceSettings(Settings):
    """Settings of the expected squared error of the albedo, from which its confidence comes."""

    window_px: float = setting(
        1.5,
        "σ of the surroundings that residuals and differences between views are averaged over.",
        unit="px",
        gt=0,
    )
    residual_share: float = setting(
        0.25,
        "Share of the squared residual of the smooth albedo that is expected to be wrong, whether its detail "
        "is taken over or not.",
        ge=0,
        le=1,
    )
    shading_change_share: float = setting(
        0.05,
        "Share of the squared change of log shading, in every octave, that is expected as error.",
        ge=0,
        le=1,
    )
    least_response: float = setting(
        0.1,
        "Dark pixels, whose logarithm changes by less than this share of a change of the light's, are as "
        "uncertain as those at it.",
        gt=0,
        le=1,
    )


class DetailSettings(Settings):
    """Settings of the Wiener filter, octave by octave, that divides the residual of the smooth albedo."""

    window: float = setting(
        2.0,
        "σ of the surroundings that energies are averaged over. Between 1.5 and 3 hardly anything changes.",
        unit="σ of the octave",
        ge=1,
        le=8,
    )
    least_window_px: float = setting(
        1.5,
        "The same at least, in the finest octaves.",
        unit="px",
        gt=0,
    )
    least_shading_window_px: float = setting(
        1.0,
        "σ of the surroundings that the shading's local change is averaged over, at least; else that of the "
        "octave.",
        unit="px",
        gt=0,
    )
    finest_sigma_px: float = setting(
        0.5,
        "Upper σ of the finest octave; each of the seven goes to twice that of the one before. "
        "`uncertainty.least` is measured for these.",
        unit="px",
        gt=0,
        le=4,
    )
    log_offset: float = setting(
        0.01,
        "Added to photo and shaded albedo under the logarithm: of what is darker, hardly anything is known.",
        unit="of the scaled image",
        gt=0,
    )
    largest_residual: float = setting(
        1.0,
        "Residuals of the smooth albedo are cut to this: what differs by more is a glint, or a shadow that "
        "is not there.",
        unit="of the logarithm",
        gt=0,
    )
    energy_power: float = setting(
        1.5,
        "Local energy is the mean of the residual's size to this power: between 1, by which lone borders "
        "count little, and 2, by which they count in full.",
        ge=1,
        le=2,
    )
    energy_of_normal: float = setting(
        0.9035,
        "Divides that energy, to the power of 2. Of normal deviates of variance 1 the energy is 0.818: at "
        "0.9035 it comes out a tenth below their variance, and noise is suppressed a little more.",
        gt=0,
        le=1,
    )
    misplacement_factor: float = setting(
        2.0,
        "Energy that a change of shading leaves behind, here and there, where it lies beside its place.",
        unit="of its own energy",
        ge=0,
    )
    even_share: float = setting(
        0.5,
        "Share of the pixels, those with the least change of shading, that count as evenly lit.",
        gt=0,
        le=1,
    )
    texture_quantile: float = setting(
        0.99,
        "Where a misplaced change of shading could explain it, texture is limited to this quantile of that "
        "on evenly lit surface: what is stronger is a shadow's border.",
        ge=0,
        le=1,
    )
    sample_pixels: int = setting(
        300_000,
        "Pixels at most that uncertainty and noise are estimated from.",
        unit="pixels",
        ge=1000,
    )
    uncertainty: UncertaintySettings = group(
        UncertaintySettings, "The standard uncertainty of the shading's logarithm, octave by octave."
    )
    noise: NoiseSettings = group(NoiseSettings, "The camera's noise, estimated from the photos.")
    classes: ClassSettings = group(
        ClassSettings,
        "Pixels in classes of equal number, by local change of shading or of texture, in which uncertainty "
        "and noise are estimated.",
    )
    variance: VarianceSettings = group(
        VarianceSettings, "The expected squared error of the albedo, from which its confidence comes."
    )

    @property
    def sigmas_px(self) -> tuple[float, ...]:
        """Upper σ of every octave, finest first."""
        return tuple(self.finest_sigma_px * 2**number for number in range(len(self.uncertainty.least)))
