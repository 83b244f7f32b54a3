"""Natural scenes: stone, wood, rust, stains, prints, plaster, under skies and in rooms.

Methods are developed on `NATURAL_SCENES` and `PHOTOGRAPHED_SCENES`. `unseen_rows` draws others by seed; a
seed is used once, when a release is evaluated, and never again.
"""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np

from benchmarks.accuracy.scenes import SCAN_SIZE, SCANS
from benchmarks.paper.laboratory import Size
from benchmarks.paper.rows import Row
from stages.synthetic.paints.natural_paint import NATURAL_PAINTS

Section = dict[str, Any]

OWN_SUBJECTS = {  # of ours: what else is set, so that the views stand in front of them
    "bust": {},
    "relief": {"spacing": 0.005, "arc_deg": 80.0},
    "courtyard": {"spacing": 0.005, "arc_deg": 60.0, "elevations_deg": (18.0, 32.0)},
}
SMOOTHED = {"smoothing": 20}
GLOSSY = {"gloss": 0.2, "glossy_parts": ()}
UNEVEN_GLOSS = {**GLOSSY, "roughness": 0.25, "roughness_contrast": 0.5}
PHOTO_SIZE = Size(300, 300, views=10)


def _paint(name: str, contrast: float, seed: int) -> Section:
    return {"paint": name, "contrast": contrast, "paint_seed": seed}


# subject, light, what else is rendered, what is known of the geometry
NATURAL_SCENES: tuple[tuple[str, str, Section, Section], ...] = (
    ("relief", "sun_and_sky", _paint("masonry", 0.3, 1), {}),
    ("courtyard", "dome", _paint("quilt", 0.2, 3), {}),
    ("gutenberg", "apartment", _paint("masonry", 0.15, 1), {}),
    ("plato", "park", _paint("quilt", 0.3, 2), {}),
    ("gutenberg", "dome", _paint("fractal", 0.05, 3), {}),
    ("plato", "sun_and_sky", _paint("rust_and_moss", 0.4, 4), SMOOTHED),
    ("skull", "studio", _paint("rubble", 0.25, 5) | UNEVEN_GLOSS, {}),
    ("bust", "city", _paint("wood", 0.35, 6) | GLOSSY, {}),
    ("relief", "venice", _paint("stains", 0.2, 7), SMOOTHED),
    ("courtyard", "sun_and_sky", _paint("print", 0.1, 8) | {"sensor_noise": 0.03}, {}),
    ("bust", "apartment", _paint("fractal", 0.6, 9) | {"metal_part": "plinth", "roughness": 0.3}, SMOOTHED),
    ("relief", "dome", _paint("fractal", 0.1, 10) | {"sensor_noise": 0.06}, {}),
    ("plato", "apartment", _paint("plaster", 0.2, 11) | {"sensor_noise": 0.01}, {}),
)

# The same from 8-bit photos: poses and shape are estimated.
PHOTOGRAPHED_SCENES: tuple[tuple[str, str, Section], ...] = (
    ("relief", "sun_and_sky", _paint("masonry", 0.3, 1) | {"sensor_noise": 0.01}),
    ("courtyard", "dome", _paint("quilt", 0.3, 11) | {"sensor_noise": 0.01}),
    ("plato", "park", _paint("rust_and_moss", 0.3, 13) | {"sensor_noise": 0.01}),
)
SKIES, PICTURED = ("dome", "sun_and_sky"), ("apartment", "city", "park", "studio", "venice", "workshop")
FIRST_UNSEEN_PAINT = 1000  # paints below are those of the scenes above


def natural_rows(data: Path | None) -> tuple[tuple[Row, Size], ...]:
    """Make the rows to develop on; without the data folder only those of our own subjects and lights."""
    scenes = [(natural_row(data, *scene), SCAN_SIZE) for scene in NATURAL_SCENES if at_hand(data, *scene[:2])]
    photos = [
        (natural_row(data, *scene, {}, photographed=True), PHOTO_SIZE)
        for scene in PHOTOGRAPHED_SCENES
        if at_hand(data, *scene[:2])
    ]
    return (*scenes, *photos)


