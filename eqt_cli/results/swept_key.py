"""Swept keys with their values as figures and tables show them."""

import json
from collections.abc import Iterator, Sequence
from contextlib import suppress
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np

from eqt_cli.core.arrays import Array
from eqt_cli.core.errors import ExpressionError
from eqt_cli.core.expressions import constant
from eqt_cli.core.units import split


@dataclass(frozen=True)
class SweptKey:
    """A key that takes several values in a sweep.

    Attributes
    ----------
    key
        Key of the configuration.
    values : (points,)
        Values as numbers; texts and matrices are numbered.
    texts
        Texts to display for the numbers: the numbered values, or expressions such as π/2.
    asks_log
        Whether the range of the sweep is logarithmic.
    unit
        The unit with which all values are written; empty if the key has its own unit.
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
        """Values numbered in the order of their first occurrence."""
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
        """Return the value at a point as configured."""
        value = float(self.values[point])
        return f"{value:g} {self.unit}" if self.unit else self.texts.get(value, value)

    @cached_property
    def names(self) -> dict[float, str]:
        """`texts` as figures and tables show them: what of mappings and lists differs, in words."""
        if self.is_number:
            return self.texts
        return dict(zip(self.texts, briefly(list(self.texts.values())), strict=True))

    def named(self, point: int) -> float | str:
        """`value`, with what stands for a text in figures and tables."""
        return self.names.get(float(self.values[point]), self.value(point))

    def at(self, point: int) -> str:
        """Return the value at a point as text."""
        value = self.named(point)
        return value if isinstance(value, str) else f"{value:.4g}".replace("-", "−")


def with_unit(text: str) -> tuple[float, str] | None:
    """Return number and unit of ``90 deg``; None for other texts."""
    if parts := split(text):
        with suppress(ExpressionError):
            return constant(parts[0]), parts[1]
    return None


def constant_of(text: str) -> tuple[float, str] | None:
    """Return number and display of an expression such as ``"-pi/2"``; None for other texts."""
    given = text.strip('"')
    with suppress(ExpressionError):
        return constant(given), given.replace("*pi", "π").replace("pi", "π").replace("-", "−")
    return None


def briefly(texts: Sequence[str]) -> list[str]:
    """JSON in as few words as tell the texts apart; ``lag, 0.05`` for a mapping.

    Of mappings, what all have in common is left out.
    """
    given: list[Any] = []
    for text in texts:
        try:
            given.append(json.loads(text))
        except (ValueError, RecursionError):
            given.append(text)
    words = [_in_words(each) for each in _differing(given)]
    return words if len(set(words)) == len(texts) else [_in_words(each) for each in given]


def _differing(values: list[Any]) -> list[Any]:
    """Mappings, or lists of one each, without the entries that all have in common."""
    if all(isinstance(value, list) and len(value) == 1 for value in values):
        return _differing([value[0] for value in values])
    if len(values) < 2 or not all(isinstance(value, dict) for value in values):
        return values
    first, *others = values
    same = {key for key in first if all(key in one and one[key] == first[key] for one in others)}
    left = [{key: value[key] for key in value if key not in same} for value in values]
    names = {key for value in left for key in value}
    if len(names) == 1 and all(left):
        return _differing([value[key] for value in left for key in value])
    return left


def _in_words(value: Any) -> str:
    """Without quotes, and without the braces around a mapping."""
    if isinstance(value, dict):
        own = [str(value["kind"])] if "kind" in value else []
        named = {key.replace("_", " "): each for key, each in value.items() if key != "kind"}
        others = (f"{key} {_in_words(each)}" for key, each in named.items())
        return ", ".join([*own, *others]) or "none"
    if isinstance(value, list):
        if len(value) == 1 and isinstance(value[0], dict):
            return _in_words(value[0])
        inner = (
            f"{{{_in_words(one)}}}" if isinstance(one, dict) else _in_words(one) for one in value
        )
        return f"[{', '.join(inner)}]" if value else "none"
    if isinstance(value, float | int) and not isinstance(value, bool):
        return f"{value:g}".replace("-", "−")
    return value if isinstance(value, str) else json.dumps(value)


def log_keys(section: Any) -> Iterator[str]:
    """Yield the keys of ranges with ``scale: log`` in the section of a sweep."""
    if isinstance(section, list):
        for entry in section:
            yield from log_keys(entry)
    elif isinstance(section, dict):
        for key, entry in section.items():
            if isinstance(entry, dict) and entry.get("scale") == "log":
                yield str(key)
            yield from log_keys(entry)
