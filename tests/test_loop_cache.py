"""Compiled loops are kept in a folder that an edit anywhere in them leaves behind."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

from stages.solvers.kernels.loop_cache import VARIABLE, digest_of_loops, name_loop_cache


def tree(folder: Path) -> Path:
    (folder / "a").mkdir(parents=True)
    (folder / "a" / "called.py").write_text("import numba\n\nONE = 1\n", encoding="utf-8")
    (folder / "calls.py").write_text("from numba import njit\n", encoding="utf-8")
    (folder / "words.py").write_text("WORDS = 1\n", encoding="utf-8")
    return folder


def test_an_edit_of_what_a_loop_calls_gives_another_folder_and_other_edits_do_not(tmp_path):
    root = tree(tmp_path / "stages")
    before = digest_of_loops(root)
    assert before == digest_of_loops(tree(tmp_path / "elsewhere"))
    (root / "words.py").write_text("WORDS = 2\n", encoding="utf-8")
    assert digest_of_loops(root) == before
    (root / "a" / "called.py").write_text("import numba\n\nONE = 2\n", encoding="utf-8")
    edited = digest_of_loops(root)
    assert edited != before
    (root / "a" / "called.py").rename(root / "a" / "renamed.py")
    assert digest_of_loops(root) not in (before, edited)


def test_the_folder_is_beside_the_sources_or_the_users_and_what_is_set_holds(tmp_path, monkeypatch):
    root = tree(tmp_path / "stages")
    monkeypatch.delenv(VARIABLE)
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "home"))
    name_loop_cache(root)
    first = Path(os.environ[VARIABLE])
    assert first.is_dir()
    assert first.parent == root / "__pycache__"
    name_loop_cache(tree(tmp_path / "other"))
    assert os.environ[VARIABLE] == str(first)
    monkeypatch.delenv(VARIABLE)
    blocked = tree(tmp_path / "blocked")
    (blocked / "__pycache__").write_bytes(b"")  # no folder can be made there
    name_loop_cache(blocked)
    assert Path(os.environ[VARIABLE]).parent == tmp_path / "home" / "unshade"


def test_without_a_home_the_folder_is_the_users_own_among_the_temporary_files(tmp_path, monkeypatch):
    monkeypatch.delenv(VARIABLE)
    monkeypatch.setenv("XDG_CACHE_HOME", "/dev/null")
    monkeypatch.setattr("tempfile.tempdir", str(tmp_path))
    blocked = tree(tmp_path / "blocked")
    (blocked / "__pycache__").write_bytes(b"")
    private = tmp_path / f"unshade-{os.geteuid()}"
    private.mkdir(mode=0o777)
    private.chmod(0o777)  # others could put their code there
    name_loop_cache(blocked)
    assert VARIABLE not in os.environ
    private.rmdir()
    name_loop_cache(blocked)
    assert Path(os.environ[VARIABLE]).parent == private
    assert private.stat().st_mode & 0o777 == 0o700


def test_the_program_names_it_before_numba_is_imported():
    said = "import sys, stages, os; print('numba' in sys.modules, os.environ['NUMBA_CACHE_DIR'])"
    clean = {name: value for name, value in os.environ.items() if name != VARIABLE}
    done = subprocess.run([sys.executable, "-c", said], env=clean, capture_output=True, text=True, check=True)
    early, folder = done.stdout.split(maxsplit=1)
    assert early == "False"
    assert "loops-" in folder
