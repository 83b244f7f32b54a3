"""What is generated is up to date, and what the README promises is there."""

from __future__ import annotations

import re
import subprocess
import sys
from pathlib import Path

import stages

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
