"""Initial states that are listed, one for each run; it knows no file."""

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
        """The first one."""
        return self.draw_of_run(G, generator, 0)

    def draw_of_run(self, G: MatrixLieGroup, generator: np.random.Generator, run: int) -> Array:
        """The run's place in the list."""
        return np.array([run])

    def place(self, G: MatrixLieGroup, numbers: Array) -> Array:
        """Those at these places."""
        return self.errors[numbers[:, 0]]


@dataclass(frozen=True)
class ListedVelocities(VelocityDistribution):
    """V(0) − V_d(0) of every run, ``(runs, m)``."""

    errors: Array

    def draw(self, G: MatrixLieGroup, generator: np.random.Generator) -> Array:
        """The first one."""
        return self.draw_of_run(G, generator, 0)

    def draw_of_run(self, G: MatrixLieGroup, generator: np.random.Generator, run: int) -> Array:
        """That of the run."""
        return self.errors[run]
