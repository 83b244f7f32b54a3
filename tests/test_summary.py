"""The summary at the end of a run: it tells what no key knows, of results that belong together."""

from __future__ import annotations

from dataclasses import replace

import pytest

from pipeline import Artefact, UserError
from pipeline.cache.store import Store
from pipeline.run import run, summarise
from pipeline.summary import consistent_results, outputs_of
from tests.toy_flow import FLOW, Witness, request, write_words


def told(results) -> dict[str, str]:
    """A summary: seconds, which are in no key, and what the last stage wrote."""
    seconds = " ".join(f"{name} {result.record.seconds >= 0}" for name, result in results.items())
    page = (results["report"].folder / "page.txt").read_text() if "report" in results else "none"
    return {"summary.txt": f"{seconds}: {page}"}


@pytest.fixture
def root(tmp_path):
    write_words(tmp_path, a="apple", b="beech")
    return tmp_path


def run_with_summary(root, **wishes) -> Witness:
    witness = Witness()
    run(replace(request(root, **wishes), summary=told, summary_files=("summary.txt",)), witness)
    return witness


def summary_of(root) -> str:
    return (root / "workspace/output/summary.txt").read_text()


def test_a_whole_run_ends_with_the_summary_of_all_results(root):
    run_with_summary(root)
    assert summary_of(root) == "join True count True report True: <11>"


def test_the_summary_is_no_part_of_the_cache_and_rewritten_only_where_it_differs(root):
    run_with_summary(root)
    file = root / "workspace/output/summary.txt"
    before = file.stat().st_mtime_ns
    assert run_with_summary(root).ran == []
    assert file.stat().st_mtime_ns == before
    file.write_text("edited")
    assert run_with_summary(root).ran == []
    assert summary_of(root) == "join True count True report True: <11>"


def test_a_run_that_stops_earlier_leaves_the_summary_as_it_is(root):
    run_with_summary(root)
    witness = run_with_summary(root, settings={"count": {"times": 3}}, last="count")
    assert summary_of(root).endswith("<11>")
    assert witness.said[-1] == (
        "Of an earlier run, in output: summary.txt "
        "(it tells of all stages; a run of all of them makes it anew)."
    )


def test_nothing_is_said_of_a_summary_that_tells_of_the_present_results_or_is_not_there(root):
    first = run_with_summary(root, last="count")
    run_with_summary(root)
    again = run_with_summary(root, last="count")
    assert not [sentence for sentence in (*first.said, *again.said) if "summary" in sentence]


def test_the_last_stage_alone_shows_what_is_there_though_sources_have_changed(root):
    run_with_summary(root)
    write_words(root, a="another")
    (root / "workspace/output/summary.txt").unlink()
    witness = Witness()
    (written,) = summarise(replace(request(root), summary=told), witness)
    assert witness.actions == {"report": "reuse"}
    assert written.read_text().endswith("<11>")


def test_results_that_do_not_belong_together_are_left_out(root):
    run_with_summary(root)
    store = Store(root / "workspace")
    assert list(consistent_results(FLOW, store)) == ["join", "count", "report"]
    run_with_summary(root, settings={"join": {"separator": "--"}}, last="join")
    assert list(consistent_results(FLOW, store)) == ["join"]  # the others were made from another text
    run_with_summary(root)
    assert list(consistent_results(FLOW, store)) == ["join", "count", "report"]


def test_a_result_of_a_version_that_gave_less_or_more_is_shown_as_far_as_it_goes(root):
    run_with_summary(root)
    store, more = Store(root / "workspace"), Artefact("more", "given since", file="more.txt")
    flow = (FLOW[0], replace(FLOW[1], version=2, gives=(*FLOW[1].gives, more)), FLOW[2])
    results = consistent_results(flow, store)
    assert list(results) == ["join", "count", "report"]
    assert outputs_of(flow, results).keys() == {"text", "numbers", "page"}
    fewer = (replace(FLOW[0], gives=()), *FLOW[1:])
    assert outputs_of(fewer, {"join": results["join"]}) == {}


def test_a_result_of_another_variant_of_its_stage_is_left_out(root):
    run_with_summary(root)
    store = Store(root / "workspace")
    takes_other_things = (FLOW[0], FLOW[1], replace(FLOW[2], takes=("text",)))
    assert list(consistent_results(takes_other_things, store)) == ["join", "count"]
    gives_what_the_record_has = (FLOW[0], replace(FLOW[1], gives=(*FLOW[1].gives, *FLOW[2].gives)))
    gives_less = (*gives_what_the_record_has, replace(FLOW[2], gives=()))
    assert list(consistent_results(gives_less, store)) == ["join", "count"]


def test_what_is_in_the_way_of_the_summary_is_named_and_results_stay(root):
    (root / "workspace/output/summary.txt").mkdir(parents=True)
    with pytest.raises(UserError, match="summary.txt cannot be written .*move away what is there"):
        run_with_summary(root)
    assert list(consistent_results(FLOW, Store(root / "workspace"))) == ["join", "count", "report"]


def test_a_link_in_place_of_the_summary_is_replaced_and_not_followed(root):
    victim = root / "victim.txt"
    victim.write_text("mine")
    (root / "workspace/output").mkdir(parents=True)
    (root / "workspace/output/summary.txt").symlink_to(victim)
    run_with_summary(root)
    assert victim.read_text() == "mine"
    assert not (root / "workspace/output/summary.txt").is_symlink()
