"""Settings of the albedo's detail: shading uncertainty, noise, and the Wiener filter."""

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
        "Least standard uncertainty of the shading in each octave, from below σ = 0.5 px to 32 px, as a "
        "share of its own local change; measured on renders of known truth. The excess over it is estimated "
        "from the scene, and recorded. A residual beyond shading uncertainty and noise is albedo. A greater "
        "value removes more shading, then fine texture where there is relief.",
        unit="of the local change of log shading",
        min_length=7,
        max_length=7,
    )
    most: float = setting(
        0.5,
        "Greatest standard uncertainty of the shading, in any octave. Bumps of the stereo depth that the "
        "photos do not show are removed from the shading before.",
        unit="of the local change of log shading",
        ge=0,
        le=4,
    )
    chroma: float = setting(
        0.3,
        "Uncertainty of the shading's colour over that of its brightness: the light is nearly of one colour.",
        ge=0,
        le=1,
    )
    level: float = setting(
        0.03,
        "Standard uncertainty of the shading at scales beyond the coarsest octave, 32 px.",
        unit="of its logarithm",
        ge=0,
        le=1,
    )
    estimate_factor: float = setting(
        0.8,
        "Share of the error estimated from the scene that is attributed to the shading; the rest is albedo, "
        "as renders of known truth show.",
        ge=0,
        le=1,
    )
    compared_octaves: int = setting(
        4,
        "Number of the finest octaves in which the shading's own change is reduced to that which the photos "
        "show; in coarser ones, albedo would be mistaken for shading.",
        unit="octaves",
        ge=0,
        le=7,
    )
    outlier_deviations: float = setting(
        3.0,
        "Residuals of more standard deviations than this are excluded from that comparison, as borders of "
        "materials.",
        unit="standard deviations",
        gt=0,
    )
    standard_errors: float = setting(
        2.0,
        "The square of the slope of the photos' change on the shading's is reduced by that of so many "
        "standard errors: a smaller slope may be chance.",
        unit="standard errors",
        ge=0,
    )
    largest_excess: float = setting(
        0.5,
        "Greatest excess of the change in the photos over that of the shading.",
        unit="of the shading's own change",
        ge=0,
    )

    @property
    def of_axes(self) -> tuple[float, float, float]:
        """Uncertainty of mean logarithm, log R/G and log B/G, relative to the first."""
        return 1.0, self.chroma, self.chroma


class NoiseSettings(Settings):
    """Settings of the estimate of the camera's noise."""

    compared_octaves: int = setting(
        2,
        "Number of the finest octaves in which noise is measured between views; beyond, it is assumed white.",
        unit="octaves",
        ge=1,
        le=7,
    )
    linked_share: float = setting(
        0.2,
        "Least share of pixels with correspondences for noise to be estimated from differences between "
        "views; below, it is estimated from the octaves of each view alone.",
        ge=0,
        le=1,
    )
    texture_spectrum: tuple[Positive, ...] = setting(
        (0.6, 1.0, 1.0, 1.0, 1.0),
        "Within one view, standard deviations of texture in the finest octaves: of 1/f brightness, slightly "
        "blurred. White noise is distinguished from it by halving from one octave to the next.",
        min_length=2,
        max_length=7,
    )
    even_share: float = setting(
        0.125,
        "Within one view, share of the classes, most evenly lit first, in which noise is estimated.",
        gt=0,
        le=1,
    )
    least_scale: float = setting(
        0.5,
        "Least standard deviation of noise, at the brightest pixels, over that at median brightness.",
        gt=0,
        le=1,
    )
    most_scale: float = setting(
        8.0,
        "Greatest standard deviation of noise, at the darkest pixels, over that at median brightness. "
        "Between the two, it follows photon noise.",
        ge=1,
    )


class ClassSettings(Settings):
    """Settings of classes: pixels in groups of equal number, sorted by local shading change or texture."""

    most: int = setting(
        16,
        "Greatest number of classes. A line is fitted to their variances.",
        unit="classes",
        ge=3,
    )
    fewest_pixels: int = setting(
        100,
        "Least number of pixels per class; fewer pixels make fewer classes.",
        unit="pixels",
        ge=1,
    )


class VarianceSettings(Settings):
    """Settings of the expected squared error of the albedo, from which its confidence comes."""

    window_px: float = setting(
        1.5,
        "σ of the Gaussian under which residuals and differences between views are averaged.",
        unit="px",
        gt=0,
    )
    residual_share: float = setting(
        0.25,
        "Share of the squared residual of the smooth albedo that is expected as error, whether its detail is "
        "kept or not.",
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
        "Least derivative of the pixel's offset logarithm by log shading: darker pixels have the variance of "
        "those at this value.",
        gt=0,
        le=1,
    )


class DetailSettings(Settings):
    """Settings of the Wiener filter, octave by octave, of the residual of the smooth albedo."""

    window: float = setting(
        2.0,
        "σ of the Gaussian under which energies are averaged. Between 1.5 and 3 the result hardly changes.",
        unit="σ of the octave",
        ge=1,
        le=8,
    )
    least_window_px: float = setting(
        1.5,
        "Least σ of that Gaussian, in the finest octaves.",
        unit="px",
        gt=0,
    )
    least_shading_window_px: float = setting(
        1.0,
        "Least σ of the Gaussian under which the shading's local change is averaged; otherwise that of the "
        "octave.",
        unit="px",
        gt=0,
    )
    finest_sigma_px: float = setting(
        0.5,
        "Upper σ of the finest octave; it doubles with each of the seven. `uncertainty.least` is measured "
        "for these.",
        unit="px",
        gt=0,
        le=4,
    )
    log_offset: float = setting(
        0.01,
        "Added to photo and shaded albedo before the logarithm: darker values carry hardly any information.",
        unit="of the scaled image",
        gt=0,
    )
    least_light: float = setting(
        0.02,
        "Least shading that photos are divided by: a quotient by less carries no information.",
        unit="of the median shading, as bright as the view shows it",
        gt=0,
        lt=1,
    )
    largest_residual: float = setting(
        1.0,
        "Residuals of the smooth albedo are clipped to this: larger ones are glints, or shadows wrongly "
        "predicted.",
        unit="of the logarithm",
        gt=0,
    )
    energy_power: float = setting(
        1.5,
        "Local energy is the mean of the residual's magnitude to this power: at 1 isolated borders count "
        "little, at 2 in full.",
        ge=1,
        le=2,
    )
    energy_of_normal: float = setting(
        0.9035,
        "Divisor of that energy as a variance, to the power of 2. Standard normal deviates have the energy "
        "0.818: at 0.9035 the result is a tenth below their variance, which suppresses noise a little more.",
        gt=0,
        le=1,
    )
    even_share: float = setting(
        0.5,
        "Share of the pixels, least change of shading first, that count as evenly lit.",
        gt=0,
        le=1,
    )
    texture_factor: float = setting(
        3.0,
        "Where the shading changes more, texture is limited so that its mean energy is at most so many times "
        "that on evenly lit surface; the rest is error of the shading. At 2 and below, bold texture is lost.",
        ge=1,
    )
    sample_pixels: int = setting(
        300_000,
        "Greatest number of pixels from which uncertainty and noise are estimated.",
        unit="pixels",
        ge=1000,
    )
    uncertainty: UncertaintySettings = group(
        UncertaintySettings, "The standard uncertainty of log shading, octave by octave."
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
