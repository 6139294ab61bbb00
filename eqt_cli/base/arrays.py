"""The array functions that a law may call.

Laws are written with operators, ``@``, slicing, ``reshape``, ``swapaxes`` and the functions of this
module. Each function acts by the type of its arguments: float arrays go to NumPy; object arrays go,
element by element, to the function table that was registered for the symbol type with
`register_symbols`. So the same law runs on floats and is traced by a compiler.
"""

from collections.abc import Callable, Mapping, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from eqt_cli.base.errors import TraceError

Array = NDArray[Any]
"""A float array, or an object array of symbols, with any leading batch axes."""

Arrays = Mapping[str, Array]
"""Arrays by their names, such as the states of a vehicle or the memory of a law."""

FUNCTIONS = (
    "sin cos tan asin acos atan sinh cosh tanh asinh acosh atanh exp log sqrt abs floor".split()
)
"""Elementwise functions of one argument; the names are also those of the expression grammar."""

_NUMPY: dict[str, Callable[..., Any]] = {
    **{name: getattr(np, name) for name in FUNCTIONS},
    "less": np.less,
    "positive": lambda x: np.less(0.0, x),
    "smooth_less": np.less,
    "where": np.where,
}
_symbol_tables: dict[type, Mapping[str, Callable[..., Any]]] = {}


def register_symbols(symbol: type, table: Mapping[str, Callable[..., Any]]) -> None:
    """Register how the functions of this module act on a `symbol` type in object arrays.

    The table may hold any of `FUNCTIONS`, ``less(a, b)`` and ``where(condition, a, b)``. Optional
    entries are ``smooth_less(a, b)`` if it differs from ``less(a, b)``, ``positive(x)`` of a sum of
    squares if it differs from ``less(0, x)``, ``inverse(matrix)`` of arrays ``(..., m, m)`` if
    there is a better way than elimination, ``repeated`` if it has loops, and ``number(symbol, x)``
    if numbers of expressions may be inputs.
    """
    defaults = {}
    if "less" in table:
        less = table["less"]
        defaults = {"smooth_less": less, "positive": lambda x: less(0.0, x)}
    _symbol_tables[symbol] = defaults | dict(table)


def as_array(x: Any) -> Any:
    """Return an array; an object with NumPy's array protocol is returned unchanged."""
    return x if hasattr(x, "__array_function__") else np.asarray(x)


def apply(name: str, *arguments: Any) -> Any:
    """Apply the elementwise function `name` to floats or symbols, which broadcast.

    Raises
    ------
    TraceError
        If an argument holds symbols whose engine offers no such function.
    """
    for argument in arguments:
        if hasattr(argument, "applied"):  # a Taylor series
            return argument.applied(name, arguments)
    arrays = [as_array(argument) for argument in arguments]
    if not any(array.dtype == object for array in arrays):
        return _NUMPY[name](*arrays)
    out = np.empty(np.broadcast_shapes(*(array.shape for array in arrays)), dtype=object)
    for index, values in zip(np.ndindex(out.shape), np.broadcast(*arrays), strict=True):
        symbols = [value for value in values if not isinstance(value, int | float | np.generic)]
        if not symbols:
            out[index] = _NUMPY[name](*values)[()]  # `where` returns an array
            continue
        table = _symbol_tables.get(type(symbols[0]), {})
        if name not in table:
            raise TraceError(f"{name}() is not available for {type(symbols[0]).__name__} symbols")
        out[index] = table[name](*values)
    return out


def number_like(variable: Any) -> Callable[[float], Any]:
    """Return what the symbols of a variable's value take for numbers that may change.

    0, 1 and −1 are structure, without which programs would be longer. Floats keep all numbers.
    """
    symbol = getattr(variable, "value", variable)  # of a Taylor series
    if isinstance(symbol, np.ndarray) and symbol.dtype == object:
        symbol = symbol.flat[0]
    number = _symbol_tables.get(type(symbol), {}).get("number")
    return lambda x: number(symbol, x) if number and abs(x) not in (0.0, 1.0) else x


def unwrapped(x: Any) -> Any:
    """Return the number in an array of no dimensions, which `apply` returns; others unchanged."""
    return x[()] if isinstance(x, np.ndarray) and x.shape == () else x


def sin(x: Any) -> Any:
    """Sine, elementwise, of floats or symbols."""
    return apply("sin", x)


