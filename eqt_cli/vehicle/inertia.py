"""The inertia that the plant has, where it is not the one that the law believes."""

from abc import ABC, abstractmethod
from dataclasses import dataclass
from typing import Any, ClassVar

import numpy as np

from eqt_cli.core.arrays import Array
from eqt_cli.groups import MatrixLieGroup
from eqt_cli.mechanics.inertia import Inertia, InertiaLaw
from eqt_cli.vehicle.component import Given
from eqt_cli.vehicle.numbers import Matrix, Number, drawn, is_drawn
from eqt_cli.written.poses import square


class TrueInertia(ABC):
    """The tensor of the plant, with numbers that may differ from run to run."""

    departs: ClassVar[str] = "inertia not as believed"

    @property
    def varies(self) -> bool:
        """Whether they do."""
        return False

    @property
    def structure(self) -> Any:
        """What of it is no number."""
        return type(self)

    @abstractmethod
    def numbers(self, G: MatrixLieGroup, random: np.random.Generator | None) -> dict[str, Array]:
        """The numbers of one run; the means without a generator."""

    @abstractmethod
    def at(self, model: Inertia, t: Any, given: Given) -> Inertia:
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

    def numbers(self, G: MatrixLieGroup, random: np.random.Generator | None) -> dict[str, Array]:
        """1 + r, which is greater than 0."""
        factor = 1.0 + drawn(self.relative, random)
        while factor <= 0:
            factor = 1.0 + drawn(self.relative, random)
        return {"factor": np.full((1, 1), factor)}

    def at(self, model: Inertia, t: Any, given: Given) -> Inertia:
        """The model times 1 + r."""
        factor = given["factor"]
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

    @property
    def varies(self) -> bool:
        """Where an entry is drawn."""
        return is_drawn(self.matrix)

    def numbers(self, G: MatrixLieGroup, random: np.random.Generator | None) -> dict[str, Array]:
        """The matrix and its inverse; draws that are not definite are drawn again."""
        matrix = square(drawn(self.matrix, random), G.dimension, G)
        while random is not None and np.linalg.eigvalsh(matrix).min() <= 0:
            matrix = square(drawn(self.matrix, random), G.dimension, G)
        return {"matrix": matrix, "inverse": np.linalg.inv(matrix)}

    def at(self, model: Inertia, t: Any, given: Given) -> Inertia:
        """The same at all times."""
        return Inertia(given["matrix"], given["inverse"])


@dataclass(frozen=True)
class VaryingInertia(TrueInertia):
    """A tensor that varies in time by itself.

    Attributes
    ----------
    law
        The tensor as a function of time.
    """

    law: InertiaLaw

    @property
    def structure(self) -> Any:
        """Its expressions."""
        blank = {name: np.zeros_like(value) for name, value in self.law.parameters.items()}
        return type(self), repr(self.law.with_parameters(blank))

    def numbers(self, G: MatrixLieGroup, random: np.random.Generator | None) -> dict[str, Array]:
        """Those of the function of time."""
        return self.law.parameters

    def at(self, model: Inertia, t: Any, given: Given) -> Inertia:
        """The tensor at time t."""
        return self.law.with_parameters(given).at(t)
