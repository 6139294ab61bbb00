"""Second, independent forms of Ad, ad and exp of a group, from its basis matrices, in floats."""

import numpy as np

from eqt_cli.core.arrays import Array
from eqt_cli.groups import MatrixLieGroup

TERMS = 18
"""Number of terms of the series of exp at ‖V‖ ≤ ½; the next term is below rounding."""


def ad_matrix(G: MatrixLieGroup, V: Array) -> Array:
    """Return the matrix of U ↦ [V, U], ``(..., m) -> (..., m, m)``, by commutators."""
    X = _matrix(G, V)[..., None, :, :]
    return np.moveaxis(_coordinates(G, X @ G.basis - G.basis @ X), -2, -1)


def Ad_matrix(G: MatrixLieGroup, Q: Array) -> Array:
    """Return the matrix of V ↦ (Q V^ Q⁻¹)^∨, ``(..., d, d) -> (..., m, m)``, by conjugation."""
    moved = Q[..., None, :, :] @ G.basis @ np.linalg.inv(Q)[..., None, :, :]
    return np.moveaxis(_coordinates(G, moved), -2, -1)


def exponential(G: MatrixLieGroup, V: Array) -> Array:
    """Return exp by its power series, with as many squarings as the largest argument needs."""
    X = _matrix(G, V)
    largest = float(np.abs(X).sum(axis=-1).max(initial=0.0))
    squarings = max(0, int(np.ceil(np.log2(2 * largest)))) if largest > 0 else 0
    X = X / 2.0**squarings
    term = found = np.broadcast_to(np.eye(G.size), X.shape)
    for k in range(1, TERMS):
        term = term @ X / k
        found = found + term
    for _ in range(squarings):
        found = found @ found
    return found


def applied(matrix: Array, vector: Array) -> Array:
    """Multiply a matrix with a vector."""
    found: Array = np.einsum("...ij,...j->...i", matrix, vector)
    return found


def _matrix(G: MatrixLieGroup, V: Array) -> Array:
    found: Array = np.einsum("...i,ijk->...jk", V, G.basis)
    return found


def _coordinates(G: MatrixLieGroup, U: Array) -> Array:
    """Return the coordinates by least squares, because a basis need not be orthogonal."""
    flat = G.basis.reshape(G.dimension, -1)
    found: Array = U.reshape(*U.shape[:-2], -1) @ np.linalg.pinv(flat)
    return found
