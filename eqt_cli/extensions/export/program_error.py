"""Bounds the rounding errors of what a program returns, at many inputs at once.

Every operation has a relative error of one unit roundoff. Its effect on the outputs is bounded in
two ways: by a running error analysis as in `numbers.Bounded`, where each operation magnifies the
largest errors of its operands; and to first order by the derivatives of the outputs with respect to
each value, so that errors of the same origin can cancel. The smaller bound counts. A comparison is
followed as computed; if rounding can change its outcome, the other branch adds to the error.
"""

import math
from dataclasses import dataclass, field
from typing import Literal, NamedTuple

import numpy as np

from eqt_cli.base.arrays import Array, Arrays
from eqt_cli.numbers.jets import slope
from eqt_cli.numbers.program import COMPARISONS, Constant, Input, Operation, Output, Program


@dataclass(frozen=True)
class Arithmetic:
    """A floating-point arithmetic.

    Attributes
    ----------
    name
        Name of the type in C.
    unit
        Unit roundoff: largest relative error of one operation.
    least
        Smallest normal number; results below it may be lost.
    function_units
        Error bound of eqt's elementary functions, in unit roundoffs.
    """

    name: Literal["double", "float"]
    unit: float
    least: float
    function_units: float

    @property
    def dtype(self) -> type[np.floating]:
        """NumPy type of the numbers."""
        return np.float32 if self.name == "float" else np.float64

    def rounded(self, values: Array) -> Array:
        """Round values to these numbers, and return them as doubles."""
        return np.asarray(values, dtype=self.dtype).astype(float)


DOUBLE = Arithmetic("double", 2.0**-53, 2.0**-1022, 4.0)
FLOAT = Arithmetic("float", 2.0**-24, 2.0**-126, 8.0)
ARITHMETICS = {arithmetic.name: arithmetic for arithmetic in (DOUBLE, FLOAT)}

SINGULAR = 2.0**10
"""Relative error of a divisor or of a compared value, in unit roundoffs, above which a state counts
as near a singularity. Ten bits are lost there."""


class BoundedOutput(NamedTuple):
    """An output of a program at many inputs.

    Attributes
    ----------
    values, errors
        Values in doubles, and bounds of the distance between rounded and exact results;
        ``(inputs, …)``.
    singular : (inputs,)
        Whether each input is near a singularity.
    """

    values: Array
    errors: Array
    singular: Array


SECOND_ORDER = 1.01
"""Factor of the first-order bound that covers the squares of small relative errors."""

BLOCK = 500
"""Number of inputs analysed at once, so that the data of all values fit into a cache."""


class _ProgramValue(NamedTuple):
    """A value of the program.

    Attributes
    ----------
    value
        The value in doubles.
    error
        Bound of the running error analysis.
    lost
        Largest relative error of a divisor that it depends on.
    rounding
        Error of this operation alone.
    slopes
        Derivatives by the operands, at their largest within the errors of these.
    """

    value: Array
    error: Array
    lost: Array
    rounding: Array
    slopes: tuple[Array, ...] = ()


def bounded(
    program: Program, inputs: Arrays, by: Arithmetic = DOUBLE, errors: Arrays | None = None
) -> dict[str, BoundedOutput]:
    """Compute the outputs of a program, and bounds of their distance from exact results.

    Parameters
    ----------
    inputs
        Inputs ``(n, length)`` for each group, or ``(length,)`` if all have the same.
    by
        The arithmetic of the program.
    errors
        Errors of the inputs, in the same shapes; 0 if missing.
    """
    values_of, errors_of = (
        {name: np.atleast_2d(np.asarray(values, float)) for name, values in rows.items()}
        for rows in (inputs, errors or {})
    )
    count = max((len(values) for values in values_of.values()), default=1)
    blocks = []
    with np.errstate(all="ignore"):
        for start in range(0, count, BLOCK):
            part = slice(start, min(start + BLOCK, count))
            one, other = (
                {name: x[part] if len(x) > 1 else x for name, x in rows.items()}
                for rows in (values_of, errors_of)
            )
            analysis = _Analysis(program, one, by, other, part.stop - part.start)
            blocks.append([analysis.of(output) for output in program.outputs])
    return {
        output.name: BoundedOutput(*map(np.concatenate, zip(*rows, strict=True)))
        for output, rows in zip(program.outputs, zip(*blocks, strict=True), strict=True)
    }


