"""Check the numbers in the code of `stages/` outside settings: each is listed with a reason.

`python checks/numbers_outside_settings.py` fails where a number is missing from
`numbers_outside_settings.yaml`, where a listed number no longer occurs, and where more than `MOST_CHOICES` of
those listed influence results. Trivial numbers (`SAY_NOTHING`) and guards against division by zero (up to
`GUARD`) are not counted, unless they are the value of a constant; nor are defaults and bounds of settings,
and versions of stages.
"""

from __future__ import annotations

import ast
import sys
from collections import defaultdict
from collections.abc import Iterator
from pathlib import Path

import yaml

ROOT = Path(__file__).resolve().parent.parent
LIST = Path(__file__).with_suffix(".yaml")
BEYOND = (
    "command",
    "diagnosis",
    "evaluation",
    "synthetic",
)  # folders that print, tell of the machine, evaluate and render: they do not influence results
SAY_NOTHING = frozenset({0, 1, 2, 3, 4, 0.5})  # identities, halves, axes, channels, neighbours
SAYS_ITS_NAME = frozenset[float]()  # a constant is counted whatever its value
DECLARE = ("setting", "Stage", "replace")  # calls that state defaults and bounds, or a stage's version
GUARD = 1e-6
MOST_CHOICES = 60
CHOICES, NO_CHOICES = "choices", "no choices"  # sections of the list


def numbers_of(tree: ast.Module) -> Iterator[tuple[str, int]]:
    """Find the numbers of a file: the name of the constant, or the literal, and its line."""
    for statement in tree.body:
        if isinstance(statement, ast.Assign | ast.AnnAssign) and statement.value is not None:
            targets = statement.targets if isinstance(statement, ast.Assign) else [statement.target]
            if any(counted(statement.value, SAYS_ITS_NAME)):
                yield ", ".join(ast.unparse(target) for target in targets).strip("()"), statement.lineno
        elif not is_settings(statement):
            yield from ((str(number.value), number.lineno) for number in counted(statement))


def counted(node: ast.AST, but: frozenset[float] = SAY_NOTHING) -> Iterator[ast.Constant]:
    """Find the numbers in a piece of code, except `but` and the defaults and bounds of settings."""
    if isinstance(node, ast.Call) and ast.unparse(node.func) in DECLARE or is_settings(node):
        return
    number = isinstance(node, ast.Constant) and type(node.value) in (int, float)
    if number and node.value not in but and (but is SAYS_ITS_NAME or abs(node.value) > GUARD):
        yield node
    for child in ast.iter_child_nodes(node):
        yield from counted(child, but)


def is_settings(node: ast.AST) -> bool:
    """Check for the declaration of settings, whose methods state defaults that depend on others."""
    return isinstance(node, ast.ClassDef) and any("Settings" in ast.unparse(base) for base in node.bases)


def found_in(folder: Path) -> dict[str, dict[str, int]]:
    """Find the numbers of all files: by file below `folder`, then by name or literal, the first line."""
    found: dict[str, dict[str, int]] = defaultdict(dict)
    for path in sorted(folder.rglob("*.py")):
        place = path.relative_to(folder)
        if place.parts[0] not in BEYOND and not place.stem.endswith("settings"):
            for name, line in numbers_of(ast.parse(path.read_text(encoding="utf-8"))):
                found[place.as_posix()].setdefault(name, line)
    return dict(found)


def complaints(found: dict[str, dict[str, int]], listed: dict[str, dict[str, dict[str, str]]]) -> list[str]:
    """Describe numbers found but not listed, listed but not found, or too many; `*` is all of a file."""
    said, allowed = [], defaultdict(dict)
    for section in listed.values():
        for file, reasons in section.items():
            allowed[file].update(reasons)
    for file, names in found.items():
        for name, line in names.items():
            if name not in allowed[file] and "*" not in allowed[file]:
                said.append(
                    f"stages/{file}:{line}: {name} is a number outside settings; expected a setting with a "
                    f"reason. Make it one, or list it in {LIST.name} and say why it is none."
                )
    for file, reasons in allowed.items():
        for name in reasons.keys() - found.get(file, {}).keys() - ({"*"} if file in found else set()):
            said.append(f"{LIST.name}: {file} has no number {name} any more; take it from the list.")
    choices = sum(len(reasons) for reasons in listed[CHOICES].values())
    if choices > MOST_CHOICES:
        said.append(f"{choices} numbers outside settings shape an answer; expected {MOST_CHOICES} at most.")
    return said


def main() -> int:
    """Compare the numbers with the list, print complaints and counts; returns the exit code."""
    listed = yaml.safe_load(LIST.read_text(encoding="utf-8"))
    found = found_in(ROOT / "stages")
    said = complaints(found, listed)
    for sentence in said:
        sys.stderr.write(sentence + "\n")
    counts = {name: sum(len(reasons) for reasons in section.values()) for name, section in listed.items()}
    sys.stdout.write(
        f"Numbers outside settings: {counts[CHOICES]} shape an answer (at most {MOST_CHOICES}), "
        f"{counts[NO_CHOICES]} are listed that do not (formats, widths, units).\n"
    )
    return bool(said)


if __name__ == "__main__":
    sys.exit(main())
