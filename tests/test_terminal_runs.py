"""Runs as they look on terminals, in pipes and to programs."""

from __future__ import annotations

import json
import os
import re
import subprocess
import sys
from pathlib import Path

import pytest

from pipeline.cache.store import Store
from pipeline.command.verbs import how_to_go_on
from tests.pseudo_terminal import Ended, run_in_terminal
from tests.toy_flow import COUNT, write_words

ROOT = Path(__file__).parent.parent
PLAIN = {
    name: text for name, text in os.environ.items() if name not in ("NO_COLOR", "FORCE_COLOR", "COLUMNS")
}
CONTROL = re.compile(r"[\r\x1b]")
COLOUR = re.compile(r"\x1b\[[0-9;]*3[0-7]m")


def command(root: Path, *words: str) -> list[str]:
    return [sys.executable, "-m", "tests.toy_command", str(root), *words]


def on_terminal(root: Path, columns: int, *words: str, interrupt_at: str = "", **variables: str) -> Ended:
    environment = PLAIN | {"TERM": "xterm-256color", "PYTHONPATH": str(ROOT)} | variables
    return run_in_terminal(command(root, *words), columns, ROOT, environment, interrupt_at)


def in_pipes(root: Path, *words: str, **variables: str) -> subprocess.CompletedProcess[str]:
    environment = PLAIN | {"PYTHONPATH": str(ROOT)} | variables
    done = subprocess.run(
        command(root, *words), capture_output=True, text=True, check=False, cwd=ROOT, env=environment
    )
    assert done.returncode == 0, done.stderr
    return done


@pytest.fixture
def root(tmp_path) -> Path:
    write_words(tmp_path, a="apple", b="pear")
    return tmp_path


@pytest.mark.parametrize("columns", [40, 80, 200])
def test_plan_bars_findings_and_table_fit_any_terminal(root, columns):
    ended = on_terminal(root, columns, "--slow", "1")
    assert ended.code == 0, ended.screen.text
    said = " ".join(ended.screen.text.split())
    assert "run join: it has never run here" in said
    assert "then count, report: for the first time" in said
    assert re.search(r"join 2 words; done in [\d.]+ s count 4 letters; done in [\d.]+ s report done in", said)
    assert re.search(r"stage result time memory join ran [\d.]+ s \d+ MB count ran", said)
    assert re.search(r"Up to date after [\d.]+ s: .*page.txt the page numbers/ the counts$", said)
    assert any("letters 2/4" in line for line in ended.screen.drawn)
    assert "letters 2/4" not in ended.screen.text
    free = [line for line in ended.screen.drawn if str(root) not in line]  # a path may be longer than that
    assert max(len(line.rstrip()) for line in free) <= columns


def test_what_is_reused_is_one_line_and_forced_stages_are_timed_by_the_earlier_run(root):
    on_terminal(root, 100, "--slow", "1")
    again = on_terminal(root, 100).screen.text
    assert again.splitlines()[0].split() == ["reuse", "join,", "count,", "report"]
    assert "done in" not in again and "earlier" not in again
    assert len(re.findall(r"^(?:join|count|report) +reused$", again, re.MULTILINE)) == 3
    forced = on_terminal(root, 100, "--force", "--slow", "2")
    said = " ".join(forced.screen.text.split())
    assert "then count, report: it was asked for with --force This took" in said
    assert any(re.search(r"count .*0:0\d, .*left", line) for line in forced.screen.drawn)


def test_in_pipes_there_are_plain_lines_and_every_stage_tells_that_it_begins(root):
    done = in_pipes(root, "--slow", "0.5")
    assert not CONTROL.search(done.stderr + done.stdout)
    lines = [" ".join(line.split()) for line in done.stderr.splitlines()]
    assert [line for line in lines if line in ("join run", "count run", "report run")] == [
        "join run",
        "count run",
        "report run",
    ]
    assert any(line.startswith("count 4 letters; done in") for line in lines)
    assert done.stdout.startswith("stage") and "page.txt" in done.stdout
    assert not any("letters 2/4" in line for line in lines)


def test_colours_are_drawn_where_they_are_wanted_and_bars_only_on_terminals(root):
    assert COLOUR.search(on_terminal(root, 80).raw)
    assert not COLOUR.search(on_terminal(root, 80, "--force", NO_COLOR="1").raw)
    dumb = on_terminal(root, 80, "--force", "--slow", "0.5", TERM="dumb")
    assert dumb.code == 0 and "letters 2/4" not in dumb.raw
    piped = in_pipes(root, "--force", FORCE_COLOR="1")
    assert COLOUR.search(piped.stderr) and "\r" not in piped.stderr


def test_programs_read_a_run_as_json_lines(root):
    done = in_pipes(root, "--json", "--slow", "1")
    events = [json.loads(line) for line in done.stderr.splitlines()]
    kinds = [event["event"] for event in events if event["event"] != "progress"]
    assert kinds == ["plan", *["begin", "end"] * 3, "done"]
    plan = next(event for event in events if event["event"] == "plan")
    assert [row["action"] for row in plan["stages"]] == ["run", "run or reuse", "run or reuse"]
    assert plan["seconds_earlier"] is None
    steps = [event for event in events if event["event"] == "progress" and event["stage"] == "count"]
    assert (steps[0]["task"], steps[0]["steps"], steps[0]["total"]) == ("letters", 0, 4)
    assert steps[-1]["steps"] == 4
    end = next(event for event in events if event["event"] == "end" and event["stage"] == "count")
    assert (end["action"], end["found"], end["facts"]) == ("run", "4 letters", {"letters": 4})
    assert end["seconds"] >= 1 and end["peak_bytes"] > 0 and end["warnings"] == []
    answer = json.loads(done.stdout)
    assert [Path(path).name for path in answer["to_open"]] == ["page.txt", "numbers"]
    assert events[-1]["to_open"] == answer["to_open"]
    assert [one["record"]["key"] for one in answer["stages"]][1] == end["key"]


def test_ctrl_c_ends_a_run_with_one_line_that_says_how_to_go_on(root):
    ended = on_terminal(root, 80, "--slow", "30", interrupt_at="letters 0/4")
    assert ended.code == 130
    line = "".join(ended.screen.text.splitlines()[-1:])
    assert line.startswith("unshade: Interrupted during count. The results of the stage before it are kept.")
    assert line.endswith(f"To go on: unshade run {root} --slow 30")
    assert "Traceback" not in ended.raw and "letters" not in ended.screen.text
    assert not list((root / "workspace/cache").glob("*/.partial-*"))
    assert Store(root / "workspace").current("join") is not None
    on = in_pipes(root)
    assert "reuse           join" in on.stderr


def test_to_go_on_with_force_is_to_begin_with_the_stage_that_was_interrupted():
    words = ["unshade", "run", "my photos.yaml", "--force"]
    assert how_to_go_on(words, [COUNT]) == "To go on: unshade run 'my photos.yaml' --force --from count"
    assert how_to_go_on([*words, "--only", "count"], [COUNT]).endswith("--force --only count")
    assert how_to_go_on(words[:3], [COUNT]) == "To go on: unshade run 'my photos.yaml'"
    assert how_to_go_on(()) == "The same command continues there."
