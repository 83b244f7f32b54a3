"""PatchMatch refinement of depth and normal: try neighbours' planes and random changes, keep the better.

Pixels are coloured like a chessboard; red ones depend only on black ones and the other way round, and
every random number is a hash of pixel, pass and try. So rows can be shared among any number of threads
without changing a bit.

Cost of a plane at a pixel: over the k sources that match its present plane best, the mean of 1 − ZNCC (and,
once the sources have depth maps, of the forward-backward reprojection error), plus a small truncated charge
for bending away from its four neighbours, which settles what photographs leave open.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numba import njit, prange

import stages.solvers.kernels.threading_layer  # noqa: F401 -- chooses the threads below
from stages.stereo.depth.patch_cost import (
    DX,
    DY,
    OUTSIDE,
    SAMPLES,
    patch_offsets,
    photometric_cost,
    reprojection_error,
    spatial_weights,
    weigh_patch,
)
from stages.stereo.depth.plane_candidates import CANDIDATES, bending, candidate, nearly_same
from stages.stereo.mvs_settings import MvsSettings

F = np.float32
GEOMETRIC = 1000  # added to the number of a geometric round's turn: other random numbers, more than rounds
UNMATCHABLE = F(1.0)  # cost of a flat patch: it correlates with nothing, so nothing is tried


class Sources(NamedTuple):
    """A view's source views, padded to a common size (H, W).

    Attributes
    ----------
    images : ndarray, shape (S, H, W), float32
        Grey values in [0, 1].
    sizes : ndarray, shape (S, 2), int32
        (height, width) of each.
    projections, back : ndarray, shape (S, 3, 4), float32
        `j_from_i` and `i_from_j`.
    inverse_depths : ndarray, shape (S, H, W), float32
        Their inverse depth, 0 where unknown; shape (0, 1, 1) in the photometric pass.
    """

    images: np.ndarray
    sizes: np.ndarray
    projections: np.ndarray
    back: np.ndarray
    inverse_depths: np.ndarray


class Rules(NamedTuple):
    """The settings of the refinement and the view's scale, as the compiled loops want them."""

    spatial: np.ndarray
    best: int
    grey_sigma: np.float32
    noise: np.float32
    smoothness: np.float32
    geometric: np.float32
    cap: np.float32
    step: np.float32
    lowest: np.float32
    highest: np.float32
    propagation: np.ndarray
    slope_change: np.float32
    same_disparity: np.float32
    same_slope: np.float32
    bending_cap: np.float32


@njit(cache=True, nogil=True, fastmath=True, inline="always")
def _source_cost(sources, flat, s, y, x, plane, patch, index, variance, rules):
    """Cost of a plane in source s: 1 − ZNCC, and the reprojection error where depth maps are given."""
    _, rows, columns = sources.images.shape
    height, width = sources.sizes[s, 0], sources.sizes[s, 1]
    w, slope_x, slope_y = plane
    start = s * rows * columns
    p = sources.projections
    cost = photometric_cost(
        flat,
        start,
        columns,
        height,
        width,
        p,
        s,
        y,
        x,
        w,
        slope_x,
        slope_y,
        patch,
        index,
        variance,
        rules.noise,
    )
    if sources.inverse_depths.shape[0] > 0:
        cost += rules.geometric * reprojection_error(
            sources.inverse_depths, height, width, p, sources.back, s, y, x, w, rules.cap
        )
    return cost


@njit(cache=True, nogil=True, fastmath=True, inline="always")
def _choose_sources(sources, flat, y, x, plane, patch, index, variance, rules, chosen, chosen_cost):
    """The sources that match the present plane best; returns how many and the sum of their costs."""
    used = 0
    for s in range(sources.images.shape[0]):
        cost = _source_cost(sources, flat, s, y, x, plane, patch, index, variance, rules)
        rank = used
        while rank > 0 and chosen_cost[rank - 1] > cost:
            rank -= 1
        if rank >= rules.best:
            continue
        for k in range(min(used, rules.best - 1), rank, -1):
            chosen[k] = chosen[k - 1]
            chosen_cost[k] = chosen_cost[k - 1]
        chosen[rank] = s
        chosen_cost[rank] = cost
        used = min(used + 1, rules.best)
    total = F(0)
    for k in range(used):
        total += chosen_cost[k]
    return used, total


