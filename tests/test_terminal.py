"""What people read in tables: numbers with the digits that tell them apart."""

from __future__ import annotations

import re
from dataclasses import replace

import pytest
from rich.console import Console

from pipeline.command.terminal import Terminal, number, table_of
from pipeline.command.verbs import run_verb, show_verb
from tests import toy_flow
from tests.toy_flow import COUNT, JOIN, REPORT, request, write_words


@pytest.mark.parametrize(
    ("value", "shown"),
    [
        (0.004, "0.004"),
        (0.0195, "0.0195"),
        (0.1, "0.1"),
        (1 / 3, "0.3333"),
        (12.3456, "12.35"),
        (-12.3456, "-12.35"),
        (4.0, "4"),
        (0.0, "0"),
        (1234.5678, "1235"),
        (123456.7, "123457"),
        (1e-12, "1e-12"),
        (2.5e12, "2.5e+12"),
        (float("nan"), "nan"),
        (float("inf"), "inf"),
    ],
)
def test_four_digits_count(value, shown):
    assert number(value) == shown


def test_a_run_ends_with_where_its_results_are_and_how_long_it_took(tmp_path, capsys):
    write_words(tmp_path, a="apple")
    for last, place in (("join", "cache"), ("count", "output")):
        run_verb(request(tmp_path, last=last), Terminal())
        said = " ".join(capsys.readouterr().out.split())
        assert re.search(rf"Up to date after \d+\.\d s: {tmp_path}/workspace/{place}$", said)


def test_a_reused_result_says_how_many_warnings_it_holds_and_they_can_be_read(tmp_path, capsys):
    def doubtful(job):
        toy_flow.join(job)
        job.warn("A word is long.")

    write_words(tmp_path, a="apple")
    wishes = request(tmp_path, flow=(replace(JOIN, run=doubtful), COUNT, REPORT))
    run_verb(wishes, Terminal())
    assert "A word is long." in capsys.readouterr().err
    run_verb(wishes, Terminal())
    reused, warned = capsys.readouterr().err.splitlines()
    assert reused.split(maxsplit=1) == ["reuse", "join, count, report"]
    assert warned.endswith("join has 1 warning(s), see `unshade show … --stage join`")
    show_verb(wishes.workspace, "join", None, Terminal())
    assert "A word is long." in capsys.readouterr().out


def test_cells_hold_numbers_lists_words_and_nothing(capsys):
    rows = [
        {"what": "spacing", "value": 0.004},
        {"what": "elevations", "value": [5.0, 17.25]},
        {"what": "parts", "value": ("hair", "face")},
        {"what": "views", "value": 13},
        {"what": "y_up", "value": False},
        {"what": "part", "value": None},
        {"what": "empty", "value": []},
        {"what": "markup", "value": "[bold]"},
    ]
    Console(width=60).print(table_of(rows, {"setting": "what", "is": "value"}))
    lines = [line.split(maxsplit=1) for line in capsys.readouterr().out.splitlines()]
    assert {name: value.strip() for name, value in lines} == {
        "setting": "is",
        "spacing": "0.004",
        "elevations": "5, 17.25",
        "parts": "hair, face",
        "views": "13",
        "y_up": "False",
        "part": "–",
        "empty": "–",
        "markup": "[bold]",
    }
