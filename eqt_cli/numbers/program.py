"""A straight-line program, its simplification, its C, and exact decimals of its constants."""

from __future__ import annotations

import math
import operator
import re
from collections import Counter
from collections.abc import Callable, Collection, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from decimal import Context, Decimal, localcontext
from functools import cached_property
from pathlib import Path
from typing import Any, NamedTuple, TypeAlias

from eqt_cli.base.arrays import Array

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
    a b + c.
    """

    name: str
    operands: tuple[int, ...]

    def moved(self, places: Places) -> Operation:
        """Return the operation on values that have moved to these places."""
        return Operation(self.name, tuple(places[operand] for operand in self.operands))


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
    """

    inputs: tuple[tuple[str, int], ...]
    values: tuple[Value, ...]
    outputs: tuple[Output, ...]

    @cached_property
    def operations(self) -> int:
        """The number of operations."""
        return sum(isinstance(value, Operation) for value in self.values)


# Joins programs, and fuses their operations, without changing a bit -------------------------------


ChainPlaces: TypeAlias = list[int]
"""The places of the numbers of a group in a chain."""


class Chain:
    """A program under construction.

    Parameters
    ----------
    inputs
        The length of each group of inputs, by its name.
    """

    def __init__(self, inputs: Mapping[str, int]) -> None:
        self._inputs = dict(inputs)
        self._values: list[Value] = []
        self._places: dict[object, int] = {}

    def given(self, group: str, entries: slice = slice(None)) -> ChainPlaces:
        """Return the places of some of a group of inputs."""
        numbers = range(self._inputs[group])[entries]
        return [self._place(Input(group, number)) for number in numbers]

    def constant(self, number: float) -> ChainPlaces:
        """Return the place of a constant."""
        return [self._place(Constant(number))]

    def then(self, program: Program, given: Mapping[str, Sequence[int]]) -> dict[str, ChainPlaces]:
        """Append a program with these places as inputs; return those of its outputs, by name."""
        places: list[int] = []
        for value in program.values:
            if isinstance(value, Input):
                places.append(given[value.group][value.number])
            elif isinstance(value, Operation):
                places.append(self._place(value.moved(places)))
            else:
                places.append(self._place(value))
        return {each.name: [places[entry] for entry in each.entries] for each in program.outputs}

    def program(self, outputs: Mapping[str, tuple[tuple[int, ...], Sequence[int]]]) -> Program:
        """Return the program whose outputs have these shapes and places."""
        needed = {place for _, entries in outputs.values() for place in entries}
        for place in reversed(range(len(self._values))):
            value = self._values[place]
            if place in needed and isinstance(value, Operation):
                needed.update(value.operands)
        moved = {place: new for new, place in enumerate(sorted(needed))}
        values = tuple(
            value.moved(moved) if isinstance(value, Operation) else value
            for value in (self._values[place] for place in moved)
        )
        found = tuple(
            Output(name, shape, tuple(moved[entry] for entry in entries))
            for name, (shape, entries) in outputs.items()
        )
        return Program(tuple(self._inputs.items()), values, found)

    def _place(self, value: Value) -> int:
        # As keys, 0.0 and -0.0 would be equal, and nan would differ from nan.
        key = value.number.hex() if isinstance(value, Constant) else value
        if key not in self._places:
            self._places[key] = len(self._values)
            self._values.append(value)
        return self._places[key]


class _Fused(NamedTuple):
    """A sum or difference with a product in it: ± product ± other."""

    product: int
    other: int
    minus_product: bool
    minus_other: bool


def fused(program: Program) -> Program:
    """Return the program with ``fma`` operations, a b + c; its values differ by rounding.

    Products are fused that only one sum or difference needs; of two in a sum, the later one.
    """
    chosen = _chosen(program)
    left_out = {each.product for each in chosen.values()}
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
            sum_ = chosen[place]
            product = program.values[sum_.product]
            assert isinstance(product, Operation)
            a, b = product.operands
            c = signed(sum_.other, sum_.minus_other)
            value = Operation("fma", (signed(a, sum_.minus_product), places[b], c))
        elif isinstance(value, Operation):
            value = value.moved(places)
        places[place] = add(value)
    outputs = tuple(each.moved(places) for each in program.outputs)
    return Program(program.inputs, tuple(values), outputs)


