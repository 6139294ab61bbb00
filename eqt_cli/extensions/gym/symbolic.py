"""Arrays of symbols that take comparisons, conditions and NumPy's functions, as floats do."""

from __future__ import annotations

from collections.abc import Callable
from functools import reduce
from typing import Any

import numpy as np

from eqt_cli.base import arrays
from eqt_cli.base.arrays import Array, apply, less, where

_NAMES = {
    **{name: name for name in ("sin", "cos", "tan", "sinh", "cosh", "tanh", "exp", "log", "sqrt")},
    **{f"arc{name}": f"a{name}" for name in ("sin", "cos", "tan", "sinh", "cosh", "tanh")},
    "absolute": "abs",
    "fabs": "abs",
    "floor": "floor",
}
"""Functions of a number by the names of NumPy's."""


def _number(condition: Any) -> Any:
    return where(condition, 1.0, 0.0)


def _is_number(x: Any) -> Any:
    return _number(less(-1.0, x * x))


def _both(*conditions: Any) -> Any:
    return reduce(lambda a, b: a * b, conditions)


def _any_of(*conditions: Any) -> Any:
    return 1.0 - _both(*(1.0 - condition for condition in conditions))


def _not_less(a: Any, b: Any) -> Any:
    """Return a ≥ b, which no NaN is."""
    return _both(_is_number(a), _is_number(b), 1.0 - _number(less(a, b)))


def _equal(a: Any, b: Any) -> Any:
    return _both(_not_less(a, b), _not_less(b, a))


def _truth(x: Any) -> Any:
    """Return 1 where a number is not 0, as it is for NumPy."""
    return 1.0 - _equal(x, 0.0)


_CONDITIONS: dict[str, Callable[..., Any]] = {
    "less": lambda a, b: _number(less(a, b)),
    "greater": lambda a, b: _number(less(b, a)),
    "less_equal": lambda a, b: _not_less(b, a),
    "greater_equal": _not_less,
    "equal": _equal,
    "not_equal": lambda a, b: 1.0 - _equal(a, b),
    "isnan": lambda x: 1.0 - _is_number(x),
    "logical_and": lambda a, b: _both(_truth(a), _truth(b)),
    "logical_or": lambda a, b: _any_of(_truth(a), _truth(b)),
    "logical_not": lambda a: 1.0 - _truth(a),
}
"""What gives conditions, which are 1 and 0 here, and True and False in NumPy."""

_OF_CONDITIONS: dict[str, Callable[..., Any]] = {
    **dict.fromkeys(("bitwise_and", "multiply"), _both),
    **dict.fromkeys(("bitwise_or", "add"), _any_of),
    "bitwise_xor": lambda a, b: _both(_any_of(a, b), 1.0 - a * b),
    "invert": lambda a: 1.0 - a,
}
"""What gives conditions of conditions alone."""

_OTHERS: dict[str, Callable[..., Any]] = {
    "maximum": arrays.maximum,
    "minimum": arrays.minimum,
    "clip": arrays.clip,
    "positive": lambda x: x,
    "hypot": lambda a, b: arrays.sqrt(a * a + b * b),
    "sign": lambda x: where(less(0.0, x), 1.0, where(less(x, 0.0), -1.0, x)),
}

_OVER_AXES: dict[str, Callable[..., Any]] = {
    "maximum": arrays.maximum,
    "minimum": arrays.minimum,
    "logical_and": _both,
    "logical_or": _any_of,
}


class Symbolic(np.ndarray[Any, Any]):
    """An array of symbols.

    Attributes
    ----------
    is_condition
        Whether its entries are conditions.
    """

    is_condition = False

    def __array_finalize__(self, other: Any) -> None:
        """A part of a condition is one."""
        self.is_condition = getattr(other, "is_condition", False)

    def __array_ufunc__(
        self, ufunc: Any, method: str, *inputs: Any, out: Any = None, **options: Any
    ) -> Any:
        """Do as the function does with floats; a `TypeError` where symbols cannot."""
        plain = [np.asarray(x) if isinstance(x, Symbolic) else x for x in inputs]
        only, name = all(map(_is_condition, inputs)), ufunc.__name__
        if method == "reduce":
            value, is_condition = self._reduced(ufunc, plain[0], only, options)
        elif method != "__call__":
            raise TypeError(f"{name}.{method}() is not available for symbols")
        elif name in _CONDITIONS:
            value, is_condition = _CONDITIONS[name](*plain), True
        elif only and name in _OF_CONDITIONS:
            value, is_condition = _OF_CONDITIONS[name](*plain), True
        else:
            of_symbols = _applied(_NAMES[name]) if name in _NAMES else _OTHERS.get(name, ufunc)
            value, is_condition = of_symbols(*plain), False
        if out is not None:
            np.asarray(out[0])[...] = value
            return out[0]
        return symbolic(value, is_condition=is_condition)

    @staticmethod
    def _reduced(ufunc: Any, plain: Array, only: bool, options: Any) -> tuple[Any, bool]:
        over = _OVER_AXES.get(ufunc.__name__)
        if over is None:
            options.pop("dtype", None)
            return ufunc.reduce(plain, **options), False
        axis, keeps = options.get("axis", 0), options.get("keepdims", False)
        if isinstance(axis, tuple) or axis is None:
            raise TypeError("symbols are compared along one axis")
        logical = ufunc.__name__.startswith("logical")
        parts = np.moveaxis(plain if only or not logical else _truth(plain), axis, 0)
        value = reduce(over, parts)
        return (np.expand_dims(value, axis) if keeps else value), logical

    def __array_function__(self, function: Any, types: Any, arguments: Any, options: Any) -> Any:
        """Choose by `where`, and take norms; other functions do as with any objects."""
        if function is np.where and len(arguments) == 3:
            condition, *both = arguments
            a, b = (np.asarray(x) for x in both)
            if not isinstance(condition, Symbolic):
                return symbolic(where(condition, a, b))
            holds = np.asarray(condition)
            chosen = where(less(0.5, holds if condition.is_condition else _truth(holds)), a, b)
            return symbolic(chosen, is_condition=all(map(_is_condition, both)))
        if function is np.linalg.norm and options.keys() <= {"axis", "keepdims"}:
            return np.sqrt((arguments[0] * arguments[0]).sum(**options))
        return super().__array_function__(function, types, arguments, options)


def _applied(name: str) -> Callable[[Any], Any]:
    return lambda x: apply(name, x)


def _is_condition(x: Any) -> bool:
    return x.is_condition if isinstance(x, Symbolic) else np.asarray(x).dtype == bool


def symbolic(value: Any, *, is_condition: bool = False) -> Any:
    """Return an array of symbols as a `Symbolic`; others as they are."""
    if not isinstance(value, np.ndarray) or value.dtype != object:
        return value
    array = value.view(Symbolic)
    array.is_condition = is_condition
    return array
