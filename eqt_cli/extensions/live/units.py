"""The unit in which a key of a configuration is read where the file writes a bare number."""

from __future__ import annotations

from collections.abc import Iterator
from itertools import takewhile
from typing import Any, get_args

from eqt_cli.base.errors import parse_key
from eqt_cli.base.option_types import POSE, STIFFNESS, Scale, Unit, UnitPlace
from eqt_cli.base.units import base_of
from eqt_cli.components.laws import gains_group
from eqt_cli.config.document import value_at
from eqt_cli.config.json_schema import type_of
from eqt_cli.config.study import Study
from eqt_cli.results.quantity import Plain


def unit_of(study: Study, key: str) -> str:
    """Return the unit of a number of a configuration as a text; empty for a pure number.

    It is also empty for a number that stands for coordinates of several units.
    """
    config, group, path = study.resolved, study.base.group, parse_key(key)
    if path[0] == "controllers" and "gains" in path:  # those of a cascade weigh the attitude alone
        loop = [*study.base.loops.values()][int(path[1])]
        group = gains_group(loop.controller, group)
    path = tuple(takewhile(lambda step: step not in ("normal", "uniform"), path))
    entry = [*takewhile(lambda step: isinstance(step, int), reversed(path))]
    path = path[: len(path) - len(entry)]
    is_part = path[-1] in [part.name for part in group.parts] and not type_of(config, path)[0]
    part, path = (str(path[-1]), path[:-1]) if is_part else ("", path)
    option, kind = type_of(config, path)
    unit = next(_units_in(option), "")
    owner, value = value_at(config, path[:-1]), value_at(config, path)
    place = UnitPlace(group, getattr(kind, "measured", POSE), part or _of(owner))
    try:
        by_part = place.units(unit)
    except KeyError:  # a plain unit
        return Plain().unit(unit)
    length = group.size if unit == STIFFNESS else group.dimension
    if isinstance(value, list) and len(value) != length:
        entry = []  # a number of a factor of the group, or none of a coordinate
    fitting = set()
    for name, (text, axes) in by_part.items():
        columns = next(part.entries[1] for part in group.parts if part.name == name)
        those = range(length)[columns if unit == STIFFNESS else axes]
        if all(at in those for at in entry):
            fitting.add(base_of(text))
    return Plain().unit(fitting.pop()) if len(fitting) == 1 else ""


def _of(owner: Any) -> str:
    """Return the part of the group that a component says it is about."""
    return str(owner.get("of", "")) if isinstance(owner, dict) else ""


def _units_in(option: Any) -> Iterator[str]:
    """Yield the units that the type of an option declares, the outermost first."""
    for mark in getattr(option, "__metadata__", ()):
        if isinstance(mark, Unit | Scale):
            yield mark.unit
    for argument in get_args(option):
        yield from _units_in(argument)
