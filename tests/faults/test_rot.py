"""Bytes that rot: what is damaged in a workspace is noticed, named and made anew, and nothing else lost."""

from __future__ import annotations

import json
import os
import random
import shutil
from collections.abc import Callable
from pathlib import Path

import pytest

from pipeline.cache.sealed_json import sealed
from stages.cli import main
from tests.faults.prepared_workspace import (
    LINEAR,
    STAGES,
    artefacts,
    copy_of,
    entry_of,
    outputs,
    prepare,
    shown,
    unshade,
    words,
)

OTHER = dict(zip(STAGES, (*STAGES[1:], STAGES[0]), strict=True))


@pytest.fixture(scope="module")
def finished(tmp_path_factory) -> Path:
    return prepare(tmp_path_factory.mktemp("rot"))


def flip(path: Path, dice: random.Random, workspace: Path) -> None:
    """Change a bit, and put the times back."""
    before, data = path.stat(), bytearray(path.read_bytes())
    if not data:
        return truncate(path, dice, workspace)
    data[dice.randrange(len(data))] ^= 1 << dice.randrange(8)
    path.write_bytes(data)
    os.utime(path, ns=(before.st_atime_ns, before.st_mtime_ns))
    return None


def truncate(path: Path, dice: random.Random, workspace: Path) -> None:
    data = path.read_bytes()
    path.write_bytes(data[: dice.randrange(len(data))] if data else b"longer")


def delete(path: Path, dice: random.Random, workspace: Path) -> None:
    path.unlink()


def swap(path: Path, dice: random.Random, workspace: Path) -> None:
    """Put there the file of the same role, or any, of another stage."""
    stage = path.relative_to(workspace / "cache").parts[0]
    other = entry_of(workspace, OTHER[stage])
    shutil.copyfile(other / path.name if path.name == "record.json" else dice.choice(artefacts(other)), path)


def replace_by_folder(path: Path, dice: random.Random, workspace: Path) -> None:
    """Put a folder of the same name in its place that holds the file itself."""
    path.rename(path.with_name("aside"))
    path.mkdir()
    path.with_name("aside").rename(path / path.name)


def replace_by_dangling_link(path: Path, dice: random.Random, workspace: Path) -> None:
    path.unlink()
    path.symlink_to(workspace / "nowhere")


def replace_by_pipe(path: Path, dice: random.Random, workspace: Path) -> None:
    path.unlink()
    os.mkfifo(path)


def add(path: Path, dice: random.Random, workspace: Path) -> None:
    """Add a file beside it: beside a record and a single file, instead of it."""
    if path.parent.parent.parent.parent == workspace:  # cache/STAGE/KEY/file: no folder of an artefact
        return flip(path, dice, workspace)
    return path.with_name("added" + path.suffix).write_bytes(b"more") and None


Damage = Callable[[Path, random.Random, Path], None]
DAMAGES: tuple[Damage, ...] = (
    flip, flip, flip, truncate, delete, swap, replace_by_folder, replace_by_dangling_link,
    replace_by_pipe, add,
)  # fmt: skip


def damage_each_stage(workspace: Path, dice: random.Random) -> dict[str, str]:
    """Damage one file of each stage, records included; returns what was done, by stage."""
    done = {}
    for stage in STAGES:
        entry = entry_of(workspace, stage)
        kinds = sorted({path.relative_to(entry).parts[0] for path in artefacts(entry)} | {"record.json"})
        kind = dice.choice(kinds)  # else the stages' many images would leave nothing to their single files
        victim = dice.choice([path for path in (entry / kind, *(entry / kind).rglob("*")) if path.is_file()])
        damage = dice.choice(DAMAGES)
        damage(victim, dice, workspace)
        done[stage] = f"{damage.__name__} {victim.relative_to(entry)}"
    return done


