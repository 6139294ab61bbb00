"""The identification of so(3) with R³, for the formulas that the paper states on SO(3) only."""

from __future__ import annotations

import numpy as np

from eqt_cli.core.arrays import Array, stack
from eqt_cli.groups import MatrixLieGroup


def is_rotations_of_space(G: MatrixLieGroup) -> bool:
    """Whether [u, v] = u × v in a group of 3×3 matrices: the group is SO(3), whatever its name."""
    if G.dimension != 3 or G.size != 3:
        return False
    cross = np.cross(np.eye(3)[:, None], np.eye(3)[None])
    return bool((G.structure_constants == cross).all())


def vee(U: Array) -> Array:
    """The vector u of a skew-symmetric matrix u^×, ``(..., 3, 3) -> (..., 3)``."""
    return stack([U[..., 2, 1], U[..., 0, 2], U[..., 1, 0]])


def cross(u: Array, v: Array) -> Array:
    """u × v, ``(..., 3)``."""
    return stack([u[..., i - 2] * v[..., i - 1] - u[..., i - 1] * v[..., i - 2] for i in range(3)])
