"""What a design is: numbered points, each a value for some keys; it knows no configuration."""

from abc import abstractmethod
from typing import Any, ClassVar, Self, TypeVar, get_type_hints

from eqt_cli.core.component import Component
from eqt_cli.core.option_types import MOST_POINTS
from eqt_cli.core.problems import KeyPath, Problems
from eqt_cli.core.validation import validated

D = TypeVar("D", bound="Design")


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
        The keys that every point gives a value to, in the order of the configuration.
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

    @abstractmethod
    def place(self, point: int, key: str) -> KeyPath:
        """Where within the section the value of `key` at a point was written."""


def counted(design: D, problems: Problems) -> D | None:
    """The design itself, or None after noting that it has more points than a sweep may have.

    They are counted by their lengths, before any point is made.
    """
    points = design.__len__()  # len() itself fails on numbers beyond 2⁶³
    if points > MOST_POINTS:
        problems.add(f"has {points:,} points; expected at most {MOST_POINTS:,}")
        return None
    return design
