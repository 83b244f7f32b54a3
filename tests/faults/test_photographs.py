"""Photographs as people take them: the real command line gives poses that are right, or says what to do."""

from __future__ import annotations

import json
import shutil
import subprocess
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
import pycolmap
import pytest

from benchmarks.fountain_poses import errors, model_poses, newest_model
from pipeline.cache.store import Store
from stages.formats.colmap.model import read_model, registered
from stages.scene.cameras import Camera
from tests.faults import photo_sets as sets
from tests.faults.program import PHOTOS, PROGRAM, ROOT


@dataclass(frozen=True)
class Outcome:
    """How a command ended: exit code, what it said without line breaks, and its workspace."""

    code: int
    said: str
    workspace: Path

    @property
    def model(self) -> pycolmap.Reconstruction:
        return read_model(newest_model(self.workspace))

    @property
    def placed(self) -> list[str]:
        return [image.name for image in registered(self.model)]

    @property
    def focal_px(self) -> dict[str, float]:
        model = self.model
        return {i.name: model.cameras[i.camera_id].mean_focal_length() for i in registered(model)}

    @property
    def facts(self) -> dict:
        record = Store(self.workspace).current("sfm")
        assert record is not None
        return dict(record.facts)

    def worst(self, cameras: list[Camera]) -> tuple[float, float]:
        """Largest errors of the poses, millimetres where a unit is a metre, and degrees."""
        centre_mm, rotation_deg = errors(model_poses(newest_model(self.workspace)), sets.true_poses(cameras))
        return centre_mm.max(), rotation_deg.max()


def run(folder: Path, photos: Path, *words: str, to: str | None = "sfm") -> Outcome:
    """`unshade run --images PHOTOS`, as a process."""
    workspace = folder / "workspace"
    command = [*PROGRAM, "run", "--images", photos, "--workspace", workspace]
    command += ["--to", to] if to else []
    done = subprocess.run([*command, *words], cwd=ROOT, capture_output=True, text=True, timeout=1500)
    said = " ".join((done.stdout + done.stderr).split())
    assert "Traceback" not in said and done.returncode in (0, 2), said
    return Outcome(done.returncode, said, workspace)


def refused(folder: Path, photos: Path, *parts: str) -> str:
    """The sentence of a set that is refused, in which all `parts` are."""
    outcome = run(folder, photos)
    assert outcome.code == 2
    for part in parts:
        assert part in outcome.said, outcome.said
    return outcome.said


def test_no_photo_one_and_forty_equal_ones(tmp_path, tried):
    (tmp_path / "none").mkdir()
    refused(tmp_path, tmp_path / "none", "There are no photos in", "Give the folder that holds them.")
    (camera,) = sets.around(1)
    one = sets.write(tmp_path / "one", [camera], sets.photos([camera]))
    for number in range(39):
        shutil.copy(one / "view_00.png", one / f"view_{number + 1:02d}.png")
    refused(
        tmp_path, one, "39 of 40 photos are copies", "one readable photo (and copies of it)", "Add photos"
    )
    tried("no photo, 40 equal photos", "refused in a sentence", times=2)


def test_copies_are_left_out_and_photos_encoded_again_stand_where_they_were_taken(tmp_path, tried):
    cameras = sets.around(4)
    photos = sets.write(tmp_path / "photos", cameras, sets.photos(cameras))
    shutil.copy(photos / "view_00.png", photos / "zz.png")
    sets.reencode(photos / "view_01.png", photos / "again.jpg")
    outcome = run(tmp_path, photos)
    assert "1 of 6 photos are copies of another, pixel by pixel, and left out: zz.png" in outcome.said
    assert outcome.placed == ["again.jpg", *(f"view_{i:02d}.png" for i in range(4))]
    centre_mm, rotation_deg = outcome.worst([*cameras, replace(cameras[1], name="again")])
    assert centre_mm < 10 and rotation_deg < 0.5
    centres = dict(zip(outcome.placed, model_poses(newest_model(outcome.workspace)).centres, strict=True))
    apart = np.linalg.norm(centres["again.jpg"] - centres["view_01.png"])
    assert apart < 0.01 * np.linalg.norm(centres["view_00.png"] - centres["view_03.png"])
    tried("a photo copied, and one encoded again", "counted and left out; poses right")


