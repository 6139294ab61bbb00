"""Keys that a reader moves: their values, and the numbers of the programs that follow them.

A key moves what `eqt run --set` moves: its configuration is built at some values, and the numbers
are compared. One that is a multiple of the value, to the bit, is computed from it; of others, the
page has a table with all values of the slider.
"""

from __future__ import annotations

import math
import re
import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from eqt_cli.base import units
from eqt_cli.base.arrays import Array, Arrays
from eqt_cli.base.errors import ConfigError, EqtError, parse_key
from eqt_cli.config.document import value_at
from eqt_cli.config.marks import SHAPES
from eqt_cli.config.schema import marks_of, not_swept
from eqt_cli.extensions.live.programs import LiveLoop
from eqt_cli.numbers.leaves import leaves
from eqt_cli.numbers.rounded import inverse as inverse_of

Numbers = Callable[[Mapping[str, Any]], dict[str, Array]]
"""Returns `numbers_of` a setting by keys."""

Range = str | Sequence[float] | None
"""``LOW:HIGH`` or ``LOW:HIGH:STEP``, or a list of these numbers; None for the usual range."""

STEPS = 100
"""Least number of steps of a slider without a step of its own."""

LINEAR = 100.0
"""Largest ratio of the ends of a range whose values, without a step, are equally far apart."""

MOST_VALUES = 2000
MOST_KEYS = 12
"""Most values of a slider, and most sliders that a page has unasked."""

MOST_SECONDS = 10.0
MOST_SECONDS_OF_ALL = 20.0
"""Longest CPU time for the table of a key that is moved unasked, and for all of them."""

MOST_NUMBERS = 20_000
"""Most numbers in the table of a key that is moved unasked."""

SHARES = (0.0, 0.13, 0.37, 0.71, 1.0)
"""Where between the ends of its slider a key is tried."""

TRIED_TOGETHER = 3
"""Settings of all keys at which the rules are tried."""


@dataclass(frozen=True)
class Slider:
    """A key with the values that a reader can choose.

    Attributes
    ----------
    values
        From the smallest to the largest, with the configured one.
    base
        The configured value.
    unit
        The unit that it is configured in; empty for a number without one.
    """

    key: str
    values: list[float]
    base: float
    unit: str = ""

    @classmethod
    def of(cls, key: str, base: Any, range_: Range = None) -> Slider:
        """Return the slider of a key.

        Raises
        ------
        EqtError
            If the key has no number, or the range is none.
        """
        if (number := _number(base)) is None:
            held = "absent; write it down, or check its name" if base is None else repr(base)
            raise EqtError(f"{key}: a slider moves a number of the configuration; this is {held}")
        base, unit = number
        low, high, step = _range(key, range_, unit) if range_ else _usual(key, base)
        if not low <= base <= high:
            raise EqtError(f"{key}: it is {base:g}, outside of its range {low:g} to {high:g}")
        if not step and low > 0 and high > LINEAR * low:
            return cls(key, _geometric(low, high, base), base, unit)
        step = step or _nice((high - low) / STEPS)
        count = math.floor((high - low) / step + 1e-9)
        if count > MOST_VALUES:
            raise EqtError(f"{key}: its range has {count:,} steps; at most {MOST_VALUES:,}")
        digits = max(0, 2 - math.floor(math.log10(step)))
        values = {round(low + k * step, digits) for k in range(count + 1)} | {high, base}
        values = {value for value in values if low <= value <= high} | {low}
        return cls(key, sorted(values), base, unit)

    @property
    def few(self) -> Slider:
        """The slider with the values alone at which its key is tried."""
        low, high = self.values[0], self.values[-1]
        places = (np.abs(np.array(self.values) - low - s * (high - low)).argmin() for s in SHARES)
        return replace(self, values=sorted({self.base, *(self.values[place] for place in places)}))

    def setting(self, value: float) -> Any:
        """Return a value as a configuration has it; a whole number as one."""
        if self.unit:
            return f"{value!r} {self.unit}"
        return int(value) if value.is_integer() and abs(value) < 2**53 else value


