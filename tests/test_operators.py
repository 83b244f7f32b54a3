"""D_x, D_y and C of Eq. 17 and 18: layout by hand, transposes by the dot test; their normal equations."""

import numpy as np
import pytest
import scipy.sparse as sp
from hypothesis import given, settings
from hypothesis import strategies as st

from stages.solvers.kernels.sparse_rows import product
from stages.solvers.kernels.unit_vectors import as_unit
from stages.solvers.least_squares.conjugate_gradient import conjugate_gradient
from stages.solvers.least_squares.correspondence_operator import correspondence_matrix
from stages.solvers.least_squares.difference_operators import difference_matrices, first_pixels, neighbours
from stages.solvers.least_squares.reweighted_least_squares import (
    NormalEquations,
    l1_weights,
    smoothed_absolute,
    without_empty_rows,
)

SEEDS = st.integers(0, 2**32 - 1)
FEW = settings(deadline=None, max_examples=25, derandomize=True)


def random_masks(rng: np.random.Generator) -> list[np.ndarray]:
    """Two to four masks of odd and even sizes, with holes."""
    shapes = rng.integers(1, 8, (rng.integers(2, 5), 2))
    return [rng.random(tuple(shape)) < 0.7 for shape in shapes]


def random_correspondences(
    rng: np.random.Generator, counts: list[int]
) -> dict[tuple[int, int], sp.csr_array]:
    """At most one link per row, about half of the rows linked."""
    correspondences = {}
    for i in range(len(counts)):
        for j in range(i + 1, len(counts)):
            rows = np.flatnonzero(rng.random(counts[i]) < 0.5) if counts[j] else np.zeros(0, int)
            columns = rng.integers(0, max(counts[j], 1), rows.size)
            shape = (counts[i], counts[j])
            correspondences[i, j] = sp.csr_array((np.ones(rows.size, np.uint8), (rows, columns)), shape=shape)
    return correspondences


def assert_dot_test(operator: sp.csr_array, rng: np.random.Generator) -> None:
    """⟨A x, y⟩ = ⟨x, Aᵀ y⟩, with Aᵀ y written out from the entries rather than by the library."""
    x, y = rng.standard_normal(operator.shape[1]), rng.standard_normal(operator.shape[0])
    entries = operator.tocoo()
    row, column = entries.coords
    transposed = np.bincount(column, entries.data * y[row], operator.shape[1])
    assert operator @ x @ y == pytest.approx(x @ transposed, abs=1e-12)
    assert np.allclose(operator.T @ y, transposed)


@given(SEEDS)
@FEW
def test_every_operator_passes_the_dot_test(seed):
    rng = np.random.default_rng(seed)
    masks = random_masks(rng)
    counts = [int(mask.sum()) for mask in masks]
    for operator in (
        *difference_matrices(masks),
        correspondence_matrix(random_correspondences(rng, counts), counts),
    ):
        assert_dot_test(operator, rng)


def test_pixels_are_numbered_view_after_view_row_by_row():
    first = np.array([[True, False], [True, True]])
    second = np.array([[False, True, True]])
    assert first_pixels([first, second]).tolist() == [0, 3, 5]
    along_x, along_y = neighbours(first)
    assert [side.tolist() for side in along_x] == [[1], [2]]
    assert [side.tolist() for side in along_y] == [[0], [1]]
    assert [side.tolist() for side in neighbours(second, 3)[0]] == [[3], [4]]


def test_differences_stay_inside_the_mask():
    """D_x and D_y of Eq. 4 and Eq. 17, by hand."""
    mask = np.array([[True, True, False], [True, False, True]])
    d_x, d_y = difference_matrices([mask])
    rho = np.array([1.0, 4.0, 9.0, 16.0])  # (0,0) (0,1) (1,0) (1,2)
    assert (d_x @ rho).tolist() == [3.0, 0.0, 0.0, 0.0]
    assert (d_y @ rho).tolist() == [8.0, 0.0, 0.0, 0.0]


@given(SEEDS)
@FEW
def test_differences_are_forward_differences_of_the_image(seed):
    """On a masked image: what numpy's diff says between used neighbours, nothing elsewhere."""
    rng = np.random.default_rng(seed)
    mask = rng.random((5, 7)) < 0.8
    image = rng.standard_normal(mask.shape)
    d_x, d_y = difference_matrices([mask])
    in_x = np.zeros(mask.shape)
    in_x[:, :-1] = np.diff(image, axis=1) * (mask[:, 1:] & mask[:, :-1])
    in_y = np.zeros(mask.shape)
    in_y[:-1] = np.diff(image, axis=0) * (mask[1:] & mask[:-1])
    assert np.allclose(d_x @ image[mask], in_x[mask])
    assert np.allclose(d_y @ image[mask], in_y[mask])


