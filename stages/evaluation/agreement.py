"""Measures without truth: agreement between views, between two lights, of albedo × shading with photos."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
import scipy.sparse as sp

from pipeline import UserError
from stages.evaluation.judged_views import CHANNELS, JudgedView, channel_values
from stages.evaluation.scaled_error import least_squares_scale


@dataclass(frozen=True, eq=False)
class Correspondences:
    """Pixels of two views that show the same surface point.

    Attributes
    ----------
    links : mapping of (name i, name j) to csr_array, shape (|Ω^i|, |Ω^j|)
        C_ij, as the `correspondence` stage makes it.
    masks : mapping of name to ndarray, shape (h, w), bool
        Ω: rows and columns of the matrices are its pixels, row by row.
    """

    links: Mapping[tuple[str, str], sp.csr_array]
    masks: Mapping[str, np.ndarray]


def consistency(
    views: Sequence[JudgedView], correspondences: Correspondences
) -> tuple[tuple[float, ...], int]:
    """Compute mean |ρ^i − ρ^j| of corresponding pixels over the mean albedo, per channel; and their number.

    Correspondences count where both pixels are judged; pairs with a view that is not among `views` are
    skipped. The mean albedo is that of the judged pixels of all views. nan without correspondences, or where
    the mean albedo is not positive.

    Raises
    ------
    UserError
        A matrix does not fit its masks.
    """
    by_name = {view.name: view for view in views}
    differences = []
    for (name_i, name_j), matrix in correspondences.links.items():
        if name_i in by_name and name_j in by_name:
            view_i, view_j = by_name[name_i], by_name[name_j]
            mask_i, mask_j = (correspondences.masks[name] for name in (name_i, name_j))
            _check_fit((name_i, name_j), matrix, (mask_i, mask_j), (view_i, view_j))
            p, q = matrix.tocoo().coords
            kept = view_i.judged[mask_i][p] & view_j.judged[mask_j][q]
            albedo_i = view_i.prediction[mask_i][p[kept]].astype(np.float64)
            differences.append(np.abs(albedo_i - view_j.prediction[mask_j][q[kept]]))
    count = sum(len(difference) for difference in differences)
    if not count:
        return (float("nan"),) * len(CHANNELS), 0
    gaps = np.concatenate(differences).mean(axis=0)
    means = [float(channel_values(views, channel)[0].mean()) for channel in range(len(CHANNELS))]
    return tuple(
        float(gap) / mean if mean > 0 else float("nan") for gap, mean in zip(gaps, means, strict=True)
    ), count


def _check_fit(
    names: tuple[str, str],
    matrix: sp.csr_array,
    masks: tuple[np.ndarray, np.ndarray],
    views: tuple[JudgedView, JudgedView],
) -> None:
    expected = tuple(int(mask.sum()) for mask in masks)
    same_size = all(mask.shape == view.judged.shape for mask, view in zip(masks, views, strict=True))
    if matrix.shape != expected or not same_size:
        raise UserError(
            f"The correspondences of {names[0]} and {names[1]} are between {matrix.shape[0]} and "
            f"{matrix.shape[1]} pixels, the masks have {expected[0]} and {expected[1]}; expected the masks "
            "that they were made with. Give these with --masks."
        )


def photometric_residual(
    image: np.ndarray, albedo: np.ndarray, shading: np.ndarray, mask: np.ndarray
) -> tuple[float, ...]:
    """Compute median |I − ρ·S| over median I, per channel, on the masked pixels of one view or many stacked.

    The median is robust to shadow edges and highlights, which the model does not explain.

    Parameters
    ----------
    image, albedo, shading : ndarray, shape (..., 3)
        Linear.
    mask : ndarray, shape (...), bool
        nan where it is empty, or the image mostly black.
    """
    if not mask.any():
        return (float("nan"),) * len(CHANNELS)
    residual = np.median(np.abs(image - albedo * shading)[mask].astype(np.float64), axis=0)
    bright = np.median(image[mask].astype(np.float64), axis=0)
    return tuple(float(r / b) if b > 0 else float("nan") for r, b in zip(residual, bright, strict=True))


def relative_difference(first: np.ndarray, second: np.ndarray) -> tuple[float, ...]:
    """Compute the RMS difference of two sets of values after one scale per channel, over the first's mean.

    ``√(mean (a − s·b)²) / mean a`` with the least-squares ``s = Σ a·b / Σ b²``. Of one scene under two lights
    this measures the stability of albedo, to be compared with the same figure of the photos.

    Parameters
    ----------
    first, second : ndarray, shape (N, 3)
        a and b, linear: the same pixels of all views together.

    Returns
    -------
    tuple of 3 floats
        nan where the first has no positive mean.
    """
    differences = []
    for a, b in zip(first.T.astype(np.float64), second.T.astype(np.float64), strict=True):
        mean = float(a.mean()) if a.size else 0.0
        gap = a - least_squares_scale(b, a) * b
        differences.append(float(np.sqrt((gap * gap).mean())) / mean if mean > 0 else float("nan"))
    return tuple(differences)
