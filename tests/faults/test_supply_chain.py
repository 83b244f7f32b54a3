"""Nothing is unpickled or evaluated; dependencies are locked, listed and audited."""

from __future__ import annotations

import ast
import importlib.util
import json
import os
import re
import subprocess
import sys
import threading
from collections.abc import Iterator
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from importlib.metadata import version
from pathlib import Path

import numpy as np
import pytest
from packaging.requirements import Requirement
from packaging.utils import canonicalize_name

from tests.faults.program import PROGRAM, ROOT
from tests.faults.small_runs import do, one_line

FOLDERS = ("pipeline", "stages", "checks", "docs", "benchmarks", "tests")
UNPICKLERS = {
    "pickle",
    "cPickle",
    "_pickle",
    "cloudpickle",
    "dill",
    "distributed",
    "joblib",
    "jsonpickle",
    "marshal",
    "shelve",
}
EVALUATES = {"eval", "exec", "compile", "__import__"}
SHELLS = {"os.system", "os.popen", "subprocess.getoutput", "subprocess.getstatusoutput"}
RACES = {"tempfile.mktemp", "os.tmpnam", "os.tempnam"}
# Numba unpickles its own cache of compiled loops. It is in stages/__pycache__ or in the user's cache, as
# trusted as the .pyc files beside it, and never in a workspace.
EXCEPTIONS = {
    "pipeline/cluster/on_demand.py": (2, "joins workers that the user names, or starts some with keys"),
    "pipeline/cluster/dask_tasks.py": (3, "sends tasks to these, and names their errors and types"),
    "pipeline/cluster/worker_checks.py": (1, "names a type"),
    "pipeline/process/own_process.py": (2, "sends its own arrays to a process that it starts itself"),
    "pipeline/process/forked.py": (3, "hears what a fork of this process tells, by a pipe without a name"),
    "benchmarks/mit_berkeley/__main__.py": (2, "sends its own values to processes that it starts itself"),
    "tests/faults/test_supply_chain.py": (1, "springs the trap once, to show that it is one"),
}
UNSAFE_LOADERS = {f"yaml.{kind}Loader" for kind in ("", "C", "Full", "CFull", "Unsafe", "CUnsafe")}
PROCESSES = {"multiprocessing", "ProcessPoolExecutor"}  # which would pickle what they send


def sources() -> list[Path]:
    return sorted(path for folder in FOLDERS for path in (ROOT / folder).rglob("*.py"))


def dangers_in(tree: ast.AST) -> Iterator[str]:
    """Describe what a file imports or calls that runs data as code."""
    for node in ast.walk(tree):
        if isinstance(node, ast.Import | ast.ImportFrom):
            names = {alias.name for alias in node.names} | {getattr(node, "module", None) or ""}
            for name in names:
                if {name.split(".")[0], name} & (UNPICKLERS | PROCESSES):
                    yield f"line {node.lineno} imports {name}"
        if isinstance(node, ast.Attribute) and ast.unparse(node) in UNSAFE_LOADERS:
            yield f"line {node.lineno} takes {ast.unparse(node)}"
        if isinstance(node, ast.Call):
            yield from (f"line {node.lineno}: {danger}" for danger in dangers_of_call(node))


def dangers_of_call(call: ast.Call) -> Iterator[str]:
    name = ast.unparse(call.func)
    options = {word.arg: word.value for word in call.keywords}
    if name in EVALUATES | SHELLS | RACES:
        yield f"calls {name}"
    if "shell" in options and ast.unparse(options["shell"]) != "False":
        yield f"{name} with shell={ast.unparse(options['shell'])}"
    if "allow_pickle" in options and ast.unparse(options["allow_pickle"]) != "False":
        yield f"{name} with allow_pickle={ast.unparse(options['allow_pickle'])}"
    if name in {"yaml.load", "yaml.load_all"} and len(call.args) + len(options) < 2:
        yield f"{name} with the default loader"
    if name in {"yaml.full_load", "yaml.full_load_all", "yaml.unsafe_load", "yaml.unsafe_load_all"}:
        yield f"calls {name}"
    if (
        name in {"np.load", "numpy.load"}
        and options.get("mmap_mode") is None
        and "allow_pickle" not in options
    ):
        yield f"{name} without allow_pickle=False"


