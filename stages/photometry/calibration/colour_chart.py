"""The colour chart of 24 patches: layout and reflectances."""

from __future__ import annotations

import numpy as np

from stages.formats.colour.icc_profiles import SRGB_IN_D50

ROWS, COLUMNS = 4, 6
FIRST_GREY = 18  # of the last row, white to black
# CIE L*a*b* under D50, 2° observer, row by row from dark skin to black: ColorChecker Classic as made since
# November 2014, as published by X-Rite (now Calibrite), "ColorChecker24_After_Nov2014", M0.
LAB_IN_D50 = np.array(
    [
        *[(37.54, 14.37, 14.92), (64.66, 19.27, 17.50), (49.32, -3.82, -22.54)],
        *[(43.46, -12.74, 22.72), (54.94, 9.61, -24.79), (70.48, -32.26, -0.37)],
        *[(62.73, 35.83, 56.50), (39.43, 10.75, -45.17), (50.57, 48.64, 16.67)],
        *[(30.10, 22.54, -20.87), (71.77, -24.13, 58.19), (71.51, 18.24, 67.37)],
        *[(28.37, 15.42, -49.80), (54.38, -39.72, 32.27), (42.43, 51.05, 28.62)],
        *[(81.80, 2.67, 80.41), (50.63, 51.28, -14.12), (49.57, -29.71, -28.32)],
        *[(95.19, -1.03, 2.93), (81.29, -0.57, 0.44), (66.89, -0.75, -0.06)],
        *[(50.76, -0.13, 0.14), (35.63, -0.46, -0.48), (20.64, 0.07, -0.46)],
    ]
)
D50 = SRGB_IN_D50.sum(axis=1)  # XYZ of white
LINEAR_FROM, SLOPE, OFFSET = 6 / 29, 3 * (6 / 29) ** 2, 4 / 29  # of CIE's f⁻¹


def chart_reflectances() -> np.ndarray:
    """Compute the patches' reflectances in linear sRGB, (24, 3).

    White of D50 becomes that of D65 by Bradford's adaptation, so that a perfect diffuser is (1, 1, 1). Cyan
    lies outside of sRGB: its red is negative.
    """
    lightness, a, b = LAB_IN_D50.T
    f_y = (lightness + 16) / 116
    f = np.stack([f_y + a / 500, f_y, f_y - b / 200], axis=1)
    xyz = D50 * np.where(f > LINEAR_FROM, f**3, SLOPE * (f - OFFSET))
    return xyz @ np.linalg.inv(SRGB_IN_D50).T


def chart_boxes(gap: float, centre: float) -> np.ndarray:
    """List the middle parts of the patches in the unit square: left, top, right, bottom, (24, 4).

    Parameters
    ----------
    gap : float
        Between patches, of a patch's side.
    centre : float
        Part of each side that is used.
    """
    row, column = np.divmod(np.arange(ROWS * COLUMNS), COLUMNS)
    place = np.stack([column, row], axis=1)
    sides = 1 / (np.array([COLUMNS, ROWS]) + gap * np.array([COLUMNS - 1, ROWS - 1]))
    middle = (place * (1 + gap) + 1 / 2) * sides
    return np.concatenate([middle - centre * sides / 2, middle + centre * sides / 2], axis=1)
