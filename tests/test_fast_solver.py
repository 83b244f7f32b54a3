"""`solver: fast` ends at a low energy, in the gauge, in numbers, and says how; its stage writes it down."""

from __future__ import annotations

import json
from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from stages.correspondence import CORRESPONDENCE
from stages.decomposition import DECOMPOSITION, DecompositionSettings
from stages.formats.images.exr import read_exr
from stages.photometry.joint import coarse_to_fine
from stages.photometry.joint.fast_alternation import FastDescent, FastSolver, solve
from stages.photometry.joint.problem_assembly import graph_of
from stages.photometry.joint.settings import FastSettings, StepSettings, Stopping
from stages.photometry.joint.stopping_rule import left_to_gain
from stages.photometry.paper.alternation import Outcome, decompose_channels
from stages.photometry.paper.energy import EnergyTerms, EnergyWeights, energy_terms
from stages.photometry.paper.settings import PaperSettings
from stages.photometry.stack import StackedViews
from tests.linked_graphs import exact_energy
from tests.sphere_scene import SphereScene, sphere_scene
from tests.test_decomposition_stage import write_scene

WEIGHTS = EnergyWeights(smoothness=2.0, consistency=1.5)
STOPPING = Stopping(tolerance=1e-3, gap=1e-3, max_rounds=100)
ONE_THREAD = 1


HOW = FastSettings(coarsest_pixels=30)


def fast(how: FastSettings = HOW, **stopping: float) -> FastSolver:
    return FastSolver(WEIGHTS, replace(STOPPING, **stopping), how)


FAST = fast()


def solution(views: StackedViews, images: list[np.ndarray], solver: FastSolver = FAST) -> FastDescent:
    return solve(views, images, solver, ONE_THREAD, lambda: None)


def terms_of(views: StackedViews, images: list[np.ndarray], descent: FastDescent) -> list[EnergyTerms]:
    return [
        energy_terms(views, image, descent.albedo[:, c].astype(float), descent.light[:, c].copy())
        for c, image in enumerate(images)
    ]


def total(terms) -> float:
    return sum(one.total(WEIGHTS) for one in terms)


def assert_in_the_gauge(images: list[np.ndarray], descent: FastDescent) -> None:
    """Σ|ρ| = Σ|I| in every channel."""
    assert np.allclose(np.abs(descent.albedo).sum(axis=0), [np.abs(one).sum() for one in images], rtol=1e-5)


@pytest.fixture(scope="module")
def sphere() -> SphereScene:
    return sphere_scene(3, 24, 20)


@pytest.fixture(scope="module")
def on_sphere(sphere) -> tuple[StackedViews, list[np.ndarray], FastDescent]:
    views, images = sphere.stacked(), sphere.channels()
    return views, images, solution(views, images)


def test_eq_2_ends_no_higher_than_the_paper_s_scheme_and_in_the_gauge(on_sphere):
    """Eq. 2, summed over the channels; the paper's scheme as `mode: paper` has it."""
    views, images, descent = on_sphere
    how = PaperSettings()
    with ThreadPoolExecutor(1) as executor:
        theirs = decompose_channels(views, images, WEIGHTS, how, executor)
    assert descent.outcome is Outcome.CONVERGED
    assert total(terms_of(views, images, descent)) <= total(one.state.terms for one in theirs)
    assert_in_the_gauge(images, descent)


def test_the_albedo_it_ends_with_is_optimal_for_the_light_it_ends_with(on_sphere):
    """Eq. 10, in the gauge: to 0.1 % of a linear program's optimum."""
    views, images, descent = on_sphere
    graph, best = graph_of(views, WEIGHTS), 0.0
    for c, image in enumerate(images):
        best += exact_energy(graph, image, views.shading(descent.light[:, c].copy()), in_gauge=True)
    assert best * (1 - 1e-5) <= total(descent.terms) <= best * (1 + 1e-3)
    energy, gap = sum(descent.rounds[-1].energy), descent.rounds[-1].gap
    assert energy * (1 - gap) <= best * (1 + 1e-5), "the bound in the gauge is above the optimum"


@pytest.mark.parametrize(("rounds", "tolerance"), [(1, 0.0), (7, 0.0), (40, 1e-3)])
def test_rounds_hold_the_energy_and_the_last_one_that_of_the_solution(on_sphere, rounds, tolerance):
    """However it ended; no round lies below the solution, by more than the tolerance where that ended it."""
    views, images, _ = on_sphere
    found = solution(views, images, fast(max_rounds=rounds, tolerance=tolerance))
    assert tuple(terms_of(views, images, found)) == found.terms
    assert sum(found.rounds[-1].energy) == pytest.approx(total(found.terms), rel=1e-5)
    least = min(sum(one.energy) for one in found.rounds)
    assert least <= sum(found.rounds[-1].energy) <= (1 + tolerance) * least
    assert len(found.rounds) <= rounds + 2


