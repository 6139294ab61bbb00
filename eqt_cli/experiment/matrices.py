"""Matrices from numbers, diagonals or rows, with checks that say what is wrong with them."""

import numpy as np

from eqt_cli.core.arrays import Array
from eqt_cli.core.errors import InputError
from eqt_cli.groups import MatrixLieGroup
from eqt_cli.mechanics import navigation

SYMMETRY_TOLERANCE = 1e-12
"""Largest asymmetry, relative to the largest entry: rounding of numbers written in decimal."""


LARGEST = 1e100
"""A largest entry is no larger, and no smaller than its inverse: products must be numbers."""


def require_symmetric(matrix: Array) -> None:
    """Raise an `InputError` that says where a matrix is not symmetric."""
    difference = np.abs(matrix - matrix.T)
    if difference.max() > SYMMETRY_TOLERANCE * np.abs(matrix).max():
        i, j = np.unravel_index(difference.argmax(), matrix.shape)
        raise InputError(
            f"expected a symmetric matrix, got [{i}][{j}] = {matrix[i, j]:g} "
            f"but [{j}][{i}] = {matrix[j, i]:g}"
        )


def require_definite(matrix: Array) -> None:
    """Raise an `InputError` if the symmetric part of a matrix is not positive definite."""
    eigenvalues = _eigenvalues((matrix + matrix.T) / 2)
    if not _positive(eigenvalues):
        got = f"got eigenvalues {_listed(eigenvalues)}"
        raise InputError(f"expected a positive definite matrix, {got}")


def require_minimum(K: Array, group: MatrixLieGroup) -> None:
    """Raise an `InputError` if Υ has no non-degenerate minimum at I."""
    eigenvalues = _eigenvalues(navigation.hessian_at_identity(group, K))
    if not _positive(eigenvalues):
        raise InputError(
            "expected a weight whose navigation function has a non-degenerate minimum at I, that "
            f"is, a Hessian on {group.name} with positive eigenvalues (on SO3: the sums of two "
            f"eigenvalues of kp), got {_listed(eigenvalues)}"
        )


def _eigenvalues(matrix: Array) -> Array:
    """Those of a symmetric matrix, which must be neither huge nor tiny as a whole.

    Raises
    ------
    InputError
        If squares of its entries, or of those of its inverse, may overflow.
    """
    size = float(np.abs(matrix).max())
    if size and not 1 / LARGEST <= size <= LARGEST:
        raise InputError(
            f"expected the largest entry to be from {1 / LARGEST:g} to {LARGEST:g}, got {size:g}; "
            "choose other units"
        )
    return np.linalg.eigvalsh(matrix)


def _positive(eigenvalues: Array) -> bool:
    """Whether all are greater than 0 beyond rounding, so that there is an inverse."""
    return bool(eigenvalues.min() > max(_rounding(eigenvalues), np.finfo(float).tiny))


def _listed(eigenvalues: Array) -> str:
    """The eigenvalues, with 0 for those that are nothing but rounding."""
    clean = np.where(np.abs(eigenvalues) <= _rounding(eigenvalues), 0.0, eigenvalues)
    return ", ".join(f"{value:.4g}" for value in clean)


def _rounding(eigenvalues: Array) -> float:
    """How wrong computed eigenvalues may be."""
    return float(len(eigenvalues) * np.finfo(float).eps * np.abs(eigenvalues).max())