def cos(x: Any) -> Any:
    """Cosine, elementwise, of floats or symbols."""
    return apply("cos", x)


def exp(x: Any) -> Any:
    """Exponential, elementwise, of floats or symbols."""
    return apply("exp", x)


def log(x: Any) -> Any:
    """Natural logarithm, elementwise, of floats or symbols."""
    return apply("log", x)


def tanh(x: Any) -> Any:
    """Hyperbolic tangent, elementwise, of floats or symbols; a smooth saturation."""
    return apply("tanh", x)


def sqrt(x: Any) -> Any:
    """Square root, elementwise, of floats or symbols."""
    return apply("sqrt", x)


def absolute(x: Any) -> Any:
    """Absolute value, elementwise, of floats or symbols."""
    return apply("abs", x)


def less(a: Any, b: Any) -> Any:
    """a < b, elementwise: a condition, only for `where`."""
    return apply("less", a, b)


def smooth_less(a: Any, b: Any) -> Any:
    """a < b, elementwise, for a `where` that chooses between two forms of one smooth function.

    As `less`, but an engine need not end a step where it changes, because both forms hold there.
    """
    return apply("smooth_less", a, b)


def where(condition: Any, a: Any, b: Any) -> Any:
    """a where the condition of `less` or `smooth_less` holds, b elsewhere, elementwise."""
    return apply("where", condition, a, b)


def outside(x: Any, low: Any, high: Any) -> Any:
    """1 where any entry along the last axis is below low or above high, else 0."""
    beyond = where(less(x, low), 1.0, where(less(high, x), 1.0, 0.0))
    return where(less(0.5, beyond.sum(axis=-1)), 1.0, 0.0)


def where_number(a: Any, b: Any) -> Any:
    """b where a is a number, also an infinite one; a where it is NaN, elementwise."""
    return where(smooth_less(-1.0, a * a), b, a)


def minimum(a: Any, b: Any) -> Any:
    """The smaller of a and b, elementwise; NaN where any of them is."""
    return where(less(a, b), a, where_number(a, b))


def maximum(a: Any, b: Any) -> Any:
    """The larger of a and b, elementwise; NaN where any of them is."""
    return where(less(a, b), b, where_number(b, a))


def clip(x: Any, low: Any, high: Any) -> Any:
    """x limited to the range from low to high, elementwise; NaN where any of them is.

    Engines end a step at each kink; `tanh` saturates without kinks.
    """
    return minimum(maximum(x, low), high)


def norm(x: Array) -> Any:
    """Euclidean norm over the last axis."""
    if x.dtype == object and x.shape[-1] == 1:
        return absolute(x[..., 0]) + _NEARLY_ZERO
    return _root((x * x).sum(axis=-1))


def frobenius(x: Array) -> Any:
    """Frobenius norm over the last two axes."""
    return _root((x * x).sum(axis=(-2, -1)))


_NEARLY_ZERO = 1e-100
"""Smallest norm of symbols, to allow division; it does not change larger norms."""


def _root(squares: Any) -> Any:
    """Return the root of a sum of squares."""
    root = sqrt(squares)
    if as_array(root).dtype != object:
        return root
    # A root has no derivative at 0. What is no number stays so: it is not positive either.
    return where(apply("positive", squares), root, squares + _NEARLY_ZERO)


def apply_matrix(matrix: Array, vector: Array) -> Array:
    """Matrix times vector, ``(..., k, m) · (..., m) -> (..., k)``."""
    if matrix.ndim == 2:  # eight times as fast for one matrix and many vectors
        return vector @ matrix.T
    return (matrix @ vector[..., None])[..., 0]


def times(stack: Array, matrix: Array) -> Array:
    """A stack of matrices times one matrix, or times a stack, ``(..., k, m) · (..., m, n)``."""
    # One product of two matrices is faster than many; other array types have faster ways.
    if matrix.ndim == 2 and stack.ndim > 2 and isinstance(stack, np.ndarray):
        rows = stack.reshape(-1, matrix.shape[0])
        return (rows @ matrix).reshape(*stack.shape[:-1], matrix.shape[-1])
    return stack @ matrix


def ordered_product(a: Array, b: Array) -> Array:
    """a @ b of stacks of matrices, with sums in one order on every machine; BLAS has its own."""
    product: Array = (a[..., :, :, None] * b[..., None, :, :]).sum(axis=-2)
    return product


