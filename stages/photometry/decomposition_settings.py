"""Settings of the `decomposition` stage, and what they mean to the solvers at the size of the views."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Literal

from pipeline import Settings, UserError, setting

if TYPE_CHECKING:
    from stages.photometry.alternation import AlternationSettings
    from stages.photometry.energy import EnergyWeights
    from stages.photometry.fast_alternation import FastSettings
    from stages.photometry.sky_decomposition import SkyDecomposition
    from stages.photometry.transfer_alternation import TransferAlternation


@dataclass(frozen=True)
class Stopping:
    """When `solver: fast` is done."""

    tolerance: float
    gap: float
    rounds: int


USUAL = {
    "paper": Stopping(1e-3, 0.03, 100),
    "harmonics": Stopping(1e-3, 0.08, 100),
    "directions": Stopping(5e-3, 0.15, 30),
}
BEST_ON_FIG_3 = {"paper": (40.0, 1.0), "fast": (12.0, 0.2)}  # λ, μ by solver (docs/paper)
PAPER_SIDE = 720.0  # px: of 540 × 960, were it a square
OWN_SIDE = 180.0  # px: of the views that λ of `mode: transfer` is stated for


class DecompositionSettings(Settings):
    """Settings of the `decomposition` stage; those of `mode: transfer` say so, as do those of the solvers."""

    mode: Literal["paper", "transfer"] = setting(
        "transfer",
        "paper: nine harmonics of the normal per view and channel, channels apart, as the paper has it. "
        "transfer: light that knows what each point sees, and what other surface sends on to it; found "
        "before the albedo, by what it makes of like paint.",
    )
    light: Literal["directions", "harmonics"] = setting(
        "directions",
        "`mode: transfer`. directions: light of at least 0 from all around, under which pixels of like "
        "colour come out alike. harmonics: the paper's energy as it is, with transfer vectors for ν.",
    )
    lighting: Literal["auto", "shared", "per-view"] = setting(
        "auto",
        "`light: directions`. shared: one light for all views, with a gain per view and channel. per-view: "
        "a light each, as when lamps are carried about or clouds pass. auto: by `moving_light`.",
    )
    moving_light: float = setting(
        0.15,
        "`lighting: auto`: where the same surface point differs more than this from view to view, after "
        "gains, each view has its own light. Noise and gloss stay below, also with sharp highlights.",
        unit="typical difference of the logarithms",
        gt=0,
    )
    samples: int = setting(
        20_000,
        "Pixels that the light of `light: directions` is found from; a quarter as many more for every "
        "further light. More changes little.",
        unit="pixels",
        ge=1000,
        le=300_000,
    )
    neutrality: float = setting(
        0.05,
        "`light: directions`: the price of channels that disagree about where the light comes from.",
        ge=0,
    )
    evenness: float = setting(
        5e-4,
        "`light: directions`: the price of light that differs from direction to direction; settles what the "
        "surface does not see.",
        ge=0,
    )
    solver: Literal["paper", "fast"] | None = setting(
        None,
        "paper: assembled normal equations, conjugate gradients, Jacobi as the only preconditioner. fast: "
        "the same energy by a primal-dual scheme on the graph of pixels, lower and sooner. none: paper in "
        "`mode: paper`, else fast.",
    )
    degree: int | None = setting(
        None,
        "`light: harmonics`: up to this degree l; none: all that `transfer` has.",
        ge=1,
        le=6,
    )
    bounces: int = setting(
        4,
        "`mode: transfer`: how often light is passed on between surfaces; 0: not at all.",
        ge=0,
        le=100,
    )
    brightest: float = setting(
        0.8,
        "`mode: transfer`: what the brightest material is taken to reflect, since images do not tell; it "
        "says how much light bounces.",
        gt=0,
        le=0.95,
    )
    lambda_: float | None = setting(
        None,
        "Weight of the albedo's smoothness (λ of Eq. 2). More takes shading out of the albedo, then paint. "
        "none, in `mode: paper`: the best of a grid on the bust of Fig. 3 (docs/paper), 40 for views of "
        "540 × 960 pixels, 12 with `solver: fast`, and in proportion to the side at other sizes. In "
        "`mode: transfer` λ is always stated for views of 180 × 180 pixels, none is 3, and it makes "
        "`albedo_tv` only.",
        name="lambda",
        ge=0,
        le=1e6,
    )
    mu: float | None = setting(
        None,
        "Weight of the agreement between views (μ of Eq. 2). none, in `mode: paper`: 1, or 0.2 with `solver: "
        "fast`, chosen as `lambda` is. In `mode: transfer` μ is shared among the links of a pixel; none: 1.",
        ge=0,
        le=1e6,
    )
    coarse_lambda: float = setting(
        10.0,
        "`albedo` of `mode: transfer`: λ at edges that are likely to be the light's, where the shading "
        "changes and the colour does not; stated for views of 180 × 180 pixels.",
        ge=0,
        le=1e6,
    )
    fine_lambda: float = setting(
        0.3,
        "`albedo` of `mode: transfer`: λ at all other edges. 0.3 takes single pixels of noise away and "
        "leaves lines of a pixel's width.",
        unit="px",
        ge=0,
        le=1e6,
    )
    shading_step: float = setting(
        0.02,
        "Change of shading between neighbouring pixels that makes an edge likely to be the light's.",
        unit="of its logarithm",
        gt=0,
    )
    chroma_step: float = setting(
        0.15,
        "Change of colour between neighbouring pixels that makes an edge likely to be paint.",
        unit="of the logarithms of red and blue over green",
        gt=0,
    )
    delta: float = setting(
        1e-4,
        "Residuals below this count as fitted (δ of Eq. 12, the paper's value).",
        unit="of the images' 99th percentile",
        gt=0,
        le=1,
    )
    cg_tolerance: float = setting(
        1e-6,
        "Relative residual at which the albedo's linear system counts as solved. The paper names none; at "
        "1e-2 the energy stands still far too high and passes for converged.",
        gt=0,
        lt=1,
    )
    cg_max_steps: int = setting(
        1000, "Steps of conjugate gradients at most; some hundreds are usual.", unit="steps", ge=1
    )
    max_alternations: int = setting(
        50, "Alternations of light and albedo at most, as in the paper.", unit="alternations", ge=1
    )
    energy_tolerance: float = setting(
        1e-3, "Relative change of the energy to stop at, as in the paper.", ge=0, lt=1
    )
    fast_tolerance: float | None = setting(
        None,
        "Relative energy that `solver: fast` may still gain to be done, estimated from what the last two "
        "doublings of its iterations have gained. none: 0.001, or 0.005 under `light: directions`, where the "
        "light is found already and the albedo's last digits change nothing that one sees.",
        ge=0,
        lt=1,
    )
    fast_gap: float | None = setting(
        None,
        "And how far, relative to the energy, the albedo may then be from the best one of its range under "
        "its light: a bound from the dual problem, several times what is really missing. none: 0.03, or in "
        "`mode: transfer`, whose light leaves more pixels nearly dark and the bound looser, 0.08 (harmonics) "
        "and 0.15 (directions).",
        gt=0,
        le=1,
    )
    fast_max_rounds: int | None = setting(
        None,
        "Rounds of `solver: fast` at most; some ten to twenty are usual. none: 100, or 30 under `light: "
        "directions`.",
        unit="rounds",
        ge=1,
    )

    @property
    def stopping(self) -> Stopping:
        """When `solver: fast` is done: what was set, or what suits the mode and its light."""
        usual = USUAL["paper" if self.mode == "paper" else self.light]
        return Stopping(
            tolerance=_or(self.fast_tolerance, usual.tolerance),
            gap=_or(self.fast_gap, usual.gap),
            rounds=usual.rounds if self.fast_max_rounds is None else self.fast_max_rounds,
        )


def check_mode(settings: DecompositionSettings) -> None:
    """Refuse a solver that does not know the mode's light.

    Raises
    ------
    UserError
        It does not.
    """
    if settings.mode == "transfer" and settings.solver == "paper":
        raise UserError(
            "decomposition.solver is paper and decomposition.mode transfer; the paper's solver knows the "
            "paper's light only. Leave the solver out, or set the mode to paper."
        )


def weights_at(settings: DecompositionSettings, side: float, links_per_pixel: float) -> EnergyWeights:
    """λ and μ of Eq. 2 for views of a side, px, were they squares.

    The data count pixels and the smoothness lengths, so the same balance takes a λ in proportion to the side.
    """
    from stages.photometry.energy import EnergyWeights

    if settings.mode == "transfer":
        given = (3.0, 1.0)
        smoothness, consistency = _or(settings.lambda_, given[0]), _or(settings.mu, given[1])
        consistency = consistency / links_per_pixel if links_per_pixel else 0.0
        return EnergyWeights(smoothness * side / OWN_SIDE, consistency, settings.delta)
    smoothness, consistency = BEST_ON_FIG_3[settings.solver or "paper"]
    return EnergyWeights(
        _or(settings.lambda_, smoothness * side / PAPER_SIDE), _or(settings.mu, consistency), settings.delta
    )


def _or(given: float | None, default: float) -> float:
    return default if given is None else given


def as_alternation(settings: DecompositionSettings, weights: EnergyWeights) -> AlternationSettings:
    """For `solver: paper`."""
    from stages.photometry.alternation import AlternationSettings

    return AlternationSettings(
        weights=weights,
        max_alternations=settings.max_alternations,
        energy_tolerance=settings.energy_tolerance,
        cg_tolerance=settings.cg_tolerance,
        cg_max_steps=settings.cg_max_steps,
    )


def as_fast(settings: DecompositionSettings, weights: EnergyWeights) -> FastSettings:
    """For `solver: fast`."""
    from stages.photometry.fast_alternation import FastSettings

    stopping = settings.stopping
    return FastSettings(
        weights=weights,
        tolerance=stopping.tolerance,
        gap_tolerance=stopping.gap,
        max_rounds=stopping.rounds,
    )


def as_transfer(settings: DecompositionSettings, weights: EnergyWeights) -> TransferAlternation:
    """For `light: harmonics`."""
    from stages.photometry.pixel_transfer import Bounces
    from stages.photometry.transfer_alternation import TransferAlternation

    return TransferAlternation(as_fast(settings, weights), Bounces(settings.bounces, settings.brightest))


def as_sky(settings: DecompositionSettings, weights: EnergyWeights, side: float) -> SkyDecomposition:
    """For `light: directions`."""
    from stages.photometry.light_from_pairs import PairWeights
    from stages.photometry.paint_edges import PaintEdges
    from stages.photometry.sky_decomposition import SkyDecomposition
    from stages.photometry.sky_light import SkySettings

    return SkyDecomposition(
        light=SkySettings(
            samples=settings.samples,
            bounces=settings.bounces,
            brightest=settings.brightest,
            weights=PairWeights(settings.neutrality, settings.evenness),
        ),
        lighting=settings.lighting,
        moving=settings.moving_light,
        edges=PaintEdges(
            coarse=max(settings.fine_lambda, settings.coarse_lambda * side / OWN_SIDE),
            fine=settings.fine_lambda,
            shading_step=settings.shading_step,
            chroma_step=settings.chroma_step,
        ),
        descent=as_fast(settings, weights),
    )
