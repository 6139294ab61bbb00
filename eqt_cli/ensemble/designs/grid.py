"""Every combination of the values of several axes; the last axis changes fastest."""

from dataclasses import dataclass
from functools import cached_property
from math import prod
from typing import Any, ClassVar

from eqt_cli.core.errors import Problems
from eqt_cli.ensemble.designs.base import Listed


@dataclass(frozen=True)
class Grid(Listed):
    """Every combination of the values of its axes."""

    name: ClassVar[str] = "grid"

    def check(self, problems: Problems) -> None:
        """Note also a value that an axis lists twice, which would make equal points."""
        super().check(problems)
        for key, axis in self.axes.items():
            if isinstance(axis, list) and (index := _repeated(axis)) is not None:
                problems.at(key, index).add(f"{axis[index]} is listed twice; give each value once")

    def __len__(self) -> int:
        return prod(len(values) for values in self.axes.values())

    @cached_property
    def _steps(self) -> dict[str, int]:
        """The number of successive points with the same value on each axis."""
        steps, step = {}, 1
        for key, values in reversed(self.axes.items()):
            steps[key] = step
            step *= len(values)
        return steps

    def index(self, point: int, key: str) -> int:
        return point // self._steps[key] % len(self.axes[key])


def _repeated(values: list[Any]) -> int | None:
    """Return the index of the first repeated value."""
    seen: set[str] = set()
    for index, value in enumerate(values):
        number = isinstance(value, int | float) and not isinstance(value, bool)
        text = repr(float(value) if number else value)
        if text in seen:
            return index
        seen.add(text)
    return None
