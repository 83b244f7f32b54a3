"""The scenes of the evaluation: the paper's rows, and scans under other lights with other albedo."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from benchmarks.accuracy.from_photos import PhotoLaboratory
from benchmarks.accuracy.on_a_floor import write_on_a_floor
from benchmarks.paper.laboratory import QUARTER, TINY, Laboratory, Size
from benchmarks.paper.rows import ROWS, Row
from pipeline.command.terminal import Terminal

WORKSPACES = Path(__file__).resolve().parents[2] / "workspaces"
PAPERS_OWN = WORKSPACES / "paper"
MADE = WORKSPACES / "accuracy" / "made"  # objects that the benchmark puts together

SCANS = {
    "gutenberg": "meshes-threedscans/subdiv2/Gutenberg.ply",
    "plato": "meshes-threedscans/subdiv2/Plato.ply",
    "skull": "meshes-odedstein/skull/skull.obj",
}
SCAN_SIZE = Size(180, 180, views=8)
STRIPES = {"paint": "stripes", "striped_part": None, "stripe_period": 0.15}
TEXTURE = {"paint": "texture"}
ON_A_FLOOR = {"paint": "vertex"}
GLOSSY = {"gloss": 0.2, "glossy_parts": ()}
SMOOTHED = {"smoothing": 20}

# scan, environment (or a light of our own), what else is rendered, what is known of the geometry
COMBINATIONS: tuple[tuple[str, str, dict[str, Any], dict[str, Any]], ...] = (
    ("gutenberg", "dome", {}, {}),
    ("gutenberg", "four_lamps", STRIPES, {}),
    ("gutenberg", "apartment", TEXTURE, {}),
    ("plato", "city", {}, {}),
    ("plato", "one_lamp", TEXTURE, {}),
    ("plato", "park", STRIPES | GLOSSY, {}),
    ("skull", "studio", {}, {}),
    ("skull", "venice", TEXTURE, SMOOTHED),
    ("skull", "workshop", STRIPES, {}),
    ("gutenberg", "one_lamp", STRIPES | GLOSSY, {}),
    ("gutenberg", "studio", TEXTURE, {}),
    ("gutenberg", "venice", {}, SMOOTHED),
    ("plato", "four_lamps", GLOSSY, {}),
    ("plato", "dome", TEXTURE, {}),
    ("plato", "workshop", STRIPES, {}),
    ("skull", "one_lamp", {}, {}),
    ("skull", "four_lamps", TEXTURE, {}),
    ("skull", "apartment", STRIPES, SMOOTHED),
    ("plato", "park", STRIPES, {}),
    ("skull", "city", TEXTURE | GLOSSY, {}),
    ("gutenberg", "four_lamps", TEXTURE | GLOSSY, {}),
    ("plato", "venice", GLOSSY, {}),
    ("skull", "four_lamps", GLOSSY, {}),
    ("plato", "city", ON_A_FLOOR, {}),
)
LIGHTS_OF_OUR_OWN = ("dome", "four_lamps", "one_lamp")


def laboratory_of(row: Row, size: Size, workspace: Path) -> Laboratory:
    """Choose the laboratory of a row: the paper's where `benchmarks.paper` has rendered it already."""
    shared = row in ROWS and size is not TINY
    kind = PhotoLaboratory if row.photographed else Laboratory
    return kind(PAPERS_OWN / size.name if shared else workspace / row.name, size, Terminal())


def paper_rows(size: Size = QUARTER) -> tuple[tuple[Row, Size], ...]:
    """List the paper's rows at one size."""
    return tuple((row, size) for row in ROWS)


def scan_rows(data: Path) -> tuple[tuple[Row, Size], ...]:
    """List the rows of scans from the data folder."""
    return tuple((_row(data, *combination), SCAN_SIZE) for combination in COMBINATIONS)


def _row(data: Path, scan: str, light: str, render: dict[str, Any], geometry: dict[str, Any]) -> Row:
    own = light in LIGHTS_OF_OUR_OWN
    floor, mesh = render.get("paint") == "vertex", data / SCANS[scan]
    sources = {"object": MADE / f"{scan}-floor.ply" if floor else mesh}
    if floor and mesh.exists():
        write_on_a_floor(mesh, sources["object"])
    if not own:
        sources["environment"] = data / f"hdri-polyhaven-1k/{light}.hdr"
    paint = "floor" if floor else str(render.get("paint", "parts"))
    twists = [paint, *(["gloss"] * ("gloss" in render)), *geometry]
    return Row(
        name="-".join([scan, light, *twists]),
        about=f"{scan} {'on a' if floor else 'in'} {paint} under {light.replace('_', ' ')}",
        render={"light": light if own else "environment", "y_up": True, **render},
        known_geometry=geometry,
        sources=sources,
    )
