"""The cache's promises as behaviour, on a dataflow of three nodes."""

from __future__ import annotations

import errno
import json
import os
import shutil
import signal
import stat
import subprocess
import sys
import time
from dataclasses import replace
from pathlib import Path
from threading import Event
from unittest.mock import patch

import pytest

from pipeline import Artefact, Stage, UserError
from pipeline.cache.digest import files_below
from pipeline.cache.output import Output
from pipeline.cache.store import Store
from pipeline.inspect import overview
from tests import toy_flow
from tests.toy_flow import COUNT, FLOW, JOIN, REPORT, Settings, run_toy, write_words


@pytest.fixture
def root(tmp_path: Path) -> Path:
    write_words(tmp_path, a="apple", b="beech")
    return tmp_path


def page(root: Path) -> str:
    return (root / "workspace/output/page.txt").read_text()


def test_first_run_runs_all_and_second_reuses_all(root):
    assert run_toy(root).ran == ["join", "count", "report"]
    assert page(root) == "<11>"
    again = run_toy(root)
    assert again.ran == []
    assert set(again.reasons.values()) == {"nothing that it depends on has changed"}


def test_a_setting_reruns_its_stage_and_what_follows_and_says_from_what_to_what(root):
    run_toy(root)
    witness = run_toy(root, settings={"count": {"times": 3}})
    assert witness.ran == ["count", "report"]
    assert witness.reasons["count"] == "setting times went from 1 to 3"
    assert witness.reasons["report"] == "input numbers changed (length.txt has other content)"
    assert page(root) == "<33>"


def test_a_setting_set_back_reuses_the_earlier_result_and_shows_it(root):
    run_toy(root)
    run_toy(root, settings={"count": {"times": 3}})
    assert run_toy(root).ran == []
    assert page(root) == "<11>"


def test_a_change_that_makes_no_difference_stops_where_it_stops_mattering(root):
    """Early cut-off: another separator of the same length changes the text but not its length."""
    run_toy(root)
    assert run_toy(root, settings={"join": {"separator": "_"}}).ran == ["join", "count"]


def test_a_setting_that_changes_no_result_reruns_nothing(root):
    run_toy(root)
    assert run_toy(root, settings={"join": {"chatty": True}}).ran == []


def test_touching_copying_and_moving_the_sources_reruns_nothing(root):
    run_toy(root)
    os.utime(root / "words/a.txt", (1, 1))
    assert run_toy(root).ran == []
    shutil.copytree(root / "words", root / "copy")
    shutil.rmtree(root / "words")
    (root / "copy").rename(root / "words")
    assert run_toy(root).ran == []


def test_renaming_a_source_of_one_file_reruns_nothing_and_its_kind_and_content_count(root):
    def copied(job):
        job.outputs["text"].write_bytes(job.inputs["words"].read_bytes())

    flow = (replace(JOIN, run=copied), COUNT, REPORT)
    run_toy(root, flow=flow, words="words/a.txt")
    (root / "words/a.txt").rename(root / "words/tree.txt")
    assert run_toy(root, flow=flow, words="words/tree.txt").ran == []
    witness = run_toy(root, flow=flow, words="words/b.txt")
    assert witness.reasons["join"] == "input words changed (words.txt has other content)"
    (root / "words/b.txt").rename(root / "words/b.md")
    witness = run_toy(root, flow=flow, words="words/b.md")
    assert witness.reasons["join"] == "input words changed (words.md is new, words.txt is gone)"


def test_one_changed_byte_in_a_source_reruns_what_depends_on_it_and_names_the_file(root):
    run_toy(root)
    write_words(root, b="birch")
    witness = run_toy(root)
    assert witness.ran == ["join", "count"]  # of equal length: the report does not depend on it
    assert witness.reasons["join"] == "input words changed (b.txt has other content)"


def test_files_that_do_not_count_and_hidden_files_change_nothing(root):
    run_toy(root)
    (root / "words/notes.md").write_text("not a word")
    (root / "words/.hidden.txt").write_text("not a word")
    assert run_toy(root).ran == []


