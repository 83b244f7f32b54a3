"""Disks that are full, read-only or changed meanwhile: a sentence, nothing lost, and the next run goes on."""

from __future__ import annotations

import json
import os
import shutil
import subprocess
import sys
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import pytest

from stages.cli import main
from stages.formats.colmap.model import read_model, write_model
from tests.faults.prepared_workspace import (
    STAGES,
    copy_of,
    entry_of,
    no_traceback,
    outputs,
    prepare,
    shown,
    unshade,
    words,
)
from tests.faults.program import LINEAR, PHOTOS, PROGRAM, ROOT

KEPT = "esults are kept", "the result itself is kept"


@pytest.fixture(scope="module")
def finished(tmp_path_factory) -> Path:
    return prepare(tmp_path_factory.mktemp("disk"))


@contextmanager
def disk(folder: Path, kilobytes: int) -> Iterator[Path]:
    """Mount a small disk; the test is skipped where that is not allowed."""
    folder.mkdir()
    command = ["mount", "-t", "tmpfs", "-o", f"size={kilobytes}k", "tmpfs", str(folder)]
    if not shutil.which("mount") or subprocess.run(command, capture_output=True, check=False).returncode:
        pytest.skip("no disk can be mounted here")
    try:
        yield folder
    finally:
        subprocess.run(["umount", str(folder)], check=True)


def remount(folder: Path, option: str) -> None:
    subprocess.run(["mount", "-o", f"remount,{option}", str(folder)], check=True)


def halves_below(workspace: Path) -> list[Path]:
    """List what a stage or a copy that did not end has left."""
    return [path for path in workspace.rglob(".*") if path.name.startswith((".part", ".partial"))]


def check_full(finished: Path, folder: Path, kilobytes: int) -> bool:
    """Run on a disk of this size, then on the same with room; returns whether it was full."""
    with disk(folder, kilobytes) as place:
        workspace = place / "workspace"
        done = unshade(words(workspace))
        assert no_traceback(done), (kilobytes, done.stderr)
        if done.returncode:
            assert any(words in done.stderr for words in KEPT), done.stderr
            assert not halves_below(workspace)
            published = {path: path.stat().st_mtime_ns for path in workspace.glob("cache/*/*/record.json")}
            remount(place, "size=64m")
            assert unshade(words(workspace)).returncode == 0
            assert {path: path.stat().st_mtime_ns for path in published} == published, "made anew"
        assert outputs(workspace) == outputs(finished)
        assert shown(workspace) == shown(finished)
    return bool(done.returncode)


