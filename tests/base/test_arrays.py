"""Products of stacks with one matrix, which have a way of their own, are those of every entry."""

import numpy as np
import pytest

from eqt_cli.base.arrays import apply_matrix, times

RANDOM = np.random.default_rng(5)
# Sums of three products of numbers up to 4, in another order.
ROUNDING = 1e-14


@pytest.mark.parametrize("shape", [(), (7,), (4, 5)])
@pytest.mark.parametrize("one", [True, False])
def test_matrix_times_vectors(shape, one):
    matrix = RANDOM.standard_normal((2, 3) if one else (*shape, 2, 3))
    vectors = RANDOM.standard_normal((*shape, 3))
    expected = np.einsum("...ij,...j->...i", matrix, vectors)
    np.testing.assert_allclose(apply_matrix(matrix, vectors), expected, rtol=0, atol=ROUNDING)


@pytest.mark.parametrize("shape", [(), (7,), (4, 5), (4, 0)])
@pytest.mark.parametrize("one", [True, False])
def test_stack_times_matrix(shape, one):
    stack = RANDOM.standard_normal((*shape, 2, 3))
    matrix = RANDOM.standard_normal((3, 4) if one else (*shape, 3, 4))
    expected = np.einsum("...ij,...jk->...ik", stack, matrix)
    found = times(stack, matrix)
    assert found.shape == (*shape, 2, 4)
    np.testing.assert_allclose(found, expected, rtol=0, atol=ROUNDING)


def test_one_row_does_not_depend_on_the_others():
    """Runs must be the same bits whatever else is in their part."""
    stack, matrix = RANDOM.standard_normal((501, 3, 3)), RANDOM.standard_normal((3, 3))
    whole = times(stack, matrix)
    for count in (1, 2, 100):
        np.testing.assert_array_equal(times(stack[:count], matrix), whole[:count])
