"""A function of numbers as a straight-line program; it knows no group, no law and no engine."""

from __future__ import annotations

import math
import operator
from collections.abc import Callable, Mapping
from typing import Any

import numpy as np

from eqt_cli.base.arrays import FUNCTIONS, Array, register_symbols
from eqt_cli.numbers.program import Constant, Input, Operation, Output, Program


class Symbol:
    """A number of a program that is being traced.

    Attributes
    ----------
    trace
        All symbols of the program.
    index
        Number of symbols created before it.
    depth
        Length of the longest chain of operations that leads to it.
    name, operands
        The operation; inputs and constants have no operands.
    number
        The value of a constant; else None.
    """

    __slots__ = ("depth", "index", "name", "number", "operands", "trace")

    def __init__(
        self,
        trace: _Trace,
        name: str,
        operands: tuple[Symbol, ...] = (),
        number: float | None = None,
    ) -> None:
        self.trace, self.name, self.operands, self.number = trace, name, operands, number
        self.index = len(trace)
        self.depth: int = 1 + max([operand.depth for operand in operands]) if operands else 0

    def __add__(self, other: Any) -> Any:
        return _of_both(_sum, self, other)

    def __sub__(self, other: Any) -> Any:
        return _of_both(_difference, self, other)

    def __rsub__(self, other: Any) -> Any:
        return _of_both(lambda b, a: _difference(a, b), self, other)

    def __mul__(self, other: Any) -> Any:
        return _of_both(_product, self, other)

    def __truediv__(self, other: Any) -> Any:
        return _of_both(_quotient, self, other)

    def __rtruediv__(self, other: Any) -> Any:
        return _of_both(lambda b, a: _quotient(a, b), self, other)

    def __pow__(self, exponent: Any) -> Any:
        return _of_both(_power, self, exponent)

    def __neg__(self) -> Symbol:
        return _negative(self)

    def __bool__(self) -> bool:
        raise TypeError("a symbol has no truth value; choose by where(less(a, b), x, y)")

    __radd__ = __add__
    __rmul__ = __mul__


class _Trace(dict[Any, Symbol]):
    """All symbols of a program, by keys that equal symbols share."""

    def constant(self, number: float) -> Symbol:
        # As keys, 0.0 and -0.0 would be equal, and nan would differ from nan.
        key = number if number and number == number else number.hex()
        found = self.get(key)
        if found is None:
            self[key] = found = Symbol(self, "constant", (), number)
        return found

    def operation(self, name: str, *operands: Symbol) -> Symbol:
        key = name, *[operand.index for operand in operands]
        found = self.get(key)
        if found is None:
            self[key] = found = Symbol(self, name, operands)
        return found


_NUMBERS = int, float, np.number


def _of_both(function: Callable[[Symbol, Symbol], Symbol], a: Symbol, b: Any) -> Any:
    """Apply a function to a symbol and a symbol or number; defer to operands of other types."""
    if isinstance(b, Symbol):
        return function(a, b)
    if isinstance(b, _NUMBERS):
        return function(a, a.trace.constant(float(b)))
    return NotImplemented


def _sum(a: Symbol, b: Symbol) -> Symbol:
    if a.number is not None and b.number is not None:
        return a.trace.constant(a.number + b.number)
    if a.number == 0:
        return b
    if b.number == 0:
        return a
    if b.name == "negative":
        return _difference(a, b.operands[0])
    if a.name == "negative":
        return _difference(b, a.operands[0])
    return a.trace.operation("add", *_in_order(a, b))


def _difference(a: Symbol, b: Symbol) -> Symbol:
    if b.number is not None:
        return _sum(a, a.trace.constant(-b.number))
    if a.number == 0:
        return _negative(b)
    if b.name == "negative":
        return _sum(a, b.operands[0])
    if a.name == "negative":
        return _negative(_sum(a.operands[0], b))
    opposite = a.trace.get(("subtract", b.index, a.index))
    return _negative(opposite) if opposite is not None else a.trace.operation("subtract", a, b)


def _negative(a: Symbol) -> Symbol:
    if a.number is not None:
        return a.trace.constant(-a.number)
    if a.name == "negative":
        return a.operands[0]
    if a.name == "multiply" and a.operands[0].number is not None:
        return _product(a.trace.constant(-a.operands[0].number), a.operands[1])
    return a.trace.operation("negative", a)


def _product(a: Symbol, b: Symbol) -> Symbol:
    if a.number is not None and b.number is not None:
        return a.trace.constant(a.number * b.number)
    if b.number is not None:
        a, b = b, a
    if a.number is not None:
        if a.number == 0:
            return a.trace.constant(0.0)
        if a.number == 1:
            return b
        if a.number == -1:
            return _negative(b)
    if a.name == "negative":
        return _negative(_product(a.operands[0], b))
    if b.name == "negative":
        return _negative(_product(a, b.operands[0]))
    return a.trace.operation("multiply", *_in_order(a, b))


