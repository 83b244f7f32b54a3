"""Settings of `solver: paper`: reweighting, conjugate gradients, and the stopping rule of the alternation."""

from __future__ import annotations

from pipeline import Settings, setting


class PaperSettings(Settings):
    """Settings of the alternation of light and albedo by reweighted least squares."""

    delta: float = setting(
        1e-4,
        "Residuals below this count as fitted (δ of Eq. 12, the paper's value).",
        unit="of the images' 99th percentile",
        gt=0,
        le=1,
    )
    max_alternations: int = setting(
        50,
        "Greatest number of alternations of light and albedo, as in the paper.",
        unit="alternations",
        ge=1,
    )
    energy_tolerance: float = setting(
        1e-3,
        "Relative change of the energy, in the gauge and between two alternations, at which to stop, as in "
        "the paper.",
        ge=0,
        lt=1,
    )
    cg_tolerance: float = setting(
        1e-6,
        "Relative residual at which the albedo's linear system counts as solved. The paper names none; at "
        "1e-2 the energy stagnates far too high and is mistaken for converged.",
        gt=0,
        lt=1,
    )
    cg_max_steps: int = setting(
        1000,
        "Greatest number of steps of conjugate gradients; some hundreds are usual.",
        unit="steps",
        ge=1,
    )
    rank_tolerance: float = setting(
        1e-12,
        "Directions of a view's light whose eigenvalue in the normal equations is below this fraction of the "
        "greatest are set to 0, as rounding of normals and basis in 32 bits; this is about its square.",
        gt=0,
        lt=1,
    )
