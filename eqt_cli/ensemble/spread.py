"""Random streams, and the base class of distributions.

Run k draws the same numbers for any number and order of runs, workers and controllers.
"""

from abc import abstractmethod
from dataclasses import dataclass
from enum import IntEnum
from typing import Any, ClassVar, Literal
from zlib import crc32

import numpy as np

from eqt_cli.core.arrays import Array
from eqt_cli.core.errors import Problems
from eqt_cli.core.option_types import Real
from eqt_cli.core.registry import Component
from eqt_cli.groups import MatrixLieGroup


class Stream(IntEnum):
    """The purpose of a stream; its number affects every result and must not change."""

    INITIAL_STATE = 0
    CROSS_CHECK = 1
    CERTIFICATES = 2
    VEHICLE = 3
    EXACT_STATES = 4
    EXPORTED_STATES = 5
    CODE = 6


def generator(root: int, stream: Stream, run: int) -> np.random.Generator:
    """Return the generator of one run in one stream."""
    sequence = np.random.SeedSequence(root, spawn_key=(int(stream), run))
    return np.random.Generator(np.random.PCG64DXSM(sequence))


def generator_at(root: int, stream: Stream, run: int, place: str) -> np.random.Generator:
    """Return the generator of one run for the component at a place of the configuration."""
    sequence = np.random.SeedSequence(root, spawn_key=(int(stream), run, crc32(place.encode())))
    return np.random.Generator(np.random.Philox(sequence))


Axis = Literal["random"] | list[Real]
"""A fixed or a random direction."""


class Distribution(Component):
    """A distribution drawn for each run: a frozen dataclass whose fields are its options."""

    @abstractmethod
    def draw(self, G: MatrixLieGroup, generator: np.random.Generator) -> Array:
        """Return the random numbers of one run."""

    def draw_of_run(self, G: MatrixLieGroup, generator: np.random.Generator, run: int) -> Array:
        """Return the numbers of a run, in distributions that depend on its number."""
        return self.draw(G, generator)

    def check(self, G: MatrixLieGroup, problems: Problems) -> None:
        """Note options that do not fit the group."""


@dataclass(frozen=True)
class Spread:
    """Independent normals around 0.

    Attributes
    ----------
    std
        Standard deviation of every entry, or one per entry, in the unit of the entries.
    """

    # Not strict, because its unit is told from outside: a strict model takes no mapping then.
    __pydantic_config__: ClassVar[dict[str, Any]] = {"extra": "forbid", "strict": False}

    std: Real | list[Real] = 1.0

    def draw(self, length: int, generator: np.random.Generator) -> Array:
        """Return `length` independent normals."""
        return np.asarray(self.std) * generator.standard_normal(length)

    def check(self, length: int, problems: Problems) -> None:
        """Note a wrong number of standard deviations, or a negative one."""
        problems = problems.at("std")
        if isinstance(self.std, list) and len(self.std) != length:
            got = len(self.std)
            problems.add(f"expected a number or a list of {length}, got a list of {got}")
        elif np.min(self.std) < 0:
            problems.add(f"expected a standard deviation of at least 0, got {np.min(self.std):g}")


@dataclass(frozen=True)
class NormalCoordinates:
    """m independent normal coordinates."""

    std: Real | list[Real] = 1.0

    def draw(self, G: MatrixLieGroup, generator: np.random.Generator) -> Array:
        """Return std · N(0, 1)^m."""
        return Spread(self.std).draw(G.dimension, generator)

    def check(self, G: MatrixLieGroup, problems: Problems) -> None:
        """Note a wrong number of standard deviations, or a negative one."""
        Spread(self.std).check(G.dimension, problems)


@dataclass(frozen=True)
class Coordinates:
    """The same m coordinates in every run; 0 where none are given."""

    coordinates: list[Real] | None = None

    def draw(self, G: MatrixLieGroup, generator: np.random.Generator) -> Array:
        """Return the coordinates."""
        return np.zeros(G.dimension) if self.coordinates is None else np.array(self.coordinates)

    def check(self, G: MatrixLieGroup, problems: Problems) -> None:
        """Note a wrong number of coordinates."""
        check_coordinates(self.coordinates, G, problems.at("coordinates"))


def check_coordinates(values: list[Real] | None, G: MatrixLieGroup, problems: Problems) -> None:
    """Note a wrong number of algebra coordinates."""
    if values is not None and len(values) != G.dimension:
        problems.add(f"expected {G.dimension} numbers for {G.name}, got {len(values)}")


# Vectors by size and axis -------------------------------------------------------------------------


def directed(
    size: float | list[float], axis: Axis, length: int, generator: np.random.Generator
) -> Array:
    """Return a vector of a fixed or a uniform size, ``(length,)``; a random axis is isotropic."""
    low, high = size if isinstance(size, list) else (size, size)
    norm = generator.uniform(low, high)
    direction = generator.standard_normal(length) if isinstance(axis, str) else np.array(axis)
    return norm * (direction / np.linalg.norm(direction))


def check_size(size: float | list[float], problems: Problems) -> None:
    """Note a list that is not a smallest and a largest size, and a size below 0."""
    if isinstance(size, list) and (len(size) != 2 or size[0] > size[1]):
        problems.add(f"expected a number, or a list of the smallest and the largest, got {size}")
    elif np.min(size) < 0:
        problems.add(f"expected a number of at least 0, got {np.min(size):g}")


def check_axis(axis: Axis, length: int, problems: Problems) -> None:
    """Note an axis of a wrong length, or without a direction."""
    if isinstance(axis, list) and (len(axis) != length or not any(axis)):
        expected = f"a list of {length} that are not all 0" if length > 1 else "[1] or [-1]"
        problems.add(f"expected random, or {expected}, got {axis}")
