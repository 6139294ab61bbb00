"""The entries `set`, `where` and `points` in the list of a sweep.

`set` computes keys from swept names and from numbers of the configuration, `where` drops the points
at which a condition does not hold, and `points` keeps some by their numbers. They apply to all
blocks together, in the order in which they stand. No text is executed: `eqt_cli.base.expressions`
reads the formulas.
"""

from __future__ import annotations

import math
import re
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

from eqt_cli.base import purposes, units
from eqt_cli.base.errors import (
    ConfigError,
    ExpressionError,
    InputError,
    InputProblem,
    Problems,
    dotted,
    parse_key,
)
from eqt_cli.base.expressions import Expression, constant, formula, shortened
from eqt_cli.base.option_types import shown
from eqt_cli.config.designs import Sweep, overlap
from eqt_cli.config.document import Document, value_at
from eqt_cli.config.schema import Config
from eqt_cli.runs.folder import RESERVED

_NAME = re.compile(r"[A-Za-z_][A-Za-z_0-9]*(?:\.[A-Za-z_][A-Za-z_0-9]*|\[[0-9]+\])*")

_WRAPPED = "where("
"""What stands before a condition when it is parsed."""

Place = tuple[str | int, ...]


@dataclass(frozen=True)
class Formula:
    """A number that follows from others, or a formula in t with such numbers.

    Attributes
    ----------
    text
        The formula as it is written.
    place
        Its place in the section `sweep`.
    expression
        The formula without its unit.
    unit
        The unit behind it; empty without one.
    moves
        Whether t in it is the time.
    """

    text: str
    place: Place
    expression: Expression
    unit: str = ""
    moves: bool = False

    @classmethod
    def read(cls, text: Any, place: Place, names: Sequence[str], in_time: bool = False) -> Formula:
        """Parse a number, or a formula in known names, in keys of the configuration and in t.

        Raises
        ------
        InputError
            If it is neither.
        """
        if isinstance(text, bool) or not isinstance(text, int | float | str):
            raise InputError(f"expected a number or a formula such as '2*w**2', got {shown(text)}")
        text, unit = str(text), ""
        in_time = in_time and "t" not in names
        names = [*names, "t"] if in_time else names
        try:
            expression = formula(text, _names_in(text, names))
        except InputError:
            spaces = (match.start() for match in re.finditer(" ", text))
            split = ((text[:k], text[k + 1 :]) for k in spaces if units.size_of(text[k + 1 :]))
            number, unit = units.split(text) or next(split, (text, ""))
            expression = formula(number, _names_in(number, names))
        return cls(text, place, expression, unit, in_time and "t" in expression.variables)

    def value(self, values: Mapping[str, float]) -> float | int | str:
        """Return the value for its names, with its unit; a whole number as such.

        A formula in t is returned with the numbers in place of all other names.

        Raises
        ------
        InputError
            If it is not finite.
        """
        if self.moves:
            longest = sorted(map(re.escape, values), key=len, reverse=True) or ["(?!)"]
            name = rf"(?<![\w.])(?:{'|'.join(longest)})(?!\w)"
            text = re.sub(name, lambda m: f"({values[m[0]]!r})", self.expression.text)
            return f"{text} {self.unit}" if self.unit else text
        number = float(self.expression.evaluate(values))
        if not math.isfinite(number):
            raise InputError(f"'{shortened(self.text)}' is {number:g} {_at(values)}")
        value = int(number) if number.is_integer() and abs(number) < 2**53 else number
        return f"{value!r} {self.unit}" if self.unit else value


@dataclass(frozen=True)
class Condition:
    """A comparison of two formulas.

    Attributes
    ----------
    text
        The condition as it is written.
    place
        Its place in the section `sweep`.
    expression
        1 where it holds, else 0.
    """

    text: str
    place: Place
    expression: Expression

    @classmethod
    def read(cls, text: Any, place: Place, names: Sequence[str]) -> Condition:
        """Parse a condition.

        Raises
        ------
        InputError
            If it is none.
        """
        if not isinstance(text, str):
            example = "'gains.kd**2 >= gains.kp'"
            raise InputError(f"expected a comparison such as {example}, got {shown(text)}")
        try:
            inner = f"{_WRAPPED}{text}, 1, 0)"
            return cls(text, place, formula(inner, _names_in(text, names)))
        except InputError as error:
            cause = error.__cause__
            message = str(cause)
            if not re.search(r"[<>]", text):
                message = "expected one comparison with <, <=, > or >=, as in 'gains.kd >= 1'"
            elif isinstance(cause, ExpressionError):
                inside = f"column {max(1, cause.column - len(_WRAPPED))}"
                message = message.replace(f"column {cause.column}", inside)
            raise InputError(f"'{shortened(text)}': {message}") from error

    def holds(self, values: Mapping[str, float]) -> bool:
        """Return whether it holds.

        Raises
        ------
        InputError
            If one of its sides is not finite.
        """
        for side in self.expression.tree.operands[:2]:
            number = float(Expression("", frozenset(), side).evaluate(values))
            if math.isnan(number):
                raise InputError(f"'{shortened(self.text)}' compares no number {_at(values)}")
        return float(self.expression.evaluate(values)) == 1.0


