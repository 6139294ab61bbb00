"""Designs of sweeps: from the base class, and from the sampled designs."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import Annotated, Any, ClassVar

import numpy as np
from pydantic import Field

from eqt_cli.extend import Array, Design, KeyPath, Sampled


@dataclass(frozen=True)
class Star(Design):
    """The first value of every axis, and from there each other value of one axis at a time.

    Attributes
    ----------
    axes
        Lists of values, by key.
    """

    name: ClassVar[str] = "star"
    whole_section: ClassVar[str] = "axes"

    axes: Annotated[dict[str, list[Any]], Field(min_length=1)]

    @cached_property
    def keys(self) -> tuple[str, ...]:  # type: ignore[override]
        """The keys of the axes."""
        return tuple(self.axes)

    @cached_property
    def _steps(self) -> list[tuple[str, int]]:
        return [(key, k) for key, values in self.axes.items() for k in range(1, len(values))]

    def __len__(self) -> int:
        return 1 + len(self._steps)

    def values(self, point: int) -> tuple[Any, ...]:
        """The centre, or one step from it."""
        moved, index = self._steps[point - 1] if point else ("", 0)
        return tuple(values[index if key == moved else 0] for key, values in self.axes.items())

    def place(self, point: int, key: str) -> KeyPath:
        """The axis."""
        return (key,)


@dataclass(frozen=True, kw_only=True)
class Diagonal(Sampled):
    """Points along the diagonal of the ranges, in random order."""

    name: ClassVar[str] = "diagonal"

    def shares(self, generator: np.random.Generator) -> Array:
        """The same share of every axis."""
        along = (np.arange(self.points) + 0.5) / self.points
        return np.repeat(generator.permutation(along)[:, None], len(self.axes), axis=1)
