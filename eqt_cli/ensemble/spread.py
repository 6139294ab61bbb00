"""What several distributions are made of: given coordinates, and independent normals."""

from abc import abstractmethod
from dataclasses import dataclass
from typing import Any, ClassVar

import numpy as np

from eqt_cli.core.arrays import Array
from eqt_cli.core.component import Component
from eqt_cli.core.option_types import Real
from eqt_cli.core.problems import Problems
from eqt_cli.groups import MatrixLieGroup


class Distribution(Component):
    """What is drawn for each run: a frozen dataclass whose fields are its options."""

    @abstractmethod
    def draw(self, G: MatrixLieGroup, generator: np.random.Generator) -> Array:
        """The numbers of one run."""

    def draw_of_run(self, G: MatrixLieGroup, generator: np.random.Generator, run: int) -> Array:
        """The same, for a distribution that knows its runs."""
        return self.draw(G, generator)

    def check(self, G: MatrixLieGroup, problems: Problems) -> None:
        """Note what of its options does not fit the group."""


@dataclass(frozen=True)
class Spread:
    """Independent normals around 0.

    Attributes
    ----------
    std
        Standard deviation of every entry, or one per entry; in the unit of what is drawn.
    """

    __pydantic_config__: ClassVar[dict[str, Any]] = {"extra": "forbid", "strict": True}

    std: Real | list[Real] = 1.0

    def draw(self, length: int, generator: np.random.Generator) -> Array:
        """`length` independent normals."""
        return np.asarray(self.std) * generator.standard_normal(length)

    def check(self, length: int, problems: Problems) -> None:
        """Note a wrong number of standard deviations, or a negative one."""
        problems = problems.at("std")
        if isinstance(self.std, list) and len(self.std) != length:
            got = f"got a list of {len(self.std)}"
            problems.add(f"expected a number or a list of {length}, {got}")
        elif np.min(self.std) < 0:
            problems.add(f"expected a standard deviation of at least 0, got {np.min(self.std):g}")


@dataclass(frozen=True)
class NormalCoordinates:
    """m independent normal coordinates."""

    std: Real | list[Real] = 1.0

    def draw(self, G: MatrixLieGroup, generator: np.random.Generator) -> Array:
        """std · N(0, 1)^m."""
        return Spread(self.std).draw(G.dimension, generator)

    def check(self, G: MatrixLieGroup, problems: Problems) -> None:
        """A wrong number of standard deviations, or a negative one."""
        Spread(self.std).check(G.dimension, problems)


@dataclass(frozen=True)
class Coordinates:
    """The same m coordinates in every run; 0 where none are given."""

    coordinates: list[Real] | None = None

    def draw(self, G: MatrixLieGroup, generator: np.random.Generator) -> Array:
        """The coordinates."""
        return np.zeros(G.dimension) if self.coordinates is None else np.array(self.coordinates)

    def check(self, G: MatrixLieGroup, problems: Problems) -> None:
        """A wrong number of coordinates."""
        check_coordinates(self.coordinates, G, problems.at("coordinates"))


def check_coordinates(given: list[Real] | None, G: MatrixLieGroup, problems: Problems) -> None:
    """Note a wrong number of algebra coordinates."""
    if given is not None and len(given) != G.dimension:
        problems.add(f"expected {G.dimension} numbers for {G.name}, got {len(given)}")
