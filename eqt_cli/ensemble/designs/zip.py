"""Axes of equal length that change together."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, ClassVar, Self

from eqt_cli.ensemble.axes import LISTED
from eqt_cli.ensemble.designs.base import Design, Note, Path, Schema, Surroundings
from eqt_cli.ensemble.designs.grid import axes_of, spelt_out


class Zip(Design):
    """The first values of all axes, then the second ones, and so on."""

    name: ClassVar[str] = "zip"

    def __init__(self, axes: Mapping[str, list[Any]], spelt: frozenset[str] = frozenset()) -> None:
        self.axes, self.spelt = dict(axes), spelt
        self.keys = tuple(axes)

    @classmethod
    def parse(cls, section: Any, note: Note) -> Self | None:
        axes = axes_of(section, note)
        if axes is None:
            return None
        first = next(iter(axes))
        for key, values in axes.items():
            if len(values) != len(axes[first]):
                note((key,), f"expected {len(axes[first])} values as {first}, got {len(values)}")
                return None
        return cls(axes, spelt_out(section))

    @classmethod
    def schema(cls, around: Surroundings) -> Schema:
        return around.axes(LISTED)

    def __len__(self) -> int:
        return len(self.axes[self.keys[0]])

    def values(self, point: int) -> tuple[Any, ...]:
        return tuple(values[point] for values in self.axes.values())

    def place(self, point: int, key: str) -> Path:
        return (key, point) if key in self.spelt else (key,)
