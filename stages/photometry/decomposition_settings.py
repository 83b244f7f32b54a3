"""Settings of the `decomposition` stage."""

from __future__ import annotations

from dataclasses import dataclass
from types import MappingProxyType
from typing import Annotated, Literal

from pydantic import Field

from pipeline import Settings, UserError, group, setting
from stages.photometry.transport.settings import LightPictureSettings, ReflectanceScaleSettings

Share = Annotated[float, Field(ge=0, le=4)]


@dataclass(frozen=True)
class Stopping:
    """When `solver: fast` is done."""

    tolerance: float
    gap: float
    rounds: int


USUAL = {
    "paper": Stopping(1e-3, 0.03, 100),
    "harmonics": Stopping(1e-3, 0.08, 100),
    "directions": Stopping(1e-2, 0.15, 30),
}


class DecompositionSettings(Settings):
    """Settings of the `decomposition` stage; those of `mode: transfer` say so, as do those of the solvers."""

    moved = MappingProxyType(
        {
            "lighting": "lighting.lights",
            "moving_light": "lighting.moving_light",
            "sheen": "lighting.specular.remove",
            "samples": "lighting.samples",
            "neutrality": "lighting.neutrality",
            "evenness": "lighting.evenness",
        }
    )

    mode: Literal["paper", "transfer"] = setting(
        "transfer",
        "paper: nine harmonics of the normal per view and channel, channels apart, as the paper has it. "
        "transfer: light that knows what each point sees, and what other surface sends on to it; found "
        "before the albedo by the stage `lighting`, by what it makes of like paint.",
    )
    light: Literal["directions", "harmonics"] = setting(
        "directions",
        "`mode: transfer`. directions: light of at least 0 from all around, under which pixels of like "
        "colour come out alike. harmonics: the paper's energy as it is, with transfer vectors for ν.",
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
    bounces: int | None = setting(
        None,
        "`light: harmonics`: as `lighting.bounces`; none: its default.",
        ge=0,
        le=100,
    )
    brightest: float | None = setting(
        None,
        "`light: harmonics`: what the brightest material is taken to reflect; none: "
        "`reflectance_scale.usual_brightest`.",
        ge=0.01,
        le=0.95,
    )
    lambda_: float | None = setting(
        None,
        "Weight of the albedo's smoothness (λ of Eq. 2). More takes shading out of the albedo, then paint. "
        "none, in `mode: paper`: the best of a grid on the bust of Fig. 3 (docs/paper), 40 for views of "
        "540 × 960 pixels, 12 with `solver: fast`, and in proportion to the side at other sizes. In "
        "`mode: transfer` λ is always stated for views of 180 × 180 pixels, none is 3, and under `light: "
        "directions` it makes `albedo_tv` only.",
        name="lambda",
        ge=0,
        le=1e6,
    )
    mu: float | None = setting(
        None,
        "Weight of the agreement between views (μ of Eq. 2). none, in `mode: paper`: 1, or 0.2 with `solver: "
        "fast`, chosen as `lambda` is. In `mode: transfer` μ is shared among the links of a pixel; none: 1; "
        "under `light: directions`, in `albedo`, up to five times as much where views contradict each other.",
        ge=0,
        le=1e6,
    )
    coarse_lambda: float = setting(
        10.0,
        "`light: directions`: λ of `albedo` at edges that are likely to be the light's, where the shading "
        "changes and the colour does not; stated for views of 180 × 180 pixels. Where paint changes softly "
        "all over, 0.3 of it. Never less than `fine_lambda`.",
        ge=0,
        le=1e6,
    )
    fine_lambda: float = setting(
        0.15,
        "`light: directions`: λ of `albedo` at all other edges. 0.15 leaves lines of a pixel's width, and "
        "single pixels where they are well lit; 0.3 takes these away, as noise.",
        unit="px",
        ge=0,
        le=1e6,
    )
    shading_step: float = setting(
        0.02,
        "`light: directions`: change of shading between neighbouring pixels that makes an edge likely to be "
        "the light's.",
        unit="of its logarithm",
        ge=1e-4,
    )
    chroma_step: float = setting(
        0.12,
        "`light: directions`: change of colour between neighbouring pixels that makes an edge likely to be "
        "paint.",
        unit="of the logarithms of red and blue over green",
        ge=1e-4,
    )
    shading_doubt: tuple[Share, ...] = setting(
        (0.34, 0.26, 0.17, 0.13, 0.085, 0.05, 0.025),
        "`light: directions`: what the shading may be wrong by at least, in each octave from below "
        "σ = 0.5 px to 32 px, as a share of its own local change there, as on renders of known truth; how "
        "much more it is, is told from the scene, and recorded. What the photo shows beyond that and "
        "beyond noise is albedo. More takes more shading out, then fine texture where there is relief.",
        unit="of the local change of log shading",
        min_length=7,
        max_length=7,
    )
    most_shading_doubt: float = setting(
        0.5,
        "`light: directions`: what the shading may be wrong by at most, in any octave. Bumps of stereo that "
        "the photos do not show are left out of the shading before.",
        unit="of the local change of log shading",
        ge=0,
        le=4,
    )
    chroma_doubt: float = setting(
        0.3,
        "`light: directions`: what the shading's colour may be wrong by, of what its brightness may: light "
        "is nearly of one colour.",
        ge=0,
        le=1,
    )
    level_doubt: float = setting(
        0.03,
        "`light: directions`: what the shading may be wrong by over more than 32 px.",
        unit="of its logarithm",
        ge=0,
        le=1,
    )
    doubt_window: float = setting(
        2.0,
        "`light: directions`: σ of the surroundings that detail is judged by. Between 1.5 and 3 hardly "
        "anything changes.",
        unit="σ of the octave",
        ge=1,
        le=8,
    )
    delta: float = setting(
        1e-4,
        "`solver: paper`: residuals below this count as fitted (δ of Eq. 12, the paper's value).",
        unit="of the images' 99th percentile",
        gt=0,
        le=1,
    )
    cg_tolerance: float = setting(
        1e-6,
        "`solver: paper`: relative residual at which the albedo's linear system counts as solved. The paper "
        "names none; at 1e-2 the energy stands still far too high and passes for converged.",
        gt=0,
        lt=1,
    )
    cg_max_steps: int = setting(
        1000,
        "`solver: paper`: steps of conjugate gradients at most; some hundreds are usual.",
        unit="steps",
        ge=1,
    )
    max_alternations: int = setting(
        50,
        "`solver: paper`: alternations of light and albedo at most, as in the paper.",
        unit="alternations",
        ge=1,
    )
    energy_tolerance: float = setting(
        1e-3,
        "`solver: paper`: relative change of the energy to stop at, as in the paper.",
        ge=0,
        lt=1,
    )
    fast_tolerance: float | None = setting(
        None,
        "Relative energy that `solver: fast` may still gain to be done, estimated from what the last two "
        "doublings of its iterations have gained. none: 0.001, or 0.01 under `light: directions`, where the "
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
    reflectance_scale: ReflectanceScaleSettings = group(
        ReflectanceScaleSettings,
        "`light: harmonics`: the absolute scale of the albedo, which says how much light bounces.",
    )
    light_pictures: LightPictureSettings = group(
        LightPictureSettings, "`light: harmonics`: pictures of all directions of the light that is found."
    )

    @property
    def kind_of_light(self) -> Literal["paper", "harmonics", "directions"]:
        """The paper's, or that of `mode: transfer`."""
        return "paper" if self.mode == "paper" else self.light

    @property
    def stopping(self) -> Stopping:
        """When `solver: fast` is done: what was set, or what suits the mode and its light."""
        usual = USUAL[self.kind_of_light]
        return Stopping(
            tolerance=given_or(self.fast_tolerance, usual.tolerance),
            gap=given_or(self.fast_gap, usual.gap),
            rounds=int(given_or(self.fast_max_rounds, usual.rounds)),
        )


def check_mode(settings: DecompositionSettings, transfer_degree: int) -> None:
    """Refuse a solver that does not know the mode's light, and light that the transfer does not know.

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
    if settings.kind_of_light == "directions":
        for name in ("bounces", "brightest"):
            if getattr(settings, name) is not None:
                raise UserError(
                    f"decomposition.{name} is {getattr(settings, name)}, but `light: directions` is found by "
                    f"another stage: it has moved to lighting.{name}; set it there."
                )
    if settings.kind_of_light == "harmonics" and given_or(settings.degree, 0) > transfer_degree:
        raise UserError(
            f"decomposition.degree is {settings.degree}, but the transfer vectors end at {transfer_degree}; "
            "raise transfer.degree or lower decomposition.degree."
        )


def given_or(given: float | None, default: float) -> float:
    """What was set, or the default for none."""
    return default if given is None else given
