"""A reference that a law of its own drives, with options and checks."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import Any, ClassVar

from eqt_cli.extend import (
    Array,
    Expression,
    Inertia,
    MatrixLieGroup,
    Problems,
    Real,
    Reference,
    parse,
    sin,
    stack,
)


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

    def check(self, G: MatrixLieGroup, problems: Problems) -> None:
        """Note a wrong number of frequencies, and an amplitude that is no expression."""
        if len(self.frequencies) != G.dimension:
            got = len(self.frequencies)
            problems.at("frequencies").add(f"expected {G.dimension} for {G.name}, got {got}")
        with problems.catching("amplitude"):
            parse(self.amplitude)
