"""A group given by its basis and closed forms, and a group of rotations and translations."""

from __future__ import annotations

import numpy as np

from eqt_cli.extend import Array, EuclideanGroup, MatrixLieGroup, Part, transpose


class Heisenberg(MatrixLieGroup):
    """Upper triangular matrices with ones on the diagonal; V = (ẋ, ẏ, ż − xẏ)."""

    name = "H3"
    axis_names = ("x", "y", "z")

    def __init__(self) -> None:
        self.basis = np.zeros((3, 3, 3))
        self.basis[0, 0, 1] = self.basis[1, 1, 2] = self.basis[2, 0, 2] = 1.0

    @property
    def parts(self) -> tuple[Part, ...]:
        """One part: the coordinates are plain numbers."""
        return (Part("whole", slice(0, 3), (slice(0, 3), slice(0, 3)), "1", "1/s", "J"),)

    def inverse(self, Q: Array) -> Array:
        """I − N + N², since N = Q − I has N³ = 0."""
        N = Q - self.identity
        return self.identity - N + N @ N

    def exp(self, V: Array) -> Array:
        """I + V^ + ½ V^²."""
        N = self.hat(V)
        return self.identity + N + N @ N / 2

    def log(self, Q: Array) -> Array:
        """N − ½ N²."""
        N = Q - self.identity
        return self.vee(N - N @ N / 2)

    def drift(self, Q: Array) -> Array:
        """0: no entry that can vary can leave the group."""
        return np.zeros(Q.shape[:-2])


class Turning(EuclideanGroup):
    """SO(3) with Ad in closed form: Ad_Q is Q."""

    name = "Turning"
    space = 3

    def Ad_matrix(self, Q: Array) -> Array:
        """Q."""
        return transpose(transpose(Q))
