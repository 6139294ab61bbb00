"""Named, dimensioned arrays in memory; it must not know files or what the numbers mean."""

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray

Attribute = str | int | float
"""What an attribute may hold; integers must fit 64 bits."""


@dataclass(frozen=True, eq=False)
class Variable:
    """An array whose axes have names.

    Parameters
    ----------
    dims
        One name per axis; empty for a scalar.
    data
        Integers of 1 to 8 bytes, floats of 4 or 8 bytes, or strings (of any NumPy string dtype, or
        an object array of `str`).
    attributes
        What describes the array: ``units``, ``long_name``, and so on.
    """

    dims: tuple[str, ...]
    data: NDArray[Any]
    attributes: Mapping[str, Attribute] = field(default_factory=dict)

    @property
    def dtype(self) -> np.dtype[Any] | None:
        """Its type; None for strings."""
        return None if self.data.dtype.kind in "UTO" else self.data.dtype


@dataclass(frozen=True, eq=False)
class Table:
    """Variables that share dimensions, with their coordinates and common attributes.

    Parameters
    ----------
    variables
        The data, by name.
    coordinates
        What the positions along the dimensions mean, by name: the array of that dimension when the
        name is a dimension's (it is then 1-D), or else a further coordinate, such as
        ``gains.kd`` along ``point``. A dimension without a coordinate only counts.
    attributes
        What describes the whole.
    """

    variables: Mapping[str, Variable]
    coordinates: Mapping[str, Variable] = field(default_factory=dict)
    attributes: Mapping[str, Attribute] = field(default_factory=dict)

    @property
    def dimensions(self) -> dict[str, int]:
        """The size of every dimension, those with coordinates first."""
        return {
            dim: size
            for variable in (*self.coordinates.values(), *self.variables.values())
            for dim, size in zip(variable.dims, variable.data.shape, strict=True)
        }
