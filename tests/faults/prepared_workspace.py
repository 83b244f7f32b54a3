"""A finished workspace of four small linear views, made by the command line, and what it holds."""

from __future__ import annotations

import json
import os
import shutil
import subprocess
from collections.abc import Sequence
from pathlib import Path

from pipeline.cache.digest import digest_file
from stages.command.report import FILES
from tests.faults.program import LINEAR, PROGRAM, ROOT

SETTINGS = ("undistort.max_size_px=64", "raycast.reduce=1", "decomposition.mode=paper",
            "decomposition.paper.max_alternations=1", "export.sheet_width_px=32")  # fmt: skip
STAGES = ("adopt_model", "undistort", "adopt_mesh", "raycast", "correspondence", "decomposition", "export",
          "report")  # fmt: skip


def words(workspace: Path | str, verb: str = "run", *more: str) -> list[str]:
    """Build the command line of a verb on these views."""
    given = ["--colmap", str(LINEAR), "--images", str(LINEAR / "images"), "--workspace", str(workspace)]
    given += ["--mesh", str(ROOT / "sample_data/truth/mesh.ply")]
    for one in SETTINGS:
        given += ["--set", one]
    return [verb, *given, *more]


def unshade(command: Sequence[str], **more) -> subprocess.CompletedProcess[str]:
    """Run the command as a process; what it says is without line breaks."""
    environment = {**os.environ, "PYTHONPATH": str(ROOT), **more.pop("env", {})}
    done = subprocess.run(
        [*PROGRAM, *command], capture_output=True, text=True, check=False, cwd=more.pop("cwd", ROOT),
        env=environment, timeout=120, **more,
    )  # fmt: skip
    done.stderr = " ".join(done.stderr.split())
    return done


def prepare(folder: Path) -> Path:
    """Run the program once."""
    workspace = folder / "workspace"
    done = unshade(words(workspace))
    assert done.returncode == 0, done.stderr
    return workspace


def copy_of(workspace: Path, folder: Path) -> Path:
    """Copy a finished workspace, for a test that harms it."""
    return Path(shutil.copytree(workspace, folder / "workspace", symlinks=True))


def outputs(workspace: Path) -> dict[str, dict[str, dict[str, str]]]:
    """Read the outputs of every current result from its record, and check that the files are those."""
    current = json.loads((workspace / "cache/current.json").read_text())
    found = {}
    for stage in STAGES:
        entry = workspace / "cache" / stage / current[stage]
        found[stage] = json.loads((entry / "record.json").read_text())["outputs"]
        on_disk = sorted(digest_file(path) for path in artefacts(entry))
        assert on_disk == sorted(digest for files in found[stage].values() for digest in files.values())
    return found


def artefacts(entry: Path) -> list[Path]:
    """List the files of a result's artefacts."""
    own = {"record.json", "log.txt"}
    return sorted(path for path in entry.rglob("*") if path.is_file() and path.name not in own)


def shown(workspace: Path) -> dict[str, str]:
    """Compute the digests of all files in the output, but for the report, in which times are."""
    output = workspace / "output"
    return {
        str(path.relative_to(output)): digest_file(path)
        for path in output.rglob("*")
        if path.is_file() and path.name not in FILES
    }


def entry_of(workspace: Path, stage: str) -> Path:
    """Find the folder of a stage's only result."""
    (entry,) = (path for path in (workspace / "cache" / stage).iterdir() if not path.name.startswith("."))
    return entry


def no_traceback(done: subprocess.CompletedProcess[str], codes: Sequence[int] = (0, 2)) -> bool:
    """Whether a command ended with a result or a sentence."""
    return done.returncode in codes and "Traceback" not in done.stderr
