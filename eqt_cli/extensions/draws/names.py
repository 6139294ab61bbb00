"""The section `draws`: names, and how each run draws their numbers."""

from __future__ import annotations

import csv
import math
import re
from collections.abc import Collection, Iterator, Sequence
from dataclasses import dataclass, field
from functools import lru_cache
from typing import Any, Self

import numpy as np

from eqt_cli.base import units
from eqt_cli.base.arrays import FUNCTIONS, Array
from eqt_cli.base.errors import InputError, Problems, suggestion
from eqt_cli.base.expressions import PIECEWISE, Expression, constant, formula
from eqt_cli.base.option_types import shown
from eqt_cli.components.initial_states import Stream, generator_at
from eqt_cli.config.document import Document, data_file
from eqt_cli.config.schema import Config

TABLE = "table"
"""The key of a file with a row for each run; no name."""

EXPECTED = (
    "expected {uniform: [least, greatest]}, {normal: [mean, std]}, a number, or a formula in other "
    "names; for several names as 'a, b', {normal: {mean: […], covariance: [[…], […]]}}"
)

SINGULAR = 1e-12
"""Variance left by other names, relative to its own, below which rounding makes it 0."""


@dataclass(frozen=True)
class Drawing:
    """How one name, or several that hang together, get their numbers.

    Attributes
    ----------
    names
        The names.
    kind
        `uniform`, `normal`, `several` normals or `formula`.
    numbers
        Bounds, mean and deviation, means, or the formula: expressions in names before it.
    factor : (n, n)
        Of several normals: L, with the covariance L Lᵀ.
    """

    names: tuple[str, ...]
    kind: str
    numbers: tuple[Expression, ...]
    factor: Any = field(default=None, compare=False)

    @property
    def place(self) -> str:
        """The name of its stream of random numbers."""
        return f"draws.{', '.join(self.names)}"

    @property
    def reads(self) -> set[str]:
        """The names that it depends on."""
        return {name for one in self.numbers for name in one.variables}

    def values(self, others: dict[str, float], random: np.random.Generator | None) -> list[float]:
        """Return its numbers; without a generator, the means."""
        numbers = [float(one.evaluate(others)) for one in self.numbers]
        if self.kind == "formula":
            return numbers
        if self.kind == "several":
            z = np.zeros(len(numbers)) if random is None else random.standard_normal(len(numbers))
            return [
                mean + float((row * z).sum())
                for mean, row in zip(numbers, self.factor, strict=True)
            ]
        (one, two), (name,) = numbers, self.names
        if self.kind == "uniform" and one > two:
            raise InputError(f"expected the smaller number of {name} first, got [{one:g}, {two:g}]")
        if self.kind == "normal" and two < 0:
            raise InputError(f"expected a standard deviation of {name} of at least 0, got {two:g}")
        if self.kind == "uniform":
            return [(one + two) / 2 if random is None else float(random.uniform(one, two))]
        return [one if random is None else float(random.normal(one, two))]


@dataclass(frozen=True, eq=False)
class DrawnNames:
    """The names of the section `draws`, and their numbers in each run.

    Attributes
    ----------
    data
        The section as it is written.
    drawings
        How the names are drawn, each after those that it reads.
    columns, rows : (runs, n)
        The names and numbers of a table; run k has row k modulo their count.
    file
        The name of its file, and its text; empty without one.
    """

    data: Any
    drawings: tuple[Drawing, ...]
    columns: tuple[str, ...] = ()
    rows: Any = None
    file: tuple[str, ...] = ()

    def __repr__(self) -> str:
        return repr((self.data, self.file[1:]))

    def __eq__(self, other: object) -> bool:
        return isinstance(other, DrawnNames) and repr(self) == repr(other)

    def __hash__(self) -> int:
        return hash(repr(self))

    @property
    def names(self) -> tuple[str, ...]:
        """All names, those of the table first."""
        return (*self.columns, *(name for drawing in self.drawings for name in drawing.names))

    @property
    def means(self) -> dict[str, float]:
        """The means by name; of a formula, the value at the means of what it reads."""
        return _means(self)

    def of(self, seed: int, run: int) -> dict[str, float]:
        """Return the numbers of a run by name."""
        return _of_run(self, seed, run)

    @classmethod
    def read(cls, document: Document, problems: Problems) -> Self | None:
        """Return the names of a configuration, or None after noting their problems."""
        section = document.data["draws"]
        if not isinstance(section, dict) or not section:
            problems.add(f"expected names, such as W: {{uniform: [2, 8]}}, got {shown(section)}")
            return None
        columns, rows, file = tuple[str, ...](), None, tuple[str, ...]()
        if TABLE in section:
            with problems.catching(TABLE):
                name = str(section[TABLE])
                file = name, data_file(document.home, name)
                columns, rows = read_table(name, file[1])
        groups = [
            (key, tuple(map(str.strip, str(key).split(",")))) for key in section if key != TABLE
        ]
        names = [*columns, *(name for _, group in groups for name in group)]
        taken = taken_names(document)
        for key, group in [(TABLE, columns), *groups]:
            for name in group:
                if why := unfit(name, names, taken):
                    problems.at(key).add(why)
        if problems:
            return None
        drawings = [
            read_drawing(group, section[key], names, problems.at(key)) for key, group in groups
        ]
        if problems:
            return None
        ordered = in_order(list(filter(None, drawings)), columns, problems)
        keys, means = {group: key for key, group in groups}, _row_means(columns, rows)
        for drawing in ordered:  # bounds may follow from others, and be in another order
            with problems.at(keys[drawing.names]).catching():
                means |= zip(drawing.names, drawing.values(means, None), strict=True)
            if problems:
                return None
        return None if problems else cls(section, ordered, columns, rows, file)


