"""Command lines in a process of their own, with bounded memory and time: what they print is what users see.

One process obeys many, since the libraries take seconds to import; what a library writes is caught as well.
"""

from __future__ import annotations

import json
import os
import resource
import signal
import subprocess
import sys
import time
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

from tests.faults.program import ROOT

ADDRESS_SPACE = 8 << 30  # bytes; the libraries alone map two of them
MOST_MB = 1000  # of any command here: the libraries and small inputs
AT_ONCE_S = 20
LONGEST = 120  # seconds for one command: a hang


@dataclass(frozen=True)
class Answer:
    """What one command line came to.

    Attributes
    ----------
    code : int
        Its exit code; negative: the signal that ended the process, 14 where it hung.
    said : str
        All that came out, of libraries too, in one line.
    seconds : float
    peak_mb : float
        Largest memory of its process, libraries included.
    """

    code: int
    said: str
    seconds: float
    peak_mb: float


def obey(rows: Sequence[Sequence[str | Path]], cwd: Path) -> list[Answer]:
    """Obey command lines one after the other; after one that ends the process, the next has a new one."""
    answers: list[Answer] = []
    while len(answers) < len(rows):
        words = [[str(word) for word in row] for row in rows[len(answers) :]]
        environment = {**os.environ, "PYTHONPATH": str(ROOT), "COLUMNS": "10000"}
        done = subprocess.run(
            [sys.executable, "-m", "tests.faults.command_lines"],
            input=json.dumps(words),
            cwd=cwd,
            env=environment,
            capture_output=True,
            text=True,
        )
        answers += [Answer(**json.loads(line)) for line in done.stdout.splitlines()]
        if done.returncode:
            answers.append(Answer(done.returncode, " ".join(done.stderr.split()), 0.0, 0.0))
    return answers


def answers_of(
    rows: Mapping[str, tuple[Sequence[str | Path], str]], folder: Path
) -> dict[str, tuple[Answer, str]]:
    """Obey command lines by name, and keep with each answer what it has to say."""
    answers = obey([words for words, _ in rows.values()], folder)
    return {name: (answer, says) for (name, (_, says)), answer in zip(rows.items(), answers, strict=True)}


def expect_refusal(answer: Answer, says: str = "", most_mb: float = MOST_MB) -> None:
    """Assert that a command was refused as promised, and by what it says."""
    assert is_refusal(answer), answer
    assert says in answer.said, answer
    assert answer.peak_mb < most_mb, answer
    assert answer.seconds < AT_ONCE_S, answer


def is_refusal(answer: Answer) -> bool:
    """Test whether a command was refused as promised: exit code 2, sentences and nothing else."""
    said = answer.said
    return (
        answer.code == 2
        and "unshade: " in said
        and "Traceback" not in said
        and "Warning" not in said
        and len(said) < 12_000
    )


def _obey_in_this_process(words: list[str], answers: int) -> None:
    """Run one command with its output in a file, and write the answer."""
    from stages.cli import main

    caught = os.memfd_create("said")
    kept = os.dup(1), os.dup(2)
    os.dup2(caught, 1)
    os.dup2(caught, 2)
    Path("/proc/self/clear_refs").write_text("5")  # begins to measure the peak anew
    begun = time.monotonic()
    signal.alarm(LONGEST)
    try:
        code = main(words)
    except SystemExit as ended:
        code = ended.code if isinstance(ended.code, int) else 1
    signal.alarm(0)
    sys.stdout.flush()
    sys.stderr.flush()
    os.dup2(kept[0], 1)
    os.dup2(kept[1], 2)
    said = os.pread(caught, 1 << 20, 0).decode("utf-8", "replace")
    for one in (caught, *kept):
        os.close(one)
    answer = {
        "code": code,
        "said": " ".join(said.split()),
        "seconds": round(time.monotonic() - begun, 3),
        "peak_mb": round(max(_own_peak_kb(), resource.getrusage(resource.RUSAGE_CHILDREN).ru_maxrss) / 1e3),
    }
    os.write(answers, (json.dumps(answer) + "\n").encode())


def _own_peak_kb() -> int:
    status = Path("/proc/self/status").read_text().splitlines()
    return int(next(line for line in status if line.startswith("VmHWM")).split()[1])


if __name__ == "__main__":
    resource.setrlimit(resource.RLIMIT_AS, (ADDRESS_SPACE, ADDRESS_SPACE))
    for row in json.load(sys.stdin):
        _obey_in_this_process(row, 1)
