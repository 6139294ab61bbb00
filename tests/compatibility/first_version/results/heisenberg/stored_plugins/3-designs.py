"""Designs of sweeps: from the base class, and from the sampled designs."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, ClassVar, Self

import numpy as np

from eqt_cli.core.arrays import Array
from eqt_cli.ensemble.axes import LISTED, listed
from eqt_cli.ensemble.designs.base import Design, Note, Path, Schema, Surroundings
from eqt_cli.ensemble.designs.sampled import Sampled


class Star(Design):
    """The first value of every axis, and from there each other value of one axis at a time."""

    name: ClassVar[str] = "star"

    def __init__(self, axes: Mapping[str, list[Any]]) -> None:
        self.axes = dict(axes)
        self.keys = tuple(axes)
        self._steps = [(key, k) for key, values in axes.items() for k in range(1, len(values))]

    @classmethod
    def parse(cls, section: Any, note: Note) -> Self | None:
        """A mapping from keys to axes."""
        if not isinstance(section, Mapping) or not section:
            note((), "expected a mapping from keys to lists of values")
            return None
        axes = {key: listed(entry, (key,), note) for key, entry in section.items()}
        found = {key: values for key, values in axes.items() if values is not None}
        return cls(found) if len(found) == len(axes) else None

    @classmethod
    def schema(cls, around: Surroundings) -> Schema:
        """The axes."""
        return around.axes(LISTED)

    def __len__(self) -> int:
        return 1 + len(self._steps)

    def values(self, point: int) -> tuple[Any, ...]:
        """The centre, or one step from it."""
        moved, index = self._steps[point - 1] if point else ("", 0)
        return tuple(values[index if key == moved else 0] for key, values in self.axes.items())

    def place(self, point: int, key: str) -> Path:
        """The axis."""
        return (key,)


class Diagonal(Sampled):
    """Points along the diagonal of the ranges, in random order."""

    name: ClassVar[str] = "diagonal"

    def shares(self, generator: np.random.Generator) -> Array:
        """The same share of every axis."""
        along = (np.arange(self.points) + 0.5) / self.points
        return np.repeat(generator.permutation(along)[:, None], len(self.axes), axis=1)
