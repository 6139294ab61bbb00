"""Base class of designs whose axes are lists of values."""

from abc import abstractmethod
from dataclasses import dataclass
from functools import cached_property
from typing import Annotated, Any, ClassVar

from pydantic import Field

from eqt_cli.core.problems import KeyPath, Problems
from eqt_cli.ensemble.axes import ListedAxis, Spaced
from eqt_cli.ensemble.designs.base import Design, check_values


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
        """Note invalid ranges, and values that are lists of mappings."""
        for key, axis in self.axes.items():
            if isinstance(axis, Spaced):
                axis.check(problems.at(key))
            else:
                check_values(axis, problems.at(key))

    @abstractmethod
    def index(self, point: int, key: str) -> int:
        """Return the index of a point's value on an axis."""

    def values(self, point: int) -> tuple[Any, ...]:
        return tuple(values[self.index(point, key)] for key, values in self.axes.items())

    def place(self, point: int, key: str) -> KeyPath:
        return (key,) if isinstance(self.axes[key], Spaced) else (key, self.index(point, key))