def _quotient(a: Symbol, b: Symbol) -> Symbol:
    if b.number is not None and abs(math.frexp(b.number)[0]) == 0.5 and abs(b.number) > 1e-300:
        return _product(a, a.trace.constant(1 / b.number))  # by a power of 2: exact
    if a.number is not None and b.number is not None:
        with np.errstate(all="ignore"):
            return a.trace.constant(float(np.float64(a.number) / b.number))
    if a.number == 0:
        return a
    if a.name == "negative":
        return _negative(_quotient(a.operands[0], b))
    if b.name == "negative":
        return _negative(_quotient(a, b.operands[0]))
    return a.trace.operation("divide", a, b)


def _power(base: Symbol, exponent: Symbol) -> Symbol:
    """Return a power; whole ones are products, whose series is also right at 0."""
    number, one = exponent.number, base.trace.constant(1.0)
    if number == 0.5:
        return base.trace.operation("sqrt", base)
    if number is None or not math.isfinite(number) or (number > 0 and number % 1):
        return base.trace.operation("pow", base, exponent)
    if number < 0:
        return _quotient(one, _power(base, _negative(exponent)))
    found, factor = one, base
    for digit in reversed(f"{int(number):b}"):
        if digit == "1":
            found = _product(found, factor)
        factor = _product(factor, factor)
    return found


def _in_order(a: Symbol, b: Symbol) -> tuple[Symbol, Symbol]:
    """Return the operands of a commutative operation: a constant first, then the older one."""
    if a.number is None and (b.number is not None or b.index < a.index):
        return b, a
    return a, b


def _compared(name: str) -> Callable[[Any, Any], Symbol]:
    def compare(a: Any, b: Any) -> Symbol:
        a, b = _symbols(a, b)
        if a.number is not None and b.number is not None:
            return a.trace.constant(float(a.number < b.number))
        return a.trace.operation(name, a, b)

    return compare


def _chosen(condition: Any, a: Any, b: Any) -> Symbol:
    condition, a, b = _symbols(condition, a, b)
    if condition.number is not None:
        return a if condition.number else b
    return a if a is b else a.trace.operation("select", condition, a, b)


def _symbols(*values: Any) -> list[Symbol]:
    """Return symbols and numbers, at least one of them a symbol, as symbols."""
    trace = next(value.trace for value in values if isinstance(value, Symbol))
    return [
        value if isinstance(value, Symbol) else trace.constant(float(value)) for value in values
    ]


_less = _compared("less")

register_symbols(
    Symbol,
    {
        **{name: (lambda x, name=name: x.trace.operation(name, x)) for name in FUNCTIONS},
        "abs": lambda x: _chosen(_less(x, 0.0), _negative(x), x),
        "less": _less,
        "smooth_less": _compared("smooth_less"),
        "where": _chosen,
    },
)


def traced(
    function: Callable[[dict[str, Array]], Mapping[str, Array]], inputs: Mapping[str, int]
) -> Program:
    """Trace a function to a program.

    Parameters
    ----------
    function
        Returns arrays of symbols or numbers by name. It is called once, with a vector of symbols
        for each group of inputs.
    inputs
        The length of each group, by its name.
    """
    trace = _Trace()
    given: dict[str, Array] = {}
    for group, length in inputs.items():
        given[group] = np.empty(length, dtype=object)
        for index in range(length):
            trace["input", group, index] = given[group][index] = Symbol(trace, "input")
    found = {name: np.asarray(array, dtype=object) for name, array in function(given).items()}
    entries = {
        name: [
            entry if isinstance(entry, Symbol) else trace.constant(float(entry))
            for entry in array.flat
        ]
        for name, array in found.items()
    }
    symbols = _needed([entry for each in entries.values() for entry in each])
    places = {symbol: place for place, symbol in enumerate(symbols)}
    keys = list(trace)
    values = tuple(
        Constant(symbol.number)
        if symbol.number is not None
        else Operation(symbol.name, tuple(places[operand] for operand in symbol.operands))
        if symbol.operands
        else Input(*keys[symbol.index][1:])
        for symbol in symbols
    )
    outputs = tuple(
        Output(name, array.shape, tuple(places[entry] for entry in entries[name]))
        for name, array in found.items()
    )
    return Program(tuple(inputs.items()), values, outputs)


def _needed(roots: list[Symbol]) -> list[Symbol]:
    """Return the symbols that the roots need, each as late as possible in a walk from the roots.

    Of two operands the deeper one comes first: then fewer values wait for the other.
    """
    found: dict[Symbol, None] = {}
    left = roots[::-1]
    while left:
        needed = [operand for operand in left[-1].operands if operand not in found]
        if needed:
            left += needed if len(needed) == 1 else sorted(needed, key=_depth)
        else:
            found[left.pop()] = None
    return list(found)


_depth = operator.attrgetter("depth")
