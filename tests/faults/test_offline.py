"""Data sets without a network: results are reused by known digests; a cut download is never used."""

from __future__ import annotations

import hashlib
import json
import shutil
import subprocess
import threading
from collections.abc import Callable, Iterator
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from pathlib import Path

import pytest

from pipeline.cache.digest import digest_file
from stages.scene.datasets import find_dataset
from tests.faults.program import LINEAR, PROGRAM, ROOT
from tests.faults.small_runs import do, one_line, results

MODEL = LINEAR  # cameras of four photos, so that none have to be found
PHOTOS = MODEL / "images"
NAMES = [f"images/{path.name}" for path in sorted(PHOTOS.iterdir())]
NOWHERE = "http://127.0.0.1:9/"


class Publisher:
    """A server of the photos on this machine, which can harm them, and counts what it gave."""

    def __init__(self) -> None:
        self.asked: list[str] = []
        self.harm: dict[str, Callable[[bytes], bytes]] = {}
        publisher = self

        class Answer(BaseHTTPRequestHandler):
            def do_GET(self) -> None:
                name = self.path.lstrip("/")
                publisher.asked.append(name)
                whole = (PHOTOS / Path(name).name).read_bytes()
                self.send_response(200)
                self.send_header("Content-Length", str(len(whole)))  # a cut answer promises all of it
                self.end_headers()
                self.wfile.write(publisher.harm.get(name, bytes)(whole))

            def log_message(self, *_) -> None:
                pass

        self.server = ThreadingHTTPServer(("127.0.0.1", 0), Answer)
        self.url = f"http://127.0.0.1:{self.server.server_port}/"
        threading.Thread(target=self.server.serve_forever, daemon=True).start()


@pytest.fixture
def publisher() -> Iterator[Publisher]:
    one = Publisher()
    yield one
    one.server.shutdown()
    one.server.server_close()


@pytest.fixture
def place(tmp_path) -> Path:
    """A copy of the program that knows one more data set, `few`, and a configuration that asks for it."""
    for package in ("pipeline", "stages"):
        shutil.copytree(ROOT / package, tmp_path / package, ignore=shutil.ignore_patterns("__pycache__"))
    shutil.copy(ROOT / "unshade.py", tmp_path)
    (tmp_path / "few.yaml").write_text(
        f"workspace: workspace\nsources: {{dataset: few, colmap: '{MODEL}'}}\n"
        "undistort: {max_size_px: 96}\n"
    )
    return tmp_path


def publish_at(place: Path, url: str) -> None:
    """Let the copy know where the data set is published, and what it is."""
    few = {
        "url": url,
        "sha256": {
            name: hashlib.sha256((PHOTOS / Path(name).name).read_bytes()).hexdigest() for name in NAMES
        },
        "blake3": {name: digest_file(PHOTOS / Path(name).name) for name in NAMES},
    }
    (place / "stages/scene/datasets.json").write_text(json.dumps({"few": few}))


def unshade(place: Path, verb: str, *words: str) -> subprocess.CompletedProcess[str]:
    """Run the copy, with a cache of downloads of its own."""
    own = {"PYTHONPATH": str(place), "XDG_CACHE_HOME": str(place / "downloads"), "UNSHADE_DATA": None}
    line = [*PROGRAM, verb, "few.yaml", *words]
    return do(line, own, cwd=place)


def photos_of(place: Path) -> list[str]:
    """Names of all files among the downloads that could be taken for photos."""
    return sorted(path.name for path in (place / "downloads").rglob("*.exr"))


def test_results_of_a_published_set_are_reused_when_neither_network_nor_data_is_there(
    place, publisher, tried
):
    publish_at(place, publisher.url)
    assert "never run here; images, not on this machine, will be fetched" in unshade(place, "plan").stdout
    assert not publisher.asked
    first = unshade(place, "run", "--to", "undistort")
    assert first.returncode == 0, first.stderr
    assert sorted(publisher.asked) == NAMES
    before = results(place / "workspace")

    shutil.rmtree(place / "downloads")
    publish_at(place, NOWHERE)
    for verb in ("plan", "run"):
        again = unshade(place, verb, "--to", "undistort")
        assert again.returncode == 0, again.stderr
        said = one_line(again.stdout + again.stderr)
        assert said.count("images, not on this machine, is known by its") == (2 if verb == "plan" else 1)
    assert results(place / "workspace") == before

    other = unshade(place, "run", "--to", "undistort", "--set", "undistort.max_size_px=64")
    assert other.returncode == 2
    assert "Traceback" not in other.stderr
    assert "few is not on this machine and could not be fetched" in one_line(other.stderr)
    assert results(place / "workspace") == before
    tried("offline: run again without network and data", "reused by the digests of the data set", 2)
    tried("offline: another setting without network and data", "refused in a sentence")


def test_a_cut_or_altered_download_is_never_used_and_the_rest_need_not_come_again(place, publisher, tried):
    publish_at(place, publisher.url)
    harms = {"cut": lambda whole: whole[: len(whole) // 2], "altered": lambda whole: whole[:-1] + b"?"}
    for attack, harm in {**harms, "empty": lambda whole: b""}.items():
        publisher.harm = {NAMES[2]: harm}
        done = unshade(place, "run", "--to", "adopt_model")
        assert done.returncode == 2, done.stderr
        assert "Traceback" not in done.stderr
        assert "could not be fetched" in one_line(done.stderr)
        assert photos_of(place) == [Path(name).name for name in NAMES[:2]]
        tried(f"offline: a download that is {attack}", "refused in a sentence, never used")
    publisher.asked.clear()
    publisher.harm = {}
    (place / "downloads/unshade/few/images/tmpleft").write_bytes(b"of a killed download")
    done = unshade(place, "run", "--to", "adopt_model")
    assert done.returncode == 0, done.stderr
    assert sorted(publisher.asked) == NAMES[2:]
    assert not list((place / "downloads").rglob("tmp*"))
    tried("offline: run again after a broken download", "went on with what was missing")


def test_a_damaged_file_among_the_downloads_is_fetched_again(place, publisher, tried):
    publish_at(place, publisher.url)
    folder = place / "downloads/unshade/few/images"
    folder.mkdir(parents=True)
    for name in NAMES:
        shutil.copy(PHOTOS / Path(name).name, folder)
    (folder / Path(NAMES[1]).name).write_bytes(b"rot")
    assert unshade(place, "run", "--to", "adopt_model").returncode == 0
    assert publisher.asked == [NAMES[1]]
    tried("offline: a damaged file among the downloads", "noticed, fetched again")


def test_a_folder_of_the_users_that_is_gone_is_not_taken_for_what_it_was(tmp_path, tried):
    """Nothing proves that it would have the photos of the cached results still."""
    line = [*PROGRAM, "run", "--images", str(tmp_path / "photos")]
    done = do([*line, "--workspace", str(tmp_path / "w")])
    assert done.returncode == 2
    assert "does not exist; expected a folder" in one_line(done.stderr)
    tried("offline: a user's folder that is gone", "refused in a sentence")


def test_the_digests_of_the_fountain_are_those_of_its_files(data_folder, monkeypatch):
    monkeypatch.setenv("UNSHADE_DATA", str(data_folder))
    fountain = find_dataset("fountain-P11")
    assert fountain.is_here()
    assert fountain.blake3 == {name: digest_file(fountain.folder / name) for name in fountain.sha256}
    assert len(fountain.digests("images")) == 11
