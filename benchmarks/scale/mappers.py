"""COLMAP's incremental and global mapper on streets: ``python -m benchmarks.scale.mappers [--views 30,100]``.

Runs `sfm` on the photos of a street with either, compares consecutive photos only, and prints a line for
each: seconds, processor seconds, photos placed, errors of the poses. What follows ``--`` is given to
`unshade run`.
"""

from __future__ import annotations

import argparse
from collections.abc import Sequence
from pathlib import Path

import numpy as np

from benchmarks.fountain_poses import errors, model_poses
from benchmarks.paper.tables import markdown
from benchmarks.scale.growth import ROOT, own_and_further, run_program
from benchmarks.scale.photo_set import PhotoSet, photo_set

HEAD = [
    "views",
    "mapper",
    "seconds",
    "CPU-s",
    "placed",
    "error of centres, mm: median, largest",
    "of rotations, °",
]


def main(argv: Sequence[str] | None = None) -> str:
    """Run and print; returns the table."""
    own, further = own_and_further(argv)
    parser = argparse.ArgumentParser(description=__doc__.split("\n\n")[0])
    parser.add_argument("--views", default="30,100", help="numbers of views, comma-separated")
    parser.add_argument("--size", default="640x400", help="of a view, px")
    parser.add_argument("--workspace", type=Path, default=ROOT / "workspaces" / "scale")
    given = parser.parse_args(own)
    width_px, height_px = map(int, given.size.split("x"))
    rows = []
    for views in map(int, given.views.split(",")):
        photos = photo_set(given.workspace / f"{views}-{given.size}", views, width_px, height_px)
        rows += [_row(photos, mapper, further) for mapper in ("incremental", "global")]
    table = markdown(HEAD, rows)
    print(table)
    return table


def _row(photos: PhotoSet, mapper: str, further: Sequence[str]) -> list[str]:
    """Place the photos of a street by a mapper."""
    workspace = photos.folder / f"workspace-{mapper}"
    how = ["--set", "sfm.matching=sequential", "--set", f"sfm.mapper={mapper}"]
    arguments = ["--images", str(photos.photos), "--workspace", str(workspace), "--to", "sfm", "--force"]
    record = run_program([*arguments, *further, *how])["sfm"]
    centre_mm, rotation_deg = errors(
        model_poses(workspace / "cache" / "sfm" / record["key"] / "model"), model_poses(photos.model)
    )
    return [
        str(photos.views),
        mapper,
        f"{record['seconds']:.0f}",
        f"{record['cpu_seconds']:.0f}",
        str(len(centre_mm)),
        f"{np.median(centre_mm):.1f} {centre_mm.max():.1f}",
        f"{np.median(rotation_deg):.3f} {rotation_deg.max():.3f}",
    ]


if __name__ == "__main__":
    main()
