"""What is generated is up to date, and what the README promises is there."""

from __future__ import annotations

import importlib.util
import re
import subprocess
import sys
from pathlib import Path

import pytest

import stages
from pipeline.config import check_settings, override
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


@pytest.mark.parametrize("equation", range(1, 19))
def test_every_equation_of_the_paper_has_a_function_and_a_test(equation):
    """The page itself is compared with the sources above."""
    page = (ROOT / "docs/equations.md").read_text(encoding="utf-8")
    row = next(line for line in page.splitlines() if line.startswith(f"| {equation} |"))
    _, _, functions, tests = row.strip("| ").split(" | ")
    assert re.search(r"\[[\w.]+\]\(\.\./(stages|benchmarks)/[\w/]+\.py\)", functions)
    assert re.search(r"\[test_\w+\]\(\.\./tests/test_\w+\.py\)", tests)


@pytest.mark.parametrize(
    ("text", "numbers"),
    [
        ("Eq. 12 and 14 to 16", {12, 14, 15, 16}),
        ("Eq. 1–4, 9–18", {1, 2, 3, 4, *range(9, 19)}),
        ("Eqs. 3, 4 and 5; Eq.\n    7", {3, 4, 5, 7}),
        ("Eq. 10 to 0.1 %", {10}),
        ("Walter et al. 2007, Eq. 20, 33, 34", set()),
    ],
)
def test_citations_of_equations_are_read_as_lists_and_ranges(text, numbers):
    spec = importlib.util.spec_from_file_location("equation_index", ROOT / "docs/equation_index.py")
    index = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(index)
    assert index.cited(text) == numbers


def test_the_method_names_functions_and_settings_that_exist():
    """`FILE`: `NAME`, …; constants of these files; `STAGE.NAME`; and `STAGE.NAME=VALUE`, the default."""
    page = (ROOT / "docs/method.md").read_text(encoding="utf-8")
    for section in page.split("\n## ")[1:]:
        named = re.findall(r"`(stages/[\w/]+\.py)`: ((?:`[\w.]+`(?:, )?)+)", section)
        assert named, section
        sources = {file: (ROOT / file).read_text(encoding="utf-8") for file, _ in named}
        for file, names in named:
            for name in re.findall(r"[\w.]+", names):
                definition = rf"^\s*(?:def|class) {name.split('.')[-1]}\b"
                assert re.search(definition, sources[file], re.MULTILINE), f"{file}: {name}"
        for name in re.findall(r"`([A-Z_]+)`", section):
            assignment = rf"^[A-Z_, ]*\b{name}\b.* = "
            assert any(re.search(assignment, text, re.MULTILINE) for text in sources.values()), name
    declared = {stage.name: stage.settings for stage in stages.ALL_STAGES}
    defaults = check_settings(declared, {})
    for stage, name, value in re.findall(r"`([a-z_]+)\.([a-z_]+)(=[^`]+)?`", page):
        if stage in declared:
            assert name in declared[stage].model_json_schema(by_alias=True)["properties"], f"{stage}.{name}"
            if value:
                assert check_settings(declared, override({}, [f"{stage}.{name}{value}"])) == defaults, name


def test_every_link_in_the_pages_on_the_method_leads_somewhere():
    for page in ("docs/method.md", "docs/experiments.md", "docs/equations.md"):
        for target in re.findall(r"\]\(([^)#]+)\)", (ROOT / page).read_text(encoding="utf-8")):
            assert (ROOT / page).parent.joinpath(target).exists(), f"{page} points to {target}"