def test_views_do_not_touch_each_other():
    views = [np.ones((2, 3), bool), np.ones((3, 2), bool)]
    for together, apart in zip(
        difference_matrices(views),
        (sp.block_diag(pair) for pair in zip(*(difference_matrices([view]) for view in views), strict=True)),
        strict=True,
    ):
        assert np.array_equal(together.toarray(), apart.toarray())


def test_eq_18_layout_for_four_views():
    """Eq. 18 with |Ω| = 2, 1, 3, 2 and the last pixel of i linked to the first of j in every pair."""
    counts = [2, 1, 3, 2]
    correspondences = {}
    for i in range(4):
        for j in range(i + 1, 4):
            correspondences[i, j] = sp.csr_array(([1], ([counts[i] - 1], [0])), shape=(counts[i], counts[j]))
    # columns:     1  1 | 2 | 3  3  3 | 4  4
    expected = [
        [0, 0, 0, 0, 0, 0, 0, 0],  # B12 C12
        [0, -1, 1, 0, 0, 0, 0, 0],
        [0, 0, 0, 0, 0, 0, 0, 0],  # B13 . C13
        [0, -1, 0, 1, 0, 0, 0, 0],
        [0, 0, 0, 0, 0, 0, 0, 0],  # B14 . . C14
        [0, -1, 0, 0, 0, 0, 1, 0],
        [0, 0, -1, 1, 0, 0, 0, 0],  # . B23 C23
        [0, 0, -1, 0, 0, 0, 1, 0],  # . B24 . C24
        [0, 0, 0, 0, 0, 0, 0, 0],  # . . B34 C34
        [0, 0, 0, 0, 0, 0, 0, 0],
        [0, 0, 0, 0, 0, -1, 1, 0],
    ]
    assert correspondence_matrix(correspondences, counts).toarray().tolist() == expected


def test_a_pair_without_links_keeps_its_rows():
    assert correspondence_matrix({}, [3, 2, 4]).shape == (3 + 3 + 2, 9)


@pytest.mark.parametrize(
    ("pair", "shape", "entries", "complaint"),
    [
        ((1, 0), (2, 2), [], "i < j"),
        ((0, 1), (3, 2), [], "shape"),
        ((0, 1), (2, 2), [(0, 0), (0, 1)], "more than one"),
    ],
)
def test_wrong_blocks_are_refused(pair, shape, entries, complaint):
    rows, columns = [e[0] for e in entries], [e[1] for e in entries]
    block = sp.csr_array((np.ones(len(entries)), (rows, columns)), shape=shape)
    with pytest.raises(ValueError, match=complaint):
        correspondence_matrix({pair: block}, [2, 2])


@given(SEEDS)
@FEW
def test_eq_17_normal_equations_are_j_transposed_j(seed):
    """Eq. 17: the filled pattern equals JᵀJ of the stacked, weighted operators, written out."""
    rng = np.random.default_rng(seed)
    masks = random_masks(rng)
    counts = [int(mask.sum()) for mask in masks]
    blocks = [*difference_matrices(masks), correspondence_matrix(random_correspondences(rng, counts), counts)]
    blocks = [without_empty_rows(block) for block in blocks]
    diagonal = rng.random(sum(counts))
    weights = [rng.random(block.shape[0]) for block in blocks]
    j = [np.diag(np.sqrt(diagonal))]
    j += [np.sqrt(w)[:, None] * block.toarray() for w, block in zip(weights, blocks, strict=True)]
    stacked = np.concatenate(j)
    filled = NormalEquations.of(blocks).assemble(diagonal, np.concatenate(weights))
    assert np.allclose(filled.toarray(), stacked.T @ stacked)


def test_a_row_that_is_no_difference_is_refused():
    with pytest.raises(ValueError, match="one −1 and one"):
        NormalEquations.of([sp.csr_array(np.array([[1.0, 1.0]]))])


def test_two_rows_between_the_same_unknowns_are_refused():
    twice = sp.csr_array(np.array([[-1.0, 1.0], [1.0, -1.0]]))
    with pytest.raises(ValueError, match="same two unknowns"):
        NormalEquations.of([twice])


