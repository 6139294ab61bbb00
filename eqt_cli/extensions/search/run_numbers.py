"""Numbers of runs that were computed in memory."""

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from eqt_cli.base.arrays import Array
from eqt_cli.results.metrics import quantity_of
from eqt_cli.results.quantity import Measure


@dataclass(frozen=True)
class Numbers:
    """Numbers per run of all points of a study with one law; it reads as a `Result` does.

    Attributes
    ----------
    status : (points, 1, runs)
        0 for a good run.
    stored
        Each stored metric, ``(points, 1, runs)``.
    horizons : (points,)
        Duration of the runs at each point, s.
    quantities
        Rows of the stored metrics.
    """

    status: Array
    stored: dict[str, Array]
    horizons: Array
    quantities: Mapping[str, Measure]

    @property
    def good(self) -> Array:
        """Whether each run is good."""
        return self.status == 0

    def quantity(self, name: str) -> Measure:
        """Return the row of a metric."""
        return self.quantities.get(name) or quantity_of(name)

    def metric(self, name: str) -> Array:
        """Return a number of every run; NaN if it failed or has none."""
        if name in self.stored:
            values = self.stored[name].astype(float)
        else:
            values = np.isfinite(self.stored[self.quantity(name).implied_by]).astype(float)
        return np.where(self.good, values, np.nan)

    def counted(self, name: str) -> Array:
        """Return the same, with the horizon for times beyond it."""
        values = self.metric(name)
        late = self.good & np.isnan(values) & self.quantity(name).censored
        return np.where(late, self.horizons[:, None, None], values)
