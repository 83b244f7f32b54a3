"""Audit the installed dependencies for known vulnerabilities: fails for one that is not in `ACCEPTED`.

pip-audit asks the database OSV. Where that cannot be reached nothing is known, which a sentence says: no
network is no failure.
"""

from __future__ import annotations

import json
import os
import subprocess
import sys
from collections.abc import Mapping
from typing import Any

DATABASE_VARIABLE = "UNSHADE_OSV"  # another address of the database, such as a mirror's
ACCEPTED: Mapping[str, str] = {}  # identifier of a vulnerability → why it does no harm here
TIMEOUT_S = 300


def audit() -> subprocess.CompletedProcess[str]:
    """Run pip-audit on this environment; its answer is JSON if it could ask."""
    command = [sys.executable, "-m", "pip_audit", "--local", "--skip-editable", "--format", "json"]
    command += ["--progress-spinner", "off", "--vulnerability-service", "osv", "--timeout", "10"]
    if address := os.environ.get(DATABASE_VARIABLE):
        command += ["--osv-url", address]
    return subprocess.run(command, capture_output=True, text=True, timeout=TIMEOUT_S)


def complaints(answer: Mapping[str, Any], accepted: Mapping[str, str] = ACCEPTED) -> list[str]:
    """List vulnerabilities that are not accepted, a sentence each."""
    said = []
    for package in answer["dependencies"]:
        for fault in package.get("vulns", ()):
            if accepted.keys().isdisjoint((fault["id"], *fault["aliases"])):
                cure = " or ".join(fault["fix_versions"])
                said.append(
                    f"{package['name']} {package['version']} has the vulnerability {fault['id']}; "
                    + (f"expected {cure}. Raise it, and run `make lock`." if cure else "no version mends it.")
                    + " Where it does no harm here, list it in checks/audit.py and say why."
                )
    return said


def main() -> int:
    """Audit and print; returns the exit code."""
    try:
        done = audit()
        answer = json.loads(done.stdout)
    except (subprocess.TimeoutExpired, ValueError):
        sys.stdout.write(
            "Dependencies were not audited: the database of vulnerabilities cannot be reached.\n"
        )
        return 0
    said = complaints(answer)
    for sentence in said:
        sys.stderr.write(sentence + "\n")
    if not said:
        sys.stdout.write(
            f"Dependencies audited: {len(answer['dependencies'])}, none known to be vulnerable.\n"
        )
    return bool(said)


if __name__ == "__main__":
    sys.exit(main())