def _chosen(program: Program) -> dict[int, _Fused]:
    """Return the sums and differences to fuse, by their places."""
    used = Counter(place for output in program.outputs for place in output.entries)
    for value in program.values:
        if isinstance(value, Operation):
            used.update(value.operands)
    products = {
        place
        for place, value in enumerate(program.values)
        if isinstance(value, Operation) and value.name == "multiply" and used[place] == 1
    }
    found = {}
    for place, value in enumerate(program.values):
        if isinstance(value, Operation) and value.name in ("add", "subtract"):
            (first, second), minus = value.operands, value.name == "subtract"
            if second in products and (first not in products or second > first):
                found[place] = _Fused(second, first, minus, False)
            elif first in products:
                found[place] = _Fused(first, second, False, minus)
    return found


# Names that are valid in C: ASCII letters, digits and underscores, and no keywords ----------------


KEYWORDS = frozenset(
    "auto break case char const continue default do double else enum extern float for goto if "
    "inline int long register restrict return short signed sizeof static struct switch typedef "
    "union unsigned void volatile while asm bool catch class delete explicit export false friend "
    "mutable namespace new operator private protected public template this throw true try typeid "
    "typename using virtual real".split()
)
"""Keywords of C and C++, and the type of the exported numbers."""


def c_name(text: str) -> str:
    """Return a name in C for a text: the text itself if it is one."""
    name = re.sub(r"[^A-Za-z0-9]+", "_", text).strip("_") if not _is_name(text) else text
    if not name or name[0].isdigit():
        name = f"n_{name}".rstrip("_")
    return f"{name}_" if name in KEYWORDS else name


def distinct(
    texts: Iterable[str], taken: Collection[str] = (), endings: Collection[str] = ("",)
) -> list[str]:
    """Return names in C for texts, none of which is taken, also with these endings.

    They differ not only in case, so that files can have them on every system.
    """
    found, used = [], {each.lower() for each in taken}
    for text in texts:
        name, number = c_name(text), 1
        while used & (own := {f"{name}{ending}".lower() for ending in endings}):
            number += 1
            name = f"{c_name(text)}_{number}"
        found.append(name)
        used |= own
    return found


def _is_name(text: str) -> bool:
    return re.fullmatch(r"[A-Za-z][A-Za-z0-9_]*", text, re.ASCII) is not None


LANES_HEADER = Path(__file__).with_name("lanes.h")
"""Header of the number type, one or several numbers side by side; it precedes programs."""

FUNCTIONS_HEADER = Path(__file__).with_name("functions.h")
"""Header of the elementary functions of programs; it follows `LANES_HEADER`."""

_INFIX = {"add": "+", "subtract": "-", "multiply": "*", "divide": "/"}


def c_function(program: Program, name: str) -> str:
    """Return the definition of a C function for a program.

    It takes a pointer ``in_GROUP`` for each group of inputs, then ``out_NAME`` for each output, in
    their order. Outputs must not overlap inputs. Elementary functions have the names of the
    program, prefixed with ``eqt_``.

    Raises
    ------
    ValueError
        If a name is no identifier of C.
    """
    groups = [group for group, _ in program.inputs]
    outputs = [output.name for output in program.outputs]
    for each in (name, *groups, *outputs):
        if not _is_name(each):
            raise ValueError(f"{each!r} is no identifier of C")
    taken = [f"const eqt_real *__restrict in_{group}" for group in groups]
    given = [f"eqt_real *__restrict out_{output}" for output in outputs]
    used = {value.group for value in program.values if isinstance(value, Input)}
    targets: dict[int, list[str]] = {}
    for output in program.outputs:
        for entry, place in enumerate(output.entries):
            targets.setdefault(place, []).append(f"out_{output.name}[{entry}] = v{place};")
    lines = [f"(void)in_{group};" for group in groups if group not in used]
    for place in range(len(program.values)):
        lines += [_definition(program, place), *targets.get(place, [])]
    body = "".join(f"    {line}\n" for line in lines)
    return f"void {name}({', '.join(taken + given)})\n{{\n{body}}}\n"


def _definition(program: Program, place: int) -> str:
    value, kind = program.values[place], "eqt_real"
    if isinstance(value, Input):
        formula = f"in_{value.group}[{value.number}]"
    elif isinstance(value, Constant):
        formula = f"eqt_constant({_literal(value.number)})"
    else:
        operands = [f"v{operand}" for operand in value.operands]
        if value.name in _INFIX:
            formula = f" {_INFIX[value.name]} ".join(operands)
        elif value.name == "negative":
            formula = f"-{operands[0]}"
        else:
            kind = "eqt_mask" if value.name in COMPARISONS else kind
            called = "less" if value.name in COMPARISONS else value.name
            formula = f"eqt_{called}({', '.join(operands)})"
    return f"const {kind} v{place} = {formula};"


