"""EXRs in ACEScg: the matrix, the headers, and photo = albedo × shading there as well."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import OpenEXR
import pytest

import stages
from pipeline.request import check_flow
from stages import additions
from stages.formats.colour.icc_profiles import SRGB_IN_D50
from stages.formats.colour.rgb_primaries import ACESCG, REC_709, conversion
from stages.formats.images.exr import read_exr
from tests.rendered_scene import TINY, unshade, write_config
from tests.test_stories import actions

PUBLISHED = [  # sRGB to ACEScg with D65 adapted to ACES white, as colour management systems have it
    [0.6131, 0.3395, 0.0474],
    [0.0702, 0.9164, 0.0135],
    [0.0206, 0.1096, 0.8698],
]


def test_the_matrix_is_the_published_one_and_keeps_white():
    matrix = conversion(REC_709, ACESCG)
    np.testing.assert_allclose(matrix, PUBLISHED, atol=5e-4)
    np.testing.assert_allclose(matrix.sum(axis=1), 1, atol=1e-12)
    np.testing.assert_allclose(conversion(ACESCG, REC_709) @ matrix, np.eye(3), atol=1e-12)


def test_from_primaries_alone_come_the_colorants_of_srgbs_icc_profile():
    """The colorants of IEC 61966-2-1: XYZ under D50, whose primaries are X, Y and Z themselves."""
    xyz = (1.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.34567, 0.35850)
    found = conversion(REC_709, xyz) * SRGB_IN_D50.sum(axis=1)[:, None]
    np.testing.assert_allclose(found, SRGB_IN_D50, atol=5e-4)


def test_every_dataflow_is_sound_with_a_card_and_in_another_colour_space():
    for light in ("paper", "harmonics", "directions"):
        plain = stages.dataflow(["images"], light)
        for extended in (
            plain,
            additions.with_texture(plain),
            additions.with_delit_photos(additions.with_texture(plain)),
            additions.with_relighting(plain),
        ):
            calibrated = additions.with_calibration(extended)
            for flow in (
                calibrated,
                additions.with_colour_space(extended),
                additions.with_colour_space(calibrated),
            ):
                check_flow(flow, stages.kinds_of_sources(flow))
                places = [one.output for stage in flow for one in stage.gives if one.output]
                assert places.count("albedo") == 2  # EXRs once, PNGs once
                assert places.count("shading") == 2
                assert places.count("lighting.json") == 1


def chromaticities(path: Path) -> np.ndarray:
    with OpenEXR.File(str(path), header_only=True) as file:
        return np.ravel(file.header()["chromaticities"])[:8]


@pytest.mark.parametrize("card", [False, True])
def test_the_command_writes_acescg_and_goes_back(card, tmp_path, capsys):
    config = write_config(
        tmp_path / "scene.yaml",
        render=TINY | {"views": 1, "noise": 0.3},
        raycast={"reduce": 1},
        decomposition={"mode": "paper", "solver": "fast"},
    )
    output, words = tmp_path / "w/output", ["--white", "8,10,8,8@000=0.3"] if card else []
    assert unshade(capsys, "run", config, *words)[0] == 0
    before = {kind: read_exr(output / kind / "000.exr") for kind in ("albedo", "shading")}
    depth = (output / "depth/000.exr").read_bytes()
    code, told, said = unshade(capsys, "run", config, *words, "--colour-space", "acescg", "--json")
    assert code == 0, said
    assert [stage for stage, action in actions(told).items() if action == "run"] == ["colour_space"]
    after = {kind: read_exr(output / kind / "000.exr") for kind in ("albedo", "shading")}
    matrix = conversion(REC_709, ACESCG).T
    np.testing.assert_allclose(after["albedo"], before["albedo"] @ matrix, atol=1e-6)
    photo = (before["albedo"] * before["shading"]) @ matrix
    np.testing.assert_allclose(after["albedo"] * after["shading"], photo, atol=1e-5)
    for kind in after:
        np.testing.assert_allclose(chromaticities(output / kind / "000.exr"), ACESCG, atol=1e-6)
    assert (output / "depth/000.exr").read_bytes() == depth
    code, told, _ = unshade(capsys, "run", config, *words, "--json")
    assert code == 0 and set(actions(told).values()) == {"reuse"}
    np.testing.assert_array_equal(read_exr(output / "albedo/000.exr"), before["albedo"])
    np.testing.assert_allclose(chromaticities(output / "albedo/000.exr"), REC_709, atol=1e-6)


def test_an_unknown_colour_space_is_refused(tmp_path, capsys):
    code, _, said = unshade(
        capsys,
        "plan",
        "--images",
        tmp_path,
        "--set",
        "colour_space.exr=rec2020",
        "--workspace",
        tmp_path / "w",
    )
    assert code == 2 and "colour_space.exr is 'rec2020'" in said
