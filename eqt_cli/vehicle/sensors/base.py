"""The base class of measurement errors; it knows no law or engine."""

from abc import abstractmethod
from dataclasses import dataclass, field
from typing import Annotated

import numpy as np

from eqt_cli.core.arrays import Array
from eqt_cli.core.errors import Problems
from eqt_cli.core.option_types import CountOrTime, Offset, Positive, Real, Scale
from eqt_cli.groups import MatrixLieGroup
from eqt_cli.vehicle.component import Numbers, VehiclePart, check_count


@dataclass(frozen=True)
class Sensor(VehiclePart):
    """An error of a measured pose or velocity, at the instants at which it is measured.

    Errors of a pose add up to n with Q_m = Q exp(n), errors of a velocity to b with V_m = V + b.
    They depend on the run and on the instant. Entries of one part share `period`, `offset`, `delay`
    and `dropout`, given at one of them.

    A sensor of a velocity may have states that follow the motion. What it measures is their
    `reading`, to which the errors of all sensors add.

    Attributes
    ----------
    of
        The part of the pose or velocity that is measured, as the group calls it; all of them if
        left out.
    period
        Time between measurements, s, a whole number of ticks of `control`; the law reads the last
        one. If left out, there is one at each instant of the law.
    offset
        Time of the first measurement after that of t = 0, s, a whole number of ticks.
    delay
        Number of control periods after which a measurement arrives, or a time such as 50 ms. The
        first one, at t = 0, is there from the start.
    dropout
        The probability that a measurement never arrives; the first one always does.
    """

    of: str | None = field(default=None, kw_only=True)
    period: Annotated[Positive | None, Scale("measurement period", "s")] = field(
        default=None, kw_only=True
    )
    offset: Offset | None = field(default=None, kw_only=True)
    delay: Annotated[CountOrTime | None, Scale("delay of the measurement in periods")] = field(
        default=None, kw_only=True
    )
    dropout: Real | None = field(default=None, kw_only=True)

    @abstractmethod
    def errors(
        self, G: MatrixLieGroup, instants: int, period: float, random: np.random.Generator
    ) -> Array:
        """Return the errors of `instants` measurements, ``(instants, n)``, n from `coordinates`.

        Measurements are `period` seconds apart: the sensor's own period, or the control period. The
        first errors do not depend on how many there are.
        """

    def states(self, G: MatrixLieGroup) -> int:
        """Return the number of states that follow the motion; a sensor of a pose has none."""
        return 0

    def started(self, V: Array) -> Array:
        """Return the states at t = 0, from the measured coordinates of V, ``(..., n)``."""
        return V

    def state_rate(self, V: Array, x: Array) -> Array:
        """Return the time derivative of the states x."""
        return x

    def reading(self, V: Array, x: Array) -> Array:
        """Return the velocity as it is measured before errors, ``(..., n)``."""
        return V

    @property
    def loses(self) -> bool:
        """Whether measurements may be lost."""
        return bool(self.dropout)

    def lost(self, measurements: int, random: np.random.Generator) -> Array:
        """Return which measurements are lost, ``(measurements,)`` booleans.

        The first entries do not depend on how many there are. The first measurement always arrives,
        whatever its entry.
        """
        return random.random(measurements) < (self.dropout or 0.0)

    def axes(self, G: MatrixLieGroup) -> slice:
        """Return the measured coordinates: those of the part, or all."""
        return next((part.axes for part in G.parts if part.name == self.of), slice(None))

    def coordinates(self, G: MatrixLieGroup) -> int:
        """Return the number of measured coordinates."""
        return len(range(G.dimension)[self.axes(G)])

    def entries(self, value: float | list[float], G: MatrixLieGroup) -> Array:
        """Return a number for each measured coordinate; one given number stands for all."""
        return np.broadcast_to(np.asarray(value, dtype=float), self.coordinates(G))

    def check_entries(
        self, value: Numbers, G: MatrixLieGroup, problems: Problems, deviations: bool = False
    ) -> None:
        """Note invalid numbers, negative `deviations`, or a wrong number of coordinates."""
        what = G.name if self.of is None else f"the {self.of} of {G.name}"
        check_count(value, self.coordinates(G), what, problems, deviations)

    def bias_deviation(self, G: MatrixLieGroup) -> tuple[Array, Array] | None:
        """Return what an estimator may know of a bias; None for other errors.

        It is the root mean square at t = 0, and the deviation of the drift after one second,
        ``(n,)`` each.
        """
        return None

    def white_deviation(self, G: MatrixLieGroup, period: float) -> Array | None:
        """Return the standard deviation of white noise, ``(n,)``; None for correlated errors.

        The numbers of the sensor must be drawn before.
        """
        return None
