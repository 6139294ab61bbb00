"""A key that takes several values in a sweep, as figures and tables show it."""

from collections.abc import Iterator
from contextlib import suppress
from dataclasses import dataclass
from typing import Any

import numpy as np

from eqt_cli.core.arrays import Array
from eqt_cli.core.errors import ExpressionError
from eqt_cli.core.expressions import constant
from eqt_cli.core.option_types import written_in_degrees


@dataclass(frozen=True)
class SweptKey:
    """A key that takes several values in a sweep.

    Attributes
    ----------
    key
        Of the configuration.
    values : (points,)
        Numbers; text and matrices are numbered.
    texts
        What is written for the numbers: what they stand for, or expressions such as π/2.
    asks_log
        Whether the range that they are from asks for a logarithmic scale.
    unit
        ``deg`` of angles that are written in degrees; nothing where the key has its own unit.
    is_number
        Whether the values are numbers; else they number texts or matrices.
    """

    key: str
    values: Array
    texts: dict[float, str]
    asks_log: bool = False
    unit: str = ""
    is_number: bool = True

    @property
    def levels(self) -> list[int]:
        """The values numbered in the order in which they first occur."""
        numbers: dict[float, int] = {}
        return [numbers.setdefault(value, len(numbers)) for value in self.values.tolist()]

    @property
    def logarithmic(self) -> bool:
        """Whether the values are spread on a logarithmic scale rather than a linear one."""
        levels = np.unique(self.values)
        if self.asks_log:
            return True
        if not self.is_number or len(levels) < 3 or levels[0] <= 0:
            return False
        return bool(np.ptp(np.diff(np.log(levels))) / np.log(levels[-1] / levels[0]) < 1e-6)

    def value(self, point: int) -> float | str:
        """At a point, as it was given."""
        found = float(self.values[point])
        return f"{found:g} {self.unit}" if self.unit else self.texts.get(found, found)

    def at(self, point: int) -> str:
        """The value at a point, as text."""
        value = self.value(point)
        return value if isinstance(value, str) else f"{value:.4g}".replace("-", "−")


def degrees_of(text: str) -> float | None:
    """The number of an angle such as ``90 deg``; None of all else."""
    written = written_in_degrees(text)
    if written is not None:
        with suppress(ExpressionError):
            return constant(written)
    return None


def constant_of(text: str) -> tuple[float, str] | None:
    """The number of an expression in quotes such as ``"-pi/2"``, and ``−π/2``; None of all else."""
    given = text.strip('"')
    with suppress(ExpressionError):
        return constant(given), given.replace("*pi", "π").replace("pi", "π").replace("-", "−")
    return None


def log_keys(section: Any) -> Iterator[str]:
    """The keys of ranges with ``scale: log``, anywhere in the section of a sweep."""
    if isinstance(section, list):
        for entry in section:
            yield from log_keys(entry)
    elif isinstance(section, dict):
        for key, entry in section.items():
            if isinstance(entry, dict) and entry.get("scale") == "log":
                yield str(key)
            yield from log_keys(entry)
