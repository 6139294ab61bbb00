"""What a design is: numbered points, each a value for some keys; it knows no configuration."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, ClassVar, Self

Path = tuple[str | int, ...]
Note = Callable[[Path, str], None]
"""Called with the place within the design's section, and what is wrong there."""

Schema = dict[str, Any]
"""A JSON schema."""


@dataclass(frozen=True)
class Surroundings:
    """What a configuration knows of designs, and they do not: the schemas around theirs.

    Attributes
    ----------
    axes
        Makes the schema of one axis that of a mapping from keys to such axes.
    block
        The schema of one block of any design.
    """

    axes: Callable[[Schema], Schema]
    block: Schema


class Design(ABC):
    """Points of a sweep; none is computed before it is asked for.

    Attributes
    ----------
    name
        As written in a configuration: ``grid``.
    keys
        The keys that every point gives a value to, in the order of the configuration.
    """

    name: ClassVar[str]
    keys: tuple[str, ...]

    @classmethod
    @abstractmethod
    def parse(cls, section: Any, note: Note) -> Self | None:
        """The design that a section describes, or None after noting what is wrong with it."""

    @classmethod
    @abstractmethod
    def schema(cls, around: Surroundings) -> Schema:
        """The JSON schema of the sections that `parse` accepts, as far as one can say it."""

    @abstractmethod
    def __len__(self) -> int:
        """The number of points."""

    @abstractmethod
    def values(self, point: int) -> tuple[Any, ...]:
        """The values at a point, in the order of `keys`."""

    @abstractmethod
    def place(self, point: int, key: str) -> Path:
        """Where within the section the value of `key` at a point was written."""
