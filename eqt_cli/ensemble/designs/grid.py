"""Every combination of the values of several axes; the last axis changes fastest."""

from __future__ import annotations

from collections.abc import Mapping
from math import prod
from typing import Any, ClassVar, Self

from eqt_cli.ensemble.axes import LISTED, listed
from eqt_cli.ensemble.designs.base import Design, Note, Path, Schema, Surroundings


class Grid(Design):
    """Every combination of the values of its axes.

    Parameters
    ----------
    axes
        Values by key.
    spelt
        The keys whose values were written out one by one, not as a range.
    """

    name: ClassVar[str] = "grid"

    def __init__(self, axes: Mapping[str, list[Any]], spelt: frozenset[str] = frozenset()) -> None:
        self.axes, self.spelt = dict(axes), spelt
        self.keys = tuple(axes)

    @classmethod
    def parse(cls, section: Any, note: Note) -> Self | None:
        axes = axes_of(section, note)
        if axes is None:
            return None
        spelt = spelt_out(section)
        twice = [key for key in spelt if _repeated(axes[key], key, note)]
        return None if twice else cls(axes, spelt)

    @classmethod
    def schema(cls, around: Surroundings) -> Schema:
        return around.axes(LISTED)

    def __len__(self) -> int:
        return prod(len(values) for values in self.axes.values())

    def values(self, point: int) -> tuple[Any, ...]:
        indices = self._indices(point)
        return tuple(values[indices[key]] for key, values in self.axes.items())

    def place(self, point: int, key: str) -> Path:
        return (key, self._indices(point)[key]) if key in self.spelt else (key,)

    def _indices(self, point: int) -> dict[str, int]:
        indices = {}
        for key, values in reversed(self.axes.items()):
            point, indices[key] = divmod(point, len(values))
        return indices


def _repeated(values: list[Any], key: str, note: Note) -> bool:
    """Whether a value of an axis is there a second time, which would make equal points."""
    seen: dict[str, Any] = {}
    for index, value in enumerate(values):
        number = isinstance(value, int | float) and not isinstance(value, bool)
        if seen.setdefault(repr(float(value) if number else value), index) != index:
            note((key, index), f"{value} is there already; give every value once")
            return True
    return False


def axes_of(section: Any, note: Note) -> dict[str, list[Any]] | None:
    """The values of every axis, or None after noting what is wrong with them."""
    if not isinstance(section, Mapping) or not section:
        note((), "expected a mapping from keys to lists of values")
        return None
    axes = {key: listed(entry, (key,), note) for key, entry in section.items()}
    found = {key: values for key, values in axes.items() if values is not None}
    return found if len(found) == len(axes) else None


def spelt_out(section: Mapping[str, Any]) -> frozenset[str]:
    """The axes that are lists."""
    return frozenset(key for key, entry in section.items() if isinstance(entry, list))
