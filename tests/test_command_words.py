"""What the command line says of itself and of the stages: the help, the findings, the places to open."""

from __future__ import annotations

from typing import get_args

import pytest

from pipeline.stage import no_words
from stages import ALL_STAGES
from stages.cli import COMMANDS, main
from stages.command.arguments import Command
from stages.command.request import POINTERS
from stages.reporting.document.page import HTML

FACTS = {  # of the embedded sample's stages
    "sfm": {"photos": 12, "registered": 12, "points": 2145, "mean_reprojection_error_px": 0.2256},
    "undistort": {"views": 12, "resampled": 12, "sizes_px": ["359x480"], "masks": 0},
    "mvs": {"coverage": {"000.png": 0.3838, "001.png": 0.4101}, "fused_points": 264085},
    "mesh": {"points": 264085, "octree_depth": 9, "vertices": 274376, "faces": 546195},
    "raycast": {"coverage": {"000": 0.4179, "001": 0.4363}, "mean_coverage": 0.4511},
    "correspondence": {"pairs": 66, "links": 4278151},
    "transfer": {"vertices": 200108, "mean_blocked": 0.1883},
    "lighting": {
        "directions": 353,
        "suns": [{"share_of_light": 0.13}],
        "shadowed_pixels": 51310,
        "specular": [],
    },
    "decomposition": {"pixels": 932734, "links": 4278151},
    "export": {"png_white": {"albedo": 0.645534, "shading": 1.50335}},
    "report": {"share_of_light": 0.30511454074598765},
}
WORDS = {
    "sfm": "12 of 12 photos placed, 2,145 points, 0.23 px reprojection error",
    "undistort": "12 views, 359x480",
    "mvs": "264,085 points; depth at 40% of the pixels",
    "mesh": "546,195 faces from 264,085 points",
    "raycast": "the surface covers 45% of 2 views",
    "correspondence": "4,278,151 corresponding pixels in 66 pairs of views",
    "transfer": "200,108 vertices, from which 19% of the sky is hidden",
    "lighting": "light from 352 directions, 1 sun (51,310 pixels in the shadow of what the mesh does not "
    "have), no specular reflection",
    "decomposition": "albedo of 932,734 pixels, which 4,278,151 correspondences tie together",
    "export": "white of the PNGs is an albedo of 0.646",
    "report": "light is 31% of the variation of brightness",
}


@pytest.mark.parametrize("stage", ALL_STAGES, ids=lambda stage: stage.name)
def test_every_stage_has_words_for_what_it_finds(stage):
    assert stage.found is not no_words
    if stage.name in FACTS:
        assert stage.found(FACTS[stage.name]) == WORDS[stage.name]


@pytest.mark.parametrize("words", [["--help"], ["-h"], ["help"], []])
def test_help_fits_a_screen_and_leads_on(capsys, words):
    assert main(words) == 0
    said = capsys.readouterr().out
    lines = said.splitlines()
    assert len(lines) <= 24 and max(map(len, lines)) <= 80
    for name in COMMANDS:
        assert any(line.startswith(f"  {name} ") and line.endswith(".") for line in lines), name
    assert "unshade run --help" in said and "unshade run --images photos/" in said
    assert "--colmap" in said and "configs/sample.yaml" in said


def test_help_of_a_command_lists_its_options(capsys):
    with pytest.raises(SystemExit) as ended:
        main(["run", "--help"])
    assert not ended.value.code
    said = capsys.readouterr().out
    assert "--images" in said and "--from" in said


def test_what_a_run_leads_to_is_given_by_its_stages():
    shown = {stage.name: [a.output for a in stage.gives if a.output] for stage in ALL_STAGES}
    for one in POINTERS:
        own = shown[one.stage] + [HTML] * (one.stage == "report")
        assert one.path.split("/")[0] in own, one
    assert len(get_args(Command)) == len(COMMANDS)
