"""Numbers that are rounded once, against mpmath's matrices and functions with 80 digits."""

import mpmath
import numpy as np
import pytest

from eqt_cli.extend import group_named, sin
from eqt_cli.numbers.rounded import inverse, is_exact, product, pseudo_inverse, rounded

A = np.random.default_rng(3).normal(size=(4, 6))


def nearest(matrix):
    """The doubles that are nearest to the entries."""
    return np.array([[float(entry) for entry in row] for row in matrix.tolist()])


@mpmath.workdps(80)
def test_an_inverse_of_an_ill_conditioned_matrix_has_no_error_but_its_rounding():
    hilbert = 1 / (np.arange(1.0, 8.0)[:, None] + np.arange(7.0))
    assert (inverse(hilbert) == nearest(mpmath.inverse(mpmath.matrix(hilbert.tolist())))).all()
    assert (product(A, A.T) == nearest(mpmath.matrix(A) * mpmath.matrix(A.T))).all()


@mpmath.workdps(80)
def test_pseudo_inverses_of_independent_rows_or_columns():
    B = mpmath.matrix(A.tolist())
    wide = nearest(B.T * mpmath.inverse(B * B.T))
    with_zeros = np.insert(A, 2, 0.0, axis=0)
    assert (pseudo_inverse(A, 4) == wide).all()
    assert (pseudo_inverse(with_zeros, 4) == np.insert(wide, 2, 0.0, axis=1)).all()
    assert (pseudo_inverse(A.T, 4) == wide.T).all()


def test_a_pseudo_inverse_of_dependent_rows_is_lapacks():
    B = np.concatenate([A, A[:1] + A[1:2]])
    found = pseudo_inverse(B, 4)
    assert found == pytest.approx(np.linalg.pinv(B), abs=1e-14)
    assert [is_exact(each) for each in (A, A.T, B, np.insert(A, 2, 0.0, axis=0))] == [
        *(True, True, False, True)
    ]


@mpmath.workdps(80)
def test_functions_are_rounded_once():
    x = np.array([0.1, 3.0, 1e6])
    assert rounded(sin, x).tolist() == [float(mpmath.sin(each)) for each in x.tolist()]


def test_a_pose_is_that_of_floats_but_for_rounding():
    G, V = group_named("SE3"), A[0]
    assert rounded(G.exp, V) == pytest.approx(G.exp(V), abs=1e-15)
    assert rounded(G.exp, 0.0 * V).tolist() == np.eye(4).tolist()
