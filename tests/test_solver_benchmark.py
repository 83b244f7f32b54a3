"""The solvers' race on a problem too small to mean much; and the pieces that count."""

from __future__ import annotations

import json
from itertools import combinations

import numpy as np
import pytest

from benchmarks.solver.__main__ import arguments, main, plan_of
from benchmarks.solver.clock import Clock, Look, OutOfTime, Trace
from benchmarks.solver.comparison import compare
from benchmarks.solver.compiled_pcg import reweighted_descent
from benchmarks.solver.corrugated_plane import VIEWS, corrugated_plane
from benchmarks.solver.growth import slope
from benchmarks.solver.inner_solvers import INNER_SOLVERS
from benchmarks.solver.ours import endless, timed
from benchmarks.solver.starts import STARTS, apart, distances, energy, rows, solve_from
from stages.photometry.joint.problem_assembly import graph_of
from stages.photometry.paper.albedo_step import albedo_system


@pytest.fixture(scope="module")
def report(tmp_path_factory):
    to = tmp_path_factory.mktemp("solver")
    problems = ["--problems", "plane-3000,nowhere", "--budget", "0.3", "--sizes", "8000"]
    return main(["--quick", *problems, "--to", str(to)])


@pytest.fixture(scope="module")
def content(report):
    return json.loads(report.with_name("solver.json").read_text(encoding="utf-8"))


def test_every_method_that_is_installed_has_its_trace_and_ours_ends_lowest(content):
    (race,) = content["races"]
    names = ["ours", "compiled PCG", *(inner.name for inner in INNER_SOLVERS if inner.available)]
    assert list(race["traces"]) == names
    for trace in race["traces"].values():
        seconds = [one[0] for one in trace]
        assert seconds == sorted(seconds)
        assert len(trace) >= 2
    ours, *rivals = race["comparisons"]
    assert ours["ratio"] == 1
    assert all(ours["least"] <= rival["least"] for rival in rivals)


def test_the_report_has_table_picture_and_what_was_left_out(report, content):
    page = report.read_text(encoding="utf-8")
    assert "| method | looks | least energy |" in page
    assert "nowhere is left out: it is no problem that is known" in page
    (race,) = content["races"]
    assert report.with_name(f"{race['problem']}.png").stat().st_size > 5000


def test_rivals_are_chosen_by_words_of_their_names(capsys):
    rules = plan_of(arguments(["--rivals", "plain,Jacobi"])).rules
    admitted = [inner.name for inner in INNER_SOLVERS if rules.admit(inner.name)]
    assert admitted == ["paper, plain CG", "paper, Jacobi CG"]
    assert plan_of(arguments([])).rules.admit("compiled PCG")
    with pytest.raises(SystemExit, match="2"):
        arguments(["--rivals", "plain,plane"])
    assert "'plane': expected words in the names of compiled PCG; paper, plain CG" in capsys.readouterr().err


def test_speed_and_growth_are_positive_numbers(content):
    assert {speed["kernel"]["threads"] for speed in content["speeds"]} >= {1}
    assert all(speed["bytes_per_s"] > 0 and speed["share"] > 0 for speed in content["speeds"])
    assert len(content["growth"]) == 1
    assert all(0 < one["given_bytes"] <= one["peak_bytes"] for one in content["growth"])


def test_ratios_are_taken_at_the_rivals_own_energy_where_it_never_gets_near():
    ours = Trace("ours", (Look(1.0, 120.0), Look(2.0, 100.0)))
    near = Trace("near", (Look(0.0, 500.0), Look(6.0, 100.9)))
    far = Trace("far", (Look(0.0, 500.0), Look(10.0, 120.0), Look(20.0, 130.0)))
    never = Trace("never", (Look(0.0, 500.0),))
    first, second, third, fourth = compare([ours, near, far, never], ours)
    assert (first.ratio, first.at_least) == (1, False)
    assert (second.ratio, second.near_s, second.at_least) == (3, 6.0, False)
    assert (third.ratio, third.near_s, third.at_least) == (10, None, True)
    assert fourth.ratio is None


def test_the_plane_has_four_links_per_pixel_and_about_the_size_asked_for():
    problem = corrugated_plane(20_000)
    assert problem.pixels == pytest.approx(20_000, rel=0.05)
    assert problem.views.view_count == VIEWS
    assert 3.5 < problem.views.correspondence_count / problem.pixels <= 4
    assert np.percentile(np.stack(problem.images), 99) == pytest.approx(1)


def test_the_compiled_rival_solves_the_papers_normal_equations():
    problem = corrugated_plane(2000)
    views, weights = problem.views, problem.weights
    light = np.ones((VIEWS, 9))
    albedo = np.stack(problem.images, axis=1)
    shading = np.repeat(views.shading(light)[:, None], 3, axis=1)
    graph = graph_of(views, weights)
    given = (values.astype(np.float32) for values in (albedo, shading, albedo))
    found = reweighted_descent(graph, *given, 1e-2, 200)
    for channel, image in enumerate(problem.images):
        matrix, rhs = albedo_system(views, image, image, light, weights, 1e-2)
        residual = rhs - matrix @ found[:, channel].astype(np.float64)
        assert np.linalg.norm(residual) < 1e-3 * np.linalg.norm(rhs)


@pytest.mark.parametrize("inner", INNER_SOLVERS, ids=lambda inner: inner.name)
def test_every_inner_solver_solves_and_can_be_stopped(inner):
    if not inner.available:
        pytest.skip(f"{inner.package} is not installed")
    problem = corrugated_plane(2000)
    image, light = problem.images[0], np.ones((VIEWS, 9))
    matrix, rhs = albedo_system(problem.views, image, image, light, problem.weights, 1e-4)
    x = inner.solve(matrix, rhs, image, lambda *_: None)
    assert np.linalg.norm(rhs - matrix @ x) < 1e-4 * np.linalg.norm(rhs)
    with pytest.raises(OutOfTime):
        inner.solve(matrix, rhs, image, Clock(-1).check)


def test_ours_is_traced_at_the_energy_that_it_has():
    problem = corrugated_plane(2000)
    solved = timed(problem, 1, endless(problem, 3))
    trace = solved.trace()
    assert len(trace.looks) == 4
    exact = sum(terms.total(problem.weights) for terms in solved.descent.terms)
    assert trace.least == pytest.approx(exact, rel=1e-5)


def test_held_time_does_not_count():
    clock = Clock(100, workers=1)
    with clock.held():
        before = clock.seconds
        while clock.seconds < before + 0.05:
            pass
    assert clock.seconds < before + 0.05


def test_slopes():
    assert slope([1, 10, 100], [3, 30, 300]) == pytest.approx(1)
    assert slope([1, 10, 100], [7, 7, 7]) == pytest.approx(0)


def test_three_starts_end_at_one_energy_and_one_albedo():
    problem = corrugated_plane(3000)
    found = {name: solve_from(name, problem, threads=1) for name in STARTS}
    energies = [energy(problem, descent) for descent in found.values()]
    assert max(energies) < 1.003 * min(energies)
    for one, other in combinations(found.values(), 2):
        assert max(distances(one.albedo, other.albedo)) < 0.01
    assert len(list(rows(problem, found))) == len(STARTS)
    assert apart(found).count(";") == 2
