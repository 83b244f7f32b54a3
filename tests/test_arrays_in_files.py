"""Arrays in files are what they were, take no memory while they are not used, and change no result."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
import scipy.sparse as sp

from stages.photometry.albedo.albedo_given_light import smooth_albedos_under_light, weights_of_edges
from stages.photometry.albedo.settings import EdgeSettings
from stages.photometry.albedo_data import AlbedoData
from stages.photometry.detail.albedo_detail import with_detail
from stages.photometry.detail.detail_scene import DetailScene
from stages.photometry.detail.settings import DetailSettings
from stages.photometry.joint.fast_alternation import FastSolver
from stages.photometry.joint.settings import FastSettings, Stopping
from stages.photometry.paper.energy import EnergyWeights
from stages.solvers.kernels.arrays_in_files import in_file, load_mapped
from tests.sphere_scene import sphere_scene

ROOT = Path(__file__).resolve().parent.parent

RESIDENT = """
import sys
from pathlib import Path
import numpy as np
from pipeline.process.free_memory import give_back_free_memory
from pipeline.process.meter import resident_bytes
from stages.solvers.kernels.arrays_in_files import in_file, load_mapped

how, folder = sys.argv[1], Path(sys.argv[2])
arrays = [np.arange(2**23), np.ones(2**22, np.float32)]
if how == "saved":
    for number, array in enumerate(arrays):
        np.save(folder / f"{number}.npy", array)
    del arrays, array
    before = resident_bytes()
    arrays = [load_mapped(folder / f"{number}.npy") for number in range(2)]
else:
    arrays = in_file(arrays, folder)
    give_back_free_memory()
    before = resident_bytes()
read = [float(array.sum()) for array in arrays]
used = resident_bytes() - before
give_back_free_memory()
waiting = resident_bytes() - before
assert read == [float(array.sum()) for array in arrays]
del arrays
print(used / 2**20, waiting / 2**20)
"""


@pytest.mark.skipif(not sys.platform.startswith("linux"), reason="looks at /proc")
@pytest.mark.parametrize("how", ["moved", "saved"])
def test_they_take_memory_only_while_they_are_used(tmp_path, how):
    """80 MiB."""
    command = [sys.executable, "-c", RESIDENT, how, str(tmp_path)]
    told = subprocess.run(command, cwd=ROOT, check=True, capture_output=True, text=True).stdout
    used, waiting = map(float, told.split())
    assert used > 75 and waiting < 10
    assert len(list(tmp_path.iterdir())) == {"moved": 0, "saved": 2}[how]


@pytest.mark.parametrize("folder", [True, False])
def test_values_shapes_and_types_stay(tmp_path, folder):
    rng = np.random.default_rng(3)
    given = [
        rng.random((5, 3)).astype(np.float32),
        np.zeros((0, 3), np.int64),
        rng.random((4, 6)).T,  # of another order in memory
        rng.random(7) < 0.5,
    ]
    back = in_file(given, tmp_path if folder else None)
    for one, other in zip(given, back, strict=True):
        assert one.dtype == other.dtype and np.array_equal(one, other)
    for one in given:
        np.save(tmp_path / "saved.npy", one)
        read = load_mapped(tmp_path / "saved.npy")
        assert one.dtype == read.dtype and np.array_equal(one, read) and not read.flags.writeable
    assert in_file([], tmp_path) == []


def test_correspondences_stay(tmp_path):
    views = sphere_scene(view_count=3).stacked()
    moved = views.in_file(tmp_path)
    assert moved.correspondences.keys() == views.correspondences.keys()
    for pair, block in views.correspondences.items():
        own = moved.correspondences[pair]
        assert isinstance(own, sp.csr_array) and (own != block).nnz == 0 and own.shape == block.shape


def test_albedo_and_detail_are_the_same_to_the_last_bit(tmp_path):
    rng = np.random.default_rng(4)
    views = sphere_scene(view_count=3).stacked()
    shading = rng.uniform(0.3, 1, (int(views.starts[-1]), 3)).astype(np.float32)
    image = (shading * rng.choice([0.2, 0.6], (len(shading), 1))).astype(np.float32)
    trusted = rng.random(len(image)) < 0.95
    data = AlbedoData(image, image, trusted, ~trusted, glossy=0.0)
    stopping = Stopping(tolerance=1e-3, gap=1e-2, max_rounds=3)
    solver = FastSolver(EnergyWeights(0.02, 0.1), stopping, FastSettings(coarsest_pixels=30))

    def solved(folder: Path | None) -> list[np.ndarray]:
        own = views if folder is None else views.in_file(folder)
        by_edge = weights_of_edges(own, shading, data, EdgeSettings(), solver.weights.consistency, 0.6)
        by_edge = by_edge.in_file(folder)
        smooth = smooth_albedos_under_light(own, shading, data, by_edge, solver, 1, lambda: None, folder)
        albedo = smooth.by_edge.albedo
        scene = DetailScene.of(own, albedo, image, shading, trusted, DetailSettings(), folder=folder)
        detail = with_detail(scene)
        return [smooth.alike.albedo, albedo, detail.albedo, detail.variance]

    for one, other in zip(solved(None), solved(tmp_path), strict=True):
        assert np.array_equal(one, other)
