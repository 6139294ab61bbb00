"""What an error of measurement is; it knows no law and no engine."""

from abc import abstractmethod
from dataclasses import dataclass, field
from typing import Annotated

import numpy as np

from eqt_cli.core.arrays import Array
from eqt_cli.core.option_types import CountOrNone, Positive, Real, Scale
from eqt_cli.core.problems import Problems
from eqt_cli.groups import MatrixLieGroup
from eqt_cli.vehicle.component import VehiclePart, check_count
from eqt_cli.vehicle.numbers import Numbers


@dataclass(frozen=True)
class Sensor(VehiclePart):
    """An error of a measured pose or velocity, at the instants at which it is measured.

    Those of a pose add up to n with Q_m = Q exp(n), those of a velocity to b with V_m = V + b. They
    depend on the run and on the instant only, and on nothing that moves. Entries of one part share
    `period`, `delay` and `dropout`, given at one of them.

    Attributes
    ----------
    of
        The part of the pose or velocity that is measured, as the group calls it; all of them if
        left out.
    period
        Between measurements, s, a whole number of control periods; the law reads the last one. If
        left out, each control instant has one.
    delay
        After how many control periods a measurement arrives. The first one, at t = 0, is there from
        the start.
    dropout
        The probability that a measurement never arrives; the first one always does.
    """

    of: str | None = field(default=None, kw_only=True)
    period: Annotated[Positive | None, Scale("measurement period", "s")] = field(
        default=None, kw_only=True
    )
    delay: Annotated[CountOrNone | None, Scale("delay in periods")] = field(
        default=None, kw_only=True
    )
    dropout: Real | None = field(default=None, kw_only=True)

    @abstractmethod
    def errors(
        self, G: MatrixLieGroup, instants: int, period: float, random: np.random.Generator
    ) -> Array:
        """The errors of so many measurements, ``(instants, n)`` with the n of `coordinates`.

        They are `period` seconds apart: its own period, or that of control. The first ones do not
        depend on how many there are.
        """

    @property
    def loses(self) -> bool:
        """Whether measurements may be lost on their way."""
        return bool(self.dropout)

    def lost(self, measurements: int, random: np.random.Generator) -> Array:
        """Which of them never arrive, ``(measurements,)`` booleans; the first one always does.

        The first ones do not depend on how many there are.
        """
        return random.random(measurements) < (self.dropout or 0.0)

    def coordinates(self, G: MatrixLieGroup) -> int:
        """How many coordinates it measures: those of the part, or m."""
        axes = (part.axes for part in G.parts if part.name == self.of)
        return len(range(G.dimension)[next(axes, slice(None))])

    def entries(self, value: float | list[float], G: MatrixLieGroup) -> Array:
        """A number for every coordinate that it measures, where one stands for all."""
        return np.broadcast_to(np.asarray(value, dtype=float), self.coordinates(G))

    def check_entries(
        self, value: Numbers, G: MatrixLieGroup, problems: Problems, deviations: bool = False
    ) -> None:
        """Note numbers that are none, negative `deviations`, or another count of coordinates."""
        what = G.name if self.of is None else f"the {self.of} of {G.name}"
        check_count(value, self.coordinates(G), what, problems, deviations)

    def bias_deviation(self, G: MatrixLieGroup) -> tuple[Array, Array] | None:
        """Of a sensor whose errors are a bias, what an estimator may know of it; else None.

        The root mean square at t = 0, and the deviation of the drift after one second, ``(n,)``.
        """
        return None

    def white_deviation(self, G: MatrixLieGroup, period: float) -> Array | None:
        """The standard deviation of each error, ``(n,)``, of a sensor whose errors are white noise.

        It is for a sensor whose numbers are drawn; None where errors depend on each other.
        """
        return None
