"""Sliding mode with a boundary layer, on any group."""

from dataclasses import dataclass
from typing import Annotated, ClassVar

from eqt_cli.controllers.sliding_variable import SlidingVariable
from eqt_cli.core.arrays import Array, tanh
from eqt_cli.core.option_types import TORQUE, VELOCITY, Positive, Unit
from eqt_cli.mechanics.tracking import Tracking


@dataclass(frozen=True)
class Sliding(SlidingVariable):
    """Sliding mode with a smooth boundary layer; uses its own gains (not matched).

    reaching = gain · tanh(s / layer), coordinate by coordinate: after Slotine and Li (1991), sec.
    7.2, with tanh in place of their saturation: the same slope at 0 and bounds, without corners.
    The book was not read. `gains.kd` is not used.

    Attributes
    ----------
    gain
        The largest force against s, N m (N for translations).
    layer
        Thickness of the boundary layer, rad/s (m/s for translations).
    """

    name: ClassVar[str] = "sliding"
    title: ClassVar[str] = "sliding mode"
    theorem: ClassVar[str] = "after Slotine, Li (1991), section 7.2"
    bibtex: ClassVar[str] = """\
@book{slotine1991applied,
  author    = {Slotine, Jean-Jacques E. and Li, Weiping},
  title     = {Applied Nonlinear Control},
  publisher = {Prentice Hall},
  year      = {1991}
}"""

    gain: Annotated[Positive, Unit(TORQUE)] = 0.5
    layer: Annotated[Positive, Unit(VELOCITY)] = 0.5

    def reaching(self, r: Tracking) -> Array:
        """gain · tanh(s / layer)."""
        return self.gain * tanh(r.V_tilde / self.layer)
