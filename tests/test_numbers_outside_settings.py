"""Every number in the cores is a setting, or is listed with a reason."""

from __future__ import annotations

import ast

import pytest

from checks.numbers_outside_settings import MOST_CHOICES, complaints, main, numbers_of

CORE = """
FAR = 0.3  # a constant
PARTNERS = 2
NAME, TRUE = "name", True

class PairSettings(Settings):
    cell: float = setting(0.12, "Width.", gt=0.01)

    @property
    def wide(self):
        return 7 * self.cell

@dataclass
class Pairs:
    count: int = 25

def near(x, most=40):
    return x[0] / max(2 * x.mean(), 1e-12) < 0.7
"""


def test_constants_literals_and_defaults_are_found_settings_are_not():
    assert [name for name, _ in numbers_of(ast.parse(CORE))] == ["FAR", "PARTNERS", "25", "40", "0.7"]


@pytest.mark.parametrize(
    ("choices", "sentence"),
    [
        ({}, "stages/a.py:3: FAR is a number outside settings"),
        ({"a.py": {"FAR": "why", "NEAR": "why"}}, "a.py has no number NEAR any more"),
        ({"a.py": {"FAR": "why"}, "b.py": {"*": "why"}}, "b.py has no number * any more"),
        ({"a.py": {f"N{k}": "why" for k in range(MOST_CHOICES + 1)}}, "61 numbers outside settings shape"),
    ],
)
def test_what_is_not_listed_or_gone_or_too_much_is_said(choices, sentence):
    said = complaints({"a.py": {"FAR": 3}}, {"choices": choices, "no choices": {}})
    assert any(sentence in one for one in said)


def test_a_list_that_fits_has_no_complaints():
    found = {"a.py": {"FAR": 3, "7": 9}, "b.py": {"WIDTH": 1, "8": 2}}
    listed = {"choices": {"a.py": {"FAR": "why", "7": "why"}}, "no choices": {"b.py": {"*": "widths"}}}
    assert complaints(found, listed) == []


def test_the_numbers_of_this_tree_are_settings_or_listed(capsys):
    assert main() == 0, capsys.readouterr().err