@dataclass
class _Analysis:
    """A program at `count` inputs, with a number for each of its values."""

    program: Program
    inputs: Arrays
    by: Arithmetic
    errors: Arrays
    count: int
    numbers: list[_ProgramValue] = field(default_factory=list)

    def __post_init__(self) -> None:
        for value in self.program.values:
            if isinstance(value, Operation):
                self.numbers.append(self._operation(value))
                continue
            exact, error = np.zeros(1), np.zeros(1)
            if isinstance(value, Input):
                exact = self.inputs[value.group][:, value.number]
                if value.group in self.errors:
                    error = self.errors[value.group][:, value.number]
            elif isinstance(value, Constant):
                exact = np.array([value.number])
                if math.isfinite(value.number):
                    error = np.abs(self.by.rounded(exact) - exact)
            self.numbers.append(_ProgramValue(exact, error, np.zeros(1), error))

    def of(self, output: Output) -> BoundedOutput:
        """Return an output, with ``(count, entries)`` for values and errors."""
        numbers = [self.numbers[entry] for entry in output.entries]
        values, errors, lost = (
            np.stack([np.broadcast_to(number[part], self.count) for number in numbers], axis=-1)
            if numbers
            else np.zeros((self.count, 0))
            for part in range(3)
        )
        errors = np.fmin(SECOND_ORDER * self._to_first_order(output), errors)
        errors = np.where(np.isnan(errors), np.inf, errors)
        far = (lost <= SINGULAR * self.by.unit).all(axis=-1)
        return BoundedOutput(values, errors, np.asarray(~far))

    def _to_first_order(self, output: Output) -> Array:
        """Sum the first-order effects of the new error of each value on the output, backwards."""
        slopes: dict[int, Array] = {}
        for index, entry in enumerate(output.entries):
            slopes.setdefault(entry, np.zeros((len(output.entries), 1)))[index] = 1.0
        total = np.zeros((len(output.entries), self.count))
        for place in reversed(range(len(self.numbers))):
            slope_of = slopes.pop(place, None)
            if slope_of is None:
                continue
            number, value = self.numbers[place], self.program.values[place]
            total += _product(np.abs(slope_of), number.rounding)
            if isinstance(value, Operation):
                for operand, by_operand in zip(value.operands, number.slopes, strict=True):
                    slopes[operand] = slopes.get(operand, 0.0) + _product(slope_of, by_operand)
        return total.T

    def _operation(self, operation: Operation) -> _ProgramValue:
        name, x = operation.name, [self.numbers[k] for k in operation.operands]
        if name == "select":
            return _selected(*x)
        if name in COMPARISONS:
            return _compared(*x)
        lost = np.maximum.reduce(np.broadcast_arrays(*(operand.lost for operand in x)))
        if name in ("divide", "sqrt", "log", "pow"):
            near = x[-1] if name == "divide" else x[0]
            # An exact value loses nothing, even if it is 0.
            lost = np.maximum(lost, np.where(near.error > 0, near.error / np.abs(near.value), 0.0))
        value, slopes = _value_and_slopes(name, x)
        error = sum(
            np.abs(_product(k, operand.error)) for k, operand in zip(slopes, x, strict=True)
        )
        if name == "multiply":
            error = error + x[0].error * x[1].error
        units = 1.0 if name in _ROUNDED else self.by.function_units
        rounding = units * self.by.unit * (np.abs(value) + error) + self.by.least
        factor = self.program.values[operation.operands[0]]
        by_power_of_2 = isinstance(factor, Constant) and abs(math.frexp(factor.number)[0]) == 0.5
        if name in ("negative", "abs", "floor") or (name == "multiply" and by_power_of_2):
            rounding = np.zeros(1)
        return _ProgramValue(value, error + rounding, lost, rounding, slopes)


_ROUNDED = ("add", "subtract", "multiply", "divide", "sqrt")
"""The operations that IEEE 754 rounds once."""


def _value_and_slopes(name: str, x: list[_ProgramValue]) -> tuple[Array, tuple[Array, ...]]:
    """Return the value of an operation, and its derivatives by the operands."""
    a, b, one = x[0], x[-1], np.ones(1)
    if name == "add":
        return a.value + b.value, (one, one)
    if name == "subtract":
        return a.value - b.value, (one, -one)
    if name == "negative":
        return -a.value, (-one,)
    if name == "multiply":
        return a.value * b.value, (b.value, a.value)
    if name == "divide":
        value, left = a.value / b.value, np.abs(b.value) - b.error
        inverse = np.where(left > 0, np.sign(b.value) / left, np.inf)
        return value, (inverse, -value * inverse)
    if name == "sqrt":
        value = np.sqrt(a.value)
        above = np.sqrt(a.value + a.error) - value
        below = value - np.sqrt(np.maximum(a.value - a.error, 0.0))
        return value, (np.where(a.error > 0, np.maximum(above, below) / a.error, 0.5 / value),)
    if name == "pow":
        value = a.value**b.value
        by_base = b.value * a.value ** (b.value - 1)
        return value, (by_base, value * np.log(np.abs(a.value)))
    value = getattr(np, name)(a.value)
    if name == "floor":
        jump = np.floor(a.value + a.error) - np.floor(a.value - a.error)
        return value, (np.where(jump > 0, jump / a.error, 0.0),)
    near = [slope(name, at) + 0.0 * at for at in (a.value, a.value - a.error, a.value + a.error)]
    return value, (np.copysign(np.fmax.reduce([np.abs(value) for value in near]), near[0]),)


def _product(a: Array, b: Array) -> Array:
    """Return a b, with 0 times anything equal to 0."""
    return np.where((a == 0) | (b == 0), 0.0, a * b)


def _compared(a: _ProgramValue, b: _ProgramValue) -> _ProgramValue:
    """Compare a < b; the error says whether rounding can change the outcome."""
    errors = a.error + b.error
    turns = ~(np.abs(a.value - b.value) > errors) & (errors > 0)
    zero = np.zeros(1)
    return _ProgramValue(a.value < b.value, turns, zero, zero, (zero, zero))


def _selected(holds: _ProgramValue, a: _ProgramValue, b: _ProgramValue) -> _ProgramValue:
    """Return the selected value; if rounding can change the choice, the difference is an error."""
    chosen, turned = holds.value.astype(bool), holds.error.astype(bool)
    value, error, lost = (np.where(chosen, p, q) for p, q in zip(a[:3], b[:3], strict=True))
    other, its_error = (np.where(chosen, q, p) for p, q in zip(a[:2], b[:2], strict=True))
    apart = np.abs(other - value)
    apart = np.where(np.isnan(apart), np.inf, apart) + its_error
    jumps = turned & (apart > SINGULAR * (error + its_error))
    jump = np.where(turned, apart, 0.0)
    return _ProgramValue(
        value,
        np.maximum(error, jump),
        np.where(jumps, np.inf, np.where(turned, np.maximum(a.lost, b.lost), lost)),
        jump,
        (np.zeros(1), chosen * 1.0, ~chosen * 1.0),
    )