def test_no_file_unpickles_evaluates_or_calls_a_shell(tried):
    found = {
        path.relative_to(ROOT).as_posix(): list(dangers_in(ast.parse(path.read_text(encoding="utf-8"))))
        for path in sources()
    }
    counts = {path: len(dangers) for path, dangers in found.items() if dangers}
    assert counts == {path: count for path, (count, _) in EXCEPTIONS.items()}, found
    tried("supply chain: search of the sources for unpickling, eval, shells", "none", len(found))


@pytest.mark.parametrize(
    "code",
    [
        "import pickle",
        "from multiprocessing import Pool",
        "import concurrent.futures\nfrom concurrent.futures import ProcessPoolExecutor",
        "eval('1')",
        "os.system('ls')",
        "subprocess.run('ls', shell=True)",
        "np.load(path)",
        "np.load(path, allow_pickle=True)",
        "np.load(path, allow_pickle=trusted)",
        "yaml.load(text)",
        "yaml.load(text, yaml.Loader)",
        "yaml.full_load(text)",
        "tempfile.mktemp()",
    ],
)
def test_each_of_these_would_be_noticed(code):
    assert list(dangers_in(ast.parse(code)))


class Payload:
    """An object whose unpickling creates a file."""

    def __init__(self, path: Path) -> None:
        self.path = path

    def __reduce__(self):
        return (os.mkdir, (str(self.path),))


def test_a_pickle_in_files_that_a_user_may_be_given_is_never_opened(tmp_path, tried):
    """Correspondences are the only arrays that a command takes from outside its own cache."""
    folder, trap = tmp_path / "correspondences", tmp_path / "sprung"
    folder.mkdir()
    row = {"i": "001", "j": "003", "file": "0000_0001.npz", "links": 1}
    (folder / "index.json").write_text(json.dumps([row]))
    hostile = np.array([Payload(trap)], dtype=object)
    np.savez(
        folder / "0000_0001.npz", format=hostile, data=hostile, indices=hostile, indptr=hostile, shape=hostile
    )
    albedo = str(ROOT / "sample_data/linear/albedo")
    line = [*PROGRAM, "evaluate", albedo, albedo, "--correspondences", str(folder)]
    done = do(line)
    assert done.returncode == 2, done.stderr
    assert "Traceback" not in done.stderr
    assert "cannot be read as correspondences" in one_line(done.stderr)
    assert not trap.exists()
    np.load(folder / "0000_0001.npz", allow_pickle=not False)["data"]  # the trap would spring
    assert trap.exists()
    tried("supply chain: a pickle in a file of arrays", "refused in a sentence, never opened")


def check_of(name: str):
    """Import a file of checks/."""
    spec = importlib.util.spec_from_file_location(f"check_{name}", ROOT / f"checks/{name}.py")
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


def locked(*names: str) -> dict[str, str]:
    """Versions in lock files."""
    entries = check_of("lock").ENTRY
    text = "\n".join((ROOT / name).read_text(encoding="utf-8") for name in names)
    return {canonicalize_name(entry["name"]): entry["version"] for entry in entries.finditer(text)}


def test_the_lock_files_hold_what_pyproject_declares():
    runtime, everything = locked("requirements.lock"), locked("requirements.lock", "requirements-test.lock")
    for lists, versions in ((("dependencies",), runtime), (("test", "synthetic"), everything)):
        for wanted in [one for name in lists for one in requirements(name)]:
            if wanted.name == "unshade" or (wanted.marker and not wanted.marker.evaluate(LOCKS_MACHINE)):
                continue
            found = versions.get(canonicalize_name(wanted.name))
            assert found is not None, f"{wanted.name} is in no lock file; run `make lock`"
            assert wanted.specifier.contains(found, prereleases=True), f"{wanted} is locked at {found}"


LOCKS_MACHINE = {"sys_platform": "linux", "platform_machine": "x86_64", "python_version": "3.11"}


def requirements(name: str) -> list[Requirement]:
    """One list of pyproject.toml."""
    text = (ROOT / "pyproject.toml").read_text(encoding="utf-8")
    body = re.search(rf"^{name} = \[(.*?)\](?:  #[^\n]*)?$", text, re.MULTILINE | re.DOTALL)[1]
    lines = [line for line in body.splitlines() if not line.strip().startswith("#")]
    return [Requirement(word) for word in re.findall(r"\"([^\"]+)\"", "\n".join(lines))]