def test_linked_files_and_folders_are_read_and_each_folder_once(root):
    (root / "elsewhere").mkdir()
    (root / "elsewhere/c.txt").write_text("cedar")
    (root / "words/again").symlink_to(root / "words")
    (root / "words/linked").symlink_to(root / "elsewhere")
    (root / "words/linked too").symlink_to(root / "elsewhere")
    (root / "words/d.txt").symlink_to(root / "elsewhere/c.txt")
    assert list(files_below(root / "words")) == ["a.txt", "b.txt", "d.txt", "linked/c.txt"]
    run_toy(root)
    (root / "elsewhere/c.txt").write_text("cocoa")
    assert "d.txt has other content, linked/c.txt has other content" in run_toy(root).reasons["join"]


@pytest.mark.parametrize("name", ["c.txt", "more words"])
def test_a_link_that_leads_nowhere_is_named(root, name):
    (root / "words" / name).symlink_to(root / "nowhere")
    with pytest.raises(UserError, match=f"words/{name} is a link to .*nowhere, which is not there"):
        run_toy(root)


@pytest.mark.skipif(os.geteuid() == 0, reason="root may read anything")
@pytest.mark.parametrize("name", ["b.txt", "more words"])
def test_a_source_that_may_not_be_read_is_named(root, name):
    (root / "words/more words").mkdir()
    (root / "words" / name).chmod(0)
    with pytest.raises(UserError, match=f"words/{name}, of the source words, cannot be read .Permission"):
        run_toy(root)
    (root / "words" / name).chmod(0o700)


def test_a_source_that_is_nothing_to_read_is_named(root):
    os.mknod(root / "words/c.txt", stat.S_IFSOCK | 0o600)
    with pytest.raises(UserError, match="words/c.txt is a socket; expected a file"):
        run_toy(root)


def test_another_version_of_a_stage_reruns_it(root):
    run_toy(root)
    flow = (JOIN, replace(COUNT, version=2), REPORT)
    witness = run_toy(root, flow=flow)
    assert witness.ran == ["count"]
    assert witness.reasons["count"] == "the stage itself went from version 1 to 2"


def test_a_tool_version_and_a_choice_of_the_machine_are_part_of_the_key(root, monkeypatch):
    flow = (JOIN, replace(COUNT, tools=("blake3",), machine=lambda settings: {"engine": "abacus"}), REPORT)
    run_toy(root, flow=flow)
    flow = (JOIN, replace(flow[1], machine=lambda settings: {"engine": "slide rule"}), REPORT)
    assert run_toy(root, flow=flow).reasons["count"] == "machine's engine went from abacus to slide rule"
    monkeypatch.setattr("pipeline.cache.key.version", lambda name: "99")
    assert "tool blake3 went from" in run_toy(root, flow=flow).reasons["count"]


@pytest.mark.parametrize("harm", ["flip", "delete", "add", "flip behind a restored time"])
def test_a_damaged_artefact_is_noticed_and_rebuilt(root, harm):
    run_toy(root)
    (artefact,) = (root / "workspace/cache/count").glob("*/numbers/length.txt")
    before = artefact.stat()
    if harm == "delete":
        artefact.unlink()
    elif harm == "add":
        artefact.with_name("more.txt").write_text("?")
    else:
        artefact.write_text("12")
        if "restored" in harm:
            os.utime(artefact, ns=(before.st_atime_ns, before.st_mtime_ns))
    witness = run_toy(root)
    assert witness.ran == ["count"]
    assert witness.reasons["count"].startswith("its cached result is damaged: numbers/")
    assert artefact.read_text() == "11"
    assert page(root) == "<11>"


def test_a_result_without_a_record_does_not_exist(root):
    run_toy(root)
    next((root / "workspace/cache/join").glob("*/record.json")).unlink()
    assert run_toy(root).ran == ["join"]