def test_eq_12_14_15_16_weights_by_hand():
    """Eq. 12, Eq. 14, Eq. 15, Eq. 16: 1/max(δ, |r|)."""
    assert l1_weights(np.array([-0.5, 0.0, 1e-5, 2.0]), 1e-4).tolist() == [2.0, 1e4, 1e4, 0.5]


def test_the_smoothed_absolute_value_by_hand():
    values = smoothed_absolute(np.array([-3.0, 0.5, 0.0, 0.25]), 0.5)
    assert values.tolist() == [3.0, 0.5, 0.25, 0.3125]


@given(st.floats(-3, 3), st.floats(-3, 3), st.sampled_from([1e-4, 0.1, 1.0]))
@settings(deadline=None, max_examples=200, derandomize=True)
def test_the_weighted_square_lies_above_the_smoothed_absolute_value_and_touches_it(r, r0, delta):
    at, anchor = np.array([r]), np.array([r0])
    bound = smoothed_absolute(anchor, delta) + l1_weights(anchor, delta) * (at**2 - anchor**2) / 2
    assert smoothed_absolute(at, delta) <= bound * (1 + 1e-12) + 1e-12


def laplacian_system(rng: np.random.Generator, size: int = 60) -> tuple[sp.csr_array, np.ndarray]:
    d = sp.csr_array(sp.diags([-np.ones(size - 1), np.ones(size - 1)], [0, 1], shape=(size - 1, size)))
    return NormalEquations.of([d]).assemble(rng.random(size), 100 * rng.random(size - 1)), rng.random(size)


def test_conjugate_gradients_meet_their_tolerance_and_count_their_steps():
    matrix, rhs = laplacian_system(np.random.default_rng(5))
    solved = conjugate_gradient(matrix, rhs, np.zeros(60), 1e-10, 500)
    assert solved.reached
    assert 0 < solved.steps < 500
    assert solved.relative_residual <= 1.1e-10
    assert np.allclose(solved.x, np.linalg.solve(matrix.toarray(), rhs))


def test_conjugate_gradients_stopped_early_say_so_and_still_descend():
    matrix, rhs = laplacian_system(np.random.default_rng(6))
    start = np.random.default_rng(7).random(60)
    heights = []
    for steps in range(1, 12):
        solved = conjugate_gradient(matrix, rhs, start, 1e-12, steps)
        assert solved.steps == steps
        assert not solved.reached
        heights.append(solved.x @ (matrix @ solved.x) / 2 - rhs @ solved.x)
    assert heights[0] < start @ (matrix @ start) / 2 - rhs @ start
    assert np.all(np.diff(heights) < 0)


def test_nothing_to_fit_gives_nothing():
    matrix, _ = laplacian_system(np.random.default_rng(8))
    solved = conjugate_gradient(matrix, np.zeros(60), np.ones(60), 1e-6, 10)
    assert solved.reached
    assert not solved.x.any()


def test_an_unknown_that_nothing_holds_keeps_its_start():
    matrix = sp.csr_array(np.diag([2.0, 0.0]))
    solved = conjugate_gradient(matrix, np.array([4.0, 0.0]), np.array([0.0, 7.0]), 1e-8, 10)
    assert np.allclose(solved.x, [2.0, 7.0])


@given(SEEDS)
@FEW
def test_products_on_all_threads_have_the_bits_of_scipys(seed):
    rng = np.random.default_rng(seed)
    sparse = sp.random_array((40, 30), density=0.2, dtype=np.float32, rng=rng, format="csr")
    for width in (1, 2, 3, 4, 6):
        dense = rng.standard_normal((30, width)).astype(np.float32)
        assert np.array_equal(product(sparse, dense), sparse @ dense)
        assert np.array_equal(product(sparse, dense, slice(7, 19)), sparse[7:19] @ dense)


@pytest.mark.parametrize("precision", [np.float32, np.float64])
def test_unit_vectors_have_the_bits_of_numpy_and_zeros_stay_zero(precision):
    rng = np.random.default_rng(7)
    vectors = (rng.normal(size=(500, 3)) * 10.0 ** rng.uniform(-6, 6, (500, 1))).astype(precision)
    vectors[0], vectors[1] = 0, np.nan
    length = np.linalg.norm(vectors, axis=1, keepdims=True)
    expected = vectors / np.where(length > 0, length, 1)
    np.testing.assert_array_equal(as_unit(vectors), expected)
    assert as_unit(vectors).dtype == precision
