"""Base classes of distributions of the initial pose."""

from abc import abstractmethod
from dataclasses import dataclass
from typing import Annotated, ClassVar

import numpy as np

from eqt_cli.core.arrays import Array
from eqt_cli.core.errors import Problems
from eqt_cli.core.option_types import Unit
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
        Options that are angles and may exceed a half-turn.
    """

    angles: ClassVar[tuple[str, ...]] = ()

    @abstractmethod
    def place(self, G: MatrixLieGroup, numbers: Array) -> Array:
        """Return the elements of G for the runs' numbers, ``(runs, k) -> (runs, d, d)``.

        This is separate from `draw`, so that many runs need only one array operation.
        """


@dataclass(frozen=True)
class RotationDistribution(PoseDistribution):
    """A distribution of the rotation part; translation columns are normal, or 0 where not given.

    Attributes
    ----------
    position, velocity
        Spread of the translation column of that name.
    """

    position: Annotated[Spread | None, Unit("m")] = None
    velocity: Annotated[Spread | None, Unit("m/s")] = None

    def draw(self, G: MatrixLieGroup, generator: np.random.Generator) -> Array:
        """Return the numbers of the rotation, then those of the columns from left to right."""
        assert isinstance(G, EuclideanGroup)  # `check` lets no other group through
        numbers = [self.draw_rotation(G, generator)]
        for column in G.columns:
            spread: Spread | None = getattr(self, column)
            numbers.append(np.zeros(G.space) if spread is None else spread.draw(G.space, generator))
        return np.concatenate(numbers)

    def place(self, G: MatrixLieGroup, numbers: Array) -> Array:
        """Return the poses of many runs."""
        assert isinstance(G, EuclideanGroup)
        k = numbers.shape[1] - G.space * len(G.columns)
        columns = numbers[:, k:].reshape(len(numbers), len(G.columns), G.space).swapaxes(-1, -2)
        return G.assemble(self.place_rotation(G, numbers[:, :k]), columns)

    @abstractmethod
    def draw_rotation(self, G: EuclideanGroup, generator: np.random.Generator) -> Array:
        """Return the random numbers of one run's rotation, ``(k,)``."""

    @abstractmethod
    def place_rotation(self, G: EuclideanGroup, numbers: Array) -> Array:
        """Return the rotations of many runs, ``(runs, k) -> (runs, n, n)``."""

    def check(self, G: MatrixLieGroup, problems: Problems) -> None:
        """Note a group without rotations, and a column that it does not have."""
        if not isinstance(G, EuclideanGroup) or not G.rotations:
            advice = f"for {G.name} use exp_normal"
            if isinstance(G, ProductGroup):
                advice += f", or a list of {len(G.factors)}, one per factor"
            problems.at("kind").add(f"{self.name} needs a group with rotations; {advice}")
            return
        for column in ("position", "velocity"):
            spread: Spread | None = getattr(self, column)
            if spread is None:
                continue
            if column not in G.columns:
                columns = ", ".join(G.columns)
                why = f"only {columns}" if columns else "since it has no translations"
                problems.at(column).add(f"{G.name} has no {column} column, {why}; remove this key")
            else:
                spread.check(G.space, problems.at(column))