def test_the_outcome_says_whether_the_rounds_sufficed(on_sphere):
    views, images, descent = on_sphere
    few = solution(views, images, fast(max_rounds=2, tolerance=1e-9))
    assert few.outcome is Outcome.LIMIT_REACHED
    assert [one.iterations for one in few.rounds] == [0, 80, 160]
    assert solution(views, images, fast(tolerance=0.9, gap=9.0)).outcome is Outcome.CONVERGED
    assert descent.outcome is Outcome.CONVERGED
    assert (
        left_to_gain(descent.rounds[: -1 if descent.rounds[-1] in descent.rounds[:-1] else None])
        <= STOPPING.tolerance
        and descent.rounds[-1].gap <= STOPPING.gap
    )


@pytest.mark.parametrize("scale", [0.25, 3.0])
def test_scaling_the_images_scales_the_fast_albedo(on_sphere, scale):
    """I → s I gives ρ → s ρ and the same light, when the steps, which are in I's unit, go along."""
    views, images, _ = on_sphere
    few = fast(max_rounds=3, tolerance=0.0)
    steps = StepSettings(scale=scale * few.how.steps.scale)
    there = replace(few, how=FastSettings(coarsest_pixels=30, steps=steps))
    one, other = solution(views, images, few), solution(views, [scale * each for each in images], there)
    rms = np.sqrt(np.mean((other.albedo / scale - one.albedo) ** 2) / np.mean(one.albedo**2))
    assert rms < (1e-12 if scale == 0.25 else 1e-2)  # rounding, which three rounds amplify
    assert total(other.terms) == pytest.approx(scale * total(one.terms), rel=1e-2)


def test_the_number_of_threads_does_not_change_the_solution(on_sphere, monkeypatch):
    views, images, _ = on_sphere
    monkeypatch.setattr(coarse_to_fine, "PIXELS_PER_THREAD", 10)
    few = fast(FastSettings(coarsest_pixels=30, coarse_iterations=20), max_rounds=1)
    one, two = (solve(views, images, few, threads, lambda: None) for threads in (1, 2))
    assert np.array_equal(one.albedo, two.albedo)
    assert np.array_equal(one.light, two.light)
    assert one.rounds == two.rounds


def black_channel(scene: SphereScene) -> None:
    for image in scene.albedos:
        image[..., 1] = 0


def black_everywhere(scene: SphereScene) -> None:
    for image in scene.albedos:
        image[:] = 0


def constant(scene: SphereScene) -> None:
    for i, mask in enumerate(scene.masks):
        scene.albedos[i], scene.shadings[i] = np.where(mask[..., None], [0.5, 0.3, 0.2], 0), 1.0 * mask


def no_correspondences(scene: SphereScene) -> None:
    scene.correspondences.clear()


def lonely_pixel(scene: SphereScene) -> None:
    """A pixel apart from the rest in the first view, and nothing but one in the last."""
    scene.masks[0][8:13, 10:15] = False
    scene.masks[2][:] = False
    scene.masks[0][10, 12] = scene.masks[2][10, 12] = True
    scene.correspondences.clear()


def shadow(scene: SphereScene) -> None:
    """Exactly black where it falls: a quarter of every view."""
    for shading in scene.shadings:
        shading[:10, :12] = 0


def empty_view(scene: SphereScene) -> None:
    scene.masks[1] = np.zeros_like(scene.masks[1])
    scene.correspondences.clear()


CASES = [black_channel, black_everywhere, constant, no_correspondences, lonely_pixel, shadow, empty_view]


@pytest.mark.parametrize("change", CASES)
def test_odd_problems_end_in_numbers_and_in_the_gauge(change):
    """Nothing is special: finite, in the gauge, hardly above ρ = I with σ·ν = 1, which the light can do."""
    scene = sphere_scene(3, 24, 20)
    change(scene)
    pixels = np.concatenate([one[mask] for one, mask in zip(scene.images, scene.masks, strict=True)])
    images = [np.ascontiguousarray(channel) / max(pixels.max(), 1e-9) for channel in pixels.T]
    views = scene.stacked()
    descent = solution(views, images, fast(max_rounds=10))
    assert np.isfinite(descent.albedo).all()
    assert np.isfinite(descent.light).all()
    assert_in_the_gauge(images, descent)
    flat = np.zeros((views.view_count, 9))
    flat[:, 0] = 1 / views.basis[0, 0]
    trivial = [energy_terms(views, image, image, flat).total(WEIGHTS) for image in images]
    brightness = sum(float(image.sum()) for image in images)
    assert total(terms_of(views, images, descent)) <= sum(trivial) + 1e-3 * brightness
    for c, image in enumerate(images):
        if not image.any():
            assert not descent.albedo[:, c].any()