def test_a_broken_record_or_memo_is_no_catastrophe(root):
    run_toy(root)
    next((root / "workspace/cache/join").glob("*/record.json")).write_text("{")
    (root / "workspace/cache/digests.json").write_text("[1")
    (root / "workspace/cache/current.json").write_text("")
    assert run_toy(root).ran == ["join"]


def test_a_failing_stage_keeps_what_earlier_runs_made_and_leaves_a_log(root):
    run_toy(root)
    write_words(root, c="poison")
    with pytest.raises(UserError, match="poison"):
        run_toy(root)
    assert page(root) == "<11>"
    assert "poison" in (root / "workspace/logs/join.txt").read_text()
    (root / "words/c.txt").unlink()
    assert run_toy(root).ran == []


def test_a_failure_that_leaves_no_log_is_still_told(root):
    (root / "workspace").mkdir()
    (root / "workspace/logs").write_text("in the way of a folder")
    write_words(root, c="poison")
    with pytest.raises(UserError, match="poison"):
        run_toy(root)


@pytest.mark.parametrize("number", [errno.ENOSPC, errno.EDQUOT, errno.EROFS, errno.EACCES])
def test_a_disk_that_refuses_is_a_sentence_with_the_place(root, number):
    def refused(job):
        raise OSError(number, os.strerror(number), str(job.outputs["text"]))

    with pytest.raises(UserError, match=rf"/workspace/cache/join/\S+ cannot be used .{os.strerror(number)}"):
        run_toy(root, flow=(replace(JOIN, run=refused), COUNT, REPORT))


def test_a_disk_that_is_full_need_not_say_where(root):
    def refused(job):
        with Path("/dev/full").open("w") as file:
            file.write("a word")

    with pytest.raises(UserError, match="/workspace cannot be used .No space left"):
        run_toy(root, flow=(replace(JOIN, run=refused), COUNT, REPORT))


def test_what_is_refused_elsewhere_is_a_fault(root):
    def refused(job):
        raise PermissionError(errno.EACCES, "Permission denied", "/elsewhere")

    with pytest.raises(PermissionError):
        run_toy(root, flow=(replace(JOIN, run=refused), COUNT, REPORT))


def test_nothing_half_done_is_ever_visible(root):
    def half(job):
        job.outputs["text"].write_text("half")
        raise RuntimeError("pulled the plug")

    with pytest.raises(RuntimeError):
        run_toy(root, flow=(replace(JOIN, run=half), COUNT, REPORT))
    assert list((root / "workspace/cache/join").iterdir()) == []


@pytest.mark.parametrize(
    ("disturb", "change"),
    [
        (lambda words: (words / "b.txt").write_text("birch"), "b.txt has other content"),
        (lambda words: (words / "c.txt").write_text("cedar"), "c.txt is new"),
        (lambda words: (words / "a.txt").unlink(), "a.txt is gone"),
    ],
)
def test_a_source_that_changes_during_the_run_leaves_no_result_under_its_old_digest(root, disturb, change):
    def disturbed(job):
        toy_flow.join(job)
        disturb(root / "words")

    with pytest.raises(UserError, match=f"source words changed during the run .{change}.*: run again"):
        run_toy(root, flow=(replace(JOIN, run=disturbed), COUNT, REPORT))
    assert list((root / "workspace/cache/join").iterdir()) == []
    assert run_toy(root).ran == ["join", "count", "report"]


def test_queued_work_of_a_failed_stage_is_dropped_and_what_has_begun_ends_before_its_folder_goes(root):
    began, saw_its_folder = Event(), []

    def work(folder):
        began.set()
        time.sleep(0.1)
        saw_its_folder.append(folder.exists())

    def hasty(job):
        for _ in range(20):
            job.executor.submit(work, job.scratch)
        began.wait()
        raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        run_toy(root, flow=(replace(JOIN, run=hasty), COUNT, REPORT))
    assert all(saw_its_folder)
    assert 1 <= len(saw_its_folder) < 20


