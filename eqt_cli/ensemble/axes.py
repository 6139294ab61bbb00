"""One axis of a design: the values listed for it, or the range it is drawn from."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from sys import float_info
from typing import Any

from eqt_cli.core.errors import ExpressionError, suggestion
from eqt_cli.core.expressions import constant
from eqt_cli.core.numbers import number_schema
from eqt_cli.ensemble.designs.base import Note, Path, Schema

RANGE_KEYS = ("low", "high", "scale", "integer")
CHOICE_KEYS = ("values",)


@dataclass(frozen=True)
class Range:
    """Numbers from `low` to `high`, evenly spread on a linear or logarithmic scale."""

    low: float
    high: float
    logarithmic: bool = False
    integer: bool = False

    def at(self, share: float) -> float | int:
        """The number at a share of the way, which is in [0, 1]; 1 itself belongs to `high`."""
        if self.integer:
            return min(int(self.high), math.floor(self._between(self.high + 1, share)))
        return min(max(self._between(self.high, share), self.low), self.high)

    def _between(self, high: float, share: float) -> float:
        if self.logarithmic:
            return self.low * (high / self.low) ** share
        return self.low + share * (high - self.low)


@dataclass(frozen=True)
class Choices:
    """Values of any kind, all equally likely."""

    values: tuple[Any, ...]

    def at(self, share: float) -> Any:
        """The value at a share of the way along the list."""
        return self.values[min(int(share * len(self.values)), len(self.values) - 1)]


def listed(section: Any, path: Path, note: Note) -> list[Any] | None:
    """The values of an axis of a grid: a list, or so many `points` of a range."""
    if isinstance(section, list):
        if section:
            return section
        note(path, "expected at least one value, got an empty list")
        return None
    if not isinstance(section, Mapping):
        note(path, "expected a list of values, or {low: …, high: …, points: …}")
        return None
    points = section.get("points")
    rest = {key: value for key, value in section.items() if key != "points"}
    axis = _range(rest, path, note, ("points", "low", "high", "scale"))
    if not isinstance(points, int) or isinstance(points, bool) or points < 2:
        note((*path, "points"), f"expected a whole number of at least 2, got {points!r}")
        return None
    return None if axis is None else [axis.at(k / (points - 1)) for k in range(points)]


def drawn(section: Any, path: Path, note: Note) -> Range | Choices | None:
    """The axis of a sampled design: a range, or `values` to choose from."""
    if not isinstance(section, Mapping):
        note(path, "expected {low: …, high: …} or {values: […]}")
        return None
    if "values" not in section:
        return _range(section, path, note, (*RANGE_KEYS, *CHOICE_KEYS))
    for key in section:
        if key != "values":
            note((*path, key), "expected nothing beside values")
    values = section["values"]
    if not isinstance(values, list) or not values:
        note((*path, "values"), "expected a list with at least one value")
        return None
    return Choices(tuple(values))


def _range(
    section: Mapping[str, Any], path: Path, note: Note, known: tuple[str, ...]
) -> Range | None:
    wrong: list[str] = []

    def complain(key: str, message: str) -> None:
        wrong.append(key)
        note((*path, key), message)

    for key in section:
        if key not in known:
            hint = suggestion(str(key), known) or f"; known here: {', '.join(known)}"
            complain(key, f"unknown key{hint}")
    low, high = (_number(section, key, complain) for key in ("low", "high"))
    scale, integer = section.get("scale", "linear"), section.get("integer", False)
    if scale not in ("linear", "log"):
        complain("scale", f"expected linear or log, got {scale!r}")
    if not isinstance(integer, bool):
        complain("integer", f"expected true or false, got {integer!r}")
    if wrong or low is None or high is None:
        return None
    if low >= high:
        complain("high", f"expected more than low = {low:g}, got {high:g}")
    if scale == "log" and low <= 0:
        complain("low", f"expected a number greater than 0 on a log scale, got {low:g}")
    if integer and not (low.is_integer() and high.is_integer()):
        complain("low", "expected whole numbers as bounds of an integer axis")
    return None if wrong else Range(low, high, scale == "log", integer)


def _number(section: Mapping[str, Any], key: str, complain: Any) -> float | None:
    value = section.get(key)
    if isinstance(value, str):
        try:
            value = constant(value)
        except ExpressionError as error:
            complain(key, f"expected a number, got '{value}': {error}")
            return None
    if isinstance(value, bool) or not isinstance(value, int | float):
        complain(key, "missing; this key has no default" if value is None else "expected a number")
        return None
    if not abs(value) <= float_info.max:
        complain(key, "expected a finite number")
        return None
    return float(value)


# The same as JSON schemas -------------------------------------------------------------------------

_VALUES: Schema = {"type": "array", "minItems": 1}
_RANGE: Schema = {
    "low": number_schema() | {"description": "The least value."},
    "high": number_schema() | {"description": "The greatest value, more than low."},
    "scale": {
        "enum": ["linear", "log"],
        "default": "linear",
        "description": "How the values are spread; on a log scale, low is greater than 0.",
    },
}
_INTEGER: Schema = {
    "type": "boolean",
    "default": False,
    "description": "Whether only whole numbers are drawn.",
}
_COUNT: Schema = {"type": "integer", "minimum": 2, "description": "How many values."}


def _where(key: str, value: Any, bounds: Schema) -> Schema:
    """Where `key` has this value, the bounds named here are narrower."""
    return {
        "if": {"properties": {key: {"const": value}}, "required": [key]},
        "then": {"properties": bounds},
    }


def _mapping(properties: Schema, required: list[str], *conditions: Schema) -> Schema:
    return {
        "type": "object",
        "properties": properties,
        "required": required,
        "additionalProperties": False,
        **({"allOf": list(conditions)} if conditions else {}),
    }


_WHOLE: Schema = {"type": ["integer", "string"]}
_POSITIVE_LOW = _where("scale", "log", {"low": number_schema(above=0)})
_WHOLE_BOUNDS = _where("integer", True, {"low": _WHOLE, "high": _WHOLE})

LISTED: Schema = {
    "description": "A list of values, or so many points of a range.",
    "anyOf": [
        _VALUES,
        _mapping(_RANGE | {"points": _COUNT}, ["low", "high", "points"], _POSITIVE_LOW),
    ],
}
"""The axes that `listed` accepts; that low is less than high, a schema cannot say."""

DRAWN: Schema = {
    "description": "A range, or values that are equally likely.",
    "anyOf": [
        _mapping(_RANGE | {"integer": _INTEGER}, ["low", "high"], _POSITIVE_LOW, _WHOLE_BOUNDS),
        _mapping({"values": _VALUES}, ["values"]),
    ],
}
"""The axes that `drawn` accepts."""
