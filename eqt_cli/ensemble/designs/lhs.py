"""Latin hypercube: along every axis, one point in each of as many equal shares as points."""

from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from eqt_cli.core.arrays import Array
from eqt_cli.ensemble.designs.sampled import Sampled


@dataclass(frozen=True, kw_only=True)
class LatinHypercube(Sampled):
    """A Latin hypercube; another number of points gives another one."""

    name: ClassVar[str] = "lhs"

    def shares(self, generator: np.random.Generator) -> Array:
        """SciPy's Latin hypercube."""
        from scipy.stats import qmc  # slow to import, and most designs do without

        return qmc.LatinHypercube(len(self.axes), rng=generator).random(self.points)
