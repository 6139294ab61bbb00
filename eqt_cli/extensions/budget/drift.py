"""Drift of a sensor: a first-order Gauss-Markov process, by the floor of its Allan deviation."""

from dataclasses import dataclass
from itertools import accumulate
from typing import Annotated, Any, ClassVar

import numpy as np
from numpy.random import Generator

from eqt_cli.base.arrays import Array
from eqt_cli.base.errors import Problems
from eqt_cli.base.option_types import MEASURED, Positive, Scale, Unit
from eqt_cli.components import vehicle_parts
from eqt_cli.components.groups import MatrixLieGroup
from eqt_cli.components.sensors import Sensor

PEAK = 0.6173642831444414
"""Greatest Allan deviation of a first-order Gauss-Markov process over its std, at 1.893 T."""


@dataclass(frozen=True)
class Drift(Sensor):
    """A slow drift around 0: a first-order Gauss-Markov process, ḃ = −b / T + w.

    It starts from its stationary distribution N(0, std²). Its Allan deviation has one maximum,
    0.617 std at averages over 1.89 T, which stands for the floor that a data sheet calls bias
    instability (IEEE Std 952, annex C: 0.664 of the coefficient B of a flicker noise).

    Attributes
    ----------
    time
        T, the time after which the drift has forgotten 63 % of itself, s.
    instability
        The floor of the Allan deviation, as read off its plot; std = instability / 0.617.
    std
        Instead: the stationary standard deviation.
    """

    name: ClassVar[str] = "drift"
    departs: ClassVar[str] = "measurements that drift"
    positive: ClassVar[tuple[str, ...]] = ("time",)

    time: Annotated[Positive, Scale("time of the drift", "s")]
    instability: Annotated[vehicle_parts.Numbers | None, Unit(MEASURED)] = None
    std: Annotated[vehicle_parts.Numbers | None, Unit(MEASURED)] = None

    def deviation(self, G: MatrixLieGroup) -> Array:
        """Return the stationary standard deviation, ``(n,)``; of the means, if not yet drawn."""
        part: Any = self.drawn(None)
        if part.std is not None:
            return self.entries(part.std, G)
        return self.entries(part.instability, G) / PEAK

    def errors(self, G: MatrixLieGroup, instants: int, period: float, random: Generator) -> Array:
        """Return b_(k+1) = φ b_k + std √(1 − φ²) N(0, 1)^n with φ = exp(−period / T), exactly."""
        std, decay = self.drawn(random).deviation(G), np.exp(-period / self.time)
        steps = std * random.standard_normal((instants, self.coordinates(G)))
        steps[1:] *= np.sqrt(-np.expm1(-2 * period / self.time))
        return np.array(list(accumulate(steps, lambda drift, step: decay * drift + step)))

    def bias_deviation(self, G: MatrixLieGroup) -> tuple[Array, Array]:
        """Return std, and the deviation of a walk with the same noise, std √(2/T), ``(n,)``."""
        std = self.deviation(G)
        return std, std * np.sqrt(2 / self.time)

    def check(self, G: MatrixLieGroup, problems: Problems) -> None:
        """Note both or neither of std and instability, negative ones, and a wrong length."""
        if (self.std is None) == (self.instability is None):
            got = "neither" if self.std is None else "both"
            problems.add(f"expected instability or std, got {got}")
        for name, value in (("instability", self.instability), ("std", self.std)):
            if value is not None:
                self.check_entries(value, G, problems.at(name), deviations=True)