def check_round(finished: Path, folder: Path, seed: int) -> int:
    """Damage a file of every stage; the next run names each, makes all anew, and ends as before."""
    workspace = copy_of(finished, folder)
    damages = damage_each_stage(workspace, random.Random(seed))
    done = unshade(words(workspace, "run", "--json"))
    assert done.returncode == 0, (damages, done.stderr)
    for row in json.loads(done.stdout)["stages"]:
        what = damages[row["stage"]], row["reason"]
        assert row["action"] == "run", what
        assert row["reason"].startswith("its cached result is damaged: "), what
        place = damages[row["stage"]].split()[1]
        assert Path(row["reason"].split()[5]).parts[0] == Path(place).parts[0], what
    assert outputs(workspace) == outputs(finished)
    assert shown(workspace) == shown(finished)
    assert unshade(words(workspace, "plan", "--json")).stdout.count('"reuse"') == len(STAGES)
    shutil.rmtree(workspace)
    return len(damages)


@pytest.mark.parametrize("seed", [0, pytest.param(1, marks=pytest.mark.slow)])
def test_every_damage_is_named_and_made_anew(finished, tmp_path, tried, seed):
    number = check_round(finished, tmp_path, seed)
    tried("a file of the cache flipped, cut, deleted, swapped or replaced", "noticed, named, rebuilt", number)


@pytest.mark.slow
def test_hundreds_of_damages_are_named_and_made_anew(finished, tmp_path, tried):
    for seed in range(100, 150):
        number = check_round(finished, tmp_path, seed)
        tried(
            "a file of the cache flipped, cut, deleted, swapped or replaced",
            "noticed, named, rebuilt",
            number,
        )


@pytest.mark.parametrize("step", [97, pytest.param(1, marks=pytest.mark.slow)])
def test_no_byte_of_a_record_can_change_unnoticed(finished, tmp_path, tried, step):
    """Each of them, or one in many, and every length that a cut leaves."""
    from pipeline.cache.store import Store

    entry = entry_of(finished, "adopt_mesh")
    store = Store(tmp_path)
    own = tmp_path / "cache/adopt_mesh" / entry.name
    own.mkdir(parents=True)
    data = (entry / "record.json").read_bytes()
    number = 0
    for place in (*range(min(60, len(data))), *range(60, len(data), step)):
        flipped = bytearray(data)
        flipped[place] ^= 1 << (place % 8)
        for changed in (bytes(flipped), data[:place]):
            (own / "record.json").write_bytes(changed)
            assert store.record("adopt_mesh", entry.name) is None, (place, changed[max(0, place - 20) :][:40])
            assert store.damaged_record("adopt_mesh", entry.name) == "record.json was changed"
            number += 1
    (own / "record.json").write_bytes(data)
    assert store.record("adopt_mesh", entry.name) is not None
    tried("a byte of a record flipped, or all after it cut off", "noticed", number)


def test_results_of_one_stage_that_change_places_are_noticed(finished, tmp_path, tried):
    workspace = copy_of(finished, tmp_path)
    assert unshade(words(workspace, "run", "--to", "raycast", "--set", "raycast.reduce=2")).returncode == 0
    one, other = sorted((workspace / "cache/raycast").iterdir())
    one.rename(tmp_path / "aside")
    other.rename(one)
    (tmp_path / "aside").rename(other)
    rows = json.loads(unshade(words(workspace, "plan", "--json")).stdout)
    reasons = {row["stage"]: row["reason"] for row in rows}
    assert reasons["raycast"] == "its cached result is damaged: record.json was changed"
    tried("two results of a stage that changed places", "noticed, named")


