"""YAML of configurations and of `--set`: plain values only, and no more of them than a person would write."""

from __future__ import annotations

import re
from pathlib import Path
from typing import Any

import yaml
from yaml.error import MarkedYAMLError

from pipeline.errors import UserError
from pipeline.files.file_kinds import expect_file

LONGEST_FILE = 1 << 18  # bytes; all settings with their defaults are some 20 kB
MOST_VALUES = 20_000  # written out: an anchor that is used a hundred times counts a hundred times
DEEPEST = 32  # levels; ours has three
MOST_BITS = 64  # of a whole number
TIMESTAMP = "tag:yaml.org,2002:timestamp"
NO_VALUE = (
    ValueError,
    KeyError,
    AttributeError,
    TypeError,
    OverflowError,
)  # `!!int x`, `!!bool x`, `!!float`


class _Loader(yaml.SafeLoader):
    """Safe YAML in which 1e-6 is a number, none is null, a date is text, and duplicate names are refused.

    PyYAML accepts only 1.0e-6 and null, reads the others as text, and drops the first of two equal names.
    """

    def __init__(self, text: str) -> None:
        super().__init__(text)
        self._levels = 0

    def compose_node(self, parent: yaml.Node | None, index: int) -> yaml.Node | None:
        """Compose a value as PyYAML does; refuse one that is nested too deeply before reading on."""
        self._levels += 1
        if self._levels > DEEPEST:
            raise MarkedYAMLError(problem=f"more than {DEEPEST} levels, one in another")
        node = super().compose_node(parent, index)
        self._levels -= 1
        return node

    def compose_mapping_node(self, anchor: object) -> yaml.MappingNode:
        """Compose a mapping as PyYAML does; refuse duplicate names."""
        node = super().compose_mapping_node(anchor)  # type: ignore[arg-type]  # types-PyYAML has it a dict
        seen: set[str] = set()
        for name, _ in node.value:
            if not isinstance(name, yaml.ScalarNode):
                raise MarkedYAMLError(
                    problem="a list or a mapping for a name; expected a word", problem_mark=name.start_mark
                )
            if name.value in seen:
                raise MarkedYAMLError(
                    problem=f"a second {name.value!r}, but each was expected once (join them or remove one)",
                    problem_mark=name.start_mark,
                )
            seen.add(name.value)
        return node

    def construct_object(self, node: yaml.Node, deep: bool = False) -> Any:
        """Construct a value as PyYAML does; refuse one that its tag cannot mean."""
        try:
            value = super().construct_object(node, deep)
            if isinstance(value, int) and value.bit_length() > MOST_BITS:
                raise OverflowError(f"a number of {value.bit_length()} bits")
            if isinstance(value, str):
                value.encode("utf-8")  # "\ud800" is half a character
        except NO_VALUE as error:
            raise MarkedYAMLError(
                problem=f"{str(node.value)[:40]!r} is no {node.tag.rpartition(':')[2]} that can be read",
                problem_mark=node.start_mark,
            ) from error
        return value


_Loader.yaml_implicit_resolvers = {
    first: [(tag, form) for tag, form in resolvers if tag != TIMESTAMP]  # dates have no use here
    for first, resolvers in yaml.SafeLoader.yaml_implicit_resolvers.items()
}
_Loader.add_implicit_resolver("tag:yaml.org,2002:null", re.compile("[nN]one$"), ["n", "N"])
_Loader.add_implicit_resolver(
    "tag:yaml.org,2002:float", re.compile(r"[-+]?(\d+\.?\d*|\.\d+)[eE][-+]?\d+$"), list("-+.0123456789")
)


def read_yaml_text(path: Path) -> str:
    """Read the text of a configuration.

    Raises
    ------
    UserError
        It is no file, is longer than anyone would write, or no text.
    """
    try:
        expect_file(path)
        with path.open("rb") as file:
            data = file.read(LONGEST_FILE + 1)
        if len(data) > LONGEST_FILE:
            raise UserError(
                f"The configuration {path} has more than {LONGEST_FILE} bytes; expected sections with "
                "settings. Check its path."
            )
        return data.decode("utf-8")
    except OSError as error:
        raise UserError(
            f"The configuration {path} cannot be read ({error.strerror}); check its path."
        ) from error
    except UnicodeDecodeError as error:
        raise UserError(f"The configuration {path} is not YAML: {error}") from error


def parse_yaml(text: str) -> Any:
    """Parse one document into numbers, texts, lists and mappings.

    Raises
    ------
    yaml.YAMLError
        It is not YAML, holds other things than those, is nested deeper than `DEEPEST`, holds itself, or has
        more than `MOST_VALUES` values.
    """
    loader = _Loader(text)
    try:
        node = loader.get_single_node()
        if node is None:
            return None
        _count_values(node, (), {})
        return loader.construct_document(node)
    finally:
        loader.dispose()


def _count_values(node: yaml.Node, within: tuple[int, ...], known: dict[int, int]) -> int:
    """Count the values of a node as if every alias were written out; `within` are the nodes around it."""
    if id(node) in known:
        return known[id(node)]
    if id(node) in within:
        raise MarkedYAMLError(problem="a value that holds itself", problem_mark=node.start_mark)
    count = 1
    if isinstance(node, yaml.CollectionNode):
        for one in node.value:
            for part in one if isinstance(one, tuple) else (one,):
                count += _count_values(part, (*within, id(node)), known)
    if count > MOST_VALUES:
        raise MarkedYAMLError(
            problem=f"more than {MOST_VALUES} values, anchors written out", problem_mark=node.start_mark
        )
    known[id(node)] = count
    return count
