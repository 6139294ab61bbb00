"""The inertia that the plant has, where it is not the one that the law believes."""

from abc import ABC, abstractmethod
from dataclasses import dataclass, field, replace
from typing import Any, ClassVar, Self

import numpy as np

from eqt_cli.core.leaves import with_fields
from eqt_cli.groups import MatrixLieGroup
from eqt_cli.mechanics.inertia import Inertia, InertiaLaw
from eqt_cli.notation.poses import square
from eqt_cli.vehicle.numbers import Matrix, Number, drawn, is_drawn


class TrueInertia(ABC):
    """The tensor of the plant, with numbers that may differ from run to run."""

    departs: ClassVar[str] = "inertia not as believed"

    @property
    def varies(self) -> bool:
        """Whether they do."""
        return False

    @abstractmethod
    def of_run(self, G: MatrixLieGroup, random: np.random.Generator | None) -> Self:
        """With the numbers of one run as arrays; with the means without a generator."""

    @abstractmethod
    def at(self, model: Inertia, t: Any) -> Inertia:
        """The tensor at time t, where the law believes in `model`."""


@dataclass(frozen=True)
class RelativeInertia(TrueInertia):
    """(1 + r) 𝕀, of the 𝕀 that the law believes.

    Attributes
    ----------
    relative
        r.
    """

    relative: Number

    @property
    def varies(self) -> bool:
        """Where r is drawn."""
        return is_drawn(self.relative)

    def of_run(self, G: MatrixLieGroup, random: np.random.Generator | None) -> Self:
        """With an r for which 1 + r is greater than 0."""
        relative = drawn(self.relative, random)
        while 1.0 + relative <= 0:
            relative = drawn(self.relative, random)
        return replace(self, relative=np.array([relative]))

    def at(self, model: Inertia, t: Any) -> Inertia:
        """The model times 1 + r."""
        factor = 1.0 + self.relative[..., None]
        change = None if model.change is None else model.change * factor
        return Inertia(model.matrix * factor, model.inverse / factor, change)


@dataclass(frozen=True)
class ConstantInertia(TrueInertia):
    """A constant tensor.

    Attributes
    ----------
    matrix
        A number, a list (the diagonal) or a list of rows.
    """

    matrix: Matrix
    inverse: Any = field(default=None, init=False, repr=False)

    @property
    def varies(self) -> bool:
        """Where an entry is drawn."""
        return is_drawn(self.matrix)

    def of_run(self, G: MatrixLieGroup, random: np.random.Generator | None) -> Self:
        """With the matrix and its inverse; draws that are not definite are drawn again."""
        matrix = square(drawn(self.matrix, random), G.dimension, G)
        while random is not None and np.linalg.eigvalsh(matrix).min() <= 0:
            matrix = square(drawn(self.matrix, random), G.dimension, G)
        return with_fields(self, matrix=matrix, inverse=np.linalg.inv(matrix))

    def at(self, model: Inertia, t: Any) -> Inertia:
        """The same at all times."""
        return Inertia(self.matrix, self.inverse)


@dataclass(frozen=True)
class VaryingInertia(TrueInertia):
    """A tensor that varies in time by itself.

    Attributes
    ----------
    law
        The tensor as a function of time.
    """

    law: InertiaLaw

    def of_run(self, G: MatrixLieGroup, random: np.random.Generator | None) -> Self:
        """Itself: nothing of it is drawn."""
        return self

    def at(self, model: Inertia, t: Any) -> Inertia:
        """The tensor at time t."""
        return self.law.at(t)
