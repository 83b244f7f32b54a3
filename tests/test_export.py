"""What people open: one scale for all views, a sheet that holds every picture."""

from __future__ import annotations

import numpy as np
import pytest

from pipeline import UserError
from stages.export import ExportSettings, common_white, evenly
from stages.formats.images.contact_sheet import CAPTION_PX, MARGIN_PX, contact_sheet
from stages.formats.images.exr import read_exr, write_exr
from stages.formats.images.masks import kept_at
from stages.formats.images.photos import write_mask
from stages.raycast import chosen_views


def test_white_is_one_quantile_over_the_masked_pixels_of_all_views(tmp_path):
    bright = np.full((10, 10, 3), 4.0)
    bright[:5] = 1000.0  # outside the mask: must not count
    for name, image in {"a": np.full((10, 10, 3), 2.0), "b": bright}.items():
        write_exr(tmp_path / "albedo" / f"{name}.exr", image)
    write_mask(tmp_path / "mask/a.png", np.ones((10, 10), bool))
    write_mask(tmp_path / "mask/b.png", np.arange(10)[:, None] * np.ones((10, 10)) >= 5)
    whole, half = ExportSettings(white_quantile=1.0), ExportSettings(white_quantile=0.5)
    assert common_white(tmp_path / "albedo", tmp_path / "mask", ["a", "b"], whole) == (4.0, 2.0)
    assert common_white(tmp_path / "albedo", tmp_path / "mask", ["a", "b"], half) == (2.0, 2.0)


def test_views_of_the_sheet_are_spread_evenly_with_both_ends():
    names = [str(i) for i in range(10)]
    assert evenly(names, 20) == names
    assert evenly(names, 4) == ["0", "3", "6", "9"]
    assert evenly(names, 1) == ["0"]


def test_a_sheet_has_a_row_per_view_and_a_column_per_map():
    red, blue = np.zeros((20, 40, 3), np.uint8), np.zeros((40, 40, 3), np.uint8)
    red[..., 0], blue[..., 2] = 255, 255
    sheet = contact_sheet({"wide": [red, red], "Größe/höher": [blue, blue]}, ["photo", "albedo"], 40)
    assert sheet.shape[1] == 2 * (40 + MARGIN_PX) + MARGIN_PX
    first_row = MARGIN_PX + 2 * CAPTION_PX
    assert (sheet[first_row + 10, MARGIN_PX + 20] == (255, 0, 0)).all()
    assert (sheet[first_row + 20 + MARGIN_PX + CAPTION_PX + 20, 2 * MARGIN_PX + 60] == (0, 0, 255)).all()


def test_views_are_chosen_by_name_and_pattern_and_a_typo_is_named():
    names = ["a/1", "a/2", "b/1"]
    assert chosen_views(names, ()) == names
    assert chosen_views(names, ("b/*", "a/2")) == ["a/2", "b/1"]
    assert chosen_views(["a[1]", "b"], ("a[1]",)) == ["a[1]"]
    assert chosen_views(names, ("!b/*",)) == [name for name in names if name[0] != "b"]
    assert chosen_views(names, ("a/*", "!a/2")) == [
        name for name in names if name[0] == "a" and name != "a/2"
    ]
    assert chosen_views(["!a", "a"], ("!a",)) == ["!a"]  # a name fits itself
    with pytest.raises(UserError, match="no view is called 'a/3'; did you mean"):
        chosen_views(names, ("a/3",))
    with pytest.raises(UserError, match="no view is called 'a/3'"):
        chosen_views(names, ("!a/3",))
    with pytest.raises(UserError, match="leaves none of the 3 views"):
        chosen_views(names, ("a/1", "!a/*"))


def test_a_reduced_pixel_is_kept_only_if_all_of_it_is(tmp_path):
    kept = np.ones((4, 6), bool)
    kept[0, 0] = False
    write_mask(tmp_path / "v.png", kept)
    np.testing.assert_array_equal(kept_at(tmp_path / "v.png", (4, 6)), kept)
    np.testing.assert_array_equal(kept_at(tmp_path / "v.png", (2, 3)), [[False, True, True], [True] * 3])
    assert kept_at(tmp_path / "absent.png", (2, 3)).all()


def test_exr_keeps_every_bit_of_one_and_three_channels(tmp_path):
    rng = np.random.default_rng(0)
    for shape in [(5, 7), (5, 7, 3)]:
        image = rng.normal(size=shape).astype(np.float32)
        write_exr(tmp_path / "deep/x.exr", image)
        np.testing.assert_array_equal(read_exr(tmp_path / "deep/x.exr"), image)
    (tmp_path / "no.exr").write_bytes(b"not an image")
    with pytest.raises(UserError, match="cannot be read as OpenEXR"):
        read_exr(tmp_path / "no.exr")
