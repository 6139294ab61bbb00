"""A reference that a law of its own drives, with options and checks."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import Any, ClassVar

from eqt_cli.core.arrays import Array, sin, stack
from eqt_cli.core.errors import ExpressionError
from eqt_cli.core.expressions import Expression, parse
from eqt_cli.core.numbers import Real
from eqt_cli.groups import MatrixLieGroup
from eqt_cli.mechanics.inertia import Inertia
from eqt_cli.references.base import Reference


@dataclass(frozen=True)
class Swinging(Reference):
    """A torque a(t)·sin(ωt) along every axis, against a drag.

    Attributes
    ----------
    amplitude
        a(t), an expression in t.
    frequencies
        ω of every axis, rad/s.
    drag
        Factor on −P_d.
    """

    name: ClassVar[str] = "swinging"

    frequencies: list[Real]
    amplitude: str = "1"
    drag: Real = 0.1

    @cached_property
    def _amplitude(self) -> Expression:
        return parse(self.amplitude)

    def driving_torque(self, G: MatrixLieGroup, inertia: Inertia, t: Any, Pd: Array) -> Array:
        """τ_d."""
        a = self._amplitude.evaluate({"t": t})
        swing = stack([a * sin(omega * t) for omega in self.frequencies])
        return swing - self.drag * inertia.momentum(inertia.velocity(Pd))

    def problems(self, G: MatrixLieGroup) -> list[tuple[str, str]]:
        """A wrong number of frequencies, or an amplitude that does not parse."""
        found = []
        if len(self.frequencies) != G.dimension:
            got = len(self.frequencies)
            found.append(("frequencies", f"expected {G.dimension} for {G.name}, got {got}"))
        try:
            parse(self.amplitude)
        except ExpressionError as error:
            found.append(("amplitude", str(error)))
        return found
