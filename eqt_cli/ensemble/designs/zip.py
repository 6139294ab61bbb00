"""Axes of equal length that change together."""

from dataclasses import dataclass
from typing import ClassVar

from eqt_cli.core.errors import Problems
from eqt_cli.ensemble.designs.base import Listed


@dataclass(frozen=True)
class Zip(Listed):
    """The first values of all axes, then the second ones, and so on."""

    name: ClassVar[str] = "zip"

    def check(self, problems: Problems) -> None:
        """Note also an axis whose length differs from the first."""
        super().check(problems)
        if problems:
            return
        first = self.keys[0]
        for key, values in self.axes.items():
            if len(values) != len(self):
                problems.at(key).add(
                    f"expected {len(self)} values, as many as {first} has, got {len(values)}"
                )
                return

    def __len__(self) -> int:
        return len(self.axes[self.keys[0]])

    def index(self, point: int, key: str) -> int:
        return point
