"""Named, dimensioned arrays in memory; it must not know files or what the numbers mean."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field
from typing import Any

from numpy.typing import NDArray

from eqt_cli.core.errors import ResultError
from eqt_cli.store.layout import NAME, RESERVED

Attribute = str | int | float
"""What an attribute may hold; integers must fit 64 bits."""

_NUMBERS = frozenset(["i1", "i2", "i4", "i8", "u1", "u2", "u4", "u8", "f4", "f8"])


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
    def is_text(self) -> bool:
        """Whether the array holds strings."""
        return self.data.dtype.kind in "UTO"


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

    Raises
    ------
    ResultError
        If sizes or names contradict each other, or something cannot be stored.
    """

    variables: Mapping[str, Variable]
    coordinates: Mapping[str, Variable] = field(default_factory=dict)
    attributes: Mapping[str, Attribute] = field(default_factory=dict)

    def __post_init__(self) -> None:
        for name, variable in self._items():
            _check_variable(name, variable)
        for name in self.variables:
            if name in self.coordinates:
                raise ResultError(
                    f"{name}: is both a variable and a coordinate; give it once or rename one"
                )
        dimensions = self.dimensions
        for name, variable in self._items():
            if name in dimensions and (name in self.variables or variable.dims != (name,)):
                raise ResultError(
                    f"{name}: has the name of a dimension, but is not its coordinate; rename it, "
                    f"or give it among the coordinates with dims ('{name}',)"
                )
        for name, variable in self.coordinates.items():
            if name not in dimensions and not any(
                set(variable.dims) <= set(other.dims) for other in self.variables.values()
            ):
                raise ResultError(
                    f"{name}: is a coordinate along {variable.dims}, which no variable has; "
                    "give it among the variables"
                )
        _check_attributes("attributes", self.attributes)

    @property
    def dimensions(self) -> dict[str, int]:
        """The size of every dimension, those with coordinates first."""
        sizes: dict[str, int] = {}
        seen: dict[str, str] = {}
        for name, variable in self._items():
            for dim, size in zip(variable.dims, variable.data.shape, strict=True):
                if sizes.setdefault(dim, size) != size:
                    raise ResultError(
                        f"{name}: dimension '{dim}' has {size} entries, but {sizes[dim]} in "
                        f"'{seen[dim]}'; give both the same size"
                    )
                seen.setdefault(dim, name)
        return sizes

    def _items(self) -> Iterable[tuple[str, Variable]]:
        yield from self.coordinates.items()
        yield from self.variables.items()


def _check_variable(name: str, variable: Variable) -> None:
    dims, data = variable.dims, variable.data
    for word in (name, *dims):
        if not NAME.fullmatch(word):
            raise ResultError(
                f"{name}: cannot store the name {word!r}; use a letter or underscore first, then "
                "letters, digits and _ . @ + -"
            )
    if len(set(dims)) != len(dims) or len(dims) != data.ndim:
        raise ResultError(
            f"{name}: dimensions {dims} do not fit data of shape {data.shape}; "
            "give every axis one name of its own"
        )
    if variable.is_text:
        for value in data.flat:
            _check_text(name, value)
    elif data.dtype.str[1:] not in _NUMBERS:
        raise ResultError(
            f"{name}: cannot store data of type {data.dtype}; expected integers, floats of 4 or 8 "
            "bytes, or strings"
        )
    _check_attributes(name, variable.attributes)


def _check_attributes(place: str, attributes: Mapping[str, Attribute]) -> None:
    for key, value in attributes.items():
        if not NAME.fullmatch(key) or key in RESERVED:
            raise ResultError(
                f"{place}: cannot store an attribute called {key!r}; choose another name"
            )
        if isinstance(value, str):
            _check_text(f"{place}.{key}", value)
        elif isinstance(value, bool) or not isinstance(value, (int, float)):
            raise ResultError(
                f"{place}.{key}: cannot store a {type(value).__name__}; expected str, int or float"
            )
        elif isinstance(value, int) and not -(2**63) <= value < 2**63:
            raise ResultError(f"{place}.{key}: {value} does not fit 64 bits; store it as text")


def _check_text(place: str, value: object) -> None:
    """HDF5 strings end at the first NUL, and lone surrogates have no UTF-8 form."""
    if not isinstance(value, str):
        raise ResultError(f"{place}: cannot store {value!r} among strings; expected str")
    try:
        storable = b"\0" not in value.encode()
    except UnicodeEncodeError:
        storable = False
    if not storable:
        raise ResultError(
            f"{place}: cannot store the text {value[:40]!r}, which holds a NUL or a lone "
            "surrogate; replace that character"
        )
