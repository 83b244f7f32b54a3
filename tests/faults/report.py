"""Write docs/reliability.md from the log of attacks: `python -m tests.faults.report LOG`.

The log has a line of JSON per `tried(…)` of the tests in this folder, which write it where UNSHADE_FAULT_LOG
says; `make reliability` does both.
"""

from __future__ import annotations

import json
import subprocess
import sys
from collections import defaultdict
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field
from datetime import datetime, timezone
from pathlib import Path

from tests.faults.program import ROOT

PAGE = ROOT / "docs/reliability.md"
COMMAND = "make reliability"
HEAD = """# Reliability

`tests/faults` attacks the command line: the program runs as a process, the attack is made, and what is
left is compared with an undisturbed run. `make test` has a short form of it, `make test-all` the long one, of
which this page is the report. **Lost** counts results that were finished before the attack and were not
there, or not the same, after it, and files outside the workspace that were touched.
"""


@dataclass
class Attack:
    """One kind of attack.

    Attributes
    ----------
    outcomes : dict of str to int
        How often each happened.
    lost : int
    """

    outcomes: dict[str, int] = field(default_factory=lambda: defaultdict(int))
    lost: int = 0

    @property
    def times(self) -> int:
        """How often it was tried."""
        return sum(self.outcomes.values())


def attacks_in(lines: Iterable[str]) -> dict[str, Attack]:
    """Sum up the lines of a log by attack, in the order of their names."""
    attacks: dict[str, Attack] = defaultdict(Attack)
    for line in lines:
        tried = json.loads(line)
        attack = attacks[tried["attack"]]
        attack.outcomes[tried["outcome"]] += tried["times"]
        attack.lost += tried["lost"]
    return dict(sorted(attacks.items(), key=lambda pair: pair[0].lower()))


def page(attacks: Mapping[str, Attack], origin: str) -> str:
    """Build the page: a row per attack, and the sums."""
    rows = ["| tried | times | what happened | lost |", "| --- | ---: | --- | ---: |"]
    rows += [
        f"| {cell(name)} | {one.times:,} | {told(one.outcomes)} | {one.lost:,} |"
        for name, one in attacks.items()
    ]
    times, lost = (sum(getattr(one, what) for one in attacks.values()) for what in ("times", "lost"))
    rows.append(f"| **all of it** | **{times:,}** | | **{lost:,}** |")
    return "\n".join([HEAD, origin, "", *rows]) + "\n"


def told(outcomes: Mapping[str, int]) -> str:
    """List outcomes, the most frequent first; how often each happened, where there are several."""
    if len(outcomes) == 1:
        return cell(next(iter(outcomes)))
    ordered = sorted(outcomes.items(), key=lambda pair: (-pair[1], pair[0]))
    return "; ".join(f"{cell(outcome)} ({times:,})" for outcome, times in ordered)


def cell(text: str) -> str:
    """Escape what would end a cell of a table."""
    return " ".join(text.split()).replace("|", r"\|")


def origin() -> str:
    """Name the date, the commit and the command of the report."""
    command = ["git", "-C", str(ROOT), "rev-parse", "--short", "HEAD"]
    commit = subprocess.run(command, check=True, capture_output=True, text=True).stdout.strip()
    return f"Generated on {datetime.now(timezone.utc):%Y-%m-%d} at commit {commit} by `{COMMAND}`."


def main(log: Path) -> int:
    """Write the page; the exit code says whether something was lost."""
    attacks = attacks_in(log.read_text(encoding="utf-8").splitlines())
    PAGE.write_text(page(attacks, origin()), encoding="utf-8")
    lost = sum(one.lost for one in attacks.values())
    tried = sum(one.times for one in attacks.values())
    sys.stdout.write(f"{PAGE.relative_to(ROOT)}: {tried} attacks of {len(attacks)} kinds, {lost} lost.\n")
    return bool(lost)


if __name__ == "__main__":
    sys.exit(main(Path(sys.argv[1])))
