"""The true inertia of the plant, where it differs from the model of the law."""

from abc import ABC, abstractmethod
from dataclasses import dataclass, field, replace
from typing import Any, ClassVar, Self

import numpy as np

from eqt_cli.core.leaves import with_fields
from eqt_cli.groups import MatrixLieGroup
from eqt_cli.mechanics.inertia import Inertia, InertiaLaw
from eqt_cli.notation.poses import square
from eqt_cli.vehicle.component import Matrix, Number, drawn, is_drawn


class TrueInertia(ABC):
    """The inertia tensor of the plant, with numbers that may differ from run to run."""

    departs: ClassVar[str] = "inertia not as believed"

    @property
    def varies(self) -> bool:
        """Whether the numbers differ from run to run."""
        return any(map(is_drawn, vars(self).values()))

    @abstractmethod
    def of_run(self, G: MatrixLieGroup, random: np.random.Generator | None) -> Self:
        """Return the inertia of one run, with arrays; without a generator, with the means."""

    @abstractmethod
    def at(self, model: Inertia, t: Any) -> Inertia:
        """Return the true tensor at time t, where `model` is the tensor of the law."""


@dataclass(frozen=True)
class RelativeInertia(TrueInertia):
    """The inertia (1 + r) 𝕀, with the 𝕀 of the law.

    Attributes
    ----------
    relative
        r.
    """

    relative: Number

    def of_run(self, G: MatrixLieGroup, random: np.random.Generator | None) -> Self:
        """Return the inertia with an r for which 1 + r is greater than 0."""
        relative = drawn(self.relative, random)
        while 1.0 + relative <= 0:
            relative = drawn(self.relative, random)
        return replace(self, relative=np.array([relative]))

    def at(self, model: Inertia, t: Any) -> Inertia:
        """Return the model times 1 + r."""
        factor = 1.0 + self.relative[..., None]
        change = None if model.change is None else model.change * factor
        return Inertia(model.matrix * factor, model.inverse / factor, change)


@dataclass(frozen=True)
class ConstantInertia(TrueInertia):
    """A constant inertia tensor.

    Attributes
    ----------
    matrix
        A number, a list (the diagonal) or a list of rows.
    """

    matrix: Matrix
    inverse: Any = field(default=None, init=False, repr=False)

    def of_run(self, G: MatrixLieGroup, random: np.random.Generator | None) -> Self:
        """Return the inertia with matrix and inverse; draws that are not definite are repeated."""
        matrix = square(drawn(self.matrix, random), G.dimension, G)
        while random is not None and np.linalg.eigvalsh(matrix).min() <= 0:
            matrix = square(drawn(self.matrix, random), G.dimension, G)
        return with_fields(self, matrix=matrix, inverse=np.linalg.inv(matrix))

    def at(self, model: Inertia, t: Any) -> Inertia:
        """Return the constant tensor."""
        return Inertia(self.matrix, self.inverse)


@dataclass(frozen=True)
class VaryingInertia(TrueInertia):
    """An inertia tensor that is a function of time.

    Attributes
    ----------
    law
        The tensor as a function of time.
    """

    law: InertiaLaw

    def of_run(self, G: MatrixLieGroup, random: np.random.Generator | None) -> Self:
        """Return the inertia itself: nothing of it is drawn."""
        return self

    def at(self, model: Inertia, t: Any) -> Inertia:
        """Return the tensor at time t."""
        return self.law.at(t)
