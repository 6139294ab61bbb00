"""Named, dimensioned arrays in memory."""

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray

Attribute = str | int | float
"""The value of an attribute; integers must fit into 64 bits."""


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
        Descriptions of the array: ``units``, ``long_name``, and so on.
    """

    dims: tuple[str, ...]
    data: NDArray[Any]
    attributes: Mapping[str, Attribute] = field(default_factory=dict)

    @property
    def dtype(self) -> np.dtype[Any] | None:
        """The type of the data; None for strings."""
        return None if self.data.dtype.kind in "UTO" else self.data.dtype


@dataclass(frozen=True, eq=False)
class Table:
    """Variables that share dimensions, with their coordinates and common attributes.

    Parameters
    ----------
    variables
        The data, by name.
    coordinates
        The meaning of positions along the dimensions, by name. A 1-D array with the name of a
        dimension belongs to that dimension; others are further coordinates, such as ``gains.kd``
        along ``point``. A dimension may have no coordinate.
    attributes
        Descriptions of the whole table.
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
