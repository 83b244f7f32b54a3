"""Settings of `solver: fast`, the joint descent of light and albedo from coarse to fine."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from types import MappingProxyType
from typing import Annotated, Literal

from pydantic import Field

from pipeline import Settings, group, setting

KindOfLight = Literal["paper", "harmonics", "directions"]
Width = Annotated[float, Field(ge=1, le=100)]


@dataclass(frozen=True)
class Stopping:
    """When a descent is done.

    Attributes
    ----------
    tolerance : float
        Relative energy that may be left to gain.
    gap : float
        How far the albedo may then be from its optimum under the light it has, relative energy.
    max_rounds : int
        Rounds at most.
    """

    tolerance: float
    gap: float
    max_rounds: int


USUAL: Mapping[KindOfLight, Stopping] = MappingProxyType(  # where nothing else is set
    {
        "paper": Stopping(tolerance=1e-3, gap=0.03, max_rounds=100),
        "harmonics": Stopping(tolerance=1e-3, gap=0.08, max_rounds=100),
        "directions": Stopping(tolerance=1e-2, gap=0.15, max_rounds=30),
    }
)
_PAPER, _HARMONICS, _DIRECTIONS = USUAL["paper"], USUAL["harmonics"], USUAL["directions"]


class StepSettings(Settings):
    """Settings of an iteration: how far it goes."""

    scale: float = setting(
        0.05,
        "Size of the primal steps (r): how far the albedo goes, and, inversely, how little the duals.",
        unit="of the scaled images",
        gt=0,
        le=10,
    )
    data_step_ratio: float = setting(
        2.0,
        "How much faster the duals of the data move than those of the edges, and how much slower the light "
        "(κ).",
        gt=0,
        le=100,
    )
    relaxation: float = setting(
        1.4,
        "Over-relaxation of plain iterations (θ): each goes so many times as far as the scheme without it; "
        "at 2 and above it need not converge.",
        ge=1,
        lt=2,
    )
    reflection: float = setting(
        2.0,
        "How many times as far an iteration goes that is then drawn back to where its epoch began "
        "(reflected Halpern iteration); 1: no further than the scheme, 2: a whole reflection, which is the "
        "most that converges.",
        ge=1,
        le=2,
    )
    epoch: int = setting(
        40,
        "Iterations of one kind, drawn back or plain, before as many of the other. Between them the gauge is "
        "restored, and the light's normal equations are made anew.",
        unit="iterations",
        ge=1,
    )
    rank_tolerance: float = setting(
        1e-7,
        "Directions of a view's light whose eigenvalue in its normal equations is below this part of the "
        "greatest are hardly observed and stay as they are; that of rounding in 32 bits.",
        gt=0,
        lt=1,
    )


class FastSettings(Settings):
    """Settings of the primal-dual descent in all channels together."""

    tolerance: float | None = setting(
        None,
        "Relative energy that may still be gained when it is done, estimated from what the last two "
        f"doublings of its iterations have gained. none: {_PAPER.tolerance:g}, or {_DIRECTIONS.tolerance:g} "
        "under `light: directions`, where the light is found already and the albedo's last digits change "
        "nothing that one sees.",
        ge=0,
        lt=1,
    )
    gap: float | None = setting(
        None,
        "And how far, relative to the energy, the albedo may then be from the best one of its range under "
        "its light: a bound from the dual problem, several times what is really missing. none: "
        f"{_PAPER.gap:g}, or in `mode: transfer`, whose light leaves more pixels nearly dark and the bound "
        f"looser, {_HARMONICS.gap:g} (harmonics) and {_DIRECTIONS.gap:g} (directions).",
        gt=0,
        le=1,
    )
    max_rounds: int | None = setting(
        None,
        f"Rounds at most; some ten to twenty are usual. none: {_PAPER.max_rounds}, or "
        f"{_DIRECTIONS.max_rounds} under `light: directions`.",
        unit="rounds",
        ge=1,
    )
    min_rounds: int = setting(
        4,
        "Rounds before anything is concluded: two doublings.",
        unit="rounds",
        ge=4,
    )
    negligible_gain: float = setting(
        0.25,
        "Where less than this is left to gain, and the gap does not close, the descent has stalled: it is "
        "only the gap that is waited for.",
        unit="of `tolerance`",
        ge=0,
        le=1,
    )
    stalled_gap: float = setting(
        0.9,
        "Where more than this of the gap is left since half of the rounds, it is not going to close soon.",
        unit="of the gap at half of the rounds",
        gt=0,
        le=1,
    )
    round_iterations: int = setting(
        80,
        "Iterations of a round, after which energy and gap are evaluated. A whole number of pairs of epochs, "
        "so that every round ends at the same point of them.",
        unit="iterations",
        ge=1,
    )
    coarse_iterations: int = setting(
        120,
        "Iterations on the level above the finest; twice as many on every further one, which has a quarter "
        "of the pixels.",
        unit="iterations",
        ge=0,
    )
    coarsest_pixels: int = setting(
        40,
        "Levels are made coarser as long as none has fewer pixels per view than this, on average.",
        unit="pixels per view",
        ge=1,
    )
    start_shading: float = setting(
        0.01,
        "Under a light that is known the descent begins with image over shading; pixels of less shading than "
        "this begin at 0, since their quotient says nothing.",
        unit="of the mean shading",
        ge=0,
        lt=1,
    )
    gap_ranges: tuple[Width, ...] = setting(
        (1.0, 1.5, 3.0),
        "The gap is bounded over these ranges of albedo, and over that of all quotients of image and "
        "shading; the tightest counts. Narrow ranges make cheap what does not balance yet, wide ones clip "
        "less.",
        unit="of the range of the albedo found",
        min_length=1,
    )
    steps: StepSettings = group(StepSettings, "How far an iteration goes.")

    def stopping(self, light: KindOfLight) -> Stopping:
        """Tell when it is done: what was set, or what suits the kind of light."""
        usual = USUAL[light]
        return Stopping(
            tolerance=usual.tolerance if self.tolerance is None else self.tolerance,
            gap=usual.gap if self.gap is None else self.gap,
            max_rounds=usual.max_rounds if self.max_rounds is None else self.max_rounds,
        )


class HarmonicsSettings(Settings):
    """Settings of `light: harmonics`: when interreflection is found anew."""

    refreshes: int = setting(
        3,
        "How often interreflection is found anew from the albedo so far, before the last descent.",
        ge=0,
        le=100,
    )
    refresh_iterations: int = setting(
        120,
        "Iterations between two of them: enough for the albedo to follow.",
        unit="iterations",
        ge=1,
    )
    picture_directions: int = setting(
        512,
        "Directions at which the light is sampled for its picture, evenly over the sphere; degree 6 has 49 "
        "harmonics.",
        unit="directions",
        ge=16,
        le=100_000,
    )