def slider_of(data: Mapping[str, Any], key: str, range_: Range = None) -> Slider:
    """Return the slider of a key of a configuration.

    Raises
    ------
    EqtError
        If no slider can move the key, or the range is none.
    """
    path = parse_key(key)
    why = not_swept(key) or (SHAPES in marks_of(key) and SHAPES.value) or _OF_ALL.get(str(path[0]))
    why = "says how many there are, and a page has the same runs" if path == _RUNS else why
    if why:
        example = "expected a number that the runs take, as gains.kp"
        raise EqtError(f"{key}: no slider can move it, since it {why}; {example}")
    return Slider.of(key, value_at(data, path), range_)


_RUNS = "ensemble", "runs"
_OF_ALL = {"solver": "says how runs are integrated, and a page integrates all in one way"}
"""Sections whose numbers a page has once for all settings."""


def _number(value: Any) -> tuple[float, str] | None:
    """Return a number of a configuration and its unit, if it has one; None for anything else."""
    if isinstance(value, str) and (parts := units.split(value)):
        with suppress(ValueError):
            return float(parts[0]), parts[1]
    is_number = isinstance(value, int | float) and not isinstance(value, bool)
    return (float(value), "") if is_number else None


def _range(key: str, written: str | Sequence[float], unit: str) -> tuple[float, float, float]:
    try:
        parts = written.split(":") if isinstance(written, str) else written
        low, high, *step = map(float, parts)
        if not (low < high and math.isfinite(high - low) and len(step) < 2 and min([1, *step]) > 0):
            raise ValueError
    except (TypeError, ValueError):
        form = "LOW:HIGH or LOW:HIGH:STEP"
        form = form if isinstance(written, str) else "[LOW, HIGH] or [LOW, HIGH, STEP]"
        form += f", in {unit}" if unit else ""
        raise EqtError(f"{key}: expected {form}, got {written!r}") from None
    return low, high, step[0] if step else 0.0


def _usual(key: str, base: float) -> tuple[float, float, float]:
    if not base:
        raise EqtError(f"{key}: it is 0; give its slider a range, --key {key}=-1:1")
    factor = 2.0 if key.startswith("inertia") else 5.0
    ends = sorted((float(f"{base / factor:.1g}"), float(f"{base * factor:.1g}")))
    return min(ends[0], base), max(ends[1], base), 0.0


def _nice(step: float) -> float:
    """Return the next smaller step of 1, 2 or 5 times a power of ten."""
    power = 10.0 ** math.floor(math.log10(step))
    return max(k * power for k in (1, 2, 5) if k * power <= step * (1 + 1e-9))


def _geometric(low: float, high: float, base: float) -> list[float]:
    """Return values of equal ratios, but for rounding: to whole numbers where all three are."""
    values = np.geomspace(low, high, STEPS + 1)[1:-1]
    if all(float(x).is_integer() for x in (low, high, base)):
        inner = {float(round(x)) for x in values}
    else:
        inner = {float(f"{x:.3g}") for x in values}
    return sorted({x for x in inner if low < x < high} | {low, high, base})


_NO_SLIDER = re.compile(r"\.(?:period|along\[\d\])$")
"""What decides the structure of a law, so that no number of a run follows it."""


def usual_keys(data: Mapping[str, Any]) -> Iterator[str]:
    """Yield the keys with numbers that a page moves unasked: gains, inertia, start."""
    for key in ("gains", "controllers", "inertia", "initial"):
        for path, value in _numeric(data.get(key), key):
            moves = key != "inertia" or _is_diagonal(path)
            if moves and value and not _NO_SLIDER.search(path):
                yield path


def _numeric(value: Any, path: str) -> Iterator[tuple[str, float]]:
    if isinstance(value, Mapping):
        for name, entry in value.items():
            yield from _numeric(entry, f"{path}.{name}")
    elif isinstance(value, Sequence) and not isinstance(value, str):
        for place, entry in enumerate(value):
            yield from _numeric(entry, f"{path}[{place}]")
    elif number := _number(value):
        yield path, number[0]


def _is_diagonal(path: str) -> bool:
    places = path.removeprefix("inertia").strip("[]").split("][")
    return len(set(places)) == 1