def test_two_zooms_in_one_folder_get_their_own_focal_lengths(tmp_path, tried):
    """With one for all, the poses are wrong by a tenth of the scene, without a message."""
    cameras = [replace_focal(c, 450.0) if i % 2 else c for i, c in enumerate(sets.around(6))]
    outcome = run(tmp_path, sets.write(tmp_path / "photos", cameras, sets.photos(cameras)))
    assert "not taken with one focal length" in outcome.said and "per_folder" in outcome.said
    assert len(outcome.placed) == 6
    for camera in cameras:
        assert outcome.focal_px[f"{camera.name}.png"] == pytest.approx(camera.focal_px, rel=0.03)
    centre_mm, rotation_deg = outcome.worst(cameras)
    assert centre_mm < 40 and rotation_deg < 2
    tried("two zooms in one folder", "noticed, said; poses and focal lengths right")


def test_a_panorama_is_not_taken_for_a_model(tmp_path, tried):
    place = sets.around(3)[1].centre_in_world
    cameras = [sets.looking(f"turn_{i}", place, sets.TARGET + [0.3 * i - 0.3, 0, 0]) for i in range(3)]
    photos = sets.write(tmp_path / "photos", cameras, sets.photos(cameras))
    refused(tmp_path, photos, "from one place", "explains 3 of 3 matching pairs", "a step to the side")
    tried("photos from one place, the camera turned", "refused in a sentence")


def test_a_turntable_before_a_background_that_stands_still(tmp_path, tried):
    cameras = [replace(sets.around(1)[0], name=f"turn_{i}") for i in range(4)]
    photos = sets.write(tmp_path / "photos", cameras, sets.turntable(4, background=1))
    refused(tmp_path, photos, "6 of 6 matching pairs a part of the picture stands still", "plain cloth")
    tried("a turntable before a still background", "refused in a sentence")


def test_two_photos_are_placed_and_their_focal_length_is_not_trusted(tmp_path, tried):
    """They were refused as sharing too few features, with a thousand matches."""
    cameras = sets.around(4)[1:3]
    outcome = run(tmp_path, sets.write(tmp_path / "photos", cameras, sets.photos(cameras)))
    assert outcome.code == 0 and len(outcome.placed) == 2 and outcome.facts["points"] > 500
    assert "focal length of view_01.png, view_02.png is uncertain" in outcome.said
    tried("two photos", "a result; its uncertain focal length said")


def test_photos_of_which_some_cannot_be_placed(tmp_path, tried):
    """Strangers are counted and named, parts that do not connect too."""
    cameras, strangers = sets.around(4), [replace(c, name=f"other_{i}") for i, c in enumerate(sets.around(3))]
    photos = sets.write(tmp_path / "photos", cameras, sets.photos(cameras))
    sets.write(photos, strangers, sets.photos(strangers, seed=5))
    outcome = run(tmp_path, photos)
    for part in (
        "3 of 7 photos could not be placed and are left out: other_0.png, other_1.png, other_2.png.",
        "not kept: 3 (other_0.png, other_1.png, other_2.png). Photos in between",
        "No photo that is left out shares a feature with one that is placed",
    ):
        assert part in outcome.said, outcome.said
    centre_mm, rotation_deg = outcome.worst(cameras)
    assert centre_mm < 10 and rotation_deg < 0.5
    tried("photos of something else among the others", "left out, counted and named; poses right")


def test_a_very_long_lens_is_not_used_in_silence(tmp_path, tried):
    cameras = sets.around(4, focal_px=20000.0)
    outcome = run(tmp_path, sets.write(tmp_path / "photos", cameras, sets.photos(cameras)))
    assert "is uncertain" in outcome.said or outcome.code == 2, outcome.said
    tried("a lens of 62 image widths", "its uncertain focal length said")


def replace_focal(camera: Camera, focal_px: float) -> Camera:
    """The camera with its zoom turned."""
    return sets.looking(camera.name, camera.centre_in_world, sets.TARGET, focal_px=focal_px)


