"""The initial states of an ensemble's runs: drawn, or from a list."""

from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np

from eqt_cli.core.arrays import Array
from eqt_cli.ensemble.poses import PoseDistribution
from eqt_cli.ensemble.spread import Distribution, Stream, generator
from eqt_cli.ensemble.velocities import VelocityDistribution
from eqt_cli.groups import MatrixLieGroup
from eqt_cli.groups.product import ProductGroup


@dataclass(frozen=True)
class _Listed(Distribution):
    """An error of every run, ``(runs, …)``."""

    errors: Array

    def draw(self, G: MatrixLieGroup, generator: np.random.Generator) -> Array:
        """Return the error of the first run."""
        return self.draw_of_run(G, generator, 0)

    def draw_of_run(self, G: MatrixLieGroup, generator: np.random.Generator, run: int) -> Array:
        """Return the error of the run."""
        return self.errors[run]


class ListedPoses(_Listed, PoseDistribution):
    """Q_d(0)⁻¹ Q(0) of every run, ``(runs, d, d)``."""

    def place(self, G: MatrixLieGroup, numbers: Array) -> Array:
        """Return the poses, which are the numbers themselves."""
        return numbers


class ListedVelocities(_Listed, VelocityDistribution):
    """V(0) − V_d(0) of every run, ``(runs, m)``."""


@dataclass(frozen=True)
class FactorPoses(PoseDistribution):
    """Independent draws for each factor, in their order."""

    factors: tuple[PoseDistribution, ...]

    def draw(self, G: MatrixLieGroup, generator: np.random.Generator) -> Array:
        """Return the numbers of all factors."""
        return np.concatenate([each.draw(factor, generator) for each, factor in self._by_factor(G)])

    def place(self, G: MatrixLieGroup, numbers: Array) -> Array:
        """Return the poses of all factors as blocks."""
        assert isinstance(G, ProductGroup)
        pairs = self._by_factor(G)
        lengths = [len(each.draw(factor, np.random.default_rng(0))) for each, factor in pairs]
        columns = np.split(numbers, np.cumsum(lengths)[:-1], axis=1)
        blocks = zip(pairs, columns, strict=True)
        return G.assemble([each.place(factor, part) for (each, factor), part in blocks])

    def _by_factor(self, G: MatrixLieGroup) -> list[tuple[PoseDistribution, MatrixLieGroup]]:
        assert isinstance(G, ProductGroup)  # checked where the configuration is read
        return list(zip(self.factors, G.factors, strict=True))


def draw_initial_states(
    G: MatrixLieGroup,
    poses: PoseDistribution,
    velocities: VelocityDistribution,
    *,
    Qd: Array,
    Vd: Array,
    seed: int,
    runs: Iterable[int],
) -> tuple[Array, Array]:
    """Return Q(0) = Q_d(0)·draw and V(0) = V_d(0) + draw for each run.

    The pose is drawn before the velocity, both from the stream of the run.

    Returns
    -------
    poses : (runs, d, d)
    velocities : (runs, m)
    """
    pose_numbers, velocity_errors = [], []
    for run in runs:
        random = generator(seed, Stream.INITIAL_STATE, run)
        pose_numbers.append(poses.draw_of_run(G, random, run))
        velocity_errors.append(velocities.draw_of_run(G, random, run))
    return Qd @ poses.place(G, np.array(pose_numbers)), Vd + np.array(velocity_errors)
