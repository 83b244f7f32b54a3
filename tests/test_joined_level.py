"""Coarse levels of all views, added up from parts of their pixels, and descents that begin from them."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import scipy.sparse as sp
from hypothesis import given
from hypothesis import settings as examples
from hypothesis import strategies as st
from scipy.ndimage import binary_dilation

from stages.photometry.albedo.smooth_albedo import albedo_under_light, level_under_light
from stages.photometry.joint.begun_level import BegunLevel
from stages.photometry.joint.coarse_to_fine import coarse_solution, steps_of
from stages.photometry.joint.fast_alternation import FastSolver
from stages.photometry.joint.joined_level import PartOfLevel, joined, places_of
from stages.photometry.joint.problem_assembly import EdgeWeights
from stages.photometry.joint.pyramid import Level, coarser
from stages.photometry.joint.settings import FastSettings, Stopping
from stages.photometry.paper.energy import EnergyWeights
from stages.photometry.stack import StackedViews, crop_origin, cropped, stack_views
from stages.solvers.primal_dual.half_edges import HalfEdges
from stages.solvers.primal_dual.state_files import load_state, save_state

HIGH, WIDE, VIEWS = 90, 150, 3
WEIGHTS = EnergyWeights(10, 0.2)
HOW = FastSettings(coarse_iterations=20)
SOLVER = FastSolver(WEIGHTS, Stopping(tolerance=1e-3, gap=1e-2, max_rounds=4), HOW)


class Wall:
    """Views of a wall, side by side, each a few pixels further, linked where they overlap; and its photos."""

    def __init__(self, seed: int = 0, kept: list[np.ndarray] | None = None):
        rng = np.random.default_rng(seed)
        self.masks = [rng.random((HIGH, WIDE)) < 0.97 for _ in range(VIEWS)]
        paint = np.kron(rng.uniform(0.1, 1, (10, 20)), np.ones((12, 12)))
        self.shift = 12
        seen = [paint[:HIGH, self.shift * view : self.shift * view + WIDE] for view in range(VIEWS)]
        albedo = np.concatenate([own[mask] for own, mask in zip(seen, self.masks, strict=True)])
        self.shading = rng.uniform(0.4, 1, (len(albedo), 3)).astype(np.float32)
        noise = rng.uniform(0.8, 1.2, (len(albedo), 1))
        self.image = (albedo[:, None] * self.shading * noise).astype(np.float32)
        self.trusted = rng.random(len(albedo)) < 0.95
        self.columns = np.concatenate(
            [np.nonzero(mask)[1] + self.shift * view for view, mask in enumerate(self.masks)]
        )

    def links(self, masks: list[np.ndarray]) -> dict[tuple[int, int], sp.csr_array]:
        """Link pixels of the same place of the wall."""
        blocks = {}
        for i in range(VIEWS):
            for j in range(i + 1, VIEWS):
                apart = self.shift * (j - i)
                both = masks[i][:, apart:] & masks[j][:, :-apart]
                rows, columns = np.nonzero(both)
                one, other = (np.cumsum(mask).reshape(mask.shape) - 1 for mask in (masks[i], masks[j]))
                places = one[rows, columns + apart], other[rows, columns]
                shape = np.count_nonzero(masks[i]), np.count_nonzero(masks[j])
                blocks[i, j] = sp.csr_array((np.ones(len(rows)), places), shape=shape)
        return blocks

    def stack(self) -> StackedViews:
        return stack_views(self.masks, None, self.links(self.masks))

    def level(self, depth: int) -> Level:
        """The level of all, as its pyramid has it."""
        level = level_under_light(self.stack(), self.image, self.shading, self.trusted, SOLVER, EdgeWeights())
        for _ in range(depth):
            level = coarser(level)
        return level


class Part:
    """Columns of the wall, and a margin to either side."""

    def __init__(self, wall: Wall, begin: int, end: int, margin: int = 16, rim: bool = False):
        near = (wall.columns >= begin - margin) & (wall.columns < end + margin)
        starts = np.concatenate([[0], np.cumsum([np.count_nonzero(mask) for mask in wall.masks])])
        masks = []
        for view, mask in enumerate(wall.masks):
            own = np.zeros_like(mask)
            own[mask] = near[starts[view] : starts[view + 1]]
            masks.append(own)
        beside = [_touching(mask) & own for mask, own in zip(masks, wall.masks, strict=True)] if rim else []
        masks = [mask | ring for mask, ring in zip(masks, beside, strict=True)] if rim else masks
        self.kept = np.concatenate([mask[own] for mask, own in zip(masks, wall.masks, strict=True)])
        links = wall.links(masks)
        self.views = [view for view, mask in enumerate(masks) if mask.any()]
        self.origins = np.array([crop_origin(masks[view]) for view in self.views])
        index = {view: number for number, view in enumerate(self.views)}
        blocks = {(index[i], index[j]): block for (i, j), block in links.items() if i in index and j in index}
        self.stack = stack_views([cropped(masks[view]) for view in self.views], None, blocks)
        self.rim = (
            np.concatenate([ring[mask] for ring, mask in zip(beside, masks, strict=True)]) if rim else None
        )
        self.own = ((wall.columns >= begin) & (wall.columns < end))[self.kept]
        self.given = (
            self.stack,
            wall.image[self.kept],
            wall.shading[self.kept],
            wall.trusted[self.kept],
        )

    def adds(self, depth: int) -> PartOfLevel:
        level = level_under_light(*self.given, SOLVER, EdgeWeights(), self.own)
        return PartOfLevel.of(level, depth, self.views, self.origins)


def _touching(mask: np.ndarray) -> np.ndarray:
    """Pixels outside a mask that touch it."""
    return binary_dilation(mask) & ~mask


def dense(graph: HalfEdges) -> np.ndarray:
    return sp.csr_array((graph.weight, graph.neighbour, graph.first), shape=2 * (graph.size,)).toarray()


@examples(deadline=None, max_examples=20)
@given(st.integers(1, 4), st.lists(st.integers(1, 170), max_size=3), st.integers(0, 3))
def test_parts_add_up_to_the_level_of_all(depth, cuts, seed):
    """Wherever the wall is cut: through groups, beside them, more than once at a place."""
    wall = Wall(seed)
    ends = [0, *sorted(cuts), HIGH + WIDE]
    parts = [
        Part(wall, begin, end).adds(depth)
        for begin, end in zip(ends[:-1], ends[1:], strict=True)
        if ((wall.columns >= begin) & (wall.columns < end)).any()
    ]
    level, places = joined(parts, VIEWS)
    wanted = wall.level(depth)
    np.testing.assert_array_equal(level.starts, wanted.starts)
    np.testing.assert_array_equal(level.positions, wanted.positions)
    np.testing.assert_array_equal(places, places_of(wanted, range(VIEWS), np.zeros((VIEWS, 2), np.int64)))
    for name in ("image", "basis", "share"):
        np.testing.assert_allclose(getattr(level, name), getattr(wanted, name), rtol=1e-5, atol=1e-6)
    np.testing.assert_allclose(dense(level.graph), dense(wanted.graph), rtol=1e-5)
    assert (dense(level.graph) == dense(level.graph).T).all()


def test_a_part_comes_back_from_its_file(tmp_path):
    part = Part(Wall(), 30, 90).adds(2)
    part.save(tmp_path / "part.npz")
    for name, values in vars(PartOfLevel.load(tmp_path / "part.npz")).items():
        np.testing.assert_array_equal(values, getattr(part, name))


def begun(wall: Wall, depth: int, folder: Path, cuts=((0, 80), (80, 240))) -> BegunLevel:
    """Solve the coarse levels of all, and read them from files."""
    parts = [Part(wall, *ends).adds(depth) for ends in cuts]
    level, places = joined(parts, VIEWS)
    state = coarse_solution(level, depth, HOW, 1, np.ones((VIEWS, 3, 1)))
    save_state(folder, state)
    read = load_state(folder, steps_of(HOW, known_light=True), free_light=False)
    nowhere = np.zeros(len(wall.image), bool)
    return BegunLevel(depth, places, read, range(VIEWS), np.zeros((VIEWS, 2), np.int64), nowhere)


@pytest.mark.parametrize("depth", [1, 2, 3])
def test_a_descent_of_all_is_the_same_from_its_coarse_levels_apart(tmp_path, depth):
    """To the last bit: the same iterations, though the levels were written to files between them."""
    wall = Wall()
    given = wall.stack(), wall.image, wall.shading, wall.trusted, EdgeWeights(), SOLVER, 1, lambda: None
    usual = albedo_under_light(*given)
    other = albedo_under_light(*given, None, begun(wall, depth, tmp_path, cuts=((0, 240),)))
    assert usual.rounds == other.rounds
    np.testing.assert_array_equal(usual.albedo, other.albedo)


def test_parts_that_begin_together_agree_at_their_border(tmp_path):
    """Beside parts that do not, whose patches of paint end at the margin."""
    wall = Wall()
    given = wall.stack(), wall.image, wall.shading, wall.trusted, EdgeWeights(), SOLVER, 1, lambda: None
    whole = albedo_under_light(*given).albedo
    common = begun(wall, 2, tmp_path)

    def apart(together: bool) -> float:
        squares, count = 0.0, 0
        for ends in ((0, 80), (80, 240)):
            part = Part(wall, *ends, margin=4, rim=together)
            here = replace(common, views=part.views, origins=part.origins, rim=part.rim)
            begins = here if together else None
            solved = albedo_under_light(*part.given, EdgeWeights(), SOLVER, 1, lambda: None, None, begins)
            differences = (solved.albedo - whole[part.kept])[part.own]
            squares, count = squares + float((differences**2).sum()), count + differences.size
        return (squares / count) ** 0.5

    assert apart(together=True) < 0.5 * apart(together=False)


def test_a_rim_stays_where_the_coarse_level_has_it(tmp_path):
    """However strongly it is tied to what it touches."""
    wall = Wall()
    common, part = begun(wall, 2, tmp_path), Part(wall, 0, 80, margin=4, rim=True)
    here = replace(common, views=part.views, origins=part.origins, rim=part.rim)
    stack, image, shading, trusted = part.given
    dark = np.where(part.rim[:, None], image, 0.1 * image)
    solved = albedo_under_light(
        stack, dark, shading, trusted, EdgeWeights(), SOLVER, 1, lambda: None, None, here
    )
    coarse = common.state.slices.collect(common.state.albedo)
    wanted = np.searchsorted(common.places, places_of(_reduced(part, 2), part.views, part.origins >> 2))
    np.testing.assert_allclose(solved.albedo[part.rim], coarse[wanted][part.rim], atol=0.01)
    assert solved.albedo[~part.rim].mean() < 0.8 * wall.image[part.kept][~part.rim].mean()


def _reduced(part: Part, depth: int) -> Level:
    level = level_under_light(*part.given, SOLVER, EdgeWeights())
    return replace(level, positions=level.positions >> depth)