def test_a_stage_that_writes_less_than_it_declares_is_not_published(root):
    with pytest.raises(RuntimeError, match="without writing text"):
        run_toy(root, flow=(replace(JOIN, run=lambda job: None), COUNT, REPORT))
    assert Store(root / "workspace").records("join") == []


def test_force_runs_the_selected_stages_and_a_different_twin_is_said_aloud(root):
    run_toy(root)
    assert run_toy(root, force=True, only="count").ran == ["count"]

    def moody(job):
        job.outputs["text"].write_text("something else")

    witness = run_toy(root, flow=(replace(JOIN, run=moody), COUNT, REPORT), force=True, last="join")
    assert witness.ran == ["join"]
    assert witness.said == [
        "join: text came out different from the same ingredients.",
        "Of an earlier run, in output: numbers/length.txt (count made it from another text).",
        "Of an earlier run, in output: page.txt (report made it from another numbers).",
    ]


def test_from_and_to_choose_a_range(root):
    assert run_toy(root, last="count").ran == ["join", "count"]
    assert run_toy(root, first="report").ran == ["report"]


def test_a_stage_outside_the_selection_must_be_up_to_date(root):
    run_toy(root)
    with pytest.raises(
        UserError, match="count needs an up-to-date join, but setting separator went from"
    ) as error:
        run_toy(root, only="count", settings={"join": {"separator": ", "}})
    assert "--to join" in str(error.value)


def test_an_unknown_stage_gets_the_near_one_suggested(root):
    with pytest.raises(UserError, match="no stage 'cuont'.*did you mean 'count'"):
        run_toy(root, only="cuont")
    with pytest.raises(UserError, match="comes after"):
        run_toy(root, first="report", last="join")


@pytest.mark.parametrize(
    ("bounds", "said"),
    [
        ({"first": "join"}, "--from join"),
        ({"last": "report"}, "--to report"),
        ({"first": "join", "last": "report"}, "--from join --to report"),
    ],
)
def test_one_stage_alone_and_a_range_are_not_both_taken(root, bounds, said):
    with pytest.raises(UserError, match=f"--only count and {said} were given.*Leave out one"):
        run_toy(root, only="count", **bounds)


def test_a_second_run_on_a_busy_workspace_is_refused(root):
    from pipeline.files.workspace_lock import locked

    with locked(root / "workspace"), pytest.raises(UserError, match="Another run is using the workspace"):
        run_toy(root)


@pytest.mark.skipif(os.geteuid() == 0, reason="root may write anywhere")
def test_a_read_only_workspace_is_refused(root):
    (root / "workspace").mkdir(mode=0o500)
    with pytest.raises(UserError, match="cannot be written"):
        run_toy(root)


def test_a_workspace_below_a_file_is_refused(root):
    (root / "workspace").write_text("a file")
    with pytest.raises(UserError, match="cannot be written.*choose another folder"):
        run_toy(root)


def test_the_overview_has_the_stages_in_the_given_order_and_unknown_ones_last(root):
    run_toy(root)
    rows = overview(Store(root / "workspace"), ["relight", "report", "join"])
    assert [row["stage"] for row in rows] == ["report", "join", "count"]


def test_output_follows_the_newest_result_and_leaves_other_files_alone(root):
    run_toy(root)
    foreign = root / "workspace/output/numbers/mine.txt"
    foreign.write_text("mine")
    (root / "workspace/output/page.txt").write_text("scribbled over")
    run_toy(root)
    assert page(root) == "<11>"
    assert foreign.read_text() == "mine"


def test_an_output_file_that_is_no_longer_made_disappears(root):
    def two(job):
        for name in ("length.txt", "extra.txt"):
            (job.outputs["numbers"] / name).write_text("2")

    run_toy(root, flow=(JOIN, replace(COUNT, run=two, version=2), REPORT))
    assert (root / "workspace/output/numbers/extra.txt").exists()
    run_toy(root)
    assert not (root / "workspace/output/numbers/extra.txt").exists()


