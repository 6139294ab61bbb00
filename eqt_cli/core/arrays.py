"""The array functions that a law may call; it knows no engine and no law.

Laws are written with operators, ``@``, slicing, ``reshape``, ``swapaxes`` and the functions of this
module. Each function looks at what it is given: float arrays go to NumPy, object arrays go,
element by element, to the function table that the owner of the symbol type has registered with
`register_symbols`. That is what lets one law run on floats and be traced by a compiler.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from eqt_cli.core.errors import TraceError

Array = NDArray[Any]
"""A float array, or an object array of symbols, with any leading batch axes."""

FUNCTIONS = (
    "sin cos tan asin acos atan sinh cosh tanh asinh acosh atanh exp log sqrt abs".split()
)
"""Elementwise functions of one argument; the names are also those of the expression grammar."""

_NUMPY = {name: getattr(np, name) for name in FUNCTIONS}
_symbol_tables: dict[type, Mapping[str, Callable[[Any], Any]]] = {}


def register_symbols(symbol: type, table: Mapping[str, Callable[[Any], Any]]) -> None:
    """Say how the elementwise functions act on one `symbol` type held in object arrays."""
    _symbol_tables[symbol] = table


def apply(name: str, x: Any) -> Any:
    """Apply the elementwise function `name` to floats or symbols.

    Raises
    ------
    TraceError
        If `x` holds symbols whose engine offers no such function.
    """
    x = np.asarray(x)
    if x.dtype != object:
        return _NUMPY[name](x)
    out = np.empty(x.shape, dtype=object)
    for index, value in np.ndenumerate(x):
        out[index] = _apply_to_symbol(name, value)
    return out


def _apply_to_symbol(name: str, value: Any) -> Any:
    if isinstance(value, (int, float)):
        return _NUMPY[name](value)
    table = _symbol_tables.get(type(value), {})
    if name not in table:
        raise TraceError(
            f"{name}() is not available for symbols of type {type(value).__name__}; "
            "use `engine: solve_ivp`, which evaluates laws on numbers"
        )
    return table[name](value)


def sin(x: Any) -> Any:
    """Sine, elementwise, of floats or symbols."""
    return apply("sin", x)


def cos(x: Any) -> Any:
    """Cosine, elementwise, of floats or symbols."""
    return apply("cos", x)


def exp(x: Any) -> Any:
    """Exponential, elementwise, of floats or symbols."""
    return apply("exp", x)


def sqrt(x: Any) -> Any:
    """Square root, elementwise, of floats or symbols."""
    return apply("sqrt", x)


def norm(x: Array) -> Any:
    """Euclidean norm over the last axis."""
    return sqrt((x * x).sum(axis=-1))


def frobenius(x: Array) -> Any:
    """Frobenius norm over the last two axes."""
    return sqrt((x * x).sum(axis=(-2, -1)))


def apply_matrix(matrix: Array, vector: Array) -> Array:
    """Matrix times vector, ``(..., k, m) · (..., m) -> (..., k)``."""
    return (matrix @ vector[..., None])[..., 0]


def dot(p: Array, v: Array) -> Any:
    """The contraction ⟨P, V⟩ of a covector and a vector, over the last axis."""
    return (p * v).sum(axis=-1)


def stack(entries: Sequence[Any]) -> Array:
    """Scalars or arrays, numbers or symbols, as the entries of a new last axis."""
    arrays = [np.asarray(entry) for entry in entries]
    dtype = object if any(array.dtype == object for array in arrays) else float
    shape = np.broadcast_shapes(*(array.shape for array in arrays))
    out = np.empty((*shape, len(arrays)), dtype=dtype)
    for index, array in enumerate(arrays):
        out[..., index] = array
    return out


def transpose(matrix: Array) -> Array:
    """Matrix transpose, over the last two axes."""
    return matrix.swapaxes(-1, -2)