# The numbers that follow keys ---------------------------------------------------------------------


@dataclass(frozen=True)
class Inverse:
    """A matrix in a row of parameters whose inverse stands there, too."""

    array: str
    matrix: int
    inverse: int
    size: int
    row: int


@dataclass(frozen=True)
class Effect:
    """Numbers of an array that follow a key.

    Attributes
    ----------
    at
        Their places in the flat array.
    by
        What the value is multiplied by; None with a table.
    table
        The numbers, for each value of the slider.
    """

    array: str
    at: list[int]
    by: list[float] | None = None
    table: list[list[float]] | None = None


def inverses(loops: Mapping[str, LiveLoop], base: Arrays) -> list[Inverse]:
    """Return the inverses among the parameters of laws."""
    rules = []
    for label, live in loops.items():
        sizes = {path: number.size for path, number in leaves(live.loop).items()}
        ends = np.cumsum([0, *sizes.values()]).tolist()
        begins = dict(zip(sizes, ends, strict=False))
        for path in sizes:
            owner, _, name = path.rpartition(".")
            if name != "inverse" or f"{owner}.matrix" not in sizes:
                continue
            size = math.isqrt(sizes[path])
            for row in range(len(base[f"{label}/parameters"])):
                places = begins[f"{owner}.matrix"], begins[path]
                rule = Inverse(f"{label}/parameters", *places, size, row)
                if _inverted(rule, base) is None:
                    rules.append(rule)
    return rules


def _inverted(rule: Inverse, arrays: Arrays) -> Array | None:
    """Return the inverse that a rule gives where the array has another one; else None."""
    row, count = arrays[rule.array][rule.row], rule.size**2
    matrix = row[rule.matrix : rule.matrix + count].reshape(rule.size, rule.size)
    if not matrix.diagonal().all():
        return matrix.ravel()  # of no body
    inverse = inverse_of(matrix).ravel()
    same = np.array_equal(inverse, row[rule.inverse : rule.inverse + count])
    return None if same else inverse


def effects(
    slider: Slider, numbers: Numbers, base: Arrays, rules: list[Inverse], is_requested: bool = True
) -> list[Effect]:
    """Return the numbers that follow a key, by a table where they are no multiples.

    Raises
    ------
    EqtError
        If none does, the key changes more than numbers, or its table is large and nobody asked.
    """
    tried = [value for value in slider.few.values if value != slider.base]
    begun = time.process_time()
    probes = [_moved(slider, value, numbers, base) for value in tried]
    seconds = (time.process_time() - begun) / len(tried) * len(slider.values)
    changes: list[Effect] = []
    tabled: dict[str, Array] = {}
    for name, at in _places(probes, base, rules).items():
        if name.endswith("/errors"):
            raise EqtError(f"{slider.key}: it changes the drawn noise of sensors")
        entries = np.array([probe[name].ravel()[at] for probe in probes])
        by = _factors(np.array(tried), entries)
        fits = ~np.isnan(by)
        if fits.any():
            changes.append(Effect(name, at[fits].tolist(), by[fits].tolist()))
        if not fits.all():
            tabled[name] = at[~fits]
    if tabled and not is_requested:
        count = len(slider.values) * sum(map(len, tabled.values()))
        large = f"takes {seconds:.0f} s" if seconds > MOST_SECONDS else ""
        large = large or (f"has {count:,} numbers" if count > MOST_NUMBERS else "")
        if large:
            raise EqtError(f"{slider.key}: its table {large}; ask for it by --key or `live`")
    if tabled:
        rows = [_moved(slider, value, numbers, base) for value in slider.values]
        for name, at in tabled.items():
            table = [row[name].ravel()[at].tolist() for row in rows]
            changes.append(Effect(name, at.tolist(), table=table))
    if not changes:
        raise EqtError(
            f"{slider.key}: no number that the runs take follows it; expected a key as gains.kp"
        )
    return changes