def test_what_an_interrupted_copy_left_in_the_output_is_removed_with_its_result(root, monkeypatch):
    def some(names):
        return lambda job: [(job.outputs["numbers"] / f"{name}.txt").write_text(name) for name in names]

    three, two = ((JOIN, replace(COUNT, run=some(names), version=len(names))) for names in ("abc", "ab"))
    copy = Output._copy

    def interrupted(self, file, target):
        copy(self, file, target)
        if target.name == "c.txt":
            raise KeyboardInterrupt

    monkeypatch.setattr(Output, "_copy", interrupted)
    with pytest.raises(KeyboardInterrupt):
        run_toy(root, flow=three)
    monkeypatch.setattr(Output, "_copy", copy)
    assert (root / "workspace/output/numbers/c.txt").exists()
    run_toy(root, flow=two)
    shown = sorted(path.name for path in (root / "workspace/output/numbers").iterdir())
    assert shown == ["a.txt", "b.txt"]
    assert (root / "workspace/output/numbers/a.txt").read_text() == "a"


def test_a_folder_that_was_closed_since_costs_nothing(root):
    """Root may enter it all the same: the dead disk is played."""
    run_toy(root)

    class Dead(type(Path())):
        def stat(self, **how):
            raise PermissionError(13, "closed")

    memo = Store(root / "workspace").memo
    memo._known["/closed/photo.jpg"] = ((1, 1, 1, 1), "0" * 32)
    memo._changed = True
    with patch("pipeline.cache.digest.Path", Dead):
        memo.save()
    assert run_toy(root).ran == []


def test_what_is_shown_of_an_earlier_run_is_named_and_stays(root):
    assert run_toy(root).said == []
    witness = run_toy(root, settings={"count": {"times": 3}}, last="count")
    assert witness.said == ["Of an earlier run, in output: page.txt (report made it from another numbers)."]
    assert page(root) == "<11>"
    assert run_toy(root, settings={"count": {"times": 3}}).said == []


def test_an_artefact_that_a_stage_gives_no_more_leaves_the_output(root):
    def with_words(job):
        toy_flow.count(job)
        (job.outputs["letters"] / "a.txt").write_text("a")

    letters = Artefact("letters", "letters", output="by/letters")
    generous = replace(COUNT, run=with_words, gives=(*COUNT.gives, letters), version=2)
    run_toy(root, flow=(JOIN, generous, REPORT))
    assert (root / "workspace/output/by/letters/a.txt").exists()
    run_toy(root)
    assert not (root / "workspace/output/by").exists()
    run_toy(root, flow=(JOIN, generous, REPORT))
    assert (root / "workspace/output/by/letters/a.txt").exists()


def test_an_artefact_that_takes_the_place_of_another_is_not_taken_away_with_it(root):
    def renamed(job):
        (job.outputs["sizes"] / "length.txt").write_text("7")

    run_toy(root)
    sizes = replace(COUNT, run=renamed, gives=(Artefact("sizes", "sizes", output="numbers"),), version=2)
    run_toy(root, flow=(JOIN, sizes), last="count")
    assert (root / "workspace/output/numbers/length.txt").read_text() == "7"


def test_a_stage_that_takes_over_from_one_that_is_gone_leaves_nothing_of_it_in_the_output(root):
    """As does another dataflow: what the one before showed of another kind is not of this result."""

    def counted_apart(job):
        (job.outputs["numbers"] / "length.txt").write_text("7")
        (job.outputs["letters"] / "a.txt").write_text("a")

    letters = Artefact("letters", "letters", output="letters")
    apart = replace(COUNT, name="count_apart", run=counted_apart, gives=(*COUNT.gives, letters))
    run_toy(root, flow=(JOIN, apart, REPORT))
    assert (root / "workspace/output/letters/a.txt").exists()
    run_toy(root, flow=(JOIN, COUNT))
    assert not (root / "workspace/output/letters").exists()
    assert (root / "workspace/output/page.txt").exists(), "of a stage whose place nobody takes"


