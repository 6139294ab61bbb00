"""Drag, linear and quadratic in the velocity."""

from dataclasses import dataclass
from typing import Any, ClassVar

from eqt_cli.core.arrays import Array, absolute, apply_matrix
from eqt_cli.groups import MatrixLieGroup
from eqt_cli.vehicle.component import Given
from eqt_cli.vehicle.forces.base import Force
from eqt_cli.vehicle.numbers import Matrix


@dataclass(frozen=True)
class Drag(Force):
    """The drag −(D₁ + D₂ diag|V|) V.

    Attributes
    ----------
    linear
        D₁: a number, a list (the diagonal) or a matrix.
    quadratic
        D₂, likewise.
    """

    name: ClassVar[str] = "drag"
    departs: ClassVar[str] = "drag"
    matrices: ClassVar[tuple[str, ...]] = ("linear", "quadratic")

    linear: Matrix = 0.0
    quadratic: Matrix = 0.0

    def acting(self, G: MatrixLieGroup, t: Any, Q: Array, V: Array, given: Given) -> Array:
        """−D₁ V − D₂ (|V| V)."""
        squares = apply_matrix(given["quadratic"], absolute(V) * V)
        return -apply_matrix(given["linear"], V) - squares