def test_a_full_disk_is_a_sentence_and_the_next_run_goes_on(finished, tmp_path, tried):
    used = sum(path.stat().st_blocks for path in finished.rglob("*") if path.is_file()) // 2
    assert check_full(finished, tmp_path / "disk", used * 3 // 4)
    tried("a full disk (tmpfs), then room", "refused in a sentence, then same digests")


@pytest.mark.slow
def test_a_full_disk_of_any_size_is_a_sentence(finished, tmp_path, tried):
    used = sum(path.stat().st_blocks for path in finished.rglob("*") if path.is_file()) // 2
    full = [
        check_full(finished, tmp_path / f"disk{part}", max(4, used * part // 40)) for part in range(1, 43)
    ]
    assert sum(full) >= 38
    tried("a full disk (tmpfs), then room", "refused in a sentence, then same digests", sum(full))


def sfm_words(workspace: Path) -> list[str]:
    """Build the command line of structure from motion of five small photos, whose database is small."""
    photos = workspace.parent / "photos"
    settings = ("sfm.max_size_px=300", "sfm.max_features=300", "sfm.attempts=1")
    pairs = [word for one in settings for word in ("--set", one)]
    return ["run", "--images", str(photos), "--workspace", str(workspace), "--to", "sfm", *pairs]


def few_photos(folder: Path) -> None:
    (folder / "photos").mkdir()
    for path in sorted(PHOTOS.glob("*.jpg"))[:5]:
        shutil.copy(path, folder / "photos")


def check_colmap_on_a_full_disk(folder: Path, kilobytes: int) -> bool:
    with disk(folder, 64_000) as place:
        few_photos(place)
        photos = sum(path.stat().st_blocks for path in (place / "photos").iterdir()) // 2
        remount(place, f"size={photos + kilobytes}k")
        done = unshade(sfm_words(place / "workspace"))
        assert no_traceback(done), (kilobytes, done.returncode, done.stderr)
        assert not halves_below(place / "workspace")
        return "No space left" in done.stderr or "cut short" in done.stderr


def test_colmap_on_a_full_disk_is_a_sentence(tmp_path, tried):
    assert check_colmap_on_a_full_disk(tmp_path / "disk", 1000)
    tried("a full disk in COLMAP's database and models", "refused in a sentence")


@pytest.mark.slow
def test_colmap_on_a_full_disk_of_any_size_is_a_sentence(tmp_path, tried):
    sizes = [*range(100, 4000, 100), *range(4000, 8000, 500)]
    full = [check_colmap_on_a_full_disk(tmp_path / f"disk{size}", size) for size in sizes]
    tried("a full disk in COLMAP's database and models", "refused in a sentence", sum(full))
    assert 20 < sum(full) < len(full)


def test_a_read_only_workspace_can_be_read_and_is_not_run(finished, tmp_path, tried):
    with disk(tmp_path / "disk", 64_000) as place:
        workspace = copy_of(finished, place)
        remount(place, "ro")
        for verb in ("status", "show", "diff"):
            assert main([verb, "--workspace", str(workspace)]) == (2 if verb == "diff" else 0)
        planned = unshade(words(workspace, "plan", "--json"))
        assert planned.stdout.count('"reuse"') == len(STAGES)
        for command in (words(workspace), ["clean", "--workspace", str(workspace)]):
            done = unshade(command)
            assert done.returncode == 2
            assert "cannot be written (Read-only file system); choose another folder" in done.stderr
    tried("a workspace on a read-only disk, six verbs", "read, or refused in a sentence", 6)


@pytest.mark.parametrize("by", ["rename", "copy"])
def test_a_workspace_that_was_moved_is_used_as_it_is(finished, tmp_path, tried, by):
    workspace = copy_of(finished, tmp_path)
    elsewhere = tmp_path / "else where/ümlaut"
    elsewhere.parent.mkdir()
    workspace.rename(elsewhere) if by == "rename" else shutil.copytree(workspace, elsewhere)
    done = unshade(words(elsewhere, "run", "--json"), cwd=tmp_path)
    assert done.stdout.count('"action": "reuse"') == len(STAGES), done.stderr
    assert shown(elsewhere) == shown(finished)
    tried(f"a workspace moved by {by}", "results reused, nothing rerun")


NO_LINKS = """
#include <errno.h>
int link(const char *a, const char *b) { errno = EPERM; return -1; }
int symlink(const char *a, const char *b) { errno = EPERM; return -1; }
int linkat(int a, const char *b, int c, const char *d, int e) { errno = EPERM; return -1; }
int symlinkat(const char *a, int b, const char *c) { errno = EPERM; return -1; }
"""


@pytest.mark.slow
@pytest.mark.skipif(
    not (sys.platform == "linux" and shutil.which("cc")), reason="no compiler to forbid links with"
)
def test_a_file_system_without_links_is_no_obstacle(finished, tmp_path, tried):
    """Neither Python nor a library makes a hard or symbolic link: on this system they are refused."""
    (tmp_path / "links.c").write_text(NO_LINKS)
    library = tmp_path / "links.so"
    subprocess.run(["cc", "-shared", "-fPIC", "-o", library, tmp_path / "links.c"], check=True)
    workspace, preloaded = tmp_path / "workspace", {"LD_PRELOAD": str(library)}
    program = "import os; os.symlink('a', 'b')"
    refused = subprocess.run(
        [sys.executable, "-c", program], env={**os.environ, **preloaded}, cwd=tmp_path, capture_output=True
    )
    assert b"Operation not permitted" in refused.stderr
    done = unshade(words(workspace), env=preloaded)
    assert done.returncode == 0, done.stderr
    assert outputs(workspace) == outputs(finished)
    tried("a file system without hard or symbolic links", "same digests")


IN_THE_WAY = ("output", "cache", "cache/raycast", "output/mask", "output/mesh.ply", "output/.part")


@pytest.mark.parametrize("place", IN_THE_WAY)
def test_what_is_in_the_way_is_named(finished, tmp_path, capsys, tried, place):
    """A file where a folder has to be, and a folder with something in it where a file has to be."""
    workspace = copy_of(finished, tmp_path)
    where = workspace / place
    folder = where.is_file() or place.endswith(".part")
    shutil.rmtree(where) if where.is_dir() else where.unlink(missing_ok=True)
    if folder:
        (where / "mine").mkdir(parents=True)
        (workspace / "output/contact_sheet.png").unlink()
    else:
        where.write_text("mine")
    code = main(words(workspace))
    said = " ".join(capsys.readouterr().err.split())
    assert code == 2 and "Traceback" not in said, said
    assert place in said
    assert where.is_dir() if folder else where.read_text() == "mine"
    tried("a file in place of a folder of the workspace, or the reverse", "refused in a sentence")


@pytest.mark.parametrize("word", [["--workspace", ""], ["--workspace="], ["--images", ""]])
def test_an_empty_word_is_not_the_current_folder(tmp_path, monkeypatch, capsys, tried, word):
    monkeypatch.chdir(tmp_path)
    assert main(["run", "--images", str(PHOTOS), *word]) == 2
    assert "An empty word was given after --" in capsys.readouterr().err
    assert list(tmp_path.iterdir()) == []
    tried("an empty path on the command line", "refused in a sentence")


def renamed_views(folder: Path, names: dict[str, str]) -> list[str]:
    """Build the command line of the same views, some of which have other names."""
    model = read_model(LINEAR / "sparse")
    for image in model.images.values():
        name = names.get(image.name, image.name)
        (folder / "images" / name).parent.mkdir(parents=True, exist_ok=True)
        shutil.copy(LINEAR / "images" / image.name, folder / "images" / name)
        image.name = name
    write_model(model, folder / "sparse")
    return ["--colmap", str(folder), "--images", str(folder / "images")]


@pytest.mark.slow
def test_the_longest_names_reach_the_output_and_longer_ones_are_refused(tmp_path, capsys, tried):
    workspace = tmp_path / "workspace"
    for length, code in ((237, 0), (238, 2)):
        name = "é" * 20 + "x" * (length - 40)
        given = renamed_views(tmp_path / str(length), {"001.exr": f"{name}.exr"})
        assert main([*words(workspace), *given]) == code
        assert code == 0 or "237 bytes a part" in " ".join(capsys.readouterr().err.split())
        assert (
            workspace / f"output/dense/stereo/depth_maps/{'é' * 20 + 'x' * 197}.png.geometric.bin"
        ).is_file()
    tried("photo names of 237 and 238 bytes", "used, refused in a sentence", 2)


def test_a_photo_and_a_folder_that_would_share_a_name_are_refused(tmp_path, capsys, tried):
    given = renamed_views(tmp_path / "model", {"003.exr": "001.png/003.exr"})
    assert main([*words(tmp_path / "one"), *given]) == 2
    (tmp_path / "photos/000.exr").mkdir(parents=True)
    for place, path in zip(("000.jpg", "000.exr/1.jpg", "2.jpg"), sorted(PHOTOS.glob("*.jpg")), strict=False):
        shutil.copy(path, tmp_path / "photos" / place)
    assert main(["run", "--images", str(tmp_path / "photos"), "--workspace", str(tmp_path / "two")]) == 2
    said = " ".join(capsys.readouterr().err.split())
    assert "a photo '001' and a folder '001.png'" in said
    assert "a photo '000' and a folder '000.exr'" in said
    tried("a photo beside a folder of its result's name", "refused in a sentence", 2)


@pytest.mark.slow
def test_an_output_follows_a_file_that_became_a_folder(finished, tmp_path, tried):
    """A view's map is in the place of a folder that other views need now, and the other way round."""
    workspace = copy_of(finished, tmp_path)
    given = renamed_views(tmp_path / "model", {"001.exr": "007.exr", "003.exr": "001.exr/003.exr"})
    for more in (given, []):
        done = unshade([*words(workspace), *more])
        assert done.returncode == 0, done.stderr
    assert shown(workspace) == shown(finished)
    tried("a file of the output that becomes a folder, and back", "same digests", 2)


def check_deletion_during(finished: Path, workspace: Path, stage: str, victim: str) -> str:
    """Delete a cached input while a stage works; what is said."""
    running = subprocess.Popen(
        [*PROGRAM, *words(workspace, "run", "--force", "--from", stage)],
        stderr=subprocess.PIPE, text=True, cwd=ROOT, env={**os.environ, "PYTHONPATH": str(ROOT)},
    )  # fmt: skip
    deadline = time.monotonic() + 60
    while not list((workspace / "cache" / stage).glob(".partial-*")) and time.monotonic() < deadline:
        time.sleep(0.002)
    for entry in (workspace / "cache" / victim).iterdir():
        shutil.rmtree(entry, ignore_errors=True)
    said = " ".join((running.communicate()[1]).split())
    assert running.returncode in (0, 2) and "Traceback" not in said, said  # not all inputs are read late
    assert unshade(words(workspace)).returncode == 0
    assert outputs(workspace) == outputs(finished)
    assert shown(workspace) == shown(finished)
    return said


def test_a_result_deleted_while_a_stage_reads_it_is_named_and_made_anew(finished, tmp_path, tried):
    said = check_deletion_during(finished, copy_of(finished, tmp_path), "correspondence", "raycast")
    assert "uring the run" in said and "un again" in said
    tried("a cached input deleted during a run", "refused in a sentence, then same digests")


@pytest.mark.slow
@pytest.mark.parametrize("victim", ["stage itself", *STAGES[:6]])
@pytest.mark.parametrize("stage", STAGES[1:])
def test_any_result_deleted_during_a_run(finished, tmp_path, tried, stage, victim):
    own = victim == "stage itself"
    if not own and STAGES.index(victim) >= STAGES.index(stage):
        pytest.skip("made later")
    workspace = copy_of(finished, tmp_path)
    check_deletion_during(finished, workspace, stage, stage if own else victim)
    tried("a cached result deleted during a run", "refused in a sentence, then same digests")


@pytest.mark.slow
def test_the_report_of_a_failed_copy_is_json_where_json_was_asked_for(finished, tmp_path, tried):
    workspace = copy_of(finished, tmp_path)
    (workspace / "output/mesh.ply").unlink()
    (workspace / "output/mesh.ply/mine").mkdir(parents=True)
    done = unshade(words(workspace, "run", "--json"))
    assert done.returncode == 2 and done.stdout == ""
    assert entry_of(workspace, "export").is_dir()
    assert json.loads(unshade(["status", "--json", "--workspace", str(workspace)]).stdout)
    tried("a folder in place of a file of the output, with --json", "refused in a sentence")