@njit(cache=True, nogil=True, fastmath=True, inline="always")
def _refine_pixel(
    image, sources, flat, planes, costs, y, x, turn, amplitude, rules, patch, index, chosen, chosen_cost
):
    """Try all candidates at one pixel and keep the cheapest."""
    variance = weigh_patch(image, y, x, rules.spatial, rules.grey_sigma, patch)
    if variance < rules.noise * rules.noise:
        costs[y, x] = UNMATCHABLE
        return
    plane = (planes[y, x, 0], planes[y, x, 1], planes[y, x, 2])
    used, total = _choose_sources(
        sources, flat, y, x, plane, patch, index, variance, rules, chosen, chosen_cost
    )
    share = F(1) / F(used)
    lowest = total * share + bending(planes, y, x, plane, rules)
    for draw in range(CANDIDATES):
        trial = candidate(planes, costs, y, x, turn, draw, rules, amplitude)
        if not (rules.lowest <= trial[0] <= rules.highest) or nearly_same(trial, plane, rules):
            continue
        cost = bending(planes, y, x, trial, rules)
        for k in range(used):
            if cost >= lowest:
                break
            cost += share * _source_cost(sources, flat, chosen[k], y, x, trial, patch, index, variance, rules)
        if cost < lowest:
            lowest, plane = cost, trial
    planes[y, x, 0], planes[y, x, 1], planes[y, x, 2] = plane
    costs[y, x] = lowest


@njit(cache=True, nogil=True, parallel=True)
def _refine_colour(image, sources, flat, planes, costs, colour, turn, amplitude, rules, offsets):
    height, width = image.shape
    for y in prange(height):
        patch = np.zeros((7, SAMPLES), np.float32)
        patch[DX] = offsets[:, 0]
        patch[DY] = offsets[:, 1]
        index = np.empty(SAMPLES, np.int32)
        chosen, chosen_cost = np.empty(rules.best, np.int32), np.empty(rules.best, np.float32)
        for x in range((y + colour) % 2, width, 2):
            _refine_pixel(
                image,
                sources,
                flat,
                planes,
                costs,
                y,
                x,
                turn,
                amplitude,
                rules,
                patch,
                index,
                chosen,
                chosen_cost,
            )


def refine(
    image: np.ndarray,
    sources: Sources,
    planes: np.ndarray,
    settings: MvsSettings,
    step: float,
    limits: tuple[float, float],
) -> tuple[np.ndarray, np.ndarray]:
    """Refine a view's planes against its sources.

    Parameters
    ----------
    image : ndarray, shape (h, w), float32
        Grey values of the view, in [0, 1].
    sources : Sources
        With inverse depths: the geometric rounds, else the photometric ones.
    planes : ndarray, shape (h, w, 3), float32
        Where to start; not changed.
    settings : MvsSettings
    step : float
        Inverse depth per pixel of disparity, the yardstick of random changes and of bending.
    limits : tuple of float
        Smallest and largest inverse depth allowed.

    Returns
    -------
    planes : ndarray, shape (h, w, 3), float32
    costs : ndarray, shape (h, w), float32
        Cost of each pixel's plane when it was last visited.
    """
    offsets, search = patch_offsets(settings.patch_radius_px), settings.patch_match
    rules = Rules(
        spatial=spatial_weights(offsets, settings.patch_radius_px / search.patch_sigmas),
        best=settings.counted_sources,
        grey_sigma=F(settings.patch_grey_sigma),
        noise=F(settings.noise),
        smoothness=F(settings.smoothness),
        geometric=F(settings.geometric_weight),
        cap=F(settings.geometric_cap_px),
        step=F(step),
        lowest=F(limits[0]),
        highest=F(limits[1]),
        propagation=np.array(search.propagation_px),
        slope_change=F(search.slope_change),
        same_disparity=F(search.same_disparity_px),
        same_slope=F(search.same_slope),
        bending_cap=F(search.bending_cap),
    )
    geometric = len(sources.inverse_depths) > 0
    rounds = settings.geometric_iterations if geometric else settings.photometric_iterations
    planes, flat = planes.copy(), sources.images.reshape(-1)
    costs = np.full(image.shape, OUTSIDE, np.float32)
    for iteration in range(rounds):
        amplitude = F(search.first_change_px * search.change_decay**iteration)
        for colour in range(2):
            turn = 2 * iteration + colour + (GEOMETRIC if geometric else 0)
            _refine_colour(image, sources, flat, planes, costs, colour, turn, amplitude, rules, offsets)
    return planes, costs