def _literal(number: float) -> str:
    """Return a number in C: its shortest digits, which compilers read as the same double."""
    if math.isfinite(number):
        return repr(number)
    return "EQT_NAN" if math.isnan(number) else f"{'-' * (number < 0)}EQT_INFINITY"


FLOAT_HEADER = Path(__file__).with_name("float_functions.h")
"""Header of the types and functions of programs in float."""

_DEFINED = re.compile(
    r"^#define (\w+)|^(?:EQT_INLINE|EQT_RARE)[\w ]* \*?(\w+)\(|^static const \w+ (\w+)\["
    r"|^typedef [^;{]*?(\w+)(?: __attribute__.*)?;|^\} (\w+);",
    re.MULTILINE,
)
_NAME = re.compile(r"\b(?:eqt|EQT)_\w+")
_RULE = re.compile(r"/\* .* -{10,} \*/")
_GUARD = re.compile(r"#define EQT_\w+_H")
_CONDITION = re.compile(r"#(if|ifdef|ifndef|elif|else|endif)\b(.*)")


def headers(real: str) -> str:
    """Return the types and functions of programs in ``double`` or ``float``, with one lane."""
    paths = [FLOAT_HEADER] if real == "float" else [LANES_HEADER, FUNCTIONS_HEADER]
    texts = [path.read_text(encoding="utf-8") for path in paths]
    return "\n".join(map(_of_one_lane, texts))


def needed(text: str, header: str) -> str:
    """Return the definitions of a header that a text needs, in the order of the header.

    Names that the text defines itself are left out.
    """
    own = set(_defined(text))
    units = [unit for unit in _units(header) if not own.intersection(_defined(unit))]
    wanted = set(_NAME.findall(text))
    chosen: set[int] = set()
    for index in reversed(range(len(units))):  # definitions stand before their use
        if wanted.intersection(_defined(units[index])):
            chosen.add(index)
            wanted.update(_NAME.findall(units[index]))
    return "\n".join(units[index] for index in sorted(chosen))


def _defined(text: str) -> Iterator[str]:
    return (name for found in _DEFINED.findall(text) for name in found if name)


def _units(header: str) -> Iterator[str]:
    """Yield the definitions of a header, each with the comment before it."""
    lines: list[str] = []
    depth = conditions = 0
    comment = False
    for line in header.splitlines():
        if _RULE.fullmatch(line) or (not line.strip() and not depth and not conditions):
            lines = [] if not comment else lines
            continue
        lines.append(line)
        comment = ("/*" in line or comment) and "*/" not in line.rpartition("/*")[2]
        code = re.sub(r"/\*.*?\*/", "", line).rstrip()
        if comment:
            continue
        if found := _CONDITION.match(line):
            conditions += {"if": 1, "ifdef": 1, "ifndef": 1, "endif": -1}.get(found[1], 0)
        depth += code.count("{") - code.count("}")
        ends = code.endswith((";", "}")) or (code.startswith("#") and not code.endswith("\\"))
        if not depth and not conditions and ends:
            yield "\n".join(lines) + "\n"
            lines = []


def _of_one_lane(header: str) -> str:
    """Return a header for one lane, without guard, includes and conditions on the lanes."""
    branches: list[str] = []  # the fate of each condition around a line
    kept = [
        line
        for line in header.splitlines()
        if _stays(line, branches) and not line.startswith("#include") and not _GUARD.fullmatch(line)
    ]
    text = "\n".join(kept).replace("EQT_LANES", "1")
    return text.replace("static EQT_CONSTANT const", "static const")


def _stays(line: str, branches: list[str]) -> bool:
    """Return whether a line stays; a condition begins, changes or ends the last branch."""
    match = _CONDITION.match(line)
    skipped = "skipped" in branches
    if match is None:
        return not skipped
    if match[1] in ("if", "ifdef", "ifndef"):
        branches.append("skipped" if skipped else _branch(line))
        return branches[-1] == "kept"
    if match[1] == "endif":
        return branches.pop() == "kept" and "skipped" not in branches
    if branches[-1] == "taken":
        branches[-1] = "skipped"
    return not skipped and branches[-1] == "kept"


def _branch(line: str) -> str:
    if line == "#if EQT_LANES == 1" or re.fullmatch(r"#ifndef EQT_(\w+_H|DEVICE)", line):
        return "taken"
    return "skipped" if line == "#ifndef EQT_LANES" else "kept"