def unseen_rows(data: Path | None, seed: int, count: int = 8) -> tuple[tuple[Row, Size], ...]:
    """Draw rows by seed: subject, light and its direction, albedo, contrast, gloss, geometry, noise.

    Subjects, lights and albedos come in a random order, each once before any repeats. Contrasts are
    log-uniform from 0.05 to 0.6.
    """
    rng = np.random.default_rng([seed, FIRST_UNSEEN_PAINT])
    subjects = [*OWN_SUBJECTS, *(SCANS if data else ())]
    lights = [*SKIES, *(PICTURED if data else ())]
    drawn = zip(*(_shuffled(rng, names, count) for names in (subjects, lights, NATURAL_PAINTS)), strict=True)
    rows = []
    for number, (subject, light, paint) in enumerate(drawn):
        contrast = round(float(np.exp(rng.uniform(np.log(0.05), np.log(0.6)))), 3)
        render = _paint(paint, contrast, int(rng.integers(FIRST_UNSEEN_PAINT, 1_000_000)))
        render |= {"turn_deg": round(float(rng.uniform(-60, 60)), 1)}
        render |= [{}, {}, GLOSSY, UNEVEN_GLOSS][rng.integers(4)]
        render |= {"sensor_noise": float(rng.choice([0.0, 0.01, 0.03, 0.06]))}
        geometry = [{}, SMOOTHED][rng.integers(2)]
        rows.append(
            (natural_row(data, subject, light, render, geometry, f"unseen-{seed}-{number}-"), SCAN_SIZE)
        )
    return tuple(rows)


def _shuffled(rng: np.random.Generator, names: tuple[str, ...] | list[str], count: int) -> list[str]:
    rounds = [rng.permutation(names) for _ in range(-(-count // len(names)))]
    return [str(name) for name in np.concatenate(rounds)[:count]]


def at_hand(data: Path | None, subject: str, light: str) -> bool:
    """Check that a scene's files are available: without the data folder, only those of our own are."""
    return data is not None or (subject in OWN_SUBJECTS and light in SKIES)


def natural_row(
    data: Path | None,
    subject: str,
    light: str,
    render: Section,
    geometry: Section,
    prefix: str = "",
    photographed: bool = False,
) -> Row:
    """Make the row of a subject under a light of these settings of the render and of the geometry."""
    own_light = light in SKIES
    sources = {} if subject in OWN_SUBJECTS else {"object": data / SCANS[subject]}
    if not own_light:
        sources["environment"] = data / f"hdri-polyhaven-1k/{light}.hdr"
    placed = {"subject": subject, **OWN_SUBJECTS[subject]} if subject in OWN_SUBJECTS else {"y_up": True}
    noise = render.get("sensor_noise", 0)
    twists = [
        *([f"{100 * render['contrast']:g}"] if render["paint"] != "plaster" else []),
        *(["gloss"] * ("gloss" in render)),
        *(["metal"] * ("metal_part" in render)),
        *([f"noise{100 * noise:g}"] if noise and not photographed else []),
        *geometry,
        *(["photos"] * photographed),
    ]
    return Row(
        name=prefix + "-".join([subject, light, render["paint"], *twists]),
        about=_about(subject, light, render, geometry, photographed),
        render={"light": light if own_light else "environment", **placed, **render},
        known_geometry=geometry,
        sources=sources,
        photographed=photographed,
    )


def _about(subject: str, light: str, render: Section, geometry: Section, photographed: bool) -> str:
    words = [f"{subject} in {render['paint'].replace('_', ' ')}"]
    if render["paint"] != "plaster":
        words[0] += f" at a contrast of {100 * render['contrast']:g} %"
    words.append(f"under {light.replace('_', ' ')}")
    if "gloss" in render:
        words.append("unevenly glossy" if "roughness_contrast" in render else "glossy")
    if "metal_part" in render:
        words.append(f"{render['metal_part']} of metal")
    if noise := render.get("sensor_noise", 0):
        words.append(f"{100 * noise:g} % sensor noise")
    if geometry:
        words.append("smoothed geometry")
    if photographed:
        words.append("poses and shape estimated from 8-bit photos")
    return ", ".join(words)
