"""What is generated is up to date, and what README and the pages in docs/ promise is there."""

from __future__ import annotations

import importlib.util
import re
import subprocess
import sys
from collections import Counter
from pathlib import Path

import pytest
import yaml

import stages
from pipeline.config import check_settings, override
from stages.command.arguments import Plan
from stages.command.report import FILES
from stages.command.request import request_of
from tests.test_architecture import all_settings

ROOT = Path(__file__).parent.parent
FOR_USERS = (
    "README.md",
    *(f"docs/{name}.md" for name in ("guide", "outputs", "evaluation", "performance", "limits")),
)
PAGES = (
    ROOT / "README.md",
    ROOT / "CONTRIBUTING.md",
    *sorted((ROOT / "docs").rglob("*.md")),
    ROOT / "stages/scene/CONVENTIONS.md",
    ROOT / "sample_data/README.md",
)
FENCE = re.compile(r"^(```|~~~).*?^\1[^\n]*$", re.MULTILINE | re.DOTALL)
CODE_SPAN = re.compile(r"(`+)(?!`)(?:(?!\n\n).)+?(?<!`)\1(?!`)", re.DOTALL)
LINK = re.compile(r"\]\(\s*<?([^)\s>]+)>?(?:\s+\"[^\"]*\")?\s*\)")
HEADING = re.compile(r"^#{1,6}\s+(.+?)\s*#*$", re.MULTILINE)
ELSEWHERE = ("http://", "https://", "mailto:")


def text_of(page: str) -> str:
    return (ROOT / page).read_text(encoding="utf-8")


def section(page: str, heading: str) -> str:
    """The text under a heading, up to the next one of its level."""
    return text_of(page).split(f"\n## {heading}\n")[1].split("\n## ")[0]


def promised_outputs(text: str) -> set[str]:
    """First parts of the paths in backticks that look like files or folders of `output/`."""
    return {path.split("/")[0] for path in re.findall(r"`([a-z_]+(?:/|\.[a-z]+))", text)} - {"output"}


def exported_outputs() -> set[str]:
    return {*FILES} | {
        artefact.output.split("/")[0]
        for stage in stages.ALL_STAGES
        for artefact in stage.gives
        if artefact.output
    }


def links_of(text: str) -> list[str]:
    """Targets of the links and pictures in a page; code holds none."""
    return LINK.findall(CODE_SPAN.sub("code", FENCE.sub("", text)))


def anchors_of(page: Path) -> set[str]:
    """The anchors that GitHub gives to the headings of a page; other files have none."""
    seen: Counter[str] = Counter()
    anchors: set[str] = set()
    if page.suffix != ".md":
        return anchors
    for heading in HEADING.findall(FENCE.sub("", page.read_text(encoding="utf-8"))):
        shown = re.sub(r"\[([^]]*)\]\([^)]*\)", r"\1", heading).lower()
        slug = re.sub(r"[^\w\- ]", "", shown).replace(" ", "-")
        anchors.add(f"{slug}-{seen[slug]}" if seen[slug] else slug)
        seen[slug] += 1
    return anchors


def broken_links(page: Path) -> list[str]:
    """Targets of a page that are no file, no anchor, or not relative."""
    broken = []
    for target in links_of(page.read_text(encoding="utf-8")):
        if target.startswith(ELSEWHERE):
            continue
        path, _, anchor = target.partition("#")
        file = page.parent / path if path else page
        found = file.exists() and not path.startswith("/")
        if not found or (anchor and anchor not in anchors_of(file)):
            broken.append(target)
    return broken


def test_generated_pages_are_up_to_date():
    check = subprocess.run(
        [sys.executable, "docs/generate.py", "--check"], cwd=ROOT, capture_output=True, text=True
    )
    assert check.returncode == 0, check.stderr


def test_every_stage_is_in_the_guides_table():
    assert re.findall(r"^\| `(\w+)` \|", section("docs/guide.md", "Dataflow"), re.MULTILINE) == [
        stage.name for stage in stages.ALL_STAGES
    ]


def test_every_output_that_is_documented_is_delivered_by_a_stage_and_the_other_way_round():
    table = text_of("docs/outputs.md").split("## What comes out")[1].strip().split("\n\n")[0]
    assert promised_outputs(table) == exported_outputs()


def test_every_output_in_the_readme_is_delivered_by_a_stage():
    listed = re.findall(r"^\* .*", section("README.md", "What comes out"), re.MULTILINE)
    promised = promised_outputs("\n".join(listed))
    assert promised
    assert promised <= exported_outputs()


def test_the_pipeline_in_the_readme_is_the_dataflow_in_eight_lines():
    lines = re.findall(r"^\d\. (.*?):", section("README.md", "The pipeline"), re.MULTILINE)
    assert len(lines) == 8
    assert re.findall(r"`(\w+)`", " ".join(lines)) == [stage.name for stage in stages.DATAFLOW]


@pytest.mark.parametrize("page", PAGES, ids=lambda page: page.relative_to(ROOT).as_posix())
def test_links_between_pages_resolve(page):
    assert not broken_links(page)


def test_a_missing_file_and_a_missing_heading_are_broken_links(tmp_path):
    page = tmp_path / "page.md"
    page.write_text(
        "# One `mode: two`, three\n## Again\n## Again\n"
        "```\n# no heading\n[no](link.md)\n```\n`[no]\n(link.md)` and `[no](link.md)`\n"
        "[a](#one-mode-two-three) [b](#again-1) [c](page.md#again) [d](https://example.org/#x)\n"
        "[e](#no-heading) [f](#again-2) [g](missing.md)\n"
        "![h](missing.png) [i](page.md#missing) [j](/page.md)\n",
        encoding="utf-8",
    )
    assert broken_links(page) == [
        "#no-heading",
        "#again-2",
        "missing.md",
        "missing.png",
        "page.md#missing",
        "/page.md",
    ]


def test_every_make_target_that_is_documented_exists():
    makefile = text_of("Makefile")
    for page in FOR_USERS:
        for target in set(re.findall(r"\bmake ([a-z][a-z-]+)\b", text_of(page))):
            assert re.search(rf"^{target}:", makefile, re.MULTILINE), f"{page}: make {target}"


def test_the_documented_scene_is_one_that_can_be_rendered(tmp_path):
    scene = text_of("docs/evaluation.md").split("## Scenes of known truth")[1]
    config = tmp_path / "striped.yaml"
    config.write_text(scene.split("```")[1], encoding="utf-8")
    request = request_of(Plan(config=config))
    assert [stage.name for stage in request.flow][:2] == ["render", "undistort"]
    assert request.workspace == tmp_path / "workspaces/striped"
    render = request.settings["render"]
    assert request.settings["undistort"].max_size_px >= max(render.width_px, render.height_px)


def test_the_citation_is_of_this_version():
    citation = yaml.safe_load(text_of("CITATION.cff"))
    assert citation["cff-version"] == "1.2.0"
    declared = re.search(r'^version = "(.+)"$', text_of("pyproject.toml"), re.MULTILINE)
    assert declared is not None
    assert citation["version"] == declared[1]


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
    """`FILE`: `NAME`, …; constants of these; settings, `STAGE.NAME` or `STAGE.PHASE.NAME`, `=DEFAULT`."""
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
    for stage, name, value in re.findall(r"`([a-z_]+)\.([a-z_.]+)(=[^`]+)?`", page):
        if stage in declared:
            assert name in {known for known, _ in all_settings(declared[stage])}, f"{stage}.{name}"
            if value:
                assert check_settings(declared, override({}, [f"{stage}.{name}{value}"])) == defaults, name
