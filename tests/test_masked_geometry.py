"""Masks in `sfm` and `mvs`: a turntable before a still background, and points of the object alone."""

from __future__ import annotations

import shutil
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pycolmap
import pytest
from PIL import Image

import stages
from benchmarks.fountain_poses import errors, model_poses
from pipeline import UserError
from pipeline.config import check_settings
from stages.formats.colmap.depth_maps import read_map
from stages.formats.images.photos import encode_srgb8, read_mask, write_mask
from stages.formats.meshes.point_clouds import read_cloud
from stages.formats.meshes.triangle_meshes import read_mesh
from stages.mesh import MESH
from stages.motion.sfm_settings import SfmSettings
from stages.mvs import MVS, MvsSettings
from stages.scene.cameras import in_image, project
from stages.sfm import SFM
from stages.stereo.colmap_stereo import fusion_options, write_fusion_masks
from stages.stereo.workspace import open_workspace
from tests import stereo_scene
from tests.faults import photo_sets as sets

PHOTOS = 5
STILL = sets.around(1)[0]
NAMES = [f"turn_{index}" for index in range(PHOTOS)]
VIEWS = stereo_scene.cameras()
QUICK = {"engine": "cpu", "sweep_scale": 1.0, "patch_radius_px": 4, "sources": 4}


@pytest.fixture(scope="module")
def turntable() -> tuple[list[np.ndarray], list[np.ndarray]]:
    """Photos of a box that turns before a painted corner that does not, and where the box is in each."""
    alone = sets.turntable(PHOTOS, background=0)
    return sets.turntable(PHOTOS, background=1), [(photo > 0).any(axis=2) for photo in alone]


@pytest.fixture(scope="module")
def photos(turntable, tmp_path_factory) -> Path:
    cameras = [replace(STILL, name=name) for name in NAMES]
    return sets.write(tmp_path_factory.mktemp("photos"), cameras, turntable[0])


@pytest.fixture(scope="module")
def masks(turntable, tmp_path_factory) -> Path:
    """Masks as COLMAP names them."""
    folder = tmp_path_factory.mktemp("masks")
    for name, box in zip(NAMES, turntable[1], strict=True):
        write_mask(folder / f"{name}.png.png", box)
    return folder


def place(make_job: Callable, folder: Path, images: Path, settings: dict | None = None, **inputs: Path):
    job = make_job(folder, SFM, SfmSettings(**settings or {}), images=images, **inputs)
    SFM.run(job)
    return job


def assert_placed_around_the_box(job) -> None:
    around = [replace(c, name=n) for c, n in zip(sets.as_if_around(STILL, PHOTOS), NAMES, strict=True)]
    assert job.facts["registered"] == PHOTOS
    centre_mm, rotation_deg = errors(model_poses(job.outputs["model"]), sets.true_poses(around))
    assert centre_mm.max() < 40 and rotation_deg.max() < 2  # at 3.4 units, taken for metres


def test_a_turntable_before_a_still_background_is_refused_and_told_of_masks(
    make_job, tmp_path, photos, masks
):
    """With masks, too, as long as they hold for the albedo only."""
    with pytest.raises(UserError, match=r"stands still.*--masks.*sfm\.within_masks=true"):
        place(make_job, tmp_path, photos, masks=masks)


def test_within_masks_it_is_placed(make_job, tmp_path, photos, masks, turntable):
    job = place(make_job, tmp_path, photos, {"within_masks": True}, masks=masks)
    assert_placed_around_the_box(job)
    assert job.facts["kept_by_masks"] == pytest.approx(np.mean(turntable[1]), abs=1e-4)


def test_within_alpha_channels_as_well_unless_they_are_set_aside(make_job, tmp_path, turntable):
    for name, photo, box in zip(NAMES, *turntable, strict=True):
        codes = np.dstack([encode_srgb8(photo), np.where(box, 255, 0).astype(np.uint8)])
        (tmp_path / "photos").mkdir(exist_ok=True)
        Image.fromarray(codes).save(tmp_path / "photos" / f"{name}.png")
    job = place(make_job, tmp_path / "with", tmp_path / "photos", {"within_masks": True})
    assert_placed_around_the_box(job)
    with pytest.raises(UserError, match="no photo has a mask.*--masks DIR"):
        place(make_job, tmp_path / "out", tmp_path / "photos", {"within_masks": True, "alpha": False})