@lru_cache(maxsize=8)
def _means(names: DrawnNames) -> dict[str, float]:
    values = _row_means(names.columns, names.rows)
    for drawing in names.drawings:
        values |= zip(drawing.names, drawing.values(values, None), strict=True)
    return values


def _row_means(columns: Sequence[str], rows: Any) -> dict[str, float]:
    """Return the means of the columns of a table by name; none without one."""
    return {} if rows is None else dict(zip(columns, rows.mean(axis=0).tolist(), strict=True))


@lru_cache(maxsize=20_000)
def _of_run(names: DrawnNames, seed: int, run: int) -> dict[str, float]:
    values: dict[str, float] = {}
    if names.rows is not None:
        values |= zip(names.columns, names.rows[run % len(names.rows)].tolist(), strict=True)
    for drawing in names.drawings:
        random = generator_at(seed, Stream.VEHICLE, run, drawing.place)
        values |= zip(drawing.names, drawing.values(values, random), strict=True)
    return values


# What is wrong with a section ---------------------------------------------------------------------


def taken_names(document: Document) -> set[str]:
    """Return the names of sweeps and searches of a configuration."""

    def inside(value: Any) -> Iterator[str]:
        if isinstance(value, dict):
            yield from map(str, value)
            value = [*value.values()]
        if isinstance(value, list):
            for entry in value:
                yield from inside(entry)

    both = document.source.data or {}, document.data
    names = (data.get(key) for data in both for key in ("sweep", "tune", "worst"))
    return {name for section in names for name in inside(section)}


def unfit(name: str, names: Sequence[str], swept: Collection[str]) -> str:
    """Return why a name cannot be one of draws; empty if it can."""
    if not re.fullmatch(r"[A-Za-z_]\w*", name):
        return f"expected a name of letters, digits and _, such as W, got {name!r}"
    clash = ""
    if name in ("t", "pi"):
        clash = {"t": "the time", "pi": "a number"}[name]
    elif name in FUNCTIONS or name in PIECEWISE:
        clash = "a function"
    elif units.size_of(name):
        clash = "a unit"
    elif name in Config.model_fields or name == TABLE:
        clash = "a key"
    elif name in swept:
        clash = "a name of the sweep or the search"
    elif names.count(name) > 1:
        return f"'{name}' is drawn twice; call one of them otherwise"
    return f"'{name}' is {clash} already; call it otherwise, such as {name}_drawn" if clash else ""


def read_drawing(
    group: tuple[str, ...], value: Any, names: Sequence[str], problems: Problems
) -> Drawing | None:
    """Return how the names of a key are drawn, or None after noting what is wrong."""
    readable = tuple(name for name in names if name not in group)

    def read(entry: Any, *path: str | int) -> Expression | None:
        with problems.catching(*path):
            return read_number(entry, group, readable)
        return None

    kind = next(iter(value), "") if isinstance(value, dict) and len(value) == 1 else ""
    inner = value[kind] if kind else value
    if kind == "normal" and isinstance(inner, dict):
        return read_several(group, inner, read, problems.at("normal"))
    if len(group) == 1 and not isinstance(value, dict | list):
        one = read(value)
        return Drawing(group, "formula", (one,)) if one else None
    if kind not in ("uniform", "normal") or len(group) > 1 or not isinstance(inner, list):
        problems.add(f"{EXPECTED}; got {shown(value)}{suggestion(kind, ('uniform', 'normal'))}")
        return None
    if len(inner) != 2:
        two = "the least and the greatest" if kind == "uniform" else "mean and deviation"
        problems.at(kind).add(f"expected two numbers, {two}, got {len(inner)}")
        return None
    numbers = [read(entry, kind, k) for k, entry in enumerate(inner)]
    if problems or None in numbers:
        return None
    return Drawing(group, kind, tuple(one for one in numbers if one))


