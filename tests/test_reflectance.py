"""What the brightest material reflects is told by the light that surfaces send one another."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest
from pydantic import ValidationError

from stages.cli import main
from stages.formats.images.exr import read_exr
from stages.formats.images.photos import read_mask
from stages.photometry.light_search.brightest_reflectance import reflectance_of
from stages.photometry.light_search.settings import ReflectanceSettings
from tests.rendered_scene import artefact, write_config

HOW = ReflectanceSettings()
COURTYARD = {
    "subject": "courtyard",
    "light": "dome",
    "paint": "fractal",
    "contrast": 0.1,
    "views": 4,
    "width_px": 64,
    "height_px": 64,
    "arc_deg": 60.0,
    "elevations_deg": [18.0, 32.0],
    "spacing": 0.02,
    "noise": 0.04,
    "paint_seed": 3,
}


def searched(curve) -> tuple[float, list[float]]:
    """What is found where lights disagree by a curve over the reflectance, and which were tried."""
    tried = []

    def light(brightest: float, near):
        tried.append(brightest)
        return brightest

    left, step = (lambda lights: [curve(one) for one in lights]), (lambda: None)
    found = reflectance_of(light, left, None, step, HOW.usual, HOW)
    assert found.light in tried and sorted(found.tried) == sorted(tried)
    return found.value, tried


@pytest.mark.parametrize("true", [0.15, 0.3, 0.5, 0.7])
def test_the_lowest_of_a_smooth_curve_is_found_and_little_is_tried(true):
    value, tried = searched(lambda one: 0.1 + 0.05 * np.log(one / true) ** 2)
    assert value == pytest.approx(true, rel=0.1)
    assert len(tried) == len(set(tried)) <= len(HOW.tried)


def test_nothing_beyond_the_scale_is_tried_and_a_flat_curve_says_the_usual():
    assert searched(lambda one: 1 / one)[0] == max(HOW.tried)
    assert searched(lambda one: one)[0] == min(HOW.tried)
    for flat in (0.2, 0.0):
        assert 0.5 < searched(lambda one, flat=flat: flat)[0] < 0.7


def test_those_that_are_tried_ascend():
    with pytest.raises(ValidationError, match="reflectances that ascend"):
        ReflectanceSettings(tried=(0.4, 0.2))


@pytest.fixture(scope="module")
def courtyard(tmp_path_factory) -> tuple[float, float, float, float]:
    """True reflectance, that found, and the slopes of the shading's error with it and with .9."""
    folder = tmp_path_factory.mktemp("courtyard")
    config = write_config(folder / "c.yaml", render=COURTYARD, transfer={"degree": 1})
    assert main(["run", str(config), "--to", "lighting"]) == 0
    workspace = folder / "w"
    found, slope = facts_of(workspace)["brightest"]["reflects"], slope_of_error(workspace)
    assert main(["run", str(config), "--to", "lighting", "--set", "lighting.brightest=0.9"]) == 0
    assert "brightest" not in facts_of(workspace)
    return true_brightest(workspace), found, slope, slope_of_error(workspace)


def test_dark_surface_is_told_from_bright(courtyard):
    """Noise makes the brightest of what is found brighter than it is."""
    true, found, _, _ = courtyard
    assert 0.7 * true < found < 1.6 * true < 0.6


def test_hollows_of_dark_surface_are_lit_as_they_are(courtyard):
    _, _, slope, taken_for_bright = courtyard
    assert abs(slope) < 0.04 < 0.1 < taken_for_bright


def facts_of(workspace: Path) -> dict:
    return json.loads(artefact(workspace, "lighting", "record.json").read_text(encoding="utf-8"))["facts"]


def pixels_of(workspace: Path, kind: str) -> np.ndarray:
    """All masked pixels of a map of the truth, or of the shading that was found."""
    truth = artefact(workspace, "render", "truth")
    folder = artefact(workspace, "lighting", "shading") if kind == "found" else truth / kind
    masks = artefact(workspace, "raycast", "mask")
    seen = ((path.stem, read_mask(path)) for path in sorted(masks.glob("*.png")))
    return np.concatenate([read_exr(folder / f"{name}.exr")[mask] for name, mask in seen])


def true_brightest(workspace: Path) -> float:
    return float(np.quantile(pixels_of(workspace, "albedo").max(axis=1), 0.98))


def slope_of_error(workspace: Path) -> float:
    """Of log true shading over found, on log found: above 0 where hollows are found too bright."""
    maps = (pixels_of(workspace, kind) for kind in ("found", "shading"))
    found, true = (np.log(np.maximum(each, 1e-3)).mean(axis=1) for each in maps)
    lit = found > np.log(0.1)
    return float(np.polyfit(found[lit], (true - found)[lit], 1)[0])
