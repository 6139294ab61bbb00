"""Scrambled Sobol points, which fill a cube more evenly than random ones."""

from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from eqt_cli.core.arrays import Array
from eqt_cli.ensemble.designs.base import Sampled


@dataclass(frozen=True, kw_only=True)
class Sobol(Sampled):
    """A scrambled Sobol sequence; more points keep the earlier ones. Use powers of 2."""

    name: ClassVar[str] = "sobol"

    def shares(self, generator: np.random.Generator) -> Array:
        """Return the first points of SciPy's sequence, scrambled by the seed."""
        from scipy.stats import qmc  # slow to import, and rarely needed

        # SciPy warns unless the number is a power of 2, so the surplus is cut off.
        sequence = qmc.Sobol(len(self.axes), rng=generator)
        return sequence.random_base2((self.points - 1).bit_length())[: self.points]
