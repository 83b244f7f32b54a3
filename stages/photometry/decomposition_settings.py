"""Settings of the `decomposition` stage."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from types import MappingProxyType
from typing import Literal

from pipeline import Settings, UserError, group, setting
from stages.photometry.albedo.settings import ClippedSettings, ConfidenceSettings, EdgeSettings
from stages.photometry.clusters.settings import AlbedoClusterSettings
from stages.photometry.detail.settings import DetailSettings
from stages.photometry.joint.settings import FastSettings, HarmonicsSettings, KindOfLight, Stopping, given_or
from stages.photometry.paper.settings import PaperSettings
from stages.photometry.transport.settings import LightPictureSettings, ReflectanceScaleSettings
from stages.scene.upright_settings import UPRIGHT_WITHIN_DEG


@dataclass(frozen=True)
class Weights:
    """λ and μ of Eq. 2."""

    smoothness: float
    consistency: float


# Defaults: in `mode: paper` by solver, the best on Fig. 3 (docs/paper); in `mode: transfer`.
USUAL_WEIGHTS = MappingProxyType(
    {"paper": Weights(40.0, 1.0), "fast": Weights(12.0, 0.2), "transfer": Weights(3.0, 1.0)}
)
_PAPER, _FAST, _TRANSFER = USUAL_WEIGHTS["paper"], USUAL_WEIGHTS["fast"], USUAL_WEIGHTS["transfer"]


# Settings, or groups of them, that are used with one kind of light only.
_OF_HARMONICS = (
    "degree",
    "bounces",
    "brightest",
    "harmonics",
    "reflectance_scale",
    "light_pictures",
    "confidence.half_shading",
    "confidence.half_residual",
    "upright_within_deg",  # of the pictures of its light
)
_OF_DIRECTIONS = ("edges", "detail", "clipped", "clusters", "confidence.half_error", "fast.start_shading")
IGNORED: Mapping[KindOfLight, tuple[str, ...]] = MappingProxyType(
    {
        "paper": ("light", *_OF_HARMONICS, *_OF_DIRECTIONS),
        "harmonics": ("solver", "paper", *_OF_DIRECTIONS),
        "directions": ("solver", "paper", *_OF_HARMONICS),
    }
)


class DecompositionSettings(Settings):
    """Settings of the `decomposition` stage; those of one mode, light or solver are marked."""

    moved = MappingProxyType(
        {
            "lighting": "lighting.lights",
            "moving_light": "lighting.moving_light",
            "sheen": "lighting.specular.remove",
            "samples": "lighting.samples",
            "neutrality": "lighting.neutrality",
            "evenness": "lighting.evenness",
            "delta": "decomposition.paper.delta",
            "cg_tolerance": "decomposition.paper.cg_tolerance",
            "cg_max_steps": "decomposition.paper.cg_max_steps",
            "max_alternations": "decomposition.paper.max_alternations",
            "energy_tolerance": "decomposition.paper.energy_tolerance",
            "fast_tolerance": "decomposition.fast.tolerance",
            "fast_gap": "decomposition.fast.gap",
            "fast_max_rounds": "decomposition.fast.max_rounds",
            "coarse_lambda": "decomposition.edges.coarse_lambda",
            "fine_lambda": "decomposition.edges.fine_lambda",
            "shading_step": "decomposition.edges.shading_step",
            "chroma_step": "decomposition.edges.chroma_step",
            "shading_doubt": "decomposition.detail.uncertainty.least",
            "most_shading_doubt": "decomposition.detail.uncertainty.most",
            "chroma_doubt": "decomposition.detail.uncertainty.chroma",
            "level_doubt": "decomposition.detail.uncertainty.level",
            "doubt_window": "decomposition.detail.window",
        }
    )

    mode: Literal["paper", "transfer"] = setting(
        "transfer",
        "paper: nine harmonics of the normal per view and channel, channels apart, as in the paper. "
        "transfer: light with visibility and interreflection, estimated before the albedo by the stage "
        "`lighting` from pairs of pixels of equal albedo.",
    )
    light: Literal["directions", "harmonics"] = setting(
        "directions",
        "`mode: transfer`. directions: non-negative radiance of all directions, under which pixels of equal "
        "albedo agree. harmonics: the paper's energy with transfer vectors for ν.",
    )
    solver: Literal["paper", "fast"] | None = setting(
        None,
        "paper: assembled normal equations, conjugate gradients, Jacobi as the only preconditioner. fast: "
        "the same energy by a primal-dual scheme on the graph of pixels, to a lower value in less time. "
        "none: paper in `mode: paper`, else fast.",
    )
    degree: int | None = setting(
        None,
        "`light: harmonics`: greatest degree l; none: that of `transfer`.",
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
        "`light: harmonics`: assumed reflectance of the brightest material; none: "
        "`reflectance_scale.usual_brightest`.",
        ge=0.01,
        le=0.95,
    )
    lambda_: float | None = setting(
        None,
        "Weight of the albedo's smoothness (λ of Eq. 2). A greater value removes shading from the albedo, "
        "then texture. none, in `mode: paper`: the best of a grid on the bust of Fig. 3 (docs/paper), "
        f"{_PAPER.smoothness:g} for views of 540 × 960 pixels, {_FAST.smoothness:g} with `solver: fast`, and "
        "in proportion to the side at other sizes. In `mode: transfer` λ is always stated for views of "
        f"180 × 180 pixels, none is {_TRANSFER.smoothness:g}, and under `light: directions` it makes "
        "`albedo_tv` only.",
        name="lambda",
        ge=0,
        le=1e6,
    )
    mu: float | None = setting(
        None,
        "Weight of the agreement between views (μ of Eq. 2). none, in `mode: paper`: "
        f"{_PAPER.consistency:g}, or {_FAST.consistency:g} with `solver: fast`, chosen as `lambda` is. In "
        f"`mode: transfer` μ is divided by the correspondences per pixel; none: {_TRANSFER.consistency:g}; "
        "under `light: directions`, in `albedo`, up to five times as much where views are inconsistent.",
        ge=0,
        le=1e6,
    )
    paper: PaperSettings = group(
        PaperSettings, "`solver: paper`: light and albedo in alternation, by reweighted least squares."
    )
    fast: FastSettings = group(
        FastSettings,
        "`solver: fast`: light and albedo together, by a primal-dual descent from coarse to fine.",
    )
    harmonics: HarmonicsSettings = group(
        HarmonicsSettings, "`light: harmonics`: updates of the interreflection, and pictures of the light."
    )
    upright_within_deg: float = UPRIGHT_WITHIN_DEG
    edges: EdgeSettings = group(
        EdgeSettings,
        "`light: directions`: λ and μ of `albedo` per edge, before the photos' detail is added.",
    )
    detail: DetailSettings = group(
        DetailSettings,
        "`light: directions`: the photos' detail beyond the smooth albedo, by a Wiener filter.",
    )
    clipped: ClippedSettings = group(
        ClippedSettings, "`light: directions`: the albedo where photos are clipped."
    )
    clusters: AlbedoClusterSettings = group(
        AlbedoClusterSettings,
        "`light: directions`: many views are solved in clusters, so that memory does not grow with them.",
    )
    confidence: ConfidenceSettings = group(
        ConfidenceSettings, "`mode: transfer`: the confidence of the albedo per pixel, 0 to 1."
    )
    reflectance_scale: ReflectanceScaleSettings = group(
        ReflectanceScaleSettings,
        "`light: harmonics`: the absolute scale of the albedo, which determines the interreflection.",
    )
    light_pictures: LightPictureSettings = group(
        LightPictureSettings, "`light: harmonics`: pictures of the estimated light over all directions."
    )

    @property
    def kind_of_light(self) -> KindOfLight:
        """Kind of light: the paper's, or that of `mode: transfer`."""
        return "paper" if self.mode == "paper" else self.light

    @property
    def stopping(self) -> Stopping:
        """Stopping criteria of `solver: fast`: the settings, or the defaults for mode and light."""
        return self.fast.stopping(self.kind_of_light)

    @property
    def usual_weights(self) -> Weights:
        """Defaults of λ and μ."""
        return USUAL_WEIGHTS["transfer" if self.mode == "transfer" else self.solver or "paper"]


def check_mode(settings: DecompositionSettings, transfer_degree: int) -> None:
    """Refuse a solver that does not support the mode, moved settings, and a degree above the transfer's.

    Raises
    ------
    UserError
        The settings contradict one another.
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
