"""Settings of the normals that the light acts on: relief that the photos contradict is noise."""

from __future__ import annotations

from typing import Annotated

from pydantic import Field, field_validator

from pipeline import Settings, group, setting

Step = Annotated[int, Field(ge=2, le=1000)]


class ReliefSettings(Settings):
    """Settings of the shares of a mesh's relief that the photos support."""

    steps: tuple[Step, ...] = setting(
        (3, 8, 20, 50),
        "Levels of smoothing between which relief is divided into bands, each about .6 times as wide as the "
        "next: how often normals are averaged over a vertex and its neighbours; once, besides. Noise of "
        "stereo is up to some ten edges wide.",
        unit="averages",
        min_length=1,
    )
    wider: int = setting(
        3,
        "How much wider than a band its filter is, in averages, either way: what a band does to the shading "
        "is not in that band alone.",
        ge=1,
        le=10,
    )
    shares: tuple[Annotated[float, Field(ge=0, le=1)], ...] = setting(
        (0.0, 0.2, 0.4, 0.6, 0.8, 1.0),
        "Shares of a band that are compared; the best one is interpolated.",
        min_length=2,
    )
    window: float = setting(
        6.0,
        "Side of the cubes in which a band is supported or not, within which it is interpolated: some two "
        "hundred vertices tell noise from relief beside the paint.",
        unit="radii of the band's smoothing",
        gt=0,
    )
    outlier: float = setting(
        1.5,
        "Differences of the photo that relief leaves unexplained count as paint or shadow from here on.",
        unit="medians of what the photo has in that band",
        gt=0,
    )
    price: float = setting(
        0.01,
        "What it must gain to leave out a band of the mesh's relief, as a share of all that photo and relief "
        "can disagree. On an exact mesh each band gains .03 by being there; noise of 13° loses .01 to .06.",
        ge=0,
        lt=1,
    )
    fewest: float = setting(
        0.05,
        "Fewest reliable pixels that a vertex is known by: less is the corner of a face that another hides.",
        unit="pixels",
        ge=0,
    )
    shared: float = setting(
        50.0,
        "Vertices that the mean over the whole mesh counts as, beside those of a cube.",
        unit="vertices",
        ge=0,
    )

    @field_validator("steps", "shares")
    @classmethod
    def _ascending(cls, values: tuple[float, ...]) -> tuple[float, ...]:
        if list(values) != sorted(set(values)):
            raise ValueError("values that ascend")
        return values


class ShadingNormalSettings(Settings):
    """Settings of the stage `shading_normals`."""

    weaken: bool = setting(
        False,
        "Weaken relief of the mesh that the photos contradict, before the light is estimated: for noisy "
        "meshes. Else its own normals are lit.",
    )
    pixels: int = setting(
        4_000_000,
        "Masked pixels, at most, of the views that a rough light is estimated from, which takes a few ten "
        "thousand of them.",
        unit="pixels",
        ge=1000,
    )
    relief: ReliefSettings = group(ReliefSettings, "The share of each band of relief that is kept.")