@dataclass(frozen=True)
class Set:
    """A set that has to be placed: cameras, photos, and bounds of the errors, mm and degrees."""

    cameras: list[Camera]
    photos: list[np.ndarray]
    centre_mm: float = 10
    rotation_deg: float = 0.6
    placed: int | None = None  # at least so many; None: all


def several_sizes() -> Set:
    larger = sets.around(8, size=(400, 300), focal_px=375.0)
    cameras = [larger[i] if i % 2 else camera for i, camera in enumerate(sets.around(8))]
    return Set(cameras, sets.photos(cameras))


def both_orientations() -> Set:
    upright = sets.around(8, size=(240, 320))
    cameras = [upright[i] if i % 2 else camera for i, camera in enumerate(sets.around(8))]
    return Set(cameras, sets.photos(cameras))


def some_blurred() -> Set:
    cameras = sets.around(8)
    photos = [sets.blurred(p, 25) if i in (1, 4, 6) else p for i, p in enumerate(sets.photos(cameras))]
    return Set(cameras, photos, placed=5)


def three_stops() -> Set:
    cameras = sets.around(8)
    return Set(cameras, [photo / (8 if i % 2 else 1) for i, photo in enumerate(sets.photos(cameras))])


def of(cameras: list[Camera]) -> Set:
    return Set(cameras, sets.photos(cameras))


@pytest.mark.slow
@pytest.mark.parametrize(
    ("what", "make"),
    [
        ("several sizes", several_sizes),
        ("portrait and landscape", both_orientations),
        ("motion blur in three of eight", some_blurred),
        ("exposures three stops apart", three_stops),
        ("three photos", lambda: of(sets.around(3))),
        ("a planar wall", lambda: of(sets.before_a_wall(6))),
        ("a very short lens", lambda: of(sets.around(8, focal_px=100.0))),
        ("no fault", lambda: of(sets.around(8))),
    ],
)
def test_sets_that_are_placed(what, make, tmp_path, tried):
    given = make()
    outcome = run(tmp_path, sets.write(tmp_path / "photos", given.cameras, given.photos))
    assert outcome.code == 0, outcome.said
    left_out = len(given.cameras) - len(outcome.placed)
    assert len(outcome.placed) >= (given.placed or len(given.cameras))
    assert (f"{left_out} of {len(given.cameras)} photos could not be placed" in outcome.said) == bool(
        left_out
    )
    centre_mm, rotation_deg = outcome.worst(given.cameras)
    assert centre_mm < given.centre_mm and rotation_deg < given.rotation_deg
    for camera in given.cameras:
        if f"{camera.name}.png" in outcome.placed:
            assert outcome.focal_px[f"{camera.name}.png"] == pytest.approx(camera.focal_px, rel=0.03)
    assert "not taken with one focal length" not in outcome.said
    tried(what, "poses and focal lengths right" + (", photos left out named" if left_out else ""))


@pytest.mark.slow
@pytest.mark.parametrize("zoomed", [(3,), (6, 7), (5, 6, 7, 8, 9)])
def test_zooms_of_any_share(zoomed, tmp_path, tried):
    cameras = [
        replace_focal(c, 500.0) if i in zoomed else c
        for i, c in enumerate(sets.around(max(8, max(zoomed) + 1)))
    ]
    outcome = run(tmp_path, sets.write(tmp_path / "photos", cameras, sets.photos(cameras)))
    assert "not taken with one focal length" in outcome.said
    for camera in cameras:
        assert outcome.focal_px[f"{camera.name}.png"] == pytest.approx(camera.focal_px, rel=0.03)
    tried("two zooms in one folder", "noticed, said; poses and focal lengths right")


@pytest.mark.slow
@pytest.mark.parametrize("background", [0.15, 1])
def test_turntables(background, tmp_path, tried):
    cameras = [replace(sets.around(1)[0], name=f"turn_{i}") for i in range(8)]
    photos = sets.write(tmp_path / "photos", cameras, sets.turntable(8, background))
    refused(tmp_path, photos, "stands still", "plain cloth")
    tried("a turntable before a still background", "refused in a sentence")


