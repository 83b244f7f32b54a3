"""Configurations and command lines that nobody would write by hand: a sentence, at once."""

from __future__ import annotations

import os
import stat
from pathlib import Path

import pytest

from tests.faults.command_lines import Answer, answers_of, expect_refusal, obey
from tests.faults.program import PHOTOS, ROOT

SOURCES = f"sources: {{images: {PHOTOS}}}\n"
LETTERS = "abcdefghijkl"
NOT_YAML, LEVELS = "is not YAML", "more than 32 levels"


def bomb(link: str) -> str:
    """Nine references to the one before, twelve times: 9¹² values."""
    return "".join(
        f"{name}: &{name} {link.format(','.join([f'*{before}'] * 9))}\n"
        for before, name in zip(LETTERS, LETTERS[1:], strict=False)
    )


TEXTS = {  # the text, and what the refusal says
    "int tag": ("mesh: {depth: !!int x}", "'x' is no int"),
    "bool tag": ("mesh: {depth: !!bool x}", "'x' is no bool"),
    "float tag": ("mesh: {depth: !!float x}", "'x' is no float"),
    "timestamp tag": ("mesh: {depth: !!timestamp x}", "'x' is no timestamp"),
    "date": ("mesh: {depth: 2001-01-01}", "mesh.depth is '2001-01-01'"),
    "date that is none": ("mesh: {depth: 2001-99-99}", "mesh.depth is '2001-99-99'"),
    "python object": ('mesh: !!python/object/apply:os.system ["touch pwned"]', NOT_YAML),
    "python name": ("mesh: {depth: !!python/name:os.system }", NOT_YAML),
    "binary": ("mesh: {depth: !!binary aGVsbG8=}", "expected numbers, words"),
    "set": ("mesh: {depth: !!set {a, b}}", "expected numbers, words"),
    "set as a section": ("mesh: !!set {a, b}", "expected `name: value` lines"),
    "self-reference": ("mesh: &a {depth: *a}", "holds itself"),
    "self-reference in a list": ("mesh: {depth: &a [*a]}", "holds itself"),
    "merge of itself": ("mesh: &a {<<: *a}", "holds itself"),
    "open brackets": ("mesh: " + "[" * 3000, LEVELS),
    "brackets": ("mesh: " + "[" * 3000 + "]" * 3000, LEVELS),
    "40 brackets": ("mesh: " + "[" * 40 + "]" * 40, LEVELS),
    "braces": ("{a: " * 3000, LEVELS),
    "dashes": ("mesh:\n " + "- " * 3000, LEVELS),
    "anchors": (f"a: &a [{','.join('x' * 9)}]\n" + bomb("[{}]"), "more than 20000 values"),
    "merged anchors": ("a: &a {x: 1}\n" + bomb("{{<<: [{}]}}"), "more than 20000 values"),
    "1e6 keys": ("\n".join(f"k{i}: 1" for i in range(10**6)), "more than 262144 bytes"),
    "3000 keys": ("mesh:\n" + "\n".join(f" k{i}: 1" for i in range(3000)), "And 2995 more."),
    "long list": (f"mesh: {{depth: [{','.join('1' * 3000)}]}}", "mesh.depth is [1, 1"),
    "number of 10000 digits": (f"mesh: {{depth: {'9' * 10000}}}", "is no int"),
    "number of 50000 hex digits": (f"mesh: {{depth: 0x{'f' * 50000}}}", "is no int"),
    "long word": (f"mesh: {{depth: {'x' * 200000}}}", "expected a valid integer"),
    "path of 5000 characters": (f"sources: {{images: {'a' * 5000}}}", "File name too long"),
    "NUL in a path": ('sources: {images: "a\\0b"}', "expected a path or a name"),
    "NUL in the workspace": (SOURCES + 'workspace: "a\\0b"', "expected a path or a name"),
    "half a character": ('sources: {images: "a\\ud800b"}', "is no str"),
    "home of nobody": ("sources: {images: ~nobody-of-that-name/a}", "begins with a home"),
    "list as a name": ("? [a, b]\n: 1", "a list or a mapping for a name"),
    "bytes as a name": ("mesh: {? !!binary aGVsbG8= : 1}", "expected numbers, words"),
    "two documents": ("mesh: {}\n---\nmesh: {}", NOT_YAML),
    "escape sequence": ('"\\e[2J": 1', "'\\x1b[2J'"),
    "NUL": ("a: \0", NOT_YAML),
    "data set elsewhere": ("sources: {dataset: ../../etc}", "There is no data set"),
    "images is a device": ("sources: {images: /dev/zero}", "is a device; expected a folder"),
}
ASSIGNMENTS = {
    "x" * 5000: "was not understood",
    "a." * 5000 + "b=1": "was not understood",
    "mesh.depth=" + "[" * 3000: LEVELS,
    "mesh.depth=!!int x": "'x' is no int",
    "mesh.depth=&a [*a]": "holds itself",
    "mesh.depth=" + "9" * 10000: "is no int",
    "mesh.depth=\udcff": NOT_YAML[3:],
    "mesh.__class__=1": "There is no setting",
    "mesh.depth.x.y.z=1": "expected a valid integer",
}
KINDS = {
    "named pipe": os.mkfifo,
    "device": lambda place: place.symlink_to("/dev/zero"),
    "socket": lambda place: os.mknod(place, stat.S_IFSOCK | 0o600),
    "loop": lambda place: place.symlink_to(place.name),
    "link to nothing": lambda place: place.symlink_to("nothing"),
}
PLACES = {"/dev/zero": "is a device", "/dev/null": "is a device", "/nowhere": "does not exist"}
WORDS = {
    "a folder for a command": ([PHOTOS], "`unshade run --images"),
    "a configuration for a command": (["mine.yaml"], "`unshade run mine.yaml`"),
    "a folder as configuration": (["run", PHOTOS], f"`--images {PHOTOS}`"),
    "a photo as configuration": (["run", PHOTOS / "000.jpg"], NOT_YAML),
    "a JPEG as light": (
        ["relight", "--images", PHOTOS, "--light", PHOTOS / "000.jpg"],
        "is no picture of light",
    ),
    "a photo as light": (
        ["relight", "--images", PHOTOS, "--light", ROOT / "sample_data/linear/images/001.exr"],
        "twice as wide as high",
    ),
    "a damaged light": (["relight", "--images", PHOTOS, "--light", "damaged.hdr"], "cannot be read"),
    "a long configuration": (["run", "/" + "a" * 5000], "File name too long"),
    "a long workspace": (["run", "--images", PHOTOS, "--workspace", "/" + "a" * 5000], "File name too long"),
    "a long workspace to look at": (["status", "--workspace", "/" + "a" * 5000], "holds no results yet"),
}


