"""What several test files share: a job made by hand, without the pipeline around it."""

from __future__ import annotations

import os
from collections.abc import Callable, Iterator
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import hypothesis
import pytest

from pipeline import Job, Silence, Stage

# As the command line does before numpy is imported: BLAS on more threads sums in another order.
os.environ["OPENBLAS_NUM_THREADS"] = "1"

from stages.solvers.kernels.threading_layer import use_threads  # noqa: E402

hypothesis.settings.register_profile("untimed", deadline=None)  # a busy machine is no defect
hypothesis.settings.load_profile("untimed")

# Files of tests that run the program, render, or search for light: five seconds and more each.
WHOLE = {
    "test_accuracy",
    "test_accuracy_benchmark",
    "test_albedo_detail",
    "test_cameras_of_others",
    "test_colmap_dense",
    "test_calibration",
    "test_colour_space",
    "test_delit_photos",
    "test_divided_light",
    "test_fast_solver_parts",
    "test_full_resolution",
    "test_ignored_settings",
    "test_known_light",
    "test_lights_between",
    "test_masked_geometry",
    "test_minimum_cuts",
    "test_mit_berkeley",
    "test_mvs_geometry",
    "test_mvs_stage",
    "test_natural_paint",
    "test_niche",
    "test_paper_benchmark",
    "test_reflectance",
    "test_relight",
    "test_render_stage",
    "test_report_page",
    "test_sfm",
    "test_short_writes",
    "test_sky_light",
    "test_solver_benchmark",
    "test_specular",
    "test_stories",
    "test_transfer_stage",
    "test_turntable",
    "test_values",
}


def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    """Mark the tests that `make test-quick` leaves out."""
    for item in items:
        if item.path.stem in WHOLE or item.path.parent.name == "faults":
            item.add_marker("whole")


@pytest.fixture(scope="session")
def make_job() -> Iterator[Callable[..., Job]]:
    """``make_job(folder, stage, settings=None, threads=2, **inputs)``: a job that writes into `folder`."""
    executors = []

    def make(folder: Path, stage: Stage, settings=None, threads: int = 2, **inputs: Path) -> Job:
        outputs = {artefact.name: folder / artefact.path for artefact in stage.gives}
        for artefact in stage.gives:
            (folder / artefact.path if artefact.file is None else folder).mkdir(parents=True, exist_ok=True)
        (folder / "scratch").mkdir()
        executors.append(ThreadPoolExecutor(threads))
        settings = stage.settings() if settings is None else settings
        return Job(
            settings=settings,
            inputs=inputs,
            outputs=outputs,
            scratch=folder / "scratch",
            threads=threads,
            executor=executors[-1],
            shown=Silence(),
            say=lambda sentence: None,
            machine=dict(stage.machine(settings)),
        )

    yield make
    for executor in executors:
        executor.shutdown()


@pytest.fixture(autouse=True)
def threads_as_found() -> Iterator[None]:
    """Compiled loops have all their threads again after a test that took some away."""
    yield
    use_threads(10_000)


@pytest.fixture
def data_folder() -> Path:
    """The folder of large test data; tests that need it are skipped where it is not."""
    folder = os.environ.get("UNSHADE_DATA")
    if not folder or not Path(folder).is_dir():
        pytest.skip("UNSHADE_DATA names no folder")
    return Path(folder)