@pytest.mark.slow
def test_a_turntable_before_black_is_a_model_of_what_turns(tmp_path, tried):
    """And its focal length, which a box of the picture's middle hardly determines, is warned of."""
    still = sets.around(1)[0]
    cameras = [replace(still, name=f"turn_{i}") for i in range(8)]
    outcome = run(tmp_path, sets.write(tmp_path / "photos", cameras, sets.turntable(8, background=0)))
    assert outcome.code == 0 and "stands still" not in outcome.said
    certain = "is uncertain" not in outcome.said
    assert certain or outcome.facts["focal_deviation"]
    _, rotation_deg = outcome.worst(sets.as_if_around(still, 8))
    assert rotation_deg < 6
    tried("a turntable before black", "a model of the object; uncertain focal length said")


@pytest.mark.slow
@pytest.mark.parametrize(("focal_px", "radial"), [(300.0, -0.08), (1000.0, 0.0), (200.0, 0.0)])
def test_panoramas_of_other_lenses(focal_px, radial, tmp_path, tried):
    place = sets.around(3, focal_px=focal_px)[1].centre_in_world
    targets = [sets.TARGET + [0.2 * i - 0.4, 0.3 - 0.15 * i, 0] for i in range(5)]
    cameras = [sets.looking(f"t{i}", place, t, focal_px=focal_px) for i, t in enumerate(targets)]
    photos = sets.write(tmp_path / "photos", cameras, sets.photos(cameras, radial=radial))
    refused(tmp_path, photos, "from one place", "a step to the side")
    tried("photos from one place, the camera turned", "refused in a sentence")


@pytest.mark.slow
def test_a_wall_square_on_is_no_panorama_and_its_focal_length_is_warned_of(tmp_path, tried):
    """A shift along a wall looks nearly like a turn, and no focal length can be had from it."""
    steps = [1.6 + 0.08 * i for i in range(6)]
    cameras = [sets.looking(f"wall_{i}", (1.6, y, 2), (0, y, 2)) for i, y in enumerate(steps)]
    outcome = run(tmp_path, sets.write(tmp_path / "photos", cameras, sets.photos(cameras)))
    assert outcome.code == 0 and "nothing in the photos determines it" in outcome.said
    tried("a wall photographed square on", "a result; its uncertain focal length said")


@pytest.mark.slow
def test_a_burst_encoded_again_is_refused_before_it_is_placed(tmp_path, tried):
    """It took minutes, and was said to share too few features."""
    cameras = [replace(sets.around(1)[0], name=f"burst_{i}") for i in range(10)]
    photos = sets.write(tmp_path / "photos", cameras, sets.photos(cameras))
    for quality, photo in enumerate(sorted(photos.iterdir()), 60):
        sets.reencode(photo, photo.with_suffix(".jpg"), quality)
        photo.unlink()
    refused(tmp_path, photos, "45 of 45 matching pairs", "leave out the copies")
    tried("one photo encoded ten times", "refused in a sentence")


@pytest.mark.slow
def test_blur_a_copy_and_a_stranger_on_the_way_to_the_albedo(tmp_path, tried):
    """The whole program on the sample's photos, with what goes wrong among them."""
    photos = Path(shutil.copytree(PHOTOS, tmp_path / "photos"))
    shutil.copy(photos / "000.jpg", photos / "copy.jpg")
    sets.blur_file(photos / "005.jpg", 41)
    stranger = replace(sets.around(1)[0], name="stranger")
    sets.write(photos, [stranger], sets.photos([stranger], seed=9))
    words = ("raycast.reduce=3", "transfer.max_vertices=30000")
    outcome = run(tmp_path, photos, *(part for word in words for part in ("--set", word)), to=None)
    assert outcome.code == 0, outcome.said
    assert "are copies of another, pixel by pixel, and left out: copy.jpg" in outcome.said
    assert "left out: " in outcome.said and "stranger.png" in outcome.said
    views = sorted(path.stem for path in (outcome.workspace / "output/albedo").glob("*.png"))
    assert views == sorted(Path(name).stem for name in outcome.placed)
    assert len(json.loads((outcome.workspace / "output/cameras.json").read_text())) > 0
    tried("blur, a copy and a stranger, to the albedo", "left out and named; albedo of the others")
