"""Functions of numbers as straight-line programs: traced, joined, evaluated and written in C.

It knows no group, no law and no engine.
"""

from __future__ import annotations

import math
import operator
from collections import Counter
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from itertools import accumulate
from typing import Any, NamedTuple, TypeAlias

import numpy as np

from eqt_cli.base.arrays import FUNCTIONS, Array, Arrays, register_symbols

# A straight-line program: inputs, then operations one after another, and outputs ------------------


Places: TypeAlias = Mapping[int, int] | Sequence[int]
"""The new places of values, by their old ones."""


class Input(NamedTuple):
    """Entry `number` of a group of inputs."""

    group: str
    number: int


class Constant(NamedTuple):
    """A number that does not depend on the inputs."""

    number: float


class Operation(NamedTuple):
    """An operation on earlier values, by their places in the program.

    Its name is ``add``, ``subtract``, ``multiply``, ``divide``, ``negative`` or ``pow``, an
    elementary function such as ``sin``, one of `COMPARISONS`, or ``select``: its second operand if
    its first, a comparison, holds, else its third. If products are fused, it may be ``fma``,
    a b + c. A ``loop`` is `of` a `Loop`, and a ``result`` the number `of` its operand, a loop.
    """

    name: str
    operands: tuple[int, ...]
    of: Any = None

    def moved(self, places: Places) -> Operation:
        """Return the operation on values that have moved to these places."""
        return self._replace(operands=tuple(places[operand] for operand in self.operands))


class Loop(NamedTuple):
    """A program that is run for so many rows of numbers, one after the other.

    Its operands are what is ``carried`` to the first row, then all rows, then what is ``shared``.
    Of the numbers that the program gives, the first ones are carried to the next row. The results
    are those after the first row, followed by those after the last.
    """

    program: Program
    rows: int


Value: TypeAlias = Input | Constant | Operation

COMPARISONS = ("less", "smooth_less")
"""Both are a < b; the second chooses between two forms of one smooth function."""


class Output(NamedTuple):
    """An output array of a program: its entries, row by row, by their places."""

    name: str
    shape: tuple[int, ...]
    entries: tuple[int, ...]

    def moved(self, places: Places) -> Output:
        """Return the output of values that have moved to these places."""
        return self._replace(entries=tuple(places[entry] for entry in self.entries))


@dataclass(frozen=True)
class Program:
    """The operations of a function on its numbers; equal programs compute the same.

    Attributes
    ----------
    inputs
        The name and the length of each group of inputs.
    values
        Values in the order of computation. No two are equal, and all are needed. Those needed for
        one value stand together, so that few are kept at a time.
    outputs
        The arrays that it returns.
    numbers
        The last inputs of the group `NUMBERS`: numbers of expressions, in which equal programs may
        differ.
    """

    inputs: tuple[tuple[str, int], ...]
    values: tuple[Value, ...]
    outputs: tuple[Output, ...]
    numbers: tuple[float, ...] = field(default=(), compare=False)

    @cached_property
    def _hash(self) -> int:
        return hash((self.inputs, self.values, self.outputs))

    def __hash__(self) -> int:
        return self._hash  # which takes long, and what is compiled is found by it

    @cached_property
    def operations(self) -> int:
        """The number of operations."""
        done = [value for value in self.values if isinstance(value, Operation)]
        loops = [value.of for value in done if value.name == "loop"]
        return len(done) + sum(loop.rows * loop.program.operations for loop in loops)

    @property
    def longest(self) -> int:
        """The number of operations of its longest piece of text: itself, or the body of a loop."""
        done = [value for value in self.values if isinstance(value, Operation)]
        loops = (value.of.program.longest for value in done if value.name == "loop")
        return max(len(done), *loops, 0)