def test_every_line_of_the_lock_files_has_digests_and_no_address():
    for name in ("requirements.lock", "requirements-test.lock"):
        text = (ROOT / name).read_text(encoding="utf-8")
        assert (
            len(re.findall(r"^[\w.-]+==", text, re.MULTILINE)) == len(check_of("lock").entries_of(text)) > 20
        )
        assert "://" not in text


def test_the_set_up_takes_the_lock_files_where_they_fit():
    """The words that setup.sh compares are those that the lock was written with."""
    setup = (ROOT / "setup.sh").read_text(encoding="utf-8")
    code = re.search(r"here=\"\$\(\.venv/bin/python -c '([^']*)'\)\"", setup)[1]
    said = subprocess.run(
        [sys.executable, "-c", code], check=True, capture_output=True, text=True
    ).stdout.strip()
    assert said == check_of("lock").machine()
    assert "--require-hashes" in setup


def test_the_bill_of_materials_lists_the_lock(tmp_path, tried):
    pytest.importorskip("cyclonedx")
    target = tmp_path / "unshade.cdx.json"
    done = do([sys.executable, str(ROOT / "checks/sbom.py"), str(target)])
    assert done.returncode == 0, done.stderr
    bill = json.loads(target.read_text(encoding="utf-8"))
    assert bill["bomFormat"] == "CycloneDX"
    assert bill["metadata"]["component"]["version"] == version("unshade")
    assert {part["name"]: part["version"] for part in bill["components"]}.keys() == locked(
        "requirements.lock"
    ).keys()
    assert all(part["hashes"] for part in bill["components"])
    tried("supply chain: software bill of materials", "written: every distribution with its digests")


@pytest.fixture
def database() -> Iterator[tuple[str, dict[str, list]]]:
    """An OSV database on this machine: its address, and vulnerabilities by distribution, to be filled."""
    faults: dict[str, list] = {}

    class Answer(BaseHTTPRequestHandler):
        def do_POST(self) -> None:
            asked = json.loads(self.rfile.read(int(self.headers["Content-Length"])))
            body = json.dumps({"vulns": faults.get(asked["package"]["name"], [])}).encode()
            self.send_response(200)
            self.send_header("Content-Length", str(len(body)))
            self.end_headers()
            self.wfile.write(body)

        def log_message(self, *_) -> None:
            pass

    server = ThreadingHTTPServer(("127.0.0.1", 0), Answer)
    threading.Thread(target=server.serve_forever, daemon=True).start()
    yield f"http://127.0.0.1:{server.server_port}/v1/query", faults
    server.shutdown()
    server.server_close()


def audit(address: str) -> subprocess.CompletedProcess[str]:
    pytest.importorskip("pip_audit")
    return do([sys.executable, str(ROOT / "checks/audit.py")], {"UNSHADE_OSV": address})


def test_a_known_vulnerability_fails_the_check_and_is_named(database, tried):
    address, faults = database
    clean = audit(address)
    assert clean.returncode == 0 and "none known to be vulnerable" in clean.stdout, clean.stderr
    affected = {"package": {"name": "numpy", "ecosystem": "PyPI"}}
    affected["ranges"] = [{"type": "ECOSYSTEM", "events": [{"introduced": "0"}, {"fixed": "999.0"}]}]
    faults["numpy"] = [
        {"id": "PYSEC-0000-1", "modified": "2026-01-01T00:00:00Z", "published": "2026-01-01T00:00:00Z",
         "summary": "bad", "details": "very", "affected": [affected]}
    ]  # fmt: skip
    done = audit(address)
    assert done.returncode == 1, done.stdout + done.stderr
    assert "numpy" in done.stderr and "PYSEC-0000-1; expected 999.0." in done.stderr
    tried("supply chain: a vulnerable dependency", "fails the check, named with its cure")


def test_without_a_network_the_audit_says_so_and_fails_nothing(tried):
    done = audit("http://127.0.0.1:9/v1/query")
    assert done.returncode == 0
    assert "not audited" in done.stdout
    tried("supply chain: audit without a network", "said in a sentence")
