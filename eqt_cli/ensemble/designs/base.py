"""The base classes of designs: of all, of those with samples, and of those with lists."""

from abc import abstractmethod
from collections.abc import Iterable
from dataclasses import dataclass
from functools import cached_property
from typing import Annotated, Any, ClassVar, Self, TypeVar, get_type_hints

import numpy as np
from pydantic import Field

from eqt_cli.core.arrays import Array
from eqt_cli.core.errors import KeyPath, Problems
from eqt_cli.core.option_types import MAX_POINTS, CountOrNone, Points, shown, validated
from eqt_cli.core.registry import Component
from eqt_cli.ensemble.axes import ListedAxis, SampledAxis, Spaced

D = TypeVar("D", bound="Design")

CASE = "case"
"""The key of named points, which is no key of the configuration."""


class Design(Component):
    """Points of a sweep, each computed when it is used.

    A frozen dataclass whose fields are its options. An option that is a mapping with arbitrary keys
    maps keys of the configuration to axes.

    Attributes
    ----------
    name
        The name in a configuration: ``grid``.
    whole_section
        The option that a block gives without its name, as in ``grid: {gains.kp: [1, 2]}``; empty
        where the block is a mapping of options.
    keys
        The keys that distinguish the points: every point has a value for each of them, in this
        order. They are keys of the configuration, or `CASE`.
    """

    name: ClassVar[str]
    whole_section: ClassVar[str] = ""
    keys: tuple[str, ...]

    @classmethod
    def read(cls, section: Any, problems: Problems) -> Self | None:
        """Return the design that a section describes, or None after noting its errors."""
        if cls.whole_section:
            kind = get_type_hints(cls, include_extras=True)[cls.whole_section]
            value = validated(kind, section, problems)
            design = None if value is None else cls(**{cls.whole_section: value})
        else:
            design = validated(cls, section, problems)
        if design is not None:
            design.check(problems)
        return None if problems or design is None else counted(design, problems)

    def check(self, problems: Problems) -> None:
        """Note errors of its options."""

    @abstractmethod
    def __len__(self) -> int:
        """The number of points."""

    @abstractmethod
    def values(self, point: int) -> tuple[Any, ...]:
        """Return the values at a point, in the order of `keys`."""

    @property
    def sets(self) -> tuple[str, ...]:
        """The keys of the configuration that points change."""
        return self.keys

    @property
    def always(self) -> tuple[str, ...]:
        """The keys of `sets` that every point changes."""
        return self.sets

    def settings(self, point: int) -> dict[str, Any]:
        """Return the new values of a point, by key of the configuration."""
        return dict(zip(self.keys, self.values(point), strict=True))

    def values_of(self, key: str) -> Iterable[Any]:
        """Yield every value that points give a key of the configuration, at least once."""
        return (point[key] for point in map(self.settings, range(len(self))) if key in point)

    @abstractmethod
    def place(self, point: int, key: str) -> KeyPath:
        """Return the place in the section where the value of `key` at a point is written."""

    def first_place(self, key: str) -> KeyPath:
        """Return the place in the section where `key` has its first value."""
        changing = (point for point in range(len(self)) if key in self.settings(point))
        return self.place(next(changing, 0), key)


def overlap(one: str, other: str) -> bool:
    """Whether two keys are equal, or one is within the other."""
    short, long = sorted((one, other), key=len)
    return long == short or long.startswith((short + ".", short + "["))


def counted(design: D, problems: Problems) -> D | None:
    """Return the design, or None after noting that it has more points than a sweep may have.

    The points are counted before any of them is made.
    """
    points = design.__len__()  # len() itself fails on numbers beyond 2⁶³
    if points > MAX_POINTS:
        problems.add(f"has {points:,} points; expected at most {MAX_POINTS:,}")
        return None
    return design


@dataclass(frozen=True, kw_only=True)
class Sampled(Design):
    """Points in the unit cube, mapped to the axes.

    Attributes
    ----------
    points
        The number of points.
    seed
        The seed of the design's random stream.
    axes
        The range or the choices of each key.
    """

    points: Points
    seed: CountOrNone = 0
    axes: Annotated[dict[str, SampledAxis], Field(min_length=1)]

    @cached_property
    def keys(self) -> tuple[str, ...]:  # type: ignore[override]  # derived
        """The keys of the axes."""
        return tuple(self.axes)

    def check(self, problems: Problems) -> None:
        """Note invalid ranges."""
        for key, axis in self.axes.items():
            axis.check(problems.at("axes", key))

    @abstractmethod
    def shares(self, generator: np.random.Generator) -> Array:
        """Return all points in the unit cube, ``(points, axes)``."""

    @cached_property
    def _shares(self) -> Array:
        return self.shares(np.random.Generator(np.random.PCG64DXSM(self.seed)))

    def __getstate__(self) -> dict[str, Any]:
        return {"points": self.points, "seed": self.seed, "axes": self.axes}

    def __len__(self) -> int:
        return self.points

    def values(self, point: int) -> tuple[Any, ...]:
        shares = self._shares[point].tolist()
        return tuple(axis.at(share) for axis, share in zip(self.axes.values(), shares, strict=True))

    def place(self, point: int, key: str) -> KeyPath:
        return ("axes", key)


@dataclass(frozen=True)
class Listed(Design):
    """Points made of the values of axes.

    Attributes
    ----------
    axes
        The axes by key.
    """

    whole_section: ClassVar[str] = "axes"

    axes: Annotated[dict[str, ListedAxis], Field(min_length=1)]

    @cached_property
    def keys(self) -> tuple[str, ...]:  # type: ignore[override]  # derived
        """The keys of the axes."""
        return tuple(self.axes)

    def check(self, problems: Problems) -> None:
        """Note invalid ranges, and lists of mappings, which fit into a table by a name only."""
        for key, axis in self.axes.items():
            if isinstance(axis, Spaced):
                axis.check(problems.at(key))
                continue
            for index, value in enumerate(axis):
                if isinstance(value, list) and any(isinstance(entry, dict) for entry in value):
                    problems.at(key, index).add(
                        "expected a number, a text, a list of numbers or one mapping, got "
                        f"{shown(value)}; give each list a name: "
                        "sweep: [{cases: {NAME: {KEY: VALUE}, …}}]"
                    )

    @abstractmethod
    def index(self, point: int, key: str) -> int:
        """Return the index of a point's value on an axis."""

    def values(self, point: int) -> tuple[Any, ...]:
        return tuple(values[self.index(point, key)] for key, values in self.axes.items())

    def values_of(self, key: str) -> Iterable[Any]:
        axis = self.axes[key]
        return (axis[index] for index in range(len(axis)))

    def place(self, point: int, key: str) -> KeyPath:
        return (key,) if isinstance(self.axes[key], Spaced) else (key, self.index(point, key))
