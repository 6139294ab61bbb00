"""The `gains` section, and checks of matrices: symmetry, definiteness and size."""

from typing import Any

import numpy as np

from eqt_cli.core.arrays import Array
from eqt_cli.core.errors import InputError, Problems
from eqt_cli.groups import MatrixLieGroup
from eqt_cli.groups.product import ProductGroup
from eqt_cli.mechanics import navigation
from eqt_cli.mechanics.tracking import Gains
from eqt_cli.notation.poses import square


def gains_from(section: dict[str, Any], G: MatrixLieGroup, problems: Problems) -> Gains | None:
    """Return the gains of a section, or None after noting its problems.

    Parameters
    ----------
    section
        The keys `kp` and `kd` that are present and have the right type.
    """
    K = K_d = None
    if "kp" in section:
        with problems.catching("kp"):
            K = _weight(section["kp"], G)
            require_symmetric(K)
            require_minimum(K, G)
    if "kd" in section:
        with problems.catching("kd"):
            K_d = square(section["kd"], G.dimension, G)
            require_definite(K_d)
    return None if K is None or K_d is None else Gains(K, K_d)


def _weight(value: Any, G: MatrixLieGroup) -> Array:
    """Return the d×d weight, from one matrix or from one for each factor."""
    if not isinstance(G, ProductGroup) or not isinstance(value, list):
        return square(value, G.size, G)
    if len(value) == G.size and len(value) != len(G.factors):
        return square(value, G.size, G)
    if len(value) != len(G.factors):
        expected = f"expected {len(G.factors)} entries, one per factor of {G.name}"
        raise InputError(f"{expected}, got {len(value)}")
    blocks = []
    for index, (entry, factor) in enumerate(zip(value, G.factors, strict=True)):
        try:
            blocks.append(square(entry, factor.size, factor))
        except InputError as error:
            raise InputError(f"entry {index}: {error}") from error
    from scipy.linalg import block_diag  # slow to import, and readers of results do not need it

    return block_diag(*blocks)


SYMMETRY_TOLERANCE = 1e-12
"""Largest asymmetry relative to the largest entry, due to decimal rounding."""


LARGEST = 1e100
"""Bound of the largest entry; its inverse is the lower bound. So products do not overflow."""


def require_symmetric(matrix: Array) -> None:
    """Raise an `InputError` with the entries in which a matrix is not symmetric."""
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
            f"must be positive, so that small errors on {group.name} have a positive stiffness (on "
            f"SO3: every sum of two eigenvalues); got the stiffness {_listed(eigenvalues)}"
        )


def _eigenvalues(matrix: Array) -> Array:
    """Return the eigenvalues of a symmetric matrix after checking its size.

    Raises
    ------
    InputError
        If squares of its entries, or of the entries of its inverse, may overflow.
    """
    size = float(np.abs(matrix).max())
    if size and not 1 / LARGEST <= size <= LARGEST:
        raise InputError(
            f"expected the largest entry to be from {1 / LARGEST:g} to {LARGEST:g}, got {size:g}; "
            "choose other units"
        )
    return np.linalg.eigvalsh(matrix)


def _positive(eigenvalues: Array) -> bool:
    """Whether all are greater than 0 by more than rounding, so that an inverse exists."""
    return bool(eigenvalues.min() > max(_rounding(eigenvalues), np.finfo(float).tiny))


def _listed(eigenvalues: Array) -> str:
    """List the eigenvalues, with 0 for those within rounding."""
    clean = np.where(np.abs(eigenvalues) <= _rounding(eigenvalues), 0.0, eigenvalues)
    return ", ".join(f"{value:.4g}" for value in clean)


def _rounding(eigenvalues: Array) -> float:
    """Return the rounding error of computed eigenvalues."""
    return float(len(eigenvalues) * np.finfo(float).eps * np.abs(eigenvalues).max())
