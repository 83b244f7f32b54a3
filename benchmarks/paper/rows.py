"""The rows of the paper's tables as settings of the render, the geometry and the decomposition."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

Section = dict[str, Any]


@dataclass(frozen=True)
class Row:
    """One experiment.

    Attributes
    ----------
    name : str
        The paper's figure.
    about : str
        Its difference, one phrase.
    render, known_geometry : dict
        Settings of these stages.
    lambda_factor : float
        Factor of the λ of Fig. 3: the paper's is 12 times smaller for Fig. 5.
    hair_red : float or None
        The paper's variance in the part hair, red (Table 2), on its own bust.
    sources : mapping of str to Path
        An object instead of the bust, an environment.
    photographed : bool
        True if poses and shape are estimated from 8-bit photos of the render (benchmarks.accuracy).
    """

    name: str
    about: str
    render: Section = field(default_factory=dict)
    known_geometry: Section = field(default_factory=dict)
    lambda_factor: float = 1.0
    hair_red: float | None = None
    sources: Mapping[str, Path] = field(default_factory=dict)
    photographed: bool = False


STRIPED = {"paint": "stripes", "stripe_period": 0.1, "light": "one_lamp"}
GLOSSY = {**STRIPED, "gloss": 0.2}
FINE_PAINT = 1 / 12

ROWS = (
    Row("fig3", "four uniform parts under a sky dome", hair_red=0.0135),
    Row("fig4", "the same, four extended lamps", {"light": "four_lamps"}, hair_red=0.0367),
    Row("fig5", "a striped shirt, one extended lamp", STRIPED, lambda_factor=FINE_PAINT),
    Row("fig6", "hair and plinth partly specular", GLOSSY, lambda_factor=FINE_PAINT, hair_red=0.0475),
    Row(
        "fig7",
        "the geometry smoothed",
        GLOSSY,
        {"smoothing": 20},
        lambda_factor=FINE_PAINT,
        hair_red=0.0626,
    ),
)

# The paper's Table 1, on its own bust: per part and channel, its decomposition and its cartoon-texture.
TABLE_1 = {
    "hair": ((0.0135, 0.0274), (0.0007, 0.0007), (0.0000, 0.0000)),
    "face": ((0.0015, 0.0106), (0.0016, 0.0065), (0.0006, 0.0031)),
    "shirt": ((0.0002, 0.0006), (0.0000, 0.0001), (0.0104, 0.0217)),
    "plinth": ((0.0004, 0.0005), (0.0003, 0.0005), (0.0001, 0.0003)),
}