HEAPS = "[" * 100_000
WRONG = {
    "a list": "[]", "a number": "5", "text": '"x"', "null": "null", "nothing": "",
    "half": '{"sfm": "0', "heaps": HEAPS,
    "an object of numbers": '{"raycast": 5, "export": 6}',
    "an object of lists": '{"raycast": [1, 2], "mesh": []}',
    "an object of objects": '{"raycast": {"stage": 1, "key": 2, "files": 3}}', "bytes": b"\xff\xfe\x00{}",
    "objects of wrong files": '{"mask": {"stage": "raycast", "key": "1", "files": {"mask/001.png": 1}}}',
    "a false digest": '{"digest": "00000000000000000000000000000000", "raycast": "0"}',
    "an object": "{}",
}  # fmt: skip
BOOKS = ("current.json", "output.json", "digests.json", "record.json")
VERBS = {
    "status": ["status", "--workspace"], "show": ["show", "--stage", "raycast", "--workspace"],
    "diff": ["diff", "--stage", "raycast", "--workspace"], "clean": ["clean", "--workspace"],
}  # fmt: skip


def write(path: Path, content: str | bytes) -> None:
    path.write_bytes(content if isinstance(content, bytes) else content.encode())


def book_of(workspace: Path, name: str) -> Path:
    return (entry_of(workspace, "raycast") if name == "record.json" else workspace / "cache") / name


@pytest.mark.parametrize("book", BOOKS)
@pytest.mark.parametrize("step", [4, pytest.param(1, marks=pytest.mark.slow)])
def test_every_verb_takes_every_kind_of_nonsense_in_the_books(finished, tmp_path, capsys, tried, book, step):
    """In one process, for there are hundreds; the slow form tries each kind, the fast one some."""
    workspace = copy_of(finished, tmp_path)
    chosen = list(WRONG.values())[::step]
    for content in chosen:
        for verb in ("status", "show", "diff", "plan"):
            write(book_of(workspace, book), content)
            code = main(words(workspace, verb) if verb == "plan" else [*VERBS[verb], str(workspace)])
            said = capsys.readouterr().err
            assert code in (0, 2) and "Traceback" not in said, (verb, content[:60], said)
    assert main([*VERBS["clean"], str(workspace)]) == 0
    for stage in set(STAGES) - {"raycast"}:
        assert artefacts(entry_of(workspace, stage)) == [
            workspace / path.relative_to(finished) for path in artefacts(entry_of(finished, stage))
        ]
    tried(f"nonsense in {book}, four verbs and clean", "a result or a sentence", 4 * len(chosen) + 1)


@pytest.mark.parametrize("book", ["current.json", "output.json"])
def test_a_run_puts_the_books_in_order(finished, tmp_path, tried, book):
    workspace = copy_of(finished, tmp_path)
    write(book_of(workspace, book), WRONG["an object of objects"])
    assert unshade(words(workspace)).returncode == 0
    assert shown(workspace) == shown(finished)
    assert outputs(workspace) == outputs(finished)
    tried(f"nonsense in {book}, then a run", "same digests")


@pytest.mark.slow
@pytest.mark.parametrize("book", BOOKS)
@pytest.mark.parametrize("name", WRONG)
def test_any_run_puts_the_books_in_order(finished, tmp_path, tried, book, name):
    workspace = copy_of(finished, tmp_path)
    write(book_of(workspace, book), WRONG[name])
    done = unshade(words(workspace))
    assert done.returncode == 0, done.stderr
    assert shown(workspace) == shown(finished)
    assert outputs(workspace) == outputs(finished)
    tried(f"nonsense in {book}, then a run", "same digests")


def test_a_damaged_record_is_said_to_be_damaged_by_every_verb(finished, tmp_path, tried):
    workspace = copy_of(finished, tmp_path)
    write(book_of(workspace, "record.json"), "{")
    planned = unshade(words(workspace, "plan", "--json", "--set", "raycast.reduce=2")).stdout
    assert "the records of its earlier results are missing or damaged" in planned
    shown = unshade([*VERBS["show"], str(workspace)])
    assert shown.returncode == 2
    assert "1 result(s) of 'raycast', none with a sound record" in shown.stderr
    assert "record.json was changed); run the stage again" in shown.stderr
    tried("a damaged record, shown and planned", "named")


