"""A reference whose body velocity is given as expressions in time."""

from dataclasses import dataclass
from typing import Any, ClassVar

from eqt_cli.core.arrays import Array, stack
from eqt_cli.core.jets import value_and_derivative
from eqt_cli.groups import MatrixLieGroup
from eqt_cli.references.base import InExpressions, ReferenceByRates


@dataclass(frozen=True)
class RatesReference(InExpressions, ReferenceByRates):
    """A body velocity V_d(t), one expression per coordinate; the pose is integrated.

    Attributes
    ----------
    rates
        m expressions in t, body frame.
    """

    name: ClassVar[str] = "rates"
    expressed: ClassVar[str] = "rates"

    rates: list[str | float]

    def velocity(self, G: MatrixLieGroup, t: Any) -> tuple[Array, Array]:
        """V_d(t) and its exact derivative."""
        pairs = [value_and_derivative(expression, {"t": t}) for expression in self.expressions]
        values, rates = zip(*pairs, strict=True)
        return stack(values), stack(rates)
