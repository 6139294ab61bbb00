"""Draws the numbers of a vehicle's parts a second time from the configuration."""

import dataclasses
from collections.abc import Mapping
from typing import Any

import numpy as np

from eqt_cli.core.arrays import Array

Options = Mapping[str, Any]
"""The options of a part with the numbers of one run, by their names in a configuration."""


def redrawn(part: Any, random: np.random.Generator) -> dict[str, Any]:
    """Draw the options of a part in the order of its fields."""
    positive = getattr(part, "positive", ())
    names = [field.name for field in dataclasses.fields(part)]
    return {name: number(getattr(part, name), random, name in positive) for name in names}


def number(value: Any, random: np.random.Generator, positive: bool = False) -> Any:
    """Return a value; draw it if it is a distribution."""
    if isinstance(value, list):
        return [number(entry, random, positive) for entry in value]
    if hasattr(value, "uniform"):
        low, high = value.uniform
        return low + (high - low) * random.random()
    if not hasattr(value, "normal"):
        return value
    mean, deviation = value.normal
    while True:
        found = mean + deviation * random.standard_normal()
        if found > 0 or not positive:
            return found


def entries(value: Any, count: int) -> Array:
    """Return a list as a vector; a number is repeated for all entries."""
    return np.broadcast_to(np.asarray(value, dtype=float), count)


def tensor(value: Any, size: int) -> Array:
    """Return a matrix from rows, a diagonal, or a multiple of the identity."""
    given = np.asarray(value, dtype=float)
    return given if given.ndim == 2 else np.diag(entries(given, size))
