"""Latin hypercube: each axis is divided into as many shares as points, with one point in each."""

from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from eqt_cli.core.arrays import Array
from eqt_cli.ensemble.designs.base import Sampled


@dataclass(frozen=True, kw_only=True)
class LatinHypercube(Sampled):
    """A Latin hypercube; all points change with their number."""

    name: ClassVar[str] = "lhs"

    def shares(self, generator: np.random.Generator) -> Array:
        """Return SciPy's Latin hypercube."""
        from scipy.stats import qmc  # slow to import, and rarely needed

        return qmc.LatinHypercube(len(self.axes), rng=generator).random(self.points)
