"""Spring, damper, and an integral of velocity error and spring force."""

from dataclasses import dataclass
from typing import ClassVar

from eqt_cli.extend import Array, Controller, Tracking


@dataclass(frozen=True)
class Integrating(Controller):
    """Proportional, integral and derivative action on the body error.

    Attributes
    ----------
    ki
        Weight of the integral.
    """

    name: ClassVar[str] = "pid"
    title: ClassVar[str] = "PID"

    ki: float = 0.2

    def memory(self, G) -> dict[str, int]:
        """One number per coordinate."""
        return {"integral": G.dimension}

    def memory_rate(self, s: Tracking) -> dict[str, Array]:
        """The rate of the integral."""
        return {"integral": s.relative.V_tilde + 0.5 * s.relative.gradient}

    def torque(self, s: Tracking) -> Array:
        """τ, body frame."""
        r = s.relative
        return r.tau_d - r.body_damping - r.gradient - self.ki * s.memory["integral"]
