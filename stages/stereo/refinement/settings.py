"""Settings of the refinement of a surface by the agreement of the photos."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Annotated, Literal

from pydantic import Field, field_validator

from pipeline import Settings, group, setting

Scale = Annotated[int, Field(ge=1, le=64)]


class PhotoErrorSettings(Settings):
    """Settings of how far photos of one point may differ: in radiance over its average around the pixel."""

    shot_noise: float = setting(
        0.01,
        "Deviation of the noise at white, from which it falls as the square root of the radiance. Only its "
        "ratio to `mismatch` matters: how large both are is measured.",
        unit="white",
        ge=0,
        le=1,
    )
    mismatch: float = setting(
        0.02,
        "Deviation of what else differs, at any radiance: gloss, blur, interpolation.",
        unit="radiance over its average around",
        gt=0,
        le=1,
    )
    spread_px: float = setting(
        0.29,
        "Deviation of the area around it that a pixel shows: .29 of a square; with a lens and "
        "demosaicing, at the photos' own size, rather .5. Results hardly depend on it.",
        unit="px",
        ge=0,
        le=2,
    )
    white: float = setting(
        0.99, "Quantile of a photo's radiance that counts as white.", unit="quantile", gt=0, le=1
    )
    darkest: float = setting(
        0.005, "Darker pixels count as this dark: below it there is noise alone.", unit="white", gt=0, lt=1
    )
    least: float = setting(
        0.1,
        "Smallest variance that may be measured, over that which these settings give: where most of the "
        "photos is burnt out, they do not differ at all.",
        gt=0,
        le=1,
    )
    outlier: float = setting(
        2.0,
        "From so many deviations on, a difference counts less and less (Cauchy): something else is in front, "
        "or it shines.",
        unit="deviations",
        gt=0,
    )
    alike: float = setting(
        2.0,
        "Pixels that err alike, and so count as one: what was interpolated errs together. With 1 noise "
        "passes for relief, with 3 relief of a quarter of a pixel for noise.",
        unit="pixels",
        ge=1,
    )


class RoughnessSettings(Settings):
    """Settings of how rough the relief may be that is added: before the photos say how rough it is."""

    stiffness: float = setting(
        300.0,
        "Weight of the squared curvature of added heights, both in pixel footprints, over the area, at "
        "first; on the finest scale it is measured, from what the photos say beyond their noise (evidence, "
        "MacKay 1992).",
        gt=0,
    )
    widest_px: float = setting(
        20.0,
        "Relief that a mesh lacks is expected to be narrower than this wavelength, as the mesh has what is "
        "wider: else an edge that is sharpened bends plain surface beside it.",
        unit="pixel footprints",
        gt=0,
    )
    widest_edges: float = setting(
        9.5, "The same of a coarse mesh, by its edges; the larger of both counts.", unit="edges", ge=0
    )
    largest_step: float = setting(3.0, "Factor by which it may change from round to round.", gt=1)
    least_share: float = setting(
        0.003,
        "Share of the vertices about which the photos say something, at least: estimated from one sample, it "
        "has an error.",
        gt=0,
        lt=1,
    )
    tail: float = setting(
        0.03,
        "How far roughness may differ from place to place: degrees of freedom of Student's distribution. "
        "Creases bend where plain surface stays plain; with large values they bend alike, and plain surface "
        "gets waves.",
        gt=0,
    )
    rings: int = setting(
        4,
        "Roughness is averaged so often with that of neighbouring vertices to say how rough a place is.",
        ge=0,
        le=100,
    )


class SliverSettings(Settings):
    """Settings of the faces that the slightest move would turn over: marching cubes make many."""

    altitude: float = setting(
        0.25,
        "Faces lower than this are slivers: their corners slide along the surface, to even spaces, before "
        "they move.",
        unit="longest edge",
        ge=0,
        lt=0.8,
    )
    steps: int = setting(
        3, "Steps by which they slide, at most; none leaves them where they are.", ge=0, le=100
    )


class FoldSettings(Settings):
    """Settings of where the surface would fold, because vertices beside each other part."""

    largest_turn_deg: float = setting(
        75.0,
        "Moves are halved where a face turns by more than this from the given mesh.",
        unit="°",
        gt=0,
        lt=180,
    )
    times: int = setting(
        5, "How often, at most; the few faces that are turned even then stay so.", ge=0, le=100
    )


class ViewPairSettings(Settings):
    """Settings of which views see the same surface: at a sample of its vertices, in small views."""

    vertices: int = setting(5_000, "Vertices that stand for the surface, about.", unit="vertices", ge=100)
    width_px: int = setting(256, "Width of the views that say which of them they see.", unit="px", ge=16)
    hidden: float = setting(
        2.0,
        "A vertex that lies farther behind or before what is seen there is not seen.",
        unit="pixel footprints of these views",
        gt=0,
    )


class RefineSettings(Settings):
    """Settings of the `refine` stage."""

    refine: bool | Literal["auto"] = setting(
        "auto",
        "The mesh is moved until the photos of neighbouring views agree on it: grooves and joints that it "
        "lacks become relief, instead of paint in the albedo. auto: one that is made here, of points; not a "
        "given one, nor any in `decomposition.mode=paper`.",
    )
    neighbours: int = setting(
        6, "Views that each view is compared with: those of stereo's best angles.", unit="views", ge=1, le=20
    )
    scales: tuple[Scale, ...] = setting(
        (2, 1),
        "Scales at which the photos are compared, in turn: pixels of the working size along a side. Coarse "
        "ones reach far, fine ones are exact; of a mesh that is off by many pixels, begin with 8 or 4.",
        unit="px at working size",
        min_length=1,
    )
    rounds: int = setting(
        4, "Rounds on each scale: photos compared, the mesh moved (Gauss-Newton).", ge=1, le=100
    )
    window_px: float = setting(
        4.0,
        "Around a pixel, differences common to a Gaussian of this σ are exposure or gloss, not relief.",
        unit="px",
        gt=0,
        le=100,
    )
    grazing: float = setting(
        0.2, "Pixels that see the surface at a smaller cosine are not compared.", ge=0, lt=1
    )
    occlusion: float = setting(
        4.0,
        "A point that lies farther than this behind what a view sees is hidden from it; pixels whose "
        "neighbours lie farther away in depth show a mixture.",
        unit="pixel footprints",
        gt=0,
    )
    largest_move: float = setting(
        2.0, "A vertex moves by no more than this in a round.", unit="pixel footprints", gt=0
    )
    hold: float = setting(
        1e-3,
        "Inverse variance of the height of every vertex by itself: what no photo shows stays where it is.",
        unit="pixel footprints⁻²",
        gt=0,
    )
    edge_px: float = setting(
        2.0,
        "Faces are divided until edges are no longer than this, as far as `most_vertices` allows: relief "
        "needs vertices.",
        unit="pixel footprints",
        gt=0,
    )
    most_vertices: int = setting(
        2_000_000, "Vertices up to which faces are divided.", unit="vertices", ge=1000
    )
    most_pixels: int = setting(
        200_000_000,
        "Pixels of views that are in memory at once; other views are read again where they are compared.",
        unit="px",
        changes_result=False,
        ge=1,
    )
    most_compared_pixels: int = setting(
        20_000_000,
        "Pixels of the photos that are compared with others at once, each on a thread of its own; one at "
        "least.",
        unit="px",
        changes_result=False,
        ge=1,
    )
    solver_steps: int = setting(
        60, "Steps of conjugate gradients in a round; more rounds are worth more than more steps.", ge=1
    )
    solver_tolerance: float = setting(1e-3, "Relative residual at which these stop earlier.", gt=0, lt=1)
    pairs: ViewPairSettings = group(ViewPairSettings, "Which views see the same surface.")
    errors: PhotoErrorSettings = group(PhotoErrorSettings, "How far photos of one point may differ.")
    slivers: SliverSettings = group(
        SliverSettings, "Faces that the slightest move would turn over: marching cubes make many."
    )
    folds: FoldSettings = group(FoldSettings, "Where the surface would fold.")
    roughness: RoughnessSettings = group(RoughnessSettings, "How rough the added relief may be.")

    @field_validator("scales")
    @classmethod
    def _descending(cls, scales: tuple[int, ...]) -> tuple[int, ...]:
        if list(scales) != sorted(set(scales), reverse=True):
            raise ValueError("scales that descend, as in [4, 2, 1]")
        return scales

    def photos_at_once(self, sizes_px: Sequence[int], threads: int) -> int:
        """Count the photos, of these numbers of pixels, that are compared at once on so many threads."""
        largest = max(sizes_px, default=1)
        return max(1, min(threads, len(sizes_px), self.most_compared_pixels // largest))
