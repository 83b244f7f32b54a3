"""What is generated is up to date, and what the README promises is there."""

from __future__ import annotations

import re
import subprocess
import sys
from pathlib import Path

import stages
from stages.command.request import request_of
from stages.command.words import Plan

ROOT = Path(__file__).parent.parent


def test_generated_pages_are_up_to_date():
    check = subprocess.run(
        [sys.executable, "docs/generate.py", "--check"], cwd=ROOT, capture_output=True, text=True
    )
    assert check.returncode == 0, check.stderr


def test_every_output_in_the_readme_is_delivered_by_a_stage_and_the_other_way_round():
    shown = {artefact.output for stage in stages.ALL_STAGES for artefact in stage.gives if artefact.output}
    table = (ROOT / "README.md").read_text(encoding="utf-8").split("## What comes out")[1].split("\n\n")[0]
    promised = {path.split("/")[0] for path in re.findall(r"`([a-z_]+(?:/|\.[a-z]+))", table)} - {"output"}
    assert promised == {path.split("/")[0] for path in shown}


def test_every_link_in_the_readme_leads_somewhere():
    for page in ("README.md", "CONTRIBUTING.md", "docs/settings.md"):
        for target in re.findall(r"\]\(([^)#]+)\)", (ROOT / page).read_text(encoding="utf-8")):
            if not target.startswith("http"):
                assert (ROOT / page).parent.joinpath(target).exists(), f"{page} points to {target}"


def test_every_make_target_in_the_readme_exists():
    makefile = (ROOT / "Makefile").read_text(encoding="utf-8")
    for target in set(
        re.findall(r"\bmake ([a-z][a-z-]+)\b", (ROOT / "README.md").read_text(encoding="utf-8"))
    ):
        assert re.search(rf"^{target}:", makefile, re.MULTILINE) or target in ("does", "alone"), target


def test_the_scene_in_the_readme_is_one_that_can_be_rendered(tmp_path):
    section = (ROOT / "README.md").read_text(encoding="utf-8").split("## Scenes of known truth")[1]
    config = tmp_path / "striped.yaml"
    config.write_text(section.split("```")[1], encoding="utf-8")
    request = request_of(Plan(config=config))
    assert [stage.name for stage in request.flow][:2] == ["render", "undistort"]
    assert request.workspace == tmp_path / "workspaces/striped"
    render = request.settings["render"]
    assert request.settings["undistort"].max_size_px >= max(render.width_px, render.height_px)