def rows_in(folder: Path) -> dict[str, tuple[list[str | Path], str]]:
    """Command lines and what their refusals say, by name."""
    rows: dict[str, tuple[list[str | Path], str]] = {}
    for number, (name, (text, says)) in enumerate(TEXTS.items()):
        (folder / f"{number}.yaml").write_text(text)
        rows[f"text: {name}"] = ["plan", f"{number}.yaml"], says
    for number, data in enumerate([b"\xff\xfe", b"mesh: {depth: '\xe9'}", bytes(range(256)) * 20]):
        (folder / f"bytes{number}.yaml").write_bytes(data)
        rows[f"bytes {number}"] = ["plan", f"bytes{number}.yaml"], NOT_YAML
    for assignment, says in ASSIGNMENTS.items():
        rows[f"set {assignment[:20]!r}"] = ["plan", "--images", PHOTOS, "--set", assignment], says
    for name, make in KINDS.items():
        make(folder / f"{name}.yaml")
        rows[f"configuration: {name}"] = ["run", f"{name}.yaml"], "check its path" * (name[0] == "l")
    for place, says in PLACES.items():
        for flag in ("images", "masks", "colmap", "mesh", "light", "known-light"):
            verb = "relight" if flag == "light" else "plan"
            rows[f"{flag} {place}"] = [verb, "--images", PHOTOS, f"--{flag}", place], says
    (folder / "damaged.hdr").write_bytes(b"#?RADIANCE\nFORMAT=32-bit_rle_rgbe\n\n-Y 10 +X 20\n")
    return rows | WORDS


NAMES = [f"text: {name}" for name in TEXTS] + [f"bytes {number}" for number in range(3)]
NAMES += [f"set {assignment[:20]!r}" for assignment in ASSIGNMENTS]
NAMES += [f"configuration: {name}" for name in KINDS] + list(WORDS)
NAMES += [
    f"{flag} {p}" for p in PLACES for flag in ("images", "masks", "colmap", "mesh", "light", "known-light")
]


@pytest.fixture(scope="module")
def refusals(tmp_path_factory, tried) -> dict[str, tuple[Answer, str]]:
    """What every command line came to, and what it has to say."""
    folder = tmp_path_factory.mktemp("configurations")
    rows = rows_in(folder)
    answers = answers_of(rows, folder)
    tried("hostile configurations and arguments", "refused in a sentence", len(rows))
    assert not (folder / "pwned").exists()
    return answers


@pytest.mark.parametrize("name", NAMES)
def test_it_is_refused_in_a_sentence_at_once(refusals, name):
    answer, says = refusals[name]
    expect_refusal(answer, says, most_mb=500)


def test_an_anchor_that_is_used_twice_is_no_bomb(tmp_path):
    (tmp_path / "a.yaml").write_text(SOURCES + "mesh: &m {depth: 9}\n")
    (answer,) = obey([["plan", "a.yaml"]], tmp_path)
    assert answer.code == 0, answer