def _places(probes: list[dict[str, Array]], base: Arrays, rules: list[Inverse]) -> dict[str, Array]:
    """Return where the arrays of any probe differ from the base; what a rule gives is left out."""
    places = {}
    for name, array in base.items():
        moved = np.logical_or.reduce([probe[name].ravel() != array.ravel() for probe in probes])
        for rule in rules:
            if rule.array == name and all(_inverted(rule, probe) is None for probe in probes):
                begin = rule.row * array.shape[-1] + rule.inverse
                moved[begin : begin + rule.size**2] = False
        if moved.any():
            places[name] = np.flatnonzero(moved)
    return places


def _moved(slider: Slider, value: float, numbers: Numbers, base: Arrays) -> dict[str, Array]:
    try:
        arrays = numbers({slider.key: slider.setting(value)})
    except EqtError as error:
        raise EqtError(f"{slider.key}: at {value:g}: {_first(error, slider.key)}") from error
    if any(arrays[name].shape != array.shape for name, array in base.items()):
        raise EqtError(f"{slider.key}: it changes more than numbers of the runs")
    return arrays


def _first(error: EqtError, key: str) -> str:
    """Return what is wrong at first, with its key if that is another one."""
    if not isinstance(error, ConfigError):
        return str(error).splitlines()[0]
    problem = error.problems[0]
    return problem.message if problem.path in ("", key) else f"{problem.path}: {problem.message}"


def _factors(values: Array, entries: Array) -> Array:
    """Return c where every entry is c times the value, to the bit; else NaN."""
    factors = np.full(entries.shape[1], np.nan)
    for value, row in zip(values, entries, strict=True):
        with np.errstate(all="ignore"):
            by = row / value if value else np.full(len(row), np.nan)
            fits = (by * values[:, None] == entries).all(axis=0)
        factors = np.where(np.isnan(factors) & fits, by, factors)
    return factors


def applied(
    setting: Mapping[str, float],
    of_keys: Sequence[tuple[Slider, list[Effect]]],
    rules: Sequence[Inverse],
    base: Arrays,
) -> dict[str, Array]:
    """Return the numbers of a setting by the rules of the page."""
    arrays = {name: array.copy() for name, array in base.items()}
    for slider, of_key in of_keys:
        value = setting[slider.key]
        for effect in of_key if value != slider.base else []:
            table = effect.table and effect.table[slider.values.index(value)]
            numbers = table or np.array(effect.by) * value
            arrays[effect.array].reshape(-1)[effect.at] = numbers
    for rule in rules:
        if (inverse := _inverted(rule, arrays)) is not None:
            row = arrays[rule.array][rule.row]
            row[rule.inverse : rule.inverse + rule.size**2] = inverse
    return arrays


def checked(
    of_keys: Sequence[tuple[Slider, list[Effect]]],
    rules: Sequence[Inverse],
    numbers: Numbers,
    base: Arrays,
) -> None:
    """Try the rules at some settings of all keys together.

    Raises
    ------
    EqtError
        If a number is not what `eqt run` has.
    """
    random = np.random.default_rng(0)
    for _ in range(TRIED_TOGETHER):
        setting = {slider.key: float(random.choice(slider.values)) for slider, _ in of_keys}
        try:
            expected = numbers(
                {slider.key: slider.setting(setting[slider.key]) for slider, _ in of_keys}
            )
        except EqtError:
            continue  # the keys do not go together there, as moments that are none of a body
        ours = applied(setting, of_keys, rules, base)
        for name, array in expected.items():
            if not np.array_equal(ours[name], array, equal_nan=True):
                raise EqtError(
                    f"{', '.join(setting)}: they move numbers ({name}) together, as no sliders "
                    "can; leave out one of them"
                )


def disjoint(
    of_keys: Sequence[tuple[Slider, list[Effect]]], slider: Slider, of: list[Effect]
) -> None:
    """Refuse a key whose numbers another one moves, too.

    Raises
    ------
    EqtError
        With both keys.
    """
    places = {(effect.array, at) for effect in of for at in effect.at}
    for other, effects_ in of_keys:
        if any((effect.array, at) in places for effect in effects_ for at in effect.at):
            raise EqtError(f"{slider.key}: it moves the same numbers as {other.key}")
