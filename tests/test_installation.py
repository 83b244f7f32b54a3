"""Advice to install something names the environment that the program runs in, which may not be active."""

from __future__ import annotations

import shlex
import sys

import pytest

from pipeline.process import installation
from stages.diagnosis.extras import EXTRAS


@pytest.mark.parametrize("extra", [one.name for one in EXTRAS])
def test_an_extra_is_installed_from_the_checkout_by_the_python_that_runs(extra):
    """The words are those of a shell; the extra is one that the project has."""
    tomllib = pytest.importorskip("tomllib")  # from Python 3.11 on
    words = shlex.split(installation.install_extra(extra))
    assert words[:4] == [sys.executable, "-m", "pip", "install"]
    assert words[4:] == ["-e", f"{installation.CHECKOUT}[{extra}]"]
    project = tomllib.loads((installation.CHECKOUT / "pyproject.toml").read_text(encoding="utf-8"))
    assert project["project"]["name"] == installation.PROJECT
    assert extra in project["project"]["optional-dependencies"]


def test_without_a_checkout_the_project_is_installed_by_its_name(tmp_path, monkeypatch):
    monkeypatch.setattr(installation, "CHECKOUT", tmp_path / "site-packages")
    assert shlex.split(installation.install_extra("raw"))[4:] == ["unshade[raw]"]


def test_spaces_in_folders_are_quoted(tmp_path, monkeypatch):
    (tmp_path / "my tools").mkdir()
    (tmp_path / "my tools" / "pyproject.toml").touch()
    monkeypatch.setattr(installation, "CHECKOUT", tmp_path / "my tools")
    assert shlex.split(installation.install_extra("raw"))[-1] == f"{tmp_path / 'my tools'}[raw]"
