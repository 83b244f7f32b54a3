"""An index of the paper: every equation is stated in exactly one docstring, and named in a test."""

from __future__ import annotations

import ast
import re
from pathlib import Path

import pytest

ROOT = Path(__file__).parent.parent
STATED = re.compile(r"Eq\. (\d+): ``")  # the docstring that states the formula; others only refer to it
NAMED = re.compile(r"Eq\. (\d+)")


def docstrings(path: Path) -> list[str]:
    kinds = ast.Module | ast.ClassDef | ast.FunctionDef
    nodes = [
        node for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))) if isinstance(node, kinds)
    ]
    return [text for node in nodes if (text := ast.get_docstring(node))]


STATEMENTS = [
    (int(number), path.relative_to(ROOT).as_posix())
    for path in sorted((ROOT / "stages").rglob("*.py"))
    for text in docstrings(path)
    for number in STATED.findall(text)
]
NAMED_IN_TESTS = {
    int(number)
    for path in sorted((ROOT / "tests").glob("test_*.py"))
    if path != Path(__file__)
    for text in docstrings(path)
    for number in NAMED.findall(text)
}


@pytest.mark.parametrize("equation", range(1, 19))
def test_every_equation_is_stated_once_and_held_by_a_test(equation):
    assert len([path for number, path in STATEMENTS if number == equation]) == 1, STATEMENTS
    assert equation in NAMED_IN_TESTS
