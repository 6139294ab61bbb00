"""What a design is: numbered points, each a value for some keys; it knows no configuration."""

from abc import abstractmethod
from typing import Any, ClassVar, Self, TypeVar, get_type_hints

from eqt_cli.core.component import Component
from eqt_cli.core.option_types import MOST_POINTS
from eqt_cli.core.problems import KeyPath, Problems
from eqt_cli.core.validation import shown, validated

D = TypeVar("D", bound="Design")

CASE = "case"
"""The key of points that have names: no key of the configuration."""


class Design(Component):
    """Points of a sweep; none is computed before it is asked for.

    A frozen dataclass whose fields are its options. An option that is a mapping with any keys is
    one from keys of the configuration to axes.

    Attributes
    ----------
    name
        As written in a configuration: ``grid``.
    whole_section
        The option that a block gives without a name, as ``grid: {gains.kp: [1, 2]}`` does; empty
        where the block is a mapping of options.
    keys
        What tells the points from each other: every point gives each of them a value, in this
        order. They are keys of the configuration, or `CASE`.
    """

    name: ClassVar[str]
    whole_section: ClassVar[str] = ""
    keys: tuple[str, ...]

    @classmethod
    def read(cls, section: Any, problems: Problems) -> Self | None:
        """The design that a section describes, or None after noting what is wrong with it."""
        if cls.whole_section:
            kind = get_type_hints(cls, include_extras=True)[cls.whole_section]
            value = validated(kind, section, problems)
            found = None if value is None else cls(**{cls.whole_section: value})
        else:
            found = validated(cls, section, problems)
        if found is not None:
            found.check(problems)
        return None if problems or found is None else counted(found, problems)

    def check(self, problems: Problems) -> None:
        """Note what is wrong with its options."""

    @abstractmethod
    def __len__(self) -> int:
        """The number of points."""

    @abstractmethod
    def values(self, point: int) -> tuple[Any, ...]:
        """The values at a point, in the order of `keys`."""

    @property
    def sets(self) -> tuple[str, ...]:
        """The keys of the configuration that points change."""
        return self.keys

    @property
    def always(self) -> tuple[str, ...]:
        """Those of `sets` that every point changes."""
        return self.sets

    def settings(self, point: int) -> dict[str, Any]:
        """What a point changes in the configuration, by key."""
        return dict(zip(self.keys, self.values(point), strict=True))

    @abstractmethod
    def place(self, point: int, key: str) -> KeyPath:
        """Where within the section the value of `key` at a point was written."""

    def first_place(self, key: str) -> KeyPath:
        """Where within the section `key` has its first value."""
        changing = (point for point in range(len(self)) if key in self.settings(point))
        return self.place(next(changing, 0), key)


def check_values(values: list[Any], problems: Problems) -> None:
    """Note lists of mappings, which no cell of a table can show: they are cases with names."""
    for index, value in enumerate(values):
        if isinstance(value, list) and any(isinstance(entry, dict) for entry in value):
            problems.at(index).add(
                f"expected a number, a text, a list of numbers or one mapping, got {shown(value)}; "
                "give each list a name: sweep: [{cases: {NAME: {KEY: VALUE}, …}}]"
            )


def overlap(one: str, other: str) -> bool:
    """Whether one key is the other, or within it."""
    short, long = sorted((one, other), key=len)
    return long == short or long.startswith((short + ".", short + "["))


def counted(design: D, problems: Problems) -> D | None:
    """The design itself, or None after noting that it has more points than a sweep may have.

    They are counted by their lengths, before any point is made.
    """
    points = design.__len__()  # len() itself fails on numbers beyond 2⁶³
    if points > MOST_POINTS:
        problems.add(f"has {points:,} points; expected at most {MOST_POINTS:,}")
        return None
    return design