def test_where_the_energy_rises_again_the_best_round_is_kept_and_comes_last():
    """A constant image: the first rounds, still swinging, rise."""
    scene = sphere_scene(3, 24, 20)
    constant(scene)
    views, images = scene.stacked(), scene.channels()
    how = FastSettings(coarsest_pixels=30, round_iterations=20)
    descent = solution(views, images, fast(how, max_rounds=2, tolerance=0.0))
    energies = [sum(one.energy) for one in descent.rounds]
    assert energies[0] < energies[1] and energies[0] < energies[2]
    assert descent.rounds[3:] == descent.rounds[:1]
    assert tuple(terms_of(views, images, descent)) == descent.terms


def test_a_constant_image_is_all_albedo_or_all_shading():
    """Under one light any split costs nothing: the energy goes to 0 and the albedo to the image."""
    scene = sphere_scene(3, 24, 20)
    constant(scene)
    views, images = scene.stacked(), scene.channels()
    descent = solution(views, images, fast(max_rounds=20))
    assert total(terms_of(views, images, descent)) < 1e-3 * sum(image.sum() for image in images)
    assert np.allclose(descent.albedo, np.stack(images, axis=1), rtol=1e-2)


# The stage


@pytest.fixture(scope="module")
def two_runs(sphere, make_job, tmp_path_factory) -> list:
    """The stage twice on the same files, on one thread and on two."""
    folder = tmp_path_factory.mktemp("fast")
    inputs = write_scene(folder, sphere)
    correspondences = {name: inputs[name] for name in ("depth", "mask", "cameras")}
    linking = make_job(folder / "links", CORRESPONDENCE, **correspondences)
    CORRESPONDENCE.run(linking)
    takes = {name: inputs[name] for name in ("linear", "normal", "mask", "cameras")}
    takes["correspondences"] = linking.outputs["correspondences"]
    how = DecompositionSettings(
        **{"mode": "paper", "solver": "fast", "fast": {"max_rounds": 30}, "lambda": 1.5, "mu": 0.5}
    )
    jobs = []
    for threads in (1, 2):
        jobs.append(make_job(folder / str(threads), DECOMPOSITION, how, threads, **takes))
        DECOMPOSITION.run(jobs[-1])
    return jobs


def test_the_stage_leaves_every_artefact_and_the_recorded_energy(sphere, two_runs):
    job = two_runs[0]
    for camera in sphere.cameras:
        maps = [read_exr(job.outputs[name] / f"{camera.name}.exr") for name in ("albedo", "shading")]
        assert all(one.shape == (20, 24, 3) and np.isfinite(one).all() and one.any() for one in maps)
    assert len(json.loads(job.outputs["lighting"].read_text(encoding="utf-8"))["views"]) == 3
    content = json.loads(job.outputs["energy"].read_text(encoding="utf-8"))
    channels = list(content["channels"].values())
    assert list(content["channels"]) == ["red", "green", "blue"]
    assert job.facts["energy"] == sum(one["alternations"][-1]["energy"] for one in channels)
    for one in channels:
        rows = one["alternations"]
        assert rows[-1]["energy"] < rows[0]["energy"]
        assert rows[-1]["energy"] == pytest.approx(
            rows[-1]["photo"] + 1.5 * rows[-1]["smooth"] + 0.5 * rows[-1]["multi_view"], rel=1e-12
        )
        assert one["outcome"] in ("converged", "limit_reached")
    assert len(job.warnings) == 3 * (channels[0]["outcome"] == "limit_reached")


def test_the_stage_gives_the_same_bytes_again(two_runs):
    one, two = ({path: path.read_bytes() for path in files_of(job)} for job in two_runs)
    assert [path.name for path in one] == [path.name for path in two]
    assert len(one) == 8
    for (path, first), second in zip(one.items(), two.values(), strict=True):
        assert first == second, path.name


def files_of(job) -> list[Path]:
    folders = [path for name in ("albedo", "shading") for path in sorted(job.outputs[name].iterdir())]
    return [*folders, job.outputs["lighting"], job.outputs["energy"]]
