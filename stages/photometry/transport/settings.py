"""Settings of light transport: visibility of the sky, environment maps, absolute reflectance."""

from __future__ import annotations

from pipeline import Settings, setting


class VisibilitySettings(Settings):
    """Settings of `visible_directions`."""

    min_cosine: float = setting(
        -0.2,
        "Directions whose cosine with a vertex normal is less are not sampled, and count as blocked. Below "
        "0, since a pixel's own normal may deviate from those of its vertices.",
        unit="cosine; under light from a finite sphere, times the distance in its radii",
        ge=-1,
        le=0,
    )


class EnvironmentMapSettings(Settings):
    """Settings of `light_of_picture`: light that is given as an environment map."""

    max_rows: int = setting(
        512,
        "Pictures with more rows are reduced to this: rows of 0.35° suffice for some thousand directions.",
        unit="rows",
        ge=2,
        le=16_384,
    )


class LightPictureSettings(Settings):
    """Settings of `picture_of_light`: environment maps that are written."""

    rows: int = setting(64, "Rows of a picture; it has twice as many columns.", unit="rows", ge=2, le=4096)
    blur: float = setting(
        2.0,
        "Radius at which the Gaussian of each direction falls to 1/e: about half of the spacing of "
        "directions, which is 3.5 in this unit.",
        unit="radians, over the root of the number of directions",
        gt=0,
        le=100,
    )


class ReflectanceScaleSettings(Settings):
    """Settings of the absolute scale of albedos known up to a factor, which scales interreflection."""

    brightest_quantile: float = setting(
        0.99,
        "Quantile of all albedo values that counts as the brightest material; specks are brighter.",
        gt=0,
        le=1,
    )
    usual_brightest: float = setting(
        0.9,
        "Reflectance of the brightest material where it is neither given nor estimated.",
        gt=0,
        le=0.95,
    )
