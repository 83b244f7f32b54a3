"""Albedo in clusters beside that of all views at once: ``python -m benchmarks.scale.agreement -- ARGUMENTS``.

``ARGUMENTS`` are those of `unshade run`, with ``--workspace``. Decomposes at once, then in about as many
clusters as asked, and prints a line for each: time, memory, the difference of the albedo over its range (one
scale per channel), and the steps of log albedo across the borders of clusters in either result.
"""

from __future__ import annotations

import argparse
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from benchmarks.paper.tables import markdown
from benchmarks.scale.growth import own_and_further, run_program
from stages.formats.artefacts.camera_file import read_cameras
from stages.formats.images.exr import read_exr
from stages.formats.images.photos import read_mask
from stages.photometry.clusters.cluster_views import divided_surface, surface_points, view_graph
from stages.photometry.clusters.settings import AlbedoClusterSettings
from stages.photometry.clusters.surface_clusters import Cluster
from stages.solvers.least_squares.difference_operators import neighbours

AT_ONCE = 10**12  # pixels of a cluster: all
WITH_MARGIN = 1.4  # pixels that take part in a cluster over its own, about
ENDS = (0.001, 0.999)  # quantiles between which the range of an albedo lies
EVERY = 7  # of the pixels, for quantiles
DARK = 0.01  # added to albedo before logarithms
STEPS = (0.5, 0.9, 0.99)  # quantiles


@dataclass(frozen=True)
class Decomposed:
    """A run of the decomposition.

    Attributes
    ----------
    paths : dict of str to Path
        Artefacts by name.
    record : dict
        Of the stage.
    """

    paths: dict[str, Path]
    record: dict[str, Any]

    def albedo(self, name: str, mask: np.ndarray) -> np.ndarray:
        """Read the albedo of a view's masked pixels, (n, 3)."""
        return read_exr(self.paths["albedo"] / f"{name}.exr")[mask].astype(np.float64)


def main(argv: Sequence[str] | None = None) -> str:
    """Run, compare and print; returns the table."""
    own, arguments = own_and_further(argv)
    parser = argparse.ArgumentParser(description=__doc__.split("\n\n")[0])
    parser.add_argument("--clusters", default="4,16", help="numbers of clusters, about, comma-separated")
    parser.add_argument("--margin", type=float, help="decomposition.clusters.margin")
    given = parser.parse_args(own)
    whole = decomposed(arguments, AT_ONCE, given.margin)
    rows = [_costs(whole)]
    for count in map(int, given.clusters.split(",")):
        pixels = int(WITH_MARGIN * whole.record["facts"]["pixels"] / count)
        parts = decomposed(arguments, pixels, given.margin)
        rows.append(
            [*_costs(parts), *differences(whole, parts), *border_steps(whole, parts, pixels, given.margin)]
        )
    head = ["clusters", "pixels", "seconds", "CPU-s", "GB", "RMS over range", "50, 90, 99, 99.9 %"]
    head += ["steps at borders, at once: 50, 90, 99 %", "in clusters"]
    table = markdown(head, [row + [""] * (len(head) - len(row)) for row in rows])
    print(table)
    return table


def decomposed(arguments: Sequence[str], pixels: int, margin: float | None) -> Decomposed:
    """Decompose in clusters of so many pixels."""
    how = ["--set", f"decomposition.clusters.pixels={pixels}"]
    how += [] if margin is None else ["--set", f"decomposition.clusters.margin={margin}"]
    records = run_program(["--to", "decomposition", *arguments, *how])
    cache = Path(arguments[list(arguments).index("--workspace") + 1]).resolve() / "cache"
    paths = {
        file.stem: file
        for record in records.values()
        for file in (cache / record["stage"] / record["key"]).iterdir()
    }
    return Decomposed(paths, records["decomposition"])


def differences(whole: Decomposed, parts: Decomposed) -> list[str]:
    """Compare the albedos: RMS over the range, per channel, and quantiles of all channels together."""
    cameras = read_cameras(whole.paths["cameras"])
    sums, count, some = np.zeros((3, 3)), 0, []
    for camera in cameras:
        mask = read_mask(whole.paths["mask"] / f"{camera.name}.png")
        one, other = whole.albedo(camera.name, mask), parts.albedo(camera.name, mask)
        sums += [(one * other).sum(axis=0), (other**2).sum(axis=0), (one**2).sum(axis=0)]
        count += len(one)
        some.append(np.stack([one[::EVERY], other[::EVERY]]))
    ends = np.quantile(np.concatenate([pair[0] for pair in some]), ENDS, axis=0)
    extent, scale = ends[1] - ends[0], sums[0] / sums[1]
    rms = np.sqrt(np.maximum(sums[2] - sums[0] * scale, 0) / count) / extent
    apart = np.concatenate([np.abs(pair[0] - scale * pair[1]) / extent for pair in some])
    return [_numbers(rms), _numbers(np.quantile(apart, (*STEPS, 0.999)))]


def border_steps(whole: Decomposed, parts: Decomposed, pixels: int, margin: float | None) -> list[str]:
    """Compare steps of log albedo between neighbours in different clusters, in either result: quantiles."""
    cameras = read_cameras(whole.paths["cameras"])
    how = AlbedoClusterSettings(pixels=pixels)
    how = how if margin is None else how.model_copy(update={"margin": margin})
    clusters = divided_surface(whole.paths, cameras, view_graph(whole.paths, cameras), how)
    found: list[list[np.ndarray]] = [[], []]
    for camera in cameras:
        mask = read_mask(whole.paths["mask"] / f"{camera.name}.png")
        owner = _owner(clusters, surface_points(whole.paths, camera, mask)[0])
        both = [np.log(run.albedo(camera.name, mask).mean(axis=1) + DARK) for run in (whole, parts)]
        for one, other in neighbours(mask, 0):
            border = owner[one] != owner[other]
            for steps, logs in zip(found, both, strict=True):
                steps.append(np.abs(logs[one[border]] - logs[other[border]]))
    return [_numbers(np.quantile(np.concatenate(steps), STEPS)) for steps in found]


def _owner(clusters: Sequence[Cluster], points: np.ndarray) -> np.ndarray:
    owner = np.zeros(len(points), np.int64)
    for number, cluster in enumerate(clusters):
        owner[cluster.owns(points)] = number
    return owner


def _costs(run: Decomposed) -> list[str]:
    record, facts = run.record, run.record["facts"]
    taken = f"{record['seconds']:.0f}", f"{record['cpu_seconds']:.0f}", f"{record['peak_bytes'] / 1e9:.2f}"
    return [str(len(facts["clusters"])), f"{facts['pixels_with_margins'] / 1e6:.2f} M", *taken]


def _numbers(values: np.ndarray) -> str:
    return " ".join(f"{value:.4f}" for value in values)


if __name__ == "__main__":
    main()