def dot(p: Array, v: Array) -> Any:
    """The contraction ⟨P, V⟩ of a covector and a vector, over the last axis."""
    return (p * v).sum(axis=-1)


def stack(entries: Sequence[Any]) -> Array:
    """Join scalars or arrays, of numbers or symbols, along a new last axis."""
    for entry in entries:
        if hasattr(entry, "stacked"):  # a Taylor series
            return entry.stacked(entries)
    arrays = [as_array(entry) for entry in entries]
    dtype = object if any(array.dtype == object for array in arrays) else float
    shape = np.broadcast_shapes(*(array.shape for array in arrays))
    like = next((array for array in arrays if not isinstance(array, np.ndarray)), arrays[0])
    out = np.empty_like(like, shape=(*shape, len(arrays)), dtype=dtype)
    for index, array in enumerate(arrays):
        out[..., index] = array
    return out


def cross(a: Array, b: Array) -> Array:
    """a × b of vectors ``(..., 3)``."""
    ax, ay, az = (a[..., k] for k in range(3))
    bx, by, bz = (b[..., k] for k in range(3))
    return stack([ay * bz - az * by, az * bx - ax * bz, ax * by - ay * bx])


def inverse_spd(matrix: Array) -> Array:
    """The inverse of a symmetric positive definite matrix, ``(..., m, m)``.

    That of a table of symbols, or Gauss-Jordan elimination without pivoting or branches, stable by
    definiteness (Golub and Van Loan, Matrix Computations, 4.2), so that floats and programs have
    the same bits.
    """
    if matrix.dtype == object:
        for entry in matrix.flat:
            if "inverse" in (table := _symbol_tables.get(type(entry), {})):
                return table["inverse"](matrix)
    n = matrix.shape[-1]
    # A float would spoil fractions.
    identity = np.eye(n, dtype=int if matrix.dtype == object else float)
    work = np.concatenate([matrix, np.broadcast_to(identity, matrix.shape)], axis=-1)
    for k in range(n):
        row = work[..., k, None, :] / work[..., k, None, k, None]
        others = [other for other in range(n) if other != k]
        work[..., others, :] = work[..., others, :] - work[..., others, k, None] * row
        work[..., k, :] = row[..., 0, :]
    return work[..., n:]


def repeated(
    step: Callable[[dict[str, Array], dict[str, Array]], Arrays],
    carried: Arrays,
    rows: Sequence[Arrays],
    apart: bool = False,
) -> tuple[dict[str, Array], dict[str, Array]]:
    """Take a step for each row, from what the one before has left; return the first and last one.

    Of symbols a program holds the step once, whatever the number of rows, so that it is no longer
    for longer delays.

    Parameters
    ----------
    step
        ``step(carried, row)`` returns arrays: those that are carried to the next row, of the same
        shapes, and any others.
    carried
        The arrays before the first row.
    rows
        Further arrays for each step, of the same names and shapes in all.
    apart
        Whether the program also holds a single step by itself, so that several loops share it.
    """
    if apart or len(rows) > 1:
        symbols = (
            entry for array in carried.values() if array.dtype == object for entry in array.flat
        )
        for entry in symbols:
            if "repeated" in (table := _symbol_tables.get(type(entry), {})):
                first, last = table["repeated"](step, carried, rows)
                return first, last
    first = last = dict(step(dict(carried), dict(rows[0])))
    for row in rows[1:]:
        last = dict(step({name: last[name] for name in carried}, dict(row)))
    return first, last


def transpose(matrix: Array) -> Array:
    """Matrix transpose, over the last two axes."""
    return matrix.swapaxes(-1, -2)


def distinct(numbers: Any) -> Array:
    """Return distinct numbers in rising order: `np.unique`, which imports masked arrays for it."""
    ordered = np.sort(numbers, axis=None)
    return ordered[np.append(True, ordered[1:] != ordered[:-1])[: ordered.size]]


def least_squares(columns: Arrays, values: Array) -> dict[str, float]:
    """Return the least-squares coefficients of the columns with the smallest norm."""
    if not columns:
        return {}
    matrix = np.stack([column.ravel() for column in columns.values()], axis=1)
    sizes = np.linalg.norm(matrix, axis=0)
    sizes[sizes == 0] = 1.0
    shares = np.linalg.lstsq(matrix / sizes, values.ravel(), rcond=1e-10)[0] / sizes
    return dict(zip(columns, shares.tolist(), strict=True))
