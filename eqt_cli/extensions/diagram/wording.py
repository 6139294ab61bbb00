"""What stands in a box about a part: its options that differ from their defaults, with units."""

from __future__ import annotations

import dataclasses
from collections.abc import Collection, Iterator, Mapping, Sequence
from itertools import groupby
from operator import itemgetter
from typing import Any, get_args, get_type_hints

from eqt_cli.base.option_types import (
    DRAG,
    POSE,
    STIFFNESS,
    Scale,
    Unit,
    UnitPlace,
    has_unit,
    option_names,
    plain_data,
)
from eqt_cli.base.registry import Keys
from eqt_cli.base.reporting import brief, count_of
from eqt_cli.base.units import base_of, split
from eqt_cli.components.groups import MatrixLieGroup
from eqt_cli.components.vehicle_parts import Distribution

MOST_CHARACTERS, MOST_ENTRIES = 26, 4
"""Longest expression, and most numbers of a list, that are shown whole."""

SPACE = "\u00a0"
"""Stands between a number and its unit, where no line ends."""

_SIGNS = {"^-1": "⁻¹", "^2": "²", "^3": "³", "sqrt(s)": "√s", "sqrt(h)": "√h", "sqrt(Hz)": "√Hz"}

_POWERS = str.maketrans("-0123456789", "⁻⁰¹²³⁴⁵⁶⁷⁸⁹")


def unit_text(unit: str) -> str:
    """Return a unit as it is printed: ``kg m²``."""
    for text, sign in _SIGNS.items():
        unit = unit.replace(text, sign)
    return "" if unit == "1" else unit.replace(" ", SPACE)


def number_text(value: float) -> str:
    """Return a number with three digits: ``0.0125``, ``1450``, ``7.8·10⁻¹⁰``."""
    text = f"{value:.0f}" if 1e3 <= abs(value) < 1e5 else brief(float(value), 3)
    digits, _, power = text.partition("e")
    if power:
        ten = f"10{str(int(power)).translate(_POWERS)}"
        text = ten if digits == "1" else f"{digits}·{ten}"
    return text.replace("-", "−")


def time_text(seconds: float) -> str:
    """Return a time in s, or in ms where it is short."""
    size, unit = (1e3 * seconds, "ms") if 0 < abs(seconds) < 0.1 else (seconds, "s")
    return f"{number_text(size)}{SPACE}{unit}"


def units_of(component: Any, name: str, place: UnitPlace) -> list[tuple[str, slice | None]]:
    """Return the units of an option with the coordinates that have them; none if it has no unit."""
    unit = next(_marks(get_type_hints(type(component), include_extras=True).get(name)), "")
    if not unit or unit == "1":
        return []
    try:
        by_part = place.units(unit)
    except KeyError:  # a plain unit
        return [(unit_text(unit), None)]
    of_columns = {part.name: part.entries[1] for part in place.group.parts}
    return [
        (
            unit_text(text if unit == DRAG else base_of(text)),  # kg m² would be an inertia
            of_columns[name] if unit == STIFFNESS else axes,
        )
        for name, (text, axes) in by_part.items()
    ]


def _marks(hint: Any) -> Iterator[str]:
    for mark in getattr(hint, "__metadata__", ()):
        if isinstance(mark, Unit | Scale):
            yield mark.unit
    for argument in get_args(hint):
        yield from _marks(argument)


def value_text(value: Any) -> str:
    """Return a value in a few characters; a distribution by its mean and deviation, or bounds."""
    if isinstance(value, bool) or value is None:
        return str(value).lower()
    if isinstance(value, int | float):
        return number_text(value)
    if isinstance(value, Mapping):
        return _mapping_text(value)
    if _has_units(value):
        return _as_written(value)
    if isinstance(value, Sequence) and not isinstance(value, str):
        return _list_text([*value])
    text = str(value)
    return text if len(text) <= MOST_CHARACTERS else "f(t)"


def _mapping_text(value: Mapping[str, Any]) -> str:
    if len(value) == 1 and "normal" in value:
        mean, deviation = value["normal"]
        return f"{value_text(mean)}{SPACE}±{SPACE}{value_text(deviation)}"
    if len(value) == 1 and "uniform" in value:
        low, high = value["uniform"]
        return f"{value_text(low)}{SPACE}…{SPACE}{value_text(high)}"
    entries = ((name, entry) for name, entry in value.items() if entry is not None)
    return ", ".join(
        value_text(entry) if name == "kind" else f"{name.replace('_', ' ')} {value_text(entry)}"
        for name, entry in entries
    )