def test_features_lie_within_the_masks_at_any_size(make_job, tmp_path, photos, masks, turntable):
    """Of photos that are reduced before features are sought; one without a mask has them everywhere."""
    some = tmp_path / "masks"
    some.mkdir()
    for name in NAMES[1:]:
        (some / f"{name}.png").write_bytes((masks / f"{name}.png.png").read_bytes())
    job = place(make_job, tmp_path, photos, {"within_masks": True, "max_size_px": 200}, masks=some)
    said = "1 of 5 photos have no mask, and features everywhere: turn_0.png. Give theirs as well"
    assert any(warning.startswith(said) for warning in job.warnings)
    with pycolmap.Database.open(job.outputs["database"]) as database:
        share_in_box = []
        for index, box in enumerate(turntable[1]):
            column, row = database.read_keypoints(index + 1)[:, :2].astype(int).T
            share_in_box.append(box[row, column].mean())
    assert share_in_box[0] < 0.9
    assert min(share_in_box[1:]) > 0.98  # but for the rounding of a pixel


def test_masks_that_are_no_help_are_refused_in_a_sentence(make_job, tmp_path, photos):
    def refused(folder: str, kept: np.ndarray) -> str:
        for name in NAMES:
            write_mask(tmp_path / folder / f"{name}.png", kept)
        with pytest.raises(UserError) as refusal:
            place(
                make_job,
                tmp_path / f"{folder} out",
                photos,
                {"within_masks": True},
                masks=tmp_path / folder,
            )
        return str(refusal.value)

    shape = STILL.shape
    assert "No mask of the photos in" in refused("black", np.zeros(shape, bool))
    assert "masks must have their photo's size" in refused("small", np.ones((shape[0] // 2, shape[1]), bool))


@pytest.fixture(scope="module")
def workspace(tmp_path_factory) -> Path:
    return stereo_scene.write_workspace(tmp_path_factory.mktemp("workspace"), VIEWS)


@pytest.fixture(scope="module")
def balls() -> list[np.ndarray]:
    """Where the sphere is in each view."""
    found = []
    for camera in VIEWS:
        traced = stereo_scene.trace(camera)
        found.append(np.linalg.norm(traced.normals - stereo_scene.WALL_NORMAL, axis=2) > 1e-6)
        found[-1] &= traced.depth > 0
    return found


@pytest.fixture(scope="module")
def kept(balls, tmp_path_factory) -> Path:
    """The masks as `undistort` hands them on."""
    folder = tmp_path_factory.mktemp("kept")
    for camera, ball in zip(VIEWS, balls, strict=True):
        write_mask(folder / f"{camera.name}.png", ball)
    return folder


@pytest.fixture(scope="module")
def within(make_job, workspace, kept, tmp_path_factory):
    settings = MvsSettings(**QUICK, within_masks=True)
    job = make_job(tmp_path_factory.mktemp("within"), MVS, settings, workspace=workspace, kept=kept)
    MVS.run(job)
    return job


def off_the_ball(x_in_world: np.ndarray) -> np.ndarray:
    return np.abs(np.linalg.norm(x_in_world - stereo_scene.CENTRE, axis=1) - stereo_scene.RADIUS)


def test_within_masks_stereo_finds_the_sphere_and_nothing_of_the_wall(within, balls):
    x_in_world, _, _ = read_cloud(within.outputs["fused"])
    assert len(x_in_world) == within.facts["fused_points"] > 500
    assert off_the_ball(x_in_world).max() < 0.15
    for camera, ball in zip(VIEWS, balls, strict=True):
        depth = read_map(within.outputs["depth_maps"] / f"depth_maps/{camera.name}.png.geometric.bin")
        assert not depth[~ball].any()
        assert read_mask(within.outputs["background"] / f"{camera.name}.png")[~ball].all()
        assert (depth[ball] > 0).mean() > 0.5


def test_and_the_mesh_has_no_background(within, make_job, workspace, tmp_path):
    job = make_job(tmp_path, MESH, workspace=workspace, **within.outputs)
    MESH.run(job)
    surface = read_mesh(job.outputs["mesh"])
    assert len(surface.faces) > 500
    assert off_the_ball(surface.vertices).max() < 0.2


def test_inside_the_masks_depth_is_what_it_was(within, make_job, workspace, balls, tmp_path):
    """Masks take away, and change nothing of what they leave."""
    whole = make_job(tmp_path, MVS, MvsSettings(**QUICK), workspace=workspace)
    MVS.run(whole)
    for camera, ball in zip(VIEWS, balls, strict=True):
        name = f"depth_maps/{camera.name}.png.geometric.bin"
        one, other = (read_map(job.outputs["depth_maps"] / name) for job in (within, whole))
        np.testing.assert_array_equal(one, np.where(ball, other, 0))


def test_smaller_sizes_keep_within_the_masks_too(make_job, workspace, kept, tmp_path):
    settings = MvsSettings(**QUICK, within_masks=True, gaps={"least_px": 64, "reach_footprints": 0.01})
    smaller = workspace.parent / "smaller"
    views = stereo_scene.cameras(width=160, height=120)
    stereo_scene.write_workspace(smaller, views)
    for camera in views:
        traced = stereo_scene.trace(camera)
        ball = np.linalg.norm(traced.normals - stereo_scene.WALL_NORMAL, axis=2) > 1e-6
        write_mask(tmp_path / "kept" / f"{camera.name}.png", ball & (traced.depth > 0))
    job = make_job(tmp_path / "out", MVS, settings, workspace=smaller, kept=tmp_path / "kept")
    MVS.run(job)
    assert job.facts["points_of_smaller_sizes"] > 0
    x_in_world, _, _ = read_cloud(job.outputs["fused"])
    assert off_the_ball(x_in_world).max() < 0.2


def test_sparse_points_keep_within_the_masks(make_job, workspace, kept, tmp_path):
    settings = MvsSettings(engine="sparse", within_masks=True)
    job = make_job(tmp_path, MVS, settings, workspace=workspace, kept=kept)
    MVS.run(job)
    x_in_world, _, _ = read_cloud(job.outputs["fused"])
    assert len(x_in_world) > 20 and off_the_ball(x_in_world).max() < 1e-3


def test_colmap_s_fusion_takes_our_masks(within, workspace, kept, tmp_path):
    """As the engine cuda hands them over; with depth maps of our own, for PatchMatch takes a card."""

    shutil.copytree(workspace, tmp_path / "w")
    whole = tmp_path / "w" / "stereo"
    shutil.copytree(within.outputs["depth_maps"], whole)
    (whole / "fusion.cfg").write_text("".join(f"{camera.name}.png\n" for camera in VIEWS))
    left_half = tmp_path / "left"
    for camera in VIEWS:
        write_mask(left_half / f"{camera.name}.png", np.arange(camera.width) < 60 + np.zeros((90, 1)))
    opened = open_workspace(tmp_path / "w", left_half)
    options = fusion_options(
        MvsSettings(), len(opened.cameras), write_fusion_masks(opened, tmp_path / "for COLMAP")
    )
    options.num_threads = 1
    pycolmap.stereo_fusion(tmp_path / "fused.ply", tmp_path / "w", options=options, output_type="PLY")
    x_in_world, _, _ = read_cloud(tmp_path / "fused.ply")
    everything, _, _ = read_cloud(within.outputs["fused"])
    assert 50 < len(x_in_world) < 0.9 * len(everything)
    in_left_half = np.zeros(len(x_in_world), int)
    for camera in VIEWS:
        xy, z = project(camera, x_in_world)
        in_left_half += in_image(camera, xy, z) & (xy[:, 0] < 62)
    assert in_left_half.min() >= 2  # three pixels must agree, of two views at least


def test_stereo_within_masks_that_are_not_there_is_refused(make_job, workspace, tmp_path):
    (tmp_path / "kept").mkdir()
    job = make_job(
        tmp_path / "out", MVS, MvsSettings(within_masks=True), workspace=workspace, kept=tmp_path / "kept"
    )
    with pytest.raises(UserError, match=r"mvs\.within_masks is set, but no view has a mask.*--masks DIR"):
        MVS.run(job)


@pytest.mark.parametrize(("stage", "taken"), [("sfm", "masks"), ("mvs", "kept")])
def test_only_what_keeps_within_masks_depends_on_them(stage, taken):
    declared = {one.name: one.settings for one in stages.ALL_STAGES}

    def inputs(given: dict) -> tuple[str, ...]:
        settings = check_settings(declared, given)
        flow = stages.keeping_within_masks(stages.dataflow(["images", "masks"]), settings)
        (one,) = (one for one in flow if one.name == stage)
        return (*one.takes, *one.may_take)

    assert taken not in inputs({})
    assert taken in inputs({stage: {"within_masks": True}})