# Tracing: a function is called with symbols, and its operations become a program -----------------


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
    name, operands, of
        The operation; inputs and constants have no operands.
    number
        The value of a constant; else None.
    """

    __slots__ = ("depth", "index", "name", "number", "of", "operands", "trace")

    def __init__(
        self,
        trace: _Trace,
        name: str,
        operands: tuple[Symbol, ...] = (),
        number: float | None = None,
        of: Any = None,
    ) -> None:
        self.trace, self.name, self.operands, self.number = trace, name, operands, number
        self.of = of
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


NUMBERS = "held"
"""The group of inputs that ends with the numbers of expressions; all runs share it."""

Numbers: TypeAlias = dict[float, int]
"""Places of the numbers of expressions. Equal ones share one, as equal constants do, so that equal
operations are done once, and products are fused or not, as if all were constants."""


class _Trace(dict[Any, Symbol]):
    """All symbols of a program, by keys that equal symbols share."""

    def __init__(self, numbers: Numbers | None, begin: int) -> None:
        super().__init__()
        self.numbers, self.begin = numbers, begin

    def constant(self, number: float) -> Symbol:
        # As keys, 0.0 and -0.0 would be equal, and nan would differ from nan.
        key = number if number and number == number else number.hex()
        symbol = self.get(key)
        if symbol is None:
            self[key] = symbol = Symbol(self, "constant", (), number)
        return symbol

    def symbol(self, value: Any) -> Symbol:
        return value if isinstance(value, Symbol) else self.constant(float(value))

    def operation(self, name: str, *operands: Symbol, of: Any = None) -> Symbol:
        key = name, *[operand.index for operand in operands], *([of] if of is not None else [])
        symbol = self.get(key)
        if symbol is None:
            self[key] = symbol = Symbol(self, name, operands, of=of)
        return symbol

    def number(self, number: float) -> Symbol:
        """Return a number of an expression: an input where `numbers` are collected."""
        if self.numbers is None:
            return self.constant(number)
        place = self.numbers.setdefault(number, len(self.numbers))
        key = "input", NUMBERS, self.begin + place
        symbol = self.get(key)
        if symbol is None:
            self[key] = symbol = Symbol(self, "input")
        return symbol

    def inputs(self, group: str, length: int, *inside: int) -> Array:
        symbols = np.empty(length, dtype=object)
        for index in range(length):
            self["input", group, index, *inside] = symbols[index] = Symbol(self, "input")
        return symbols


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
    """Return a product; 0 times anything is 0: without that, programs are a quarter longer."""
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
    product, factor = one, base
    for digit in reversed(f"{int(number):b}"):
        if digit == "1":
            product = _product(product, factor)
        factor = _product(factor, factor)
    return product


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


def _selected(condition: Any, a: Any, b: Any) -> Symbol:
    condition, a, b = _symbols(condition, a, b)
    if condition.number is not None:
        return a if condition.number else b
    return a if a is b else a.trace.operation("select", condition, a, b)


def _symbols(*values: Any) -> list[Symbol]:
    """Return symbols and numbers, at least one of them a symbol, as symbols."""
    trace = next(value.trace for value in values if isinstance(value, Symbol))
    return [trace.symbol(value) for value in values]


_less = _compared("less")

register_symbols(
    Symbol,
    {
        **{name: (lambda x, name=name: x.trace.operation(name, x)) for name in FUNCTIONS},
        "abs": lambda x: _selected(_less(x, 0.0), _negative(x), x),
        "less": _less,
        "smooth_less": _compared("smooth_less"),
        "where": _selected,
        "number": lambda like, number: like.trace.number(number),
        "repeated": lambda *arguments: _repeated(*arguments),
    },
)


def traced(
    function: Callable[[dict[str, Array]], Arrays],
    inputs: Mapping[str, int],
    numbers: Numbers | None = None,
) -> Program:
    """Trace a function to a program.

    Parameters
    ----------
    function
        Returns arrays of symbols or numbers by name. It is called once, with a vector of symbols
        for each group of inputs.
    inputs
        The length of each group, by its name.
    numbers
        Numbers of expressions, to which new ones are added; they become inputs. Without it they
        are constants.
    """
    trace = _Trace(numbers, inputs.get(NUMBERS, 0))
    symbols_of = {group: trace.inputs(group, length) for group, length in inputs.items()}
    arrays = {name: np.asarray(array, dtype=object) for name, array in function(symbols_of).items()}
    entries = {name: [*map(trace.symbol, array.flat)] for name, array in arrays.items()}
    symbols = _needed([entry for listed in entries.values() for entry in listed])
    places = {symbol: place for place, symbol in enumerate(symbols)}
    keys = list(trace)
    values = tuple(
        _value(symbol, places)
        if symbol.operands or symbol.number is not None
        else Input(*keys[symbol.index][1:])
        for symbol in symbols
    )
    outputs = tuple(
        Output(name, array.shape, tuple(places[entry] for entry in entries[name]))
        for name, array in arrays.items()
    )
    return with_numbers(Program(tuple(inputs.items()), values, outputs), numbers or {})


def with_numbers(program: Program, numbers: Numbers) -> Program:
    """Return a program that takes these numbers of expressions."""
    more = len(numbers) - len(program.numbers)
    inputs = [(name, length + more * (name == NUMBERS)) for name, length in program.inputs]
    return replace(program, inputs=tuple(inputs), numbers=tuple(numbers))


def _value(symbol: Symbol, places: Mapping[Symbol, int]) -> Value:
    """Return a constant or an operation of a program from its symbol."""
    if symbol.number is not None:
        return Constant(symbol.number)
    return Operation(symbol.name, tuple(places[operand] for operand in symbol.operands), symbol.of)


def _needed(roots: list[Symbol], begin: int = 0) -> list[Symbol]:
    """Return the symbols that the roots need, each as late as possible in a walk from the roots.

    Of two operands the deeper one comes first: then fewer values wait for the other. What symbols
    before number `begin` need is left out, but for comparisons.
    """
    ordered: dict[Symbol, None] = {}
    waiting = roots[::-1]
    while waiting:
        last = waiting[-1]
        operands = last.operands if last.index >= begin or last.name in COMPARISONS else ()
        needed = [operand for operand in operands if operand not in ordered]
        if needed:
            waiting += sorted(needed, key=operator.attrgetter("depth"))
        else:
            ordered[waiting.pop()] = None
    return list(ordered)


def _repeated(
    step: Callable[[dict[str, Array], dict[str, Array]], Arrays],
    carried: Arrays,
    rows: Sequence[Arrays],
) -> list[dict[str, Array]]:
    """Return what `repeated` does, by a loop of which one step is traced.

    What a step computes from numbers of no row is computed before it, but for comparisons.
    """
    entries = [entry for array in carried.values() for entry in array.flat]
    trace = next(entry.trace for entry in entries if isinstance(entry, Symbol))
    start = [trace.symbol(entry) for entry in entries]
    table = [[*map(trace.symbol, _flat(row))] for row in rows]
    varying = [
        k
        for k, column in enumerate(zip(*table, strict=True))
        if any(entry is not column[0] or entry.number is None for entry in column)
    ]
    begin = len(trace)
    variables = trace.inputs("carried", len(start), begin)
    row = np.array(table[0], dtype=object)
    row[varying] = trace.inputs("row", len(varying), begin)
    after = step(_shaped(variables, carried), _shaped(row, rows[0]))
    named = {name: np.asarray(after[name], dtype=object) for name in [*carried, *after]}
    roots = [*map(trace.symbol, _flat(named))]

    inside, needed, keys = set[Symbol](), dict[Symbol, None](), list(trace)
    for symbol in _needed(roots, begin):
        inner = symbol.name == "input" and keys[symbol.index][3:] == (begin,)
        if (
            inner
            or symbol.name in COMPARISONS
            or any(operand in inside for operand in symbol.operands)
        ):
            inside.add(symbol)
            needed |= dict.fromkeys((*symbol.operands, symbol))
    needed |= dict.fromkeys(roots)
    places = {symbol: place for place, symbol in enumerate(needed)}
    shared, values = list[Symbol](), list[Value]()
    for symbol in needed:
        if symbol.number is None and symbol not in inside:
            values.append(Input("shared", len(shared)))
            shared.append(symbol)
        elif symbol.name == "input":
            values.append(Input(*keys[symbol.index][1:3]))
        else:
            values.append(_value(symbol, places))
    sizes = ("carried", len(start)), ("row", len(varying)), ("shared", len(shared))
    output = Output("after", (len(roots),), tuple(places[root] for root in roots))
    body = Loop(Program(sizes, tuple(values), (output,)), len(rows))
    numbers = [entries[k] for entries in table for k in varying]
    loop = trace.operation("loop", *start, *numbers, *shared, of=body)
    ends = 0, (len(rows) > 1) * len(roots)
    results = [
        [trace.operation("result", loop, of=end + k) for k in range(len(roots))] for end in ends
    ]
    return [_shaped(np.array(result, dtype=object), named) for result in results]


def _flat(arrays: Arrays) -> list[Any]:
    return [entry for array in arrays.values() for entry in np.asarray(array).flat]


def _shaped(entries: Array, like: Arrays) -> dict[str, Array]:
    """Return arrays of the shapes of others from the entries of all of them."""
    ends = np.cumsum([np.size(array) for array in like.values()])[:-1]
    parts = zip(like.items(), np.split(entries, ends), strict=True)
    return {name: part.reshape(np.shape(array)) for (name, array), part in parts}


# Joins programs, and fuses their operations, without changing a bit -------------------------------


class Chain:
    """A program under construction, whose values have places.

    Parameters
    ----------
    inputs
        The name and the length of each group of inputs.
    """

    def __init__(self, inputs: Iterable[tuple[str, int]]) -> None:
        self._inputs = dict(inputs)
        self._values: list[Value] = []
        self._places: dict[object, int] = {}

    def places_of(self, group: str, entries: slice = slice(None)) -> list[int]:
        """Return the places of some of a group of inputs."""
        return [self._place(Input(group, number)) for number in range(self._inputs[group])[entries]]

    def constant(self, number: float) -> list[int]:
        """Return the place of a constant."""
        return [self._place(Constant(number))]

    def then(self, program: Program, inputs: Mapping[str, Sequence[int]]) -> dict[str, list[int]]:
        """Append a program with these places as inputs; return those of its outputs, by name."""
        places: list[int] = []
        for value in program.values:
            if isinstance(value, Input):
                places.append(inputs[value.group][value.number])
            elif isinstance(value, Operation):
                places.append(self._place(value.moved(places)))
            else:
                places.append(self._place(value))
        return {
            output.name: [places[entry] for entry in output.entries] for output in program.outputs
        }

    def program(self, outputs: Mapping[str, Sequence[int]]) -> Program:
        """Return the program whose outputs are vectors of these places."""
        needed = {place for places in outputs.values() for place in places}
        for place in reversed(range(len(self._values))):
            value = self._values[place]
            if place in needed and isinstance(value, Operation):
                needed.update(value.operands)
        moved = {place: new for new, place in enumerate(sorted(needed))}
        values = tuple(
            value.moved(moved) if isinstance(value, Operation) else value
            for value in (self._values[place] for place in moved)
        )
        listed = tuple(
            Output(name, (len(places),), tuple(moved[place] for place in places))
            for name, places in outputs.items()
        )
        return Program(tuple(self._inputs.items()), values, listed)

    def _place(self, value: Value) -> int:
        # As keys, 0.0 and -0.0 would be equal, and nan would differ from nan.
        key = value.number.hex() if isinstance(value, Constant) else value
        if key not in self._places:
            self._places[key] = len(self._values)
            self._values.append(value)
        return self._places[key]


def fused(program: Program) -> Program:
    """Return the program with ``fma`` operations, a b + c; its values differ by rounding.

    Products are fused that only one sum or difference needs; of two in a sum, the later one.
    """
    chosen = _chosen(program)
    left_out = {product for product, *_ in chosen.values()}
    values: list[Value] = []
    places: dict[int, int] = {}

    def add(value: Value) -> int:
        values.append(value)
        return len(values) - 1

    def signed(place: int, minus: bool) -> int:
        return add(Operation("negative", (places[place],))) if minus else places[place]

    for place, value in enumerate(program.values):
        if place in left_out:
            continue
        if place in chosen:
            product, addend, minus_product, minus_addend = chosen[place]
            multiplied = program.values[product]
            assert isinstance(multiplied, Operation)
            a, b = multiplied.operands
            c = signed(addend, minus_addend)
            value = Operation("fma", (signed(a, minus_product), places[b], c))
        elif isinstance(value, Operation):
            value = value.moved(places)
        places[place] = add(value)
    outputs = tuple(output.moved(places) for output in program.outputs)
    return Program(program.inputs, tuple(values), outputs)


def _chosen(program: Program) -> dict[int, tuple[int, int, bool, bool]]:
    """Return the sums and differences to fuse, ± product ± addend, by their places.

    Each is the places of product and addend, and whether each of them is subtracted.
    """
    used = Counter(place for output in program.outputs for place in output.entries)
    for value in program.values:
        if isinstance(value, Operation):
            used.update(value.operands)
    products = {
        place
        for place, value in enumerate(program.values)
        if isinstance(value, Operation) and value.name == "multiply" and used[place] == 1
    }
    chosen = {}
    for place, value in enumerate(program.values):
        if isinstance(value, Operation) and value.name in ("add", "subtract"):
            (first, second), minus = value.operands, value.name == "subtract"
            if second in products and (first not in products or second > first):
                chosen[place] = (second, first, minus, False)
            elif first in products:
                chosen[place] = (first, second, False, minus)
    return chosen


# Evaluates a program by NumPy, on the numbers of many runs at a time ------------------------------


class ArrayProgram:
    """A program as NumPy calls: an operation for all runs each, in arrays that stay.

    It has no loops: those of estimators are taken at instants, which are not evaluated by it.

    Attributes
    ----------
    inputs : (length, runs) each
        Each group of inputs, by its name, to be written to.
    """

    def __init__(self, program: Program, runs: int) -> None:
        lengths = dict(program.inputs)
        self._arrays = np.empty((sum(lengths.values()) + len(program.values), runs))
        *groups, _ = np.split(self._arrays, np.cumsum([*lengths.values()]))
        self.inputs = dict(zip(lengths, groups, strict=True))
        starts = dict(zip(lengths, accumulate(lengths.values(), initial=0), strict=False))
        self._calls: list[tuple[Callable[..., Any], list[Array]]] = []
        places: list[int] = []
        rows: list[Array] = []
        for place, value in enumerate(program.values, start=sum(lengths.values())):
            if isinstance(value, Input):
                place = starts[value.group] + value.number
            row = self._arrays[place]
            if isinstance(value, Constant):
                row.fill(value.number)
            elif isinstance(value, Operation):
                if value.name in COMPARISONS:
                    row = np.empty(runs, dtype=bool)
                arguments = [*(rows[operand] for operand in value.operands), row]
                self._calls.append((_NUMPY.get(value.name) or getattr(np, value.name), arguments))
            places.append(place)
            rows.append(row)
        self._outputs = {
            output.name: (output.shape, [places[entry] for entry in output.entries])
            for output in program.outputs
        }

    def __call__(self) -> dict[str, Array]:
        """Return the outputs for the numbers written to the inputs, ``(…, runs)`` each."""
        for function, arguments in self._calls:
            function(*arguments)
        return {
            name: self._arrays[places].reshape(*shape, -1)
            for name, (shape, places) in self._outputs.items()
        }


def _select(condition: Array, a: Array, b: Array, out: Array) -> None:
    np.copyto(out, b)
    np.putmask(out, condition, a)


_NUMPY: dict[str, Callable[..., Any]] = {**dict.fromkeys(COMPARISONS, np.less), "select": _select}