def test_a_memo_that_lies_is_not_believed(finished, tmp_path, tried):
    """A damaged file, and a memo changed so that it would vouch for it, without the memo's own digest."""
    workspace = copy_of(finished, tmp_path)
    assert unshade(words(workspace)).returncode == 0
    victim = entry_of(workspace, "raycast") / "cameras.json"
    data = victim.read_bytes()
    victim.write_bytes(data.replace(b"1", b"2", 1))
    memo = workspace / "cache/digests.json"
    stat = victim.stat()
    text = memo.read_text()
    entries = json.loads(text)
    entries.pop("digest", None)
    right = json.loads((victim.parent / "record.json").read_text())["outputs"]["cameras"]["cameras.json"]
    lie = {**entries, str(victim): [stat.st_size, stat.st_mtime_ns, stat.st_ctime_ns, stat.st_ino, right]}
    memo.write_text(text[: text.index(",")] + "," + json.dumps(lie)[1:])
    planned = unshade(words(workspace, "plan"))
    assert "damaged: cameras.json was changed" in " ".join(planned.stdout.split())
    tried("a memo of digests that vouches for a damaged file", "not believed")


def test_clean_keeps_what_is_no_result_and_a_result_that_can_be_used(finished, tmp_path, capsys, tried):
    workspace = copy_of(finished, tmp_path)
    cache = workspace / "cache"
    (cache / "raycast/note.txt").write_text("mine")
    (cache / "raycast/mine").mkdir()
    (cache / "raycast/mine/note.txt").write_text("mine")
    (cache / "notes").mkdir()
    (cache / "notes/note.txt").write_text("mine")
    write(cache / "current.json", "[]")
    assert main(["clean", "--workspace", str(workspace)]) == 0
    assert "0 result(s) removed" in capsys.readouterr().out
    assert outputs_of_one(workspace, "raycast")
    assert main(["clean", "--everything", "--workspace", str(workspace)]) == 0
    notes = [cache / "raycast/note.txt", cache / "raycast/mine/note.txt", cache / "notes/note.txt"]
    assert [note.read_text() for note in notes] == ["mine"] * 3
    assert not [path for stage in STAGES if stage != "raycast" for path in (cache / stage).iterdir()]
    tried("stray files and folders in the cache, then clean", "kept", 2)


def outputs_of_one(workspace: Path, stage: str) -> list[Path]:
    (entry,) = (path for path in (workspace / "cache" / stage).iterdir() if len(path.name) == 32)
    return artefacts(entry)


def a_ledger_that_climbs(workspace: Path, victim: Path) -> None:
    ledger = workspace / "cache/output.json"
    entries = {
        "mask": {
            "stage": "raycast",
            "key": "0",
            "files": {os.path.relpath(victim, workspace / "output"): [1, 2]},
        }
    }
    ledger.write_text(sealed(entries))


def a_ledger_with_an_absolute_path(workspace: Path, victim: Path) -> None:
    entries = {"mask": {"stage": "raycast", "key": "0", "files": {str(victim): [1, 2]}}}
    (workspace / "cache/output.json").write_text(sealed(entries))


def a_ledger_through_a_link(workspace: Path, victim: Path) -> None:
    (workspace / "output/lead").symlink_to(victim.parent)
    entries = {"mask": {"stage": "raycast", "key": "0", "files": {f"lead/{victim.name}": [1, 2]}}}
    (workspace / "cache/output.json").write_text(sealed(entries))


def a_folder_of_the_output_that_is_a_link(workspace: Path, victim: Path) -> None:
    shutil.rmtree(workspace / "output/mask")
    (workspace / "output/mask").symlink_to(victim.parent)


def an_output_that_is_a_link(workspace: Path, victim: Path) -> None:
    shutil.rmtree(workspace / "output")
    (workspace / "output").symlink_to(victim.parent)


