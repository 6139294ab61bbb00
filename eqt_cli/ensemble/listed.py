"""Initial states from a list, one for each run."""

from dataclasses import dataclass

import numpy as np

from eqt_cli.core.arrays import Array
from eqt_cli.ensemble.poses import PoseDistribution
from eqt_cli.ensemble.velocities import VelocityDistribution
from eqt_cli.groups import MatrixLieGroup


@dataclass(frozen=True)
class ListedPoses(PoseDistribution):
    """Q_d(0)⁻¹ Q(0) of every run, ``(runs, d, d)``."""

    errors: Array

    def draw(self, G: MatrixLieGroup, generator: np.random.Generator) -> Array:
        """Return the draw of the first run."""
        return self.draw_of_run(G, generator, 0)

    def draw_of_run(self, G: MatrixLieGroup, generator: np.random.Generator, run: int) -> Array:
        """Return the run's position in the list."""
        return np.array([run])

    def place(self, G: MatrixLieGroup, numbers: Array) -> Array:
        """Return the poses at these positions."""
        return self.errors[numbers[:, 0]]


@dataclass(frozen=True)
class ListedVelocities(VelocityDistribution):
    """V(0) − V_d(0) of every run, ``(runs, m)``."""

    errors: Array

    def draw(self, G: MatrixLieGroup, generator: np.random.Generator) -> Array:
        """Return the draw of the first run."""
        return self.draw_of_run(G, generator, 0)

    def draw_of_run(self, G: MatrixLieGroup, generator: np.random.Generator, run: int) -> Array:
        """Return the velocity error of the run."""
        return self.errors[run]
