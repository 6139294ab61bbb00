"""R^n: translations without rotations, for products of groups."""

import re
from typing import Self

import numpy as np

from eqt_cli.core.arrays import Array
from eqt_cli.groups.euclidean import EuclideanGroup


class VectorGroup(EuclideanGroup):
    """Vectors of R^n under addition, R1 to R9, as matrices [[I, x], [0, 1]]; V is ẋ."""

    name = "R<n>"
    columns = ("position",)
    column_units = ("m",)
    force_units = ("N",)

    def __init__(self, n: int) -> None:
        self.space = n
        self.rotations = 0
        self.basis = np.zeros((n, n + 1, n + 1))
        self.basis[range(n), range(n), n] = 1.0
        self.axis_names = tuple(f"v{index + 1}" for index in range(n))
        self.name = f"R{n}"

    @classmethod
    def named(cls, name: str) -> Self | None:
        """Return R^3 for R3."""
        match = re.fullmatch(r"R([1-9])", name)
        return cls(int(match.group(1))) if match else None

    @classmethod
    def examples(cls) -> tuple[str, ...]:
        """A line and a space."""
        return "R1", "R3"

    def Ad_matrix(self, Q: Array) -> Array:
        """I: the group is commutative."""
        return np.broadcast_to(np.eye(self.space), (*Q.shape[:-2], self.space, self.space))

    def exp(self, V: Array) -> Array:
        """I + V^."""
        return self.identity + self.hat(V)

    def log(self, Q: Array) -> Array:
        """The translation."""
        return Q[..., : self.space, self.space]

    def jacobian(self, x: Array) -> Array:
        """I: the group is commutative."""
        return np.broadcast_to(np.eye(self.space), (*x.shape[:-1], self.space, self.space))

    def log_force(self, x: Array, p: Array) -> Array:
        """p: the logarithm is linear."""
        return p

    def drift(self, Q: Array) -> Array:
        """0: the varying entries are free."""
        return np.zeros(Q.shape[:-2])
