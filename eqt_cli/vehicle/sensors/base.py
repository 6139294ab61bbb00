"""What an error of measurement is; it knows no law and no engine."""

from abc import abstractmethod
from dataclasses import dataclass

import numpy as np

from eqt_cli.core.arrays import Array
from eqt_cli.groups import MatrixLieGroup
from eqt_cli.vehicle.component import VehiclePart


@dataclass(frozen=True)
class Sensor(VehiclePart):
    """An error of a measured pose or velocity, at the control instants of a run.

    Those of a pose add up to n with Q_m = Q exp(n), those of a velocity to b with V_m = V + b. They
    depend on the run and on the instant only, and on nothing that moves.
    """

    @abstractmethod
    def errors(
        self, G: MatrixLieGroup, instants: int, period: float, random: np.random.Generator
    ) -> Array:
        """The errors at t = k·period, ``(instants, m)``; the first do not depend on how many."""

    def white_deviation(self, G: MatrixLieGroup, period: float) -> Array | None:
        """The standard deviation of each error, ``(m,)``, of a sensor whose errors are white noise.

        It is for a sensor whose numbers are drawn; None where errors depend on each other.
        """
        return None
