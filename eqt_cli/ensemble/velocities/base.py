"""What a distribution of initial velocities is."""

from __future__ import annotations

from abc import abstractmethod
from dataclasses import dataclass

import numpy as np

from eqt_cli.core.arrays import Array
from eqt_cli.core.component import Component
from eqt_cli.core.problems import Problems
from eqt_cli.groups import MatrixLieGroup


@dataclass(frozen=True)
class VelocityDistribution(Component):
    """A distribution on g: a frozen dataclass whose fields are its options.

    Run k starts at V(0) = V_d(0) + draw.
    """

    @abstractmethod
    def draw(self, G: MatrixLieGroup, generator: np.random.Generator) -> Array:
        """Algebra coordinates of one element of g, ``(m,)``."""

    def draw_of_run(self, G: MatrixLieGroup, generator: np.random.Generator, run: int) -> Array:
        """The same, for a distribution that knows its runs."""
        return self.draw(G, generator)

    def check(self, G: MatrixLieGroup, problems: Problems) -> None:
        """Note what of its options does not fit the group."""
