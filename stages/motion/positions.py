"""Selection of pairs of photos by where they were taken, as their EXIF data say."""

from __future__ import annotations

from collections.abc import Collection, Sequence
from dataclasses import dataclass
from math import isfinite
from pathlib import Path
from typing import Any

import numpy as np
import scipy.sparse as sp
from scipy.sparse.csgraph import connected_components
from scipy.spatial import cKDTree

from stages.formats.decoders.pictures import exif_directory, exif_of

GPS_IFD = 0x8825
SOUTH, LATITUDE, WEST, LONGITUDE = 1, 2, 3, 4  # tags of the GPS directory
SEXAGESIMAL = (1, 60, 3600)
EARTH_RADIUS_M = 6.371e6


@dataclass(frozen=True)
class Position:
    """Latitude, north positive, and longitude, east positive, degrees."""

    latitude: float
    longitude: float


def position_of(path: Path) -> Position | None:
    """Read the position of a photo; None where its data have none, or none that can be."""
    try:
        gps = exif_directory(exif_of(path), GPS_IFD)
        latitude = _degrees(gps[LATITUDE], gps.get(SOUTH, "N") == "S")
        longitude = _degrees(gps[LONGITUDE], gps.get(WEST, "E") == "W")
    except (KeyError, TypeError, ValueError, ZeroDivisionError, AttributeError, IndexError):
        return None  # other data in its place
    there = isfinite(latitude) and isfinite(longitude) and abs(latitude) <= 90 and abs(longitude) <= 180
    unset = latitude == 0 and longitude == 0  # what receivers write that have seen no satellite
    return Position(latitude, longitude) if there and not unset else None


def _degrees(parts: Any, negative: bool) -> float:
    """Sum degrees, minutes and seconds."""
    total = sum(float(part) / unit for part, unit in zip(parts, SEXAGESIMAL, strict=True))
    return -total if negative else total


def near_pairs(positions: Sequence[Position], neighbours: int) -> list[tuple[int, int]]:
    """List pairs i < j (indices) of photos: of each photo those that were taken nearest to it.

    Distances are those on a sphere; heights, which receivers measure worst, do not count. Where more photos
    than that were taken in one place, groups would remain without a pair between them: those of each that are
    nearest to another are paired, too, until all are connected.
    """
    places = _on_unit_sphere(positions)
    count = min(neighbours + 1, len(positions))  # the nearest is the photo itself
    _, nearest = cKDTree(places).query(places, k=count)
    found = {(i, int(j)) for i, row in enumerate(nearest.reshape(len(places), count)) for j in row if i != j}
    groups, group = _groups(len(places), found)
    while groups > 1:
        for number in range(groups):
            found |= _out_of(places, group == number, neighbours)
        groups, group = _groups(len(places), found)
    return sorted({(min(pair), max(pair)) for pair in found})


def reach_m(positions: Sequence[Position], neighbours: int) -> float:
    """Measure how far away the last of so many nearest neighbours is, metres, the median over all photos."""
    places = _on_unit_sphere(positions)
    distance, _ = cKDTree(places).query(places, k=[min(neighbours + 1, len(places))])
    return EARTH_RADIUS_M * float(np.median(distance))


def _on_unit_sphere(positions: Sequence[Position]) -> np.ndarray:
    latitude, longitude = np.deg2rad([[one.latitude, one.longitude] for one in positions]).T
    level = np.cos(latitude)
    return np.stack([level * np.cos(longitude), level * np.sin(longitude), np.sin(latitude)], axis=1)


def _groups(count: int, pairs: Collection[tuple[int, int]]) -> tuple[int, np.ndarray]:
    """Count the groups of photos that pairs connect, and number each photo's."""
    one, other = np.array(sorted(pairs), np.int64).reshape(-1, 2).T
    graph = sp.coo_array((np.ones(len(one)), (one, other)), shape=(count, count))
    groups, group = connected_components(graph, directed=False)
    return int(groups), group


def _out_of(places: np.ndarray, inside: np.ndarray, most: int) -> set[tuple[int, int]]:
    """Pair photos of a group, (n,), bool, at most so many, with the nearest outside it."""
    within, outside = np.flatnonzero(inside), np.flatnonzero(~inside)
    distance, nearest = map(np.asarray, cKDTree(places[outside]).query(places[within]))
    first = np.argsort(distance, kind="stable")[:most]
    return set(zip(within[first].tolist(), outside[nearest[first]].tolist(), strict=True))
