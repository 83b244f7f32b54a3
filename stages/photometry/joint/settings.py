"""Settings of `solver: fast`, the joint descent of light and albedo from coarse to fine."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from types import MappingProxyType
from typing import Annotated, Literal, TypeVar

from pydantic import Field

from pipeline import Settings, group, setting

KindOfLight = Literal["paper", "harmonics", "directions"]
Value = TypeVar("Value")
Width = Annotated[float, Field(ge=1, le=100)]
Scale = Annotated[float, Field(gt=0, le=1000)]


@dataclass(frozen=True)
class Stopping:
    """Stopping criteria of a descent.

    Attributes
    ----------
    tolerance : float
        Greatest decrease of the energy that may remain, relative.
    gap : float
        Greatest duality gap of the albedo under its light, relative to the energy.
    max_rounds : int
        Greatest number of rounds.
    """

    tolerance: float
    gap: float
    max_rounds: int


USUAL: Mapping[KindOfLight, Stopping] = MappingProxyType(  # defaults by kind of light
    {
        "paper": Stopping(tolerance=1e-3, gap=0.03, max_rounds=100),
        "harmonics": Stopping(tolerance=1e-3, gap=0.08, max_rounds=100),
        "directions": Stopping(tolerance=1e-2, gap=0.15, max_rounds=30),
    }
)
_PAPER, _HARMONICS, _DIRECTIONS = USUAL["paper"], USUAL["harmonics"], USUAL["directions"]


@dataclass(frozen=True)
class Schedule:
    """Schedule of iterations and step scales of a descent from coarse to fine.

    Attributes
    ----------
    coarse_scales : tuple of float
        Scale of the steps (r) on coarse levels over that on the finest; each has as many of the iterations.
    round_iterations : int
        On the finest level, between two evaluations of energy and gap.
    epoch : int
        Iterations of one kind.
    """

    coarse_scales: tuple[float, ...]
    round_iterations: int
    epoch: int


# Defaults. Where the light is found as well, coarse levels find it above all. Under a known light they find
# how bright whole patches of paint are: these move slowly as one, so that r is large at first.
IN_UNKNOWN_LIGHT = Schedule((1.0,), round_iterations=80, epoch=40)
IN_KNOWN_LIGHT = Schedule((80.0, 20.0, 4.0, 1.0), round_iterations=60, epoch=30)


def given_or(given: Value | None, default: Value) -> Value:
    """Return the given value, or the default for none."""
    return default if given is None else given


def _listed(scales: tuple[float, ...]) -> str:
    """Write a tuple as one does in settings."""
    return str([float(f"{scale:g}") for scale in scales])


class StepSettings(Settings):
    """Settings of the step sizes of an iteration."""

    scale: float = setting(
        0.05,
        "Scale of the primal steps (r): steps of the albedo grow with it, those of the duals shrink.",
        unit="of the scaled images",
        gt=0,
        le=10,
    )
    coarse_scales: tuple[Scale, ...] | None = setting(
        None,
        "r on coarse levels, an equal share of their iterations each: large steps move whole patches of "
        f"paint, small ones settle the rest. none: {_listed(IN_UNKNOWN_LIGHT.coarse_scales)}, or "
        f"{_listed(IN_KNOWN_LIGHT.coarse_scales)} under `light: directions`.",
        unit="of `scale`",
        min_length=1,
    )
    data_step_ratio: float = setting(
        2.0,
        "Ratio of the steps of the data's duals to those of the edges' (κ); steps of the light are divided "
        "by it.",
        gt=0,
        le=100,
    )
    relaxation: float = setting(
        1.4,
        "Over-relaxation of plain iterations (θ): factor of the step. At 2 and above, convergence is not "
        "guaranteed.",
        ge=1,
        lt=2,
    )
    reflection: float = setting(
        2.0,
        "Factor of the step of reflected Halpern iterations, which are then averaged with the start of their "
        "epoch. 1: no reflection; 2: a full reflection, the greatest that converges.",
        ge=1,
        le=2,
    )
    epoch: int | None = setting(
        None,
        "Iterations of one kind, Halpern or plain, before as many of the other. Between them the gauge is "
        f"restored, and the light's normal equations are recomputed. none: {IN_UNKNOWN_LIGHT.epoch}, or "
        f"{IN_KNOWN_LIGHT.epoch} under `light: directions`.",
        unit="iterations",
        ge=1,
    )
    rank_tolerance: float = setting(
        1e-7,
        "Directions of a view's light whose eigenvalue in its normal equations is below this fraction of the "
        "greatest are not updated, as hardly observed; about the rounding of 32 bits.",
        gt=0,
        lt=1,
    )


class FastSettings(Settings):
    """Settings of the primal-dual descent in all channels together."""

    tolerance: float | None = setting(
        None,
        "Relative decrease of the energy that may remain at convergence, extrapolated from the last two "
        f"doublings of the iterations. none: {_PAPER.tolerance:g}, or {_DIRECTIONS.tolerance:g} under "
        "`light: directions`, where the light is known and the albedo's last digits are not visible.",
        ge=0,
        lt=1,
    )
    gap: float | None = setting(
        None,
        "Greatest duality gap of the albedo under its light at convergence, relative to the energy; the "
        f"bound is several times the true excess. none: {_PAPER.gap:g}, or in `mode: transfer`, whose light "
        f"leaves more pixels nearly dark and the bound looser, {_HARMONICS.gap:g} (harmonics) and "
        f"{_DIRECTIONS.gap:g} (directions).",
        gt=0,
        le=1,
    )
    max_rounds: int | None = setting(
        None,
        f"Greatest number of rounds; ten to twenty are usual. none: {_PAPER.max_rounds}, or "
        f"{_DIRECTIONS.max_rounds} under `light: directions`.",
        unit="rounds",
        ge=1,
    )
    min_rounds: int = setting(
        4,
        "Rounds before the stopping rule is evaluated: two doublings.",
        unit="rounds",
        ge=4,
    )
    negligible_gain: float = setting(
        0.25,
        "If the remaining decrease is less than this, and the gap does not close, the descent has stalled.",
        unit="of `tolerance`",
        ge=0,
        le=1,
    )
    stalled_gap: float = setting(
        0.9,
        "If the gap is still greater than this, it counts as not closing.",
        unit="of the gap at half of the rounds",
        gt=0,
        le=1,
    )
    round_iterations: int | None = setting(
        None,
        "Iterations of a round, after which energy and gap are evaluated. A whole number of pairs of epochs "
        "lets every round end at the same point of the cycle. none: "
        f"{IN_UNKNOWN_LIGHT.round_iterations}, or {IN_KNOWN_LIGHT.round_iterations} under "
        "`light: directions`.",
        unit="iterations",
        ge=1,
    )
    coarse_iterations: int = setting(
        120,
        "Iterations on the second finest level; doubled on every coarser one, which has a quarter of the "
        "pixels.",
        unit="iterations",
        ge=0,
    )
    coarsest_pixels: int = setting(
        40,
        "Least average number of pixels per view on the coarsest level.",
        unit="pixels per view",
        ge=1,
    )
    start_shading: float = setting(
        0.01,
        "Under a known light the albedo is initialised with image over shading; pixels of less shading than "
        "this are initialised with 0, since their quotient carries no information.",
        unit="of the mean shading",
        ge=0,
        lt=1,
    )
    gap_ranges: tuple[Width, ...] = setting(
        (1.0, 1.5, 3.0),
        "The gap is bounded over these ranges of albedo, and over the range of all quotients of image and "
        "shading; the tightest bound is used. Narrow ranges reduce the cost of duals that are not balanced "
        "yet, wide ones clip less.",
        unit="of the range of the current albedo",
        min_length=1,
    )
    steps: StepSettings = group(StepSettings, "The step sizes of an iteration.")

    def schedule(self, known_light: bool) -> Schedule:
        """Resolve the schedule: the settings, or the defaults for a known or an unknown light."""
        usual, steps = IN_KNOWN_LIGHT if known_light else IN_UNKNOWN_LIGHT, self.steps
        return Schedule(
            given_or(steps.coarse_scales, usual.coarse_scales),
            given_or(self.round_iterations, usual.round_iterations),
            given_or(steps.epoch, usual.epoch),
        )

    def stopping(self, light: KindOfLight) -> Stopping:
        """Resolve the stopping criteria: the settings, or the defaults for the kind of light."""
        usual = USUAL[light]
        return Stopping(
            tolerance=given_or(self.tolerance, usual.tolerance),
            gap=given_or(self.gap, usual.gap),
            max_rounds=given_or(self.max_rounds, usual.max_rounds),
        )


class HarmonicsSettings(Settings):
    """Settings of `light: harmonics`: updates of the interreflection."""

    refreshes: int = setting(
        3,
        "Number of updates of the interreflection from the current albedo, before the last descent.",
        ge=0,
        le=100,
    )
    refresh_iterations: int = setting(
        120,
        "Iterations between two updates: enough for the albedo to follow.",
        unit="iterations",
        ge=1,
    )
    picture_directions: int = setting(
        512,
        "Number of directions, evenly over the sphere, at which the light is sampled for its picture; degree "
        "6 has 49 harmonics.",
        unit="directions",
        ge=16,
        le=100_000,
    )
