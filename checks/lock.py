"""Write the lock files: the versions that are installed here, with the digests of all their files.

`make lock`, after the tests passed with other versions (`LOCKED=no sh setup.sh test` installs the newest that
pyproject.toml allows). `requirements.lock` has what the program needs, `requirements-test.lock` also what its
tests do. uv resolves; pip checks the digests when setup.sh installs from them.
"""

from __future__ import annotations

import platform
import re
import subprocess
import sys
import tempfile
from pathlib import Path

ROOT = Path(__file__).resolve().parent.parent
LOCK, TEST_LOCK = ROOT / "requirements.lock", ROOT / "requirements-test.lock"
HEAD = """# Versions that the tests passed with, and the digests of their files. Written by `make lock`.
# Made for: {machine}
"""
ENTRY = re.compile(
    r"^(?P<name>[\w.-]+)==(?P<version>\S+)(?: \\\n    --hash=sha256:[0-9a-f]{64})+", re.MULTILINE
)


def machine() -> str:
    """Name the Python and the platform, as setup.sh compares them."""
    version = ".".join(platform.python_version_tuple()[:2])
    return f"{platform.python_implementation()} {version} on {sys.platform} {platform.machine()}"


def installed() -> str:
    """List the installed distributions with their versions, as pip does."""
    command = [sys.executable, "-m", "pip", "freeze", "--all", "--exclude-editable"]
    return subprocess.run(command, check=True, capture_output=True, text=True, cwd=ROOT).stdout


def resolved(constraints: str, *extras: str) -> list[str]:
    """Resolve pyproject.toml to entries of a lock file, within the versions given."""
    with tempfile.TemporaryDirectory() as folder:
        limits = Path(folder, "constraints.txt")
        limits.write_text(constraints, encoding="utf-8")
        command = ["uv", "pip", "compile", "pyproject.toml", "--quiet", "--generate-hashes", "--no-header"]
        command += ["--no-annotate", "--python", sys.executable, "--constraint", str(limits)]
        command += [word for extra in extras for word in ("--extra", extra)]
        done = subprocess.run(
            [sys.executable, "-m", *command], check=True, capture_output=True, text=True, cwd=ROOT
        )
    return entries_of(done.stdout)


def entries_of(text: str) -> list[str]:
    """Split a lock file into its entries: a version and its digests each."""
    return [entry[0] for entry in ENTRY.finditer(text)]


def main() -> None:
    """Write both files."""
    head, versions = HEAD.format(machine=machine()), installed()
    own = resolved(versions)
    more = [entry for entry in resolved(versions, "test") if entry not in own]
    LOCK.write_text(head + "\n".join(own) + "\n", encoding="utf-8")
    TEST_LOCK.write_text(head + "\n".join([f"-r {LOCK.name}", *more]) + "\n", encoding="utf-8")


if __name__ == "__main__":
    main()
