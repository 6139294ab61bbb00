"""What a design is: numbered points, each a value for some keys; it knows no configuration."""

from abc import abstractmethod
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, ClassVar, Self, TypeAlias, TypeVar, get_type_hints

from pydantic import TypeAdapter

from eqt_cli.core.component import Component
from eqt_cli.core.option_types import MOST_POINTS
from eqt_cli.core.problems import KeyPath, Problems, parse_key
from eqt_cli.core.validation import validated
from eqt_cli.ensemble.axes import ListedAxis, Spaced

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

    def __init_subclass__(cls, **options: Any) -> None:
        super().__init_subclass__(**options)
        if "parse" in vars(cls):
            cls.read = classmethod(_read_by_parse)  # type: ignore[assignment]  # set once


def counted(design: D, problems: Problems) -> D | None:
    """The design itself, or None after noting that it has more points than a sweep may have.

    They are counted by their lengths, before any point is made.
    """
    points = design.__len__()  # len() itself fails on numbers beyond 2⁶³
    if points > MOST_POINTS:
        problems.add(f"has {points:,} points; expected at most {MOST_POINTS:,}")
        return None
    return design


# Plugins of the first version parse their section, and write its JSON schema, by hand -------------

Path: TypeAlias = KeyPath
Schema: TypeAlias = dict[str, Any]
Note = Callable[[KeyPath, str], None]
"""Called with the place within the design's section, and what is wrong there."""


@dataclass(frozen=True)
class Surroundings:
    """What `schema` of such a plugin is given: the schemas around its own.

    Attributes
    ----------
    axes
        Makes the schema of one axis that of a mapping from keys to such axes.
    block
        The schema of one block of any design.
    """

    axes: Callable[[Schema], Schema]
    block: Schema


LISTED: Schema = TypeAdapter(ListedAxis).json_schema()
"""Of one axis, as a list or a range."""


def listed(section: Any, path: Path, note: Note) -> list[Any] | None:
    """The values of such an axis, or None after noting what is wrong with it."""
    problems = Problems()
    axis = validated(ListedAxis, section, problems)
    if isinstance(axis, Spaced):
        axis.check(problems)
    for problem in problems:
        note((*path, *(parse_key(problem.path) if problem.path else ())), problem.message)
    if problems:
        return None
    return axis.values if isinstance(axis, Spaced) else list(axis)


def _read_by_parse(design: Any, section: Any, problems: Problems) -> Any:
    return design.parse(section, lambda path, message: problems.at(*path).add(message))
