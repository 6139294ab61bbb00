"""What a distribution of initial poses is, and the part that rotations have in common."""

from abc import abstractmethod
from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from eqt_cli.core.arrays import Array
from eqt_cli.core.problems import Problems
from eqt_cli.ensemble.spread import Distribution, Spread
from eqt_cli.groups import MatrixLieGroup
from eqt_cli.groups.euclidean import EuclideanGroup
from eqt_cli.groups.product import ProductGroup


@dataclass(frozen=True)
class PoseDistribution(Distribution):
    """A distribution on a group: a frozen dataclass whose fields are its options.

    It draws random numbers, ``(k,)``: run k starts at Q(0) = Q_d(0) · `place`.

    Attributes
    ----------
    angles
        Options that are angles of any size.
    """

    angles: ClassVar[tuple[str, ...]] = ()

    @abstractmethod
    def place(self, G: MatrixLieGroup, numbers: Array) -> Array:
        """The elements of G that the runs' numbers stand for, ``(runs, k) -> (runs, d, d)``.

        Apart from `draw`, so that many runs cost one array operation.
        """


@dataclass(frozen=True)
class RotationDistribution(PoseDistribution):
    """A distribution of the rotation part; translation columns are normal, or 0 where not given.

    Attributes
    ----------
    position, velocity
        Spread of the translation column of that name.
    """

    position: Spread | None = None
    velocity: Spread | None = None

    def draw(self, G: MatrixLieGroup, generator: np.random.Generator) -> Array:
        """The numbers of the rotation, then those of the columns from left to right."""
        assert isinstance(G, EuclideanGroup)  # `check` lets no other group through
        numbers = [self.draw_rotation(G, generator)]
        for column in G.columns:
            spread: Spread | None = getattr(self, column)
            numbers.append(np.zeros(G.space) if spread is None else spread.draw(G.space, generator))
        return np.concatenate(numbers)

    def place(self, G: MatrixLieGroup, numbers: Array) -> Array:
        """The poses of many runs."""
        assert isinstance(G, EuclideanGroup)
        k = numbers.shape[1] - G.space * len(G.columns)
        columns = numbers[:, k:].reshape(len(numbers), len(G.columns), G.space).swapaxes(-1, -2)
        return G.assemble(self.place_rotation(G, numbers[:, :k]), columns)

    @abstractmethod
    def draw_rotation(self, G: EuclideanGroup, generator: np.random.Generator) -> Array:
        """The random numbers of one run's rotation, ``(k,)``."""

    @abstractmethod
    def place_rotation(self, G: EuclideanGroup, numbers: Array) -> Array:
        """The rotations of many runs, ``(runs, k) -> (runs, n, n)``."""

    def check(self, G: MatrixLieGroup, problems: Problems) -> None:
        """A group without rotations, or a column that it does not have."""
        if not isinstance(G, EuclideanGroup) or not G.rotations:
            takes = f"for {G.name} use exp_normal"
            if isinstance(G, ProductGroup):
                takes += f", or a list of {len(G.factors)}, one per factor"
            problems.at("kind").add(f"{self.name} needs a group with rotations; {takes}")
            return
        for column in ("position", "velocity"):
            spread: Spread | None = getattr(self, column)
            if spread is None:
                continue
            if column not in G.columns:
                has = ", ".join(G.columns)
                why = f"only {has}" if has else "since it has no translations"
                problems.at(column).add(f"{G.name} has no {column} column, {why}; remove this key")
            else:
                spread.check(G.space, problems.at(column))
