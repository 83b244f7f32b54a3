"""Render the scenes of `tests/test_accuracy.py`: ``python -m tests.accuracy_scenes.make [NAME …]`` (minutes).

Their photos, masks, cameras, mesh and true albedo are stored, so that the test needs no renderer. Run it when
the scenes themselves change; then look at the albedo, and write the new figures into the test.
"""

from __future__ import annotations

import os
import sys
import tempfile
from collections.abc import Sequence
from pathlib import Path

os.environ["OPENBLAS_NUM_THREADS"] = "1"  # before numpy: more threads sum in another order

import numpy as np  # noqa: E402

from benchmarks.accuracy.natural import GLOSSY, SMOOTHED, natural_row  # noqa: E402
from benchmarks.paper.judging import Judge  # noqa: E402
from benchmarks.paper.laboratory import Laboratory, Size  # noqa: E402
from pipeline.command.terminal import Terminal  # noqa: E402
from stages.formats.artefacts.camera_file import read_cameras  # noqa: E402
from stages.formats.meshes.triangle_meshes import read_mesh  # noqa: E402

FOLDER = Path(__file__).parent
SIZE = Size(96, 96, views=5)
COARSE = {"spacing": 0.012}
MASONRY = {"paint": "masonry", "contrast": 0.3, "paint_seed": 41}
SCENES = {  # bold paint on matt surface, mild paint on glossy, coloured walls around a hollow
    "relief": ("relief", "sun_and_sky", MASONRY, {}),
    "relief_dome": ("relief", "dome", MASONRY, {}),
    "bust": ("bust", "dome", {"paint": "quilt", "contrast": 0.12, "paint_seed": 42} | GLOSSY, {}),
    "courtyard": ("courtyard", "dome", {"paint": "quilt", "contrast": 0.3, "paint_seed": 43}, SMOOTHED),
}


def main(names: Sequence[str]) -> None:
    """Render and store the scenes of these names."""
    for name in names:
        subject, light, paint, geometry = SCENES[name]
        row = natural_row(None, subject, light, paint, geometry)
        row.render.update(COARSE)
        with tempfile.TemporaryDirectory() as folder:
            prepared = Laboratory(Path(folder), SIZE, Terminal()).prepare(row)
            judge, cameras = Judge.of(prepared), read_cameras(prepared.paths["cameras"])
            mesh = read_mesh(prepared.paths["mesh"])
            maps = {
                f"{kind}_{n}": values[n].astype(np.float16)
                for n in judge.names
                for kind, values in (
                    ("image", judge.images),
                    ("albedo", {n: judge.true_albedo(n) for n in judge.names}),
                )
            }
            masks = {f"mask_{n}": judge.judged(n) for n in judge.names}
            views = {f"intrinsics_{one.name}": one.intrinsics for one in cameras}
            views |= {f"cam_from_world_{one.name}": one.cam_from_world for one in cameras}
        np.savez_compressed(
            FOLDER / f"{name}.npz",
            vertices=mesh.vertices.astype(np.float32),
            faces=mesh.faces.astype(np.int32),
            **maps,
            **masks,
            **views,
        )


if __name__ == "__main__":
    main(sys.argv[1:] or list(SCENES))
