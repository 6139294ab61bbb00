"""A force given as expressions in time."""

from dataclasses import dataclass
from typing import Any, ClassVar, Self

import numpy as np

from eqt_cli.core.arrays import Array
from eqt_cli.groups import MatrixLieGroup
from eqt_cli.references.base import InExpressions
from eqt_cli.vehicle.forces.base import Force


@dataclass(frozen=True)
class ExpressionForce(InExpressions, Force):
    """A force f(t), one expression per coordinate.

    Attributes
    ----------
    force
        m expressions in t.
    """

    name: ClassVar[str] = "expression"
    departs: ClassVar[str] = "force in time"
    expressed: ClassVar[str] = "force"

    force: list[str | float]

    def of_run(self, G: MatrixLieGroup, random: np.random.Generator | None) -> Self:
        """Return the force itself: its entries are expressions, even where they are numbers."""
        return self

    def acting(self, G: MatrixLieGroup, t: Any, Q: Array, V: Array) -> Array:
        """Return f(t)."""
        return self.at(t)