# Evaluation of programs in decimals of many digits, to which rounded results are compared ---------


DIGITS = 60
"""Digits of every operation, so that some 40 are left where a state is near a singularity."""


def evaluated(program: Program, inputs: Mapping[str, Array]) -> dict[str, list[Decimal]]:
    """Return the outputs of a program for doubles, entry by entry; NaN where undefined.

    Values that no `select` chooses may be undefined: no condition is trapped, so that they are NaN
    or infinite, and no comparison with NaN holds.
    """
    values: list[Any] = []
    with localcontext(Context(prec=DIGITS, traps=[], Emin=-(10**6), Emax=10**6)):
        for value in program.values:
            if isinstance(value, Input):
                values.append(Decimal(float(inputs[value.group][value.number])))
            elif isinstance(value, Constant):
                values.append(Decimal(value.number))
            else:
                function = _OPERATIONS[value.name]
                values.append(function(*(values[operand] for operand in value.operands)))
        return {
            output.name: [+values[entry] for entry in output.entries] for output in program.outputs
        }


def _pi() -> Decimal:
    """Return π by Machin's formula."""
    return 4 * (4 * _arctangent(Decimal(1) / 5) - _arctangent(Decimal(1) / 239))


def _summed(first: Decimal, ratio: Callable[[int], Decimal]) -> Decimal:
    """Return a series from its first term, and the ratio of its n-th term to the one before."""
    term = total = first
    n = 0
    while abs(term) > Decimal(10) ** -(DIGITS + 5) * abs(first):
        n += 1
        term *= ratio(n)
        total += term
    return total


def _arctangent(x: Decimal) -> Decimal:
    """Return the arctangent of a number between -1/2 and 1/2."""
    return _summed(x, lambda n: -x * x * (2 * n - 1) / (2 * n + 1))


def _atan(x: Decimal) -> Decimal:
    if x.is_infinite():
        return (_pi() / 2).copy_sign(x)
    for _ in range(3):  # atan x = 2 atan(x / (1 + sqrt(1 + x^2)))
        x = x / (1 + (1 + x * x).sqrt())
    return 8 * _arctangent(x)


def _turned(x: Decimal) -> tuple[Decimal, Decimal]:
    """Return sine and cosine."""
    turn = 2 * _pi()
    x = x - (x / turn).to_integral_value() * turn
    sine = _summed(x, lambda n: -x * x / (2 * n * (2 * n + 1)))
    return sine, _summed(Decimal(1), lambda n: -x * x / (2 * n * (2 * n - 1)))


def _asin(x: Decimal) -> Decimal:
    return _atan(x / (1 - x * x).sqrt())


def _sinh(x: Decimal) -> Decimal:
    if abs(x) < Decimal("0.1"):  # where a difference of exponentials loses digits
        return _summed(x, lambda n: x * x / (2 * n * (2 * n + 1)))
    return (x.exp() - (-x).exp()) / 2


def _cosh(x: Decimal) -> Decimal:
    return (x.exp() + (-x).exp()) / 2


_OPERATIONS: dict[str, Callable[..., Any]] = {
    "add": lambda a, b: a + b,
    "subtract": lambda a, b: a - b,
    "multiply": lambda a, b: a * b,
    "divide": lambda a, b: a / b,
    "negative": lambda a: -a,
    "pow": operator.pow,
    "select": lambda holds, a, b: a if holds else b,
    **dict.fromkeys(COMPARISONS, operator.lt),
    "abs": abs,
    "sqrt": lambda x: x.sqrt(),
    "exp": lambda x: x.exp(),
    "log": lambda x: x.ln(),
    "sin": lambda x: _turned(x)[0],
    "cos": lambda x: _turned(x)[1],
    "tan": lambda x: _turned(x)[0] / _turned(x)[1],
    "asin": _asin,
    "acos": lambda x: _pi() / 2 - _asin(x),
    "atan": _atan,
    "sinh": _sinh,
    "cosh": _cosh,
    "tanh": lambda x: _sinh(x) / _cosh(x) if abs(x) < 100 else Decimal(1).copy_sign(x),
    "asinh": lambda x: (abs(x) + (x * x + 1).sqrt()).ln().copy_sign(x),
    "acosh": lambda x: (x + (x * x - 1).sqrt()).ln(),
    "atanh": lambda x: ((1 + x) / (1 - x)).ln() / 2,
}
