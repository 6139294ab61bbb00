"""A force that is given as expressions in time."""

from dataclasses import dataclass
from typing import Any, ClassVar

from eqt_cli.core.arrays import Array
from eqt_cli.groups import MatrixLieGroup
from eqt_cli.references.base import InExpressions
from eqt_cli.vehicle.component import Given
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

    def acting(self, G: MatrixLieGroup, t: Any, Q: Array, V: Array, given: Given) -> Array:
        """f(t)."""
        return self.at(t)