def test_what_one_more_stage_shows_in_the_place_of_another_goes_with_it(root):
    """A stage that gives the numbers in another form: without it, they are back, and what it gave is gone."""

    def doubled(job):
        number = int((job.inputs["numbers"] / "length.txt").read_text())
        (job.outputs["doubled"] / "length.txt").write_text(str(2 * number))
        job.outputs["factor"].write_text("2")

    twice = replace(
        REPORT,
        name="twice",
        run=doubled,
        gives=(
            Artefact("doubled", "twice the counts", output="numbers"),
            Artefact("factor", "by which", file="factor.txt", output="factor.txt"),
        ),
    )
    unshown = replace(COUNT, gives=(Artefact("numbers", "counts"),))
    output = root / "workspace/output"
    for flow, length, ran in (
        ((JOIN, COUNT), "11", ["join", "count"]),
        ((JOIN, unshown, twice), "22", ["twice"]),
        ((JOIN, COUNT), "11", []),
        ((JOIN, unshown, twice), "22", []),
    ):
        assert run_toy(root, flow=flow).ran == ran
        assert (output / "numbers/length.txt").read_text() == length
        assert (output / "factor.txt").exists() == (twice in flow)


def test_an_output_of_a_program_that_kept_no_origins_is_brought_up_to_date(root):
    run_toy(root)
    ledger = root / "workspace/cache/output.json"
    entries = json.loads(ledger.read_text())
    ledger.write_text(json.dumps({name: one["files"] for name, one in entries.items() if name != "digest"}))
    witness = run_toy(root, settings={"count": {"times": 2}})
    assert witness.said == []
    assert page(root) == "<22>"
    assert json.loads(ledger.read_text())["page"]["stage"] == "report"


SLEEPER = """
import sys, time
from dataclasses import replace
from pathlib import Path
from tests import toy_flow
root, sleepy = Path(sys.argv[1]), sys.argv[2]
def slow(stage):
    def run(job):
        stage.run(job)
        (root / "reached").write_text("")
        time.sleep(60)
    return replace(stage, run=run)
toy_flow.run_toy(root, flow=tuple(slow(s) if s.name == sleepy else s for s in toy_flow.FLOW))
"""


@pytest.mark.parametrize("stage", [stage.name for stage in FLOW])
def test_a_run_killed_during_any_stage_continues_to_the_same_digests(root, stage):
    undisturbed = root / "undisturbed"
    undisturbed.mkdir()
    write_words(undisturbed, a="apple", b="beech")
    run_toy(undisturbed)
    victim = subprocess.Popen(
        [sys.executable, "-c", SLEEPER, str(root), stage], cwd=Path(__file__).parent.parent
    )
    deadline = time.monotonic() + 30
    while not (root / "reached").exists() and time.monotonic() < deadline:
        time.sleep(0.02)
    victim.send_signal(signal.SIGKILL)
    victim.wait()
    witness = run_toy(root)
    assert witness.ran == [later.name for later in FLOW[[s.name for s in FLOW].index(stage) :]]
    for later in FLOW:
        ours, theirs = (Store(place / "workspace").current(later.name) for place in (root, undisturbed))
        assert ours.outputs == theirs.outputs
        assert ours.key == theirs.key
    assert not list((root / "workspace/cache").glob("*/.partial-*"))


def test_a_flow_that_contradicts_itself_is_a_fault_of_the_program():
    from pipeline.request import check_flow

    with pytest.raises(ValueError, match="takes"):
        check_flow((COUNT,), (toy_flow.WORDS,))
    twice = Stage("again", 1, "", Settings, ("words",), (Artefact("text", ""),), toy_flow.join)
    with pytest.raises(ValueError, match="there already"):
        check_flow((JOIN, twice), (toy_flow.WORDS,))