def _names_in(text: str, names: Sequence[str]) -> tuple[str, ...]:
    """Return the names that a formula may use: the known ones, and keys that are in its text."""
    sections = (name for name in _NAME.findall(text) if _is_key(name))
    return tuple(dict.fromkeys((*names, *sections)))


def _is_key(name: str) -> bool:
    return bool(re.search(r"[.\[]", name)) or name in Config.model_fields


def _at(values: Mapping[str, float]) -> str:
    return "where " + ", ".join(f"{name} = {value:g}" for name, value in values.items())


@purposes.rules_of_a_sweep
class Rules:
    """What holds for the points of all blocks of a sweep.

    Parameters
    ----------
    entries
        The entries of a section that are rules, by their places in it.
    swept
        The keys that the blocks change, and their names.

    Attributes
    ----------
    formulas
        What each name or key of `set` is: a formula, or nested lists of them.
    variables
        Names that are no keys of the configuration.
    combinations
        The combinations of all blocks that count, in their order; None for all.
    """

    def __init__(
        self, entries: Mapping[Place, Mapping[str, Any]], swept: Sequence[str], problems: Problems
    ) -> None:
        self.formulas: dict[str, Any] = {}
        self.places: dict[str, Place] = {}
        self.filters: list[Condition | Numbers] = []
        self.combinations: list[int] | None = None
        self.dropped, self.why = 0, ""
        self.data: Any = {}
        self.locate: Callable[[tuple[str | int, ...]], str] = dotted
        listed = [*_entries(entries)]
        later = [key for kind, _, texts in listed if kind == "set" for key in texts or ()]
        for kind, place, section in listed:
            at = problems.at(*place)
            if kind == "set":
                if not isinstance(section, dict) or not section:
                    at.add(
                        f"expected keys with formulas, {{gains.kp: 'w**2'}}, got {shown(section)}"
                    )
                    continue
                for key, text in section.items():
                    later.remove(key)
                    with at.catching(key):
                        self._add(str(key), text, (*place, key), swept, later)
            elif kind == "where":
                usable = [*filter(str.isidentifier, swept), *self.formulas]
                several = isinstance(section, list) and section
                for index, text in enumerate(section if several else [section]):
                    where = (*place, index) if several else place
                    with problems.catching(*where):
                        self.filters.append(Condition.read(text, where, usable))
            else:
                with at.catching():
                    self.filters.append(Numbers.read(section, place))
        used = {name for one in self._all() for name in one.expression.variables}
        names = [*swept, *self.formulas]
        self.variables = {key for key in names if not _is_key(key) and key in used}
        for key in self.variables & RESERVED:
            problems.add(f"'{key}' is a name in results; call it otherwise")

    def _add(
        self, key: str, text: Any, place: Place, swept: Sequence[str], later: Sequence[str]
    ) -> None:
        parse_key(key)
        if other := next((name for name in (*swept, *self.formulas) if overlap(name, key)), None):
            does = "is set" if other in self.formulas else "is swept"
            raise InputError(f"{other} {does} already; remove one of them")
        names = [*filter(str.isidentifier, swept), *filter(str.isidentifier, self.formulas)]
        read = _read(text, place, names, in_time=_is_key(key))
        for one in _flat(read):
            for name in one.expression.variables:
                if same := next((name for other in (key, *later) if overlap(other, name)), None):
                    raise InputError(
                        f"'{shortened(one.text)}' reads {same}, which is set "
                        f"{'by this formula' if overlap(key, same) else 'below; move it up'}"
                    )
        self.formulas[key], self.places[key] = read, place

    def _all(self) -> list[Formula]:
        return [one for read in self.formulas.values() for one in _flat(read)]

    # What a sweep asks.

    def sets(self, keys: Sequence[str]) -> tuple[str, ...]:
        """Return the keys of the configuration that points change, from those of the blocks."""
        return tuple(key for key in (*keys, *self.formulas) if key not in self.variables)

    def settings(self, settings: dict[str, Any]) -> dict[str, Any]:
        """Return the values of keys of the configuration from the values that the blocks give."""
        every = self._derived(settings)
        return {key: value for key, value in every.items() if key not in self.variables}

    def place(self, key: str) -> Place | None:
        """Return the place of the formula of a key; None if it has none."""
        return self.places.get(key)

    def derived(self, settings: dict[str, Any]) -> dict[str, Any]:
        """Return the values of all names and keys that formulas compute."""
        every = self._derived(settings)
        return {key: every[key] for key in self.formulas}

    def text(self, key: str) -> str:
        """Return the formula of a key as it is written."""
        texts = [one.text for one in _flat(self.formulas[key])]
        return texts[0] if isinstance(self.formulas[key], Formula) else f"[{', '.join(texts)}]"

    def bind(self, sweep: Sweep, document: Document, problems: Problems) -> None:
        """Take the numbers of a configuration, and drop the points that do not count."""
        self.data, self.locate = document.data, document.place
        count = len(sweep)
        chosen: Sequence[int] = range(count)
        for rule in self.filters:
            with problems.catching(*rule.place):
                if isinstance(rule, Condition):
                    chosen = [k for k in chosen if self._holds(rule, sweep.settings_of_blocks(k))]
                    if not chosen:
                        raise InputError(
                            f"'{shortened(rule.text)}' holds at none of {count} points"
                        )
                else:
                    chosen = rule.of(chosen)
        if self.filters and not problems:
            self.combinations = list(chosen)
            self.dropped = count - len(self.combinations)
            self.why = ", ".join(f"{rule.place[1]}: {rule.text}" for rule in self.filters)

    def _holds(self, condition: Condition, settings: dict[str, Any]) -> bool:
        every = self._derived(settings)
        return condition.holds(self._values(condition.expression, every, condition.text))

    def _derived(self, settings: dict[str, Any]) -> dict[str, Any]:
        every = dict(settings)
        for key, read in self.formulas.items():
            every[key] = self._computed(read, every)
        return every

    def _computed(self, read: Any, every: dict[str, Any]) -> Any:
        if isinstance(read, list):
            return [self._computed(inner, every) for inner in read]
        try:
            return read.value(self._values(read.expression, every, read.text))
        except InputError as error:
            path = ("sweep", *read.place)
            problem = InputProblem(dotted(path), str(error), self.locate(path))
            raise ConfigError([problem]) from error

    def _values(
        self, expression: Expression, settings: Mapping[str, Any], text: str
    ) -> dict[str, float]:
        return {
            name: _number(self._written(name, settings), name, text)
            for name in sorted(expression.variables - ({"t"} - settings.keys()))
        }

    def _written(self, name: str, settings: Mapping[str, Any]) -> Any:
        """Return what a point, or else the configuration, writes at a key."""
        path = parse_key(name)
        for key, value in settings.items():
            above = parse_key(key)
            if path[: len(above)] == above:
                return value_at(value, path[len(above) :])
        return value_at(self.data, path)