def a_cache_that_is_a_link(workspace: Path, victim: Path) -> None:
    (workspace / "cache").rename(victim.parent / "cache")
    (workspace / "cache").symlink_to(victim.parent / "cache")


def a_stage_that_is_a_link(workspace: Path, victim: Path) -> None:
    shutil.rmtree(workspace / "cache/raycast")
    (victim.parent / ".partial-0").mkdir()
    (victim.parent / ("0" * 32)).mkdir()
    (workspace / "cache/raycast").symlink_to(victim.parent)


def links_in_place_of_files_that_are_being_written(workspace: Path, victim: Path) -> None:
    cache = workspace / "cache"
    (cache / "current.json").unlink()
    (workspace / "output/mask/001.png").unlink()
    for link in (".current.json.part", ".output.json.part", ".digests.json.part", "../output/.part"):
        (cache / link).symlink_to(victim)


def links_in_place_of_written_files(workspace: Path, victim: Path) -> None:
    for link in ("cache/current.json", "cache/output.json", "cache/digests.json", "output/mask/001.png"):
        (workspace / link).unlink()
        (workspace / link).symlink_to(victim)


def a_lock_that_is_a_link(workspace: Path, victim: Path) -> None:
    (workspace / ".lock").unlink(missing_ok=True)
    (workspace / ".lock").symlink_to(victim)


def a_result_that_is_a_link(workspace: Path, victim: Path) -> None:
    entry = entry_of(workspace, "raycast")
    entry.rename(victim.parent / entry.name)
    entry.symlink_to(victim.parent / entry.name)
    (entry / "mask/001.png").write_bytes(b"damaged")


OUTSIDE = (
    a_ledger_that_climbs, a_ledger_with_an_absolute_path, a_ledger_through_a_link,
    a_folder_of_the_output_that_is_a_link, an_output_that_is_a_link, a_cache_that_is_a_link,
    a_stage_that_is_a_link,
    links_in_place_of_files_that_are_being_written, links_in_place_of_written_files, a_lock_that_is_a_link,
    a_result_that_is_a_link,
)  # fmt: skip


@pytest.mark.parametrize("attack", OUTSIDE, ids=lambda attack: attack.__name__)
def test_nothing_outside_the_workspace_is_written_or_deleted(finished, tmp_path, tried, capsys, attack):
    workspace = copy_of(finished, tmp_path)
    victim = tmp_path / "victims/victim"
    victim.parent.mkdir()
    victim.write_text("precious")
    attack(workspace, victim)
    before = listing(victim.parent)
    commands = (
        words(workspace, "run", "--to", "raycast"),
        ["clean", "--workspace", str(workspace)],
        ["clean", "--everything", "--workspace", str(workspace)],
    )
    for command in commands:
        code = main(command)
        said = capsys.readouterr().err
        assert code in (0, 2) and "Traceback" not in said, said
    assert listing(victim.parent) == before
    tried("paths and links that lead out of the workspace: run and clean", "nothing outside touched", 3)


def listing(folder: Path) -> dict[str, bytes]:
    return {str(path): path.read_bytes() if path.is_file() else b"" for path in sorted(folder.rglob("*"))}


def test_an_output_that_is_damaged_is_refused_by_evaluate_and_mended_by_a_run(
    finished, tmp_path, capsys, tried
):
    workspace, truth = copy_of(finished, tmp_path), str(LINEAR / "albedo")
    albedo = sorted((workspace / "output/albedo").glob("*.exr"))[0]
    data = albedo.read_bytes()
    for content in (data[:100], data[: len(data) // 2], b"", b"\x00" * 500):
        albedo.write_bytes(content)
        assert main(["evaluate", str(workspace / "output"), truth]) == 2
        assert "Traceback" not in capsys.readouterr().err
    assert main(words(workspace)) == 0
    assert shown(workspace) == shown(finished)
    tried("a damaged map in the output, then evaluate", "refused in a sentence", 4)