def _list_text(values: list[Any]) -> str:
    if values and isinstance(values[0], list):
        rows, columns = len(values), len(values[0])
        diagonal = [values[k][k] for k in range(min(rows, columns))] if rows == columns else []
        off = any(x for i, row in enumerate(values) for k, x in enumerate(row) if i != k)
        return _list_text(diagonal) if diagonal and not off else f"{rows} × {columns}"
    if values and isinstance(values[0], Mapping) and not {*values[0]} & {"normal", "uniform"}:
        return count_of(len(values), "entry").replace("entrys", "entries")
    texts = [value_text(value) for value in values]
    if len({*texts}) == 1:
        return texts[0]
    if len(texts) <= MOST_ENTRIES:
        return ", ".join(texts)
    if all(isinstance(value, int | float) for value in values):
        return f"{number_text(min(values))} to {number_text(max(values))}"
    return f"{len(texts)} entries"


def option_texts(
    component: Any,
    group: MatrixLieGroup,
    written: Any = None,
    *,
    measured: str = POSE,
    without: Sequence[str] = (),
    always: Collection[str] = (),
) -> list[str]:
    """Return the options of a part that differ from their defaults, ``time constant 72 ms``.

    Parameters
    ----------
    written
        Its section of the configuration, whose units are kept.
    measured
        What a sensor measures.
    without
        Options that are told elsewhere.
    always
        Options that are told also where they have their default.
    """
    place = UnitPlace(group, measured, getattr(component, "of", None) or "")
    section = written if isinstance(written, Mapping) else {}
    fields = {field.name: field for field in dataclasses.fields(component) if field.init}
    texts = []
    for name, option in zip(fields, option_names(component), strict=True):
        part = getattr(component, name)
        value = plain_data(part)
        is_told = option in always or value != _default(fields[name])
        if option in without or value is None or not is_told:
            continue
        if isinstance(part, Keys) and not isinstance(part, Distribution):
            inside = option_texts(part, group, section.get(option), measured=measured)
            texts.append(f"{name.replace('_', ' ')}: {', '.join(inside)}")
        else:
            texts.append(option_text(component, name, value, place, section.get(option)))
    return texts


def _default(field: Any) -> Any:
    if field.default is not dataclasses.MISSING:
        return plain_data(field.default)
    return None if field.default_factory is dataclasses.MISSING else field.default_factory()


def option_text(
    component: Any, name: str, value: Any, place: UnitPlace, written: Any = None
) -> str:
    """Return an option with its value and unit."""
    words = name.rstrip("_").replace("_", " ")
    if isinstance(value, bool):
        return words if value else f"without {words}"
    units = units_of(component, name, place)
    if _has_units(written):
        return f"{words} {_as_written(written, units)}"
    if [unit for unit, _ in units] == ["s"] and isinstance(value, int | float):
        return f"{words} {time_text(value)}"
    if isinstance(value, str):
        units = []
    return f"{words} {with_units(value, units)}"


def _has_units(value: Any) -> bool:
    """Whether a number, or one of a list, is written with a unit."""
    return has_unit(value) or (isinstance(value, list) and any(map(has_unit, value)))


def _as_written(value: Any, units: Sequence[tuple[str, slice | None]] = ()) -> str:
    """Return numbers with the units in which they are written, once for neighbours of the same.

    Numbers without a unit have that of their coordinate.
    """
    entries = value if isinstance(value, list) else [value]
    named = []
    for k, entry in enumerate(entries):
        pair = split(entry) if isinstance(entry, str) else None
        unit = _unit_at(k, units) if pair is None else unit_text(pair[1])
        named.append((_rounded(entry if pair is None else pair[0]), unit))
    texts = []
    for unit, group in groupby(named, key=itemgetter(1)):
        numbers = [number for number, _ in group]
        shown = numbers[0] if len({*numbers}) == 1 else ", ".join(numbers)
        texts.append(f"{shown}{SPACE}{unit}".strip(SPACE))
    return "; ".join(texts)


def _unit_at(k: int, units: Sequence[tuple[str, slice | None]]) -> str:
    """Return the unit of a coordinate, of a part where that is measured alone."""
    for unit, axes in units:
        if len(units) == 1 or axes is None or k in range(axes.start, axes.stop):
            return unit
    return ""


def _rounded(number: Any) -> str:
    try:
        return number_text(float(number))
    except (TypeError, ValueError):  # an expression, or a distribution
        return value_text(number)


def with_units(value: Any, units: Sequence[tuple[str, slice | None]]) -> str:
    """Return a value with its unit; a list with a part for each unit of the coordinates."""
    names = list(dict.fromkeys(unit for unit, _ in units))
    if isinstance(value, list) and len(names) > 1:
        stop = max(axes.stop for _, axes in units if axes is not None)
        if len(value) == stop and not isinstance(value[0], list):
            parts = [(value[axes], unit) for unit, axes in units if axes is not None]
            texts = [f"{_list_text(part)}{SPACE}{unit}" for part, unit in parts if any(part)]
            return "; ".join(texts) or "0"
    return f"{value_text(value)}{SPACE}{', '.join(names)}".strip()