def _entries(entries: Mapping[Place, Mapping[str, Any]]) -> Iterator[tuple[str, Place, Any]]:
    """Yield the kind, the place and the section of each rule."""
    for place, entry in entries.items():
        for kind, section in entry.items():
            yield kind, (*place, kind), section


def _read(text: Any, place: Place, names: Sequence[str], in_time: bool = False) -> Any:
    if isinstance(text, list) and text:
        return [_read(entry, (*place, index), names, in_time) for index, entry in enumerate(text)]
    return Formula.read(text, place, names, in_time)


def _flat(read: Any) -> Iterator[Formula]:
    if isinstance(read, list):
        for inner in read:
            yield from _flat(inner)
    else:
        yield read


def _number(written: Any, name: str, text: str) -> float:
    """Return a written value as a number in the unit in which eqt keeps it."""
    number: float | None = None
    if isinstance(written, int | float) and not isinstance(written, bool):
        number = float(written)
    elif isinstance(written, str):
        value, unit = units.split(written) or (written, "")
        size = units.factor(unit, units.base_of(unit)) if unit else 1.0
        try:
            number = None if size is None else constant(value) * size
        except ExpressionError:
            number = None
    if number is None:
        held = "no number is written there" if written is None else f"it holds {shown(written)}"
        raise InputError(f"'{shortened(text)}' reads {name}, but {held}")
    return number


# Points by their numbers --------------------------------------------------------------------------


@dataclass(frozen=True)
class Numbers:
    """The numbers of the points that count.

    Attributes
    ----------
    text
        The numbers as they are written.
    place
        Their place in the section `sweep`.
    numbers
        All of them.
    """

    text: str
    place: Place
    numbers: tuple[int, ...]

    @classmethod
    def read(cls, section: Any, place: Place) -> Numbers:
        """Read a list of numbers, or a text such as ``3,5:8``.

        Raises
        ------
        InputError
            If it is neither.
        """
        numbers: set[int] = set()
        text = ",".join(map(str, section)) if isinstance(section, list) else str(section)
        for entry in text.split(","):
            ends = re.fullmatch(r" *(\d{1,8})(?::(\d{1,8}))? *", entry)
            if not ends or (ends[2] and int(ends[1]) >= int(ends[2])):
                raise InputError(
                    f"expected numbers of points, such as 3,5:8 for 3, 5, 6 and 7, got {text!r}"
                )
            numbers |= {*range(int(ends[1]), int(ends[2] or int(ends[1]) + 1))}
        return cls(text, place, tuple(sorted(numbers)))

    def of(self, points: Sequence[int]) -> list[int]:
        """Return the points with these numbers.

        Raises
        ------
        InputError
            If there are fewer.
        """
        if self.numbers[-1] >= len(points):
            raise InputError(
                f"there is no point {self.numbers[-1]}; choose from 0 to {len(points) - 1}"
            )
        return [points[number] for number in self.numbers]