def read_number(entry: Any, group: Collection[str], readable: Collection[str]) -> Expression:
    """Return a number, perhaps with a unit, or a formula in names outside of a group.

    Raises
    ------
    InputError
        If it is neither.
    """
    if isinstance(entry, bool) or not isinstance(entry, int | float | str):
        raise InputError(f"expected a number or a formula in other names, got {shown(entry)}")
    if isinstance(entry, float) and not math.isfinite(entry):
        raise InputError(f"expected a finite number, got {shown(entry)}")
    if isinstance(entry, str) and (split := units.split(entry)):
        number, unit = split
        size = units.factor(unit, units.base_of(unit)) or 1.0
        entry = constant(number) * size
    text = entry if isinstance(entry, str) else repr(float(entry))
    expression = formula(text, (*readable, *group))
    if circle := sorted(expression.variables & {*group}):
        raise InputError(f"'{entry}' reads {circle[0]}, which it defines; remove the circle")
    return expression


def read_several(
    group: tuple[str, ...], inner: dict[str, Any], read: Any, problems: Problems
) -> Drawing | None:
    """Return several normals with a covariance, or None after noting what is wrong."""
    n = len(group)
    if inner.keys() != {"mean", "covariance"}:
        problems.add(f"expected mean and covariance, got {', '.join(map(str, inner)) or 'nothing'}")
        return None
    mean, covariance = inner["mean"], inner["covariance"]
    if not isinstance(mean, list) or len(mean) != n:
        problems.at("mean").add(f"expected {n} numbers, for {', '.join(group)}, got {shown(mean)}")
        return None
    rows = covariance if isinstance(covariance, list) else [covariance]
    if len(rows) != n or any(not isinstance(row, list) or len(row) != n for row in rows):
        problems.at("covariance").add(f"expected {n} rows of {n} numbers, got {shown(covariance)}")
        return None
    means = [read(entry, "normal", "mean", k) for k, entry in enumerate(mean)]
    with problems.catching("covariance"):
        C = np.array([[float(read_number(x, (), ()).evaluate({})) for x in row] for row in rows])
        factor = factor_of(C)
    if problems or None in means:
        return None
    return Drawing(group, "several", tuple(means), factor)


def factor_of(C: Array) -> Array:
    """Return a lower triangle L with C = L Lᵀ, also of a singular covariance.

    Raises
    ------
    InputError
        If C is not symmetric, or has a negative eigenvalue.
    """
    if np.abs(C - C.T).max() > SINGULAR * np.abs(C).max():
        raise InputError(f"expected a symmetric matrix, got {shown(C.tolist())}")
    L = np.zeros_like(C)
    for k in range(len(C)):
        left = C[k:, k] - L[k:, :k] @ L[k, :k]
        least = SINGULAR * np.abs(C[k, k])
        if left[0] > least:
            L[k:, k] = left / math.sqrt(left[0])
        elif left[0] < -least or np.abs(left).max() > math.sqrt(SINGULAR) * np.sqrt(
            np.abs(C).max()
        ):
            raise InputError(
                f"expected a covariance, got the eigenvalue {np.linalg.eigvalsh(C)[0]:.4g}; of two "
                "names with deviations a and b, none off the diagonal exceeds a b"
            )
    return L


def in_order(
    drawings: list[Drawing], columns: Sequence[str], problems: Problems
) -> tuple[Drawing, ...]:
    """Return drawings in an order in which each reads only earlier ones; note a circle."""
    ordered, there, left = list[Drawing](), {*columns}, drawings
    while left:
        ready = [drawing for drawing in left if drawing.reads <= there]
        if not ready:
            words = " and ".join(
                f"{', '.join(x.names)} reads {', '.join(sorted(x.reads - there))}" for x in left
            )
            problems.add(
                f"names follow from each other in a circle: {words}; give one of them numbers"
            )
            return ()
        ordered += ready
        there |= {name for drawing in ready for name in drawing.names}
        left = [drawing for drawing in left if drawing not in ready]
    return tuple(ordered)


def read_table(name: str, text: str) -> tuple[tuple[str, ...], Array]:
    """Return the names in the first line of a table, and the numbers of its rows.

    Raises
    ------
    InputError
        If it has no rows, or an entry is no finite number.
    """
    lines = [
        (k, row)
        for k, row in enumerate(csv.reader(text.splitlines()), 1)
        if any(map(str.strip, row))
    ]
    if len(lines) < 2:
        raise InputError(
            f"{name}: expected names in the first line, and a row of numbers for each run"
        )
    columns = tuple(map(str.strip, lines[0][1]))
    rows = []
    for k, row in lines[1:]:
        if len(row) != len(columns):
            raise InputError(f"{name}, line {k}: expected {len(columns)} numbers, got {len(row)}")
        for column, entry in zip(columns, row, strict=True):
            try:
                is_finite = math.isfinite(float(entry))
            except ValueError:
                is_finite = False
            if not is_finite:
                raise InputError(
                    f"{name}, line {k}, {column}: expected a number, got {entry.strip()!r}"
                )
        rows.append([float(entry) for entry in row])
    return columns, np.array(rows)
