"""A reference whose body velocity is given as expressions in time."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import Any, ClassVar

from eqt_cli.core.arrays import Array, stack
from eqt_cli.core.differentiation import value_and_derivative
from eqt_cli.core.expressions import Expression, formula
from eqt_cli.core.problems import Problems
from eqt_cli.groups import MatrixLieGroup
from eqt_cli.references.base import ReferenceByRates, check_expressions, instants_of


@dataclass(frozen=True)
class RatesReference(ReferenceByRates):
    """A body velocity V_d(t), one expression per coordinate; the pose is integrated.

    Attributes
    ----------
    rates
        m expressions in t, body frame.
    """

    name: ClassVar[str] = "rates"

    rates: list[str | float]

    @cached_property
    def expressions(self) -> list[Expression]:
        """The velocity, parsed."""
        return [formula(entry) for entry in self.rates]

    def velocity(self, G: MatrixLieGroup, t: Any) -> tuple[Array, Array]:
        """V_d(t) and its exact derivative."""
        pairs = [value_and_derivative(expression, {"t": t}) for expression in self.expressions]
        values, rates = zip(*pairs, strict=True)
        return stack(values), stack(rates)

    def instants(self, G: MatrixLieGroup) -> Array:
        """Where an expression changes its piece."""
        return instants_of(self.expressions)

    def check(self, G: MatrixLieGroup, problems: Problems) -> None:
        """Expressions that do not parse, or a number of them that is not m."""
        check_expressions(self.rates, G, problems.at("rates"))
