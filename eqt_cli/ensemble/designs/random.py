"""Independent, uniformly distributed points."""

from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from eqt_cli.core.arrays import Array
from eqt_cli.ensemble.designs.base import Sampled


@dataclass(frozen=True, kw_only=True)
class Random(Sampled):
    """Independent points; more of them keep the earlier ones."""

    name: ClassVar[str] = "random"

    def shares(self, generator: np.random.Generator) -> Array:
        """Return points that are uniform on the unit cube."""
        return generator.random((self.points, len(self.axes)))
