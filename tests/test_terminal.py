"""What people read in tables: numbers with the digits that tell them apart."""

from __future__ import annotations

import pytest
from rich.console import Console

from pipeline.terminal import number, table_of


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
