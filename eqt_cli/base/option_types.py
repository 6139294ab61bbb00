"""Annotated types of numbers and names in a configuration, and the validation of plain data.

Errors are described in words, including those of unknown keys.
"""

import dataclasses
import json
import math
import re
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass
from datetime import date
from decimal import Decimal
from enum import Enum
from fractions import Fraction
from functools import cache, lru_cache, reduce
from operator import getitem
from pathlib import PurePath
from typing import Annotated, Any, NamedTuple, Self, TypeVar, get_args, get_type_hints

from pydantic import (
    AfterValidator,
    BaseModel,
    BeforeValidator,
    Discriminator,
    Field,
    PydanticUserError,
    Tag,
    TypeAdapter,
    ValidationError,
    WithJsonSchema,
    WrapValidator,
)
from pydantic_core import PydanticCustomError, core_schema

from eqt_cli.base.errors import (
    MAX_PROBLEMS,
    SAME_MEANING,
    ConfigError,
    ExpressionError,
    InputError,
    KeyPath,
    Problems,
    closest,
    suggestion,
)
from eqt_cli.base.expressions import constant
from eqt_cli.base.files import is_device
from eqt_cli.base.registry import Registry, is_foreign, meanings, option_of_field, summary
from eqt_cli.base.reporting import listed
from eqt_cli.base.units import base_of, factor, offered, split


def number_schema(above: float | None = None) -> dict[str, Any]:
    """Return the JSON schema of a number greater than `above`, or of a constant expression."""
    limit = {} if above is None else {"exclusiveMinimum": above}
    words = "a constant expression such as -pi/2, or a number with a unit such as 20 ms"
    return {"anyOf": [{"type": "number", **limit}, {"type": "string", "description": words}]}


@dataclass(frozen=True)
class _FiniteReal:
    """Marks a float that may also be written as a constant expression, or with a unit."""

    above: float | None = None

    def __get_pydantic_core_schema__(self, source: Any, handler: Any) -> Any:
        number = core_schema.float_schema(strict=True, allow_inf_nan=False, gt=self.above)
        return core_schema.no_info_before_validator_function(number_of, number)

    def __get_pydantic_json_schema__(self, schema: Any, handler: Any) -> dict[str, Any]:
        return number_schema(self.above)


# Units --------------------------------------------------------------------------------------------

TORQUE, DAMPING, DRAG, TORQUE_RATE = "torque", "torque s", "torque s^2", "torque/s"
STIFFNESS, MOMENTUM, INERTIA = "stiffness", "momentum", "inertia"
POSE, VELOCITY = "pose", "velocity"
MEASURED, DENSITY, WALK = "measured", "measured density", "measured walk"
"""The unit of `POSE` or `VELOCITY`, by the place of a sensor; of its noise, and of its drift."""
ANY = "any"
"""Any unit, for a number that is read before its key is known."""

_OF_PART = {
    TORQUE: "{force}",
    TORQUE_RATE: "{force}/s",
    MOMENTUM: "{force} s",
    DAMPING: "{force} {per}/{of}",
    DRAG: "{force} {per}^2/{of}^2",
    STIFFNESS: "{force} {per}/{of}/s",
    INERTIA: "{force} {per}/{of} s",
    VELOCITY: "{of}/{per}",
    POSE: "{of}/{per} s",
    "magnetometer": "T",
    "accelerometer": "m/s^2",
    "depth": "m",
}
"""Units that differ between the parts of a group, by their velocity unit ``of/per``."""

_MEASURED = {MEASURED: "", DENSITY: " sqrt(s)", WALK: "/sqrt(s)"}
"""What follows the unit of a measurement."""

_PARTS = (("rad", "s", "N m"), ("m", "s", "N"), ("m", "s^2", "N s"))
"""Units of velocities and forces of the parts of all groups, where the group is not known."""


class UnitPlace(NamedTuple):
    """Place of a number, which decides its unit.

    Attributes
    ----------
    group
        The group; None where it is not known.
    measured
        The unit that `MEASURED` stands for.
    of
        Name of the part of the group that the component is about; empty for all.
    """

    group: Any = None
    measured: str = POSE
    of: str = ""

    def units(self, unit: str) -> dict[str, tuple[str, slice]]:
        """Return the unit of each part by name, with its coordinates."""
        more, by_part = _MEASURED.get(unit, ""), {}
        unit = self.measured if unit in _MEASURED else unit
        names = [part.name for part in self.group.parts]
        for part in self.group.parts:
            of, _, per = part.velocity_unit.partition("/")
            if self.of in ("", part.name) or self.of not in names:
                part_unit = _OF_PART[unit].format(force=part.force_unit, of=of, per=per)
                by_part[part.name] = part_unit + more, part.axes
        return by_part


class Written(str):
    """A number as text, with the units that it may have.

    Attributes
    ----------
    units
        Units of all dimensions that it may have.
    mixed
        Whether one number would stand for coordinates of different dimensions.
    """

    units: tuple[str, ...]
    mixed: bool

    def __new__(cls, text: str, units: Iterable[str], *, mixed: bool = False) -> Self:
        """Return the text with its units."""
        written = super().__new__(cls, text)
        written.units, written.mixed = tuple(dict.fromkeys(units)), mixed
        return written


class _InUnit:
    """Marks an option with a unit: its texts, also in lists, get the units that they may have."""

    unit: str

    def __get_pydantic_core_schema__(self, source: Any, handler: Any) -> Any:
        schema = handler(source)
        if not self.unit:
            return schema
        return core_schema.with_info_before_validator_function(
            lambda value, info: self.with_units(value, info.context or UnitPlace()), schema
        )

    def with_units(self, value: Any, place: UnitPlace) -> Any:
        """Return the value, in which texts have the units that they may have."""
        if isinstance(value, int | float):
            return value
        if self.unit not in (*_OF_PART, *_MEASURED):
            return _tagged(value, [self.unit])
        if place.group is None:
            kinds = (POSE, VELOCITY) if self.unit in _MEASURED else (self.unit,)
            units = [
                _OF_PART[kind].format(force=force, of=of, per=per) + _MEASURED.get(self.unit, "")
                for kind in kinds
                for of, per, force in _PARTS
            ]
            return _tagged(value, units)
        by_part = place.units(self.unit)
        by_axis = [unit for unit, axes in by_part.values() for _ in range(axes.start, axes.stop)]
        units = list(dict.fromkeys(by_axis))
        if isinstance(value, list) and not any(isinstance(entry, list) for entry in value):
            by_entry = [[unit] for unit in by_axis]
            allowed = by_entry if len(value) == len(by_axis) else [units] * len(value)
            return [_tagged(entry, some) for entry, some in zip(value, allowed, strict=True)]
        if isinstance(value, dict) and value.keys() <= {*by_part, "rate"}:
            by_part["rate"] = "rad/s", slice(0)
            return {name: _tagged(entry, [by_part[name][0]]) for name, entry in value.items()}
        return _tagged(value, units, mixed=len(units) > 1 and not isinstance(value, list))


def _tagged(value: Any, units: Sequence[str], *, mixed: bool = False) -> Any:
    return with_values(value, lambda x: Written(x, units, mixed=mixed) if isinstance(x, str) else x)


def with_values(data: Any, function: Callable[[Any], Any]) -> Any:
    """Return nested mappings and lists with a function applied to each value in them."""
    if isinstance(data, dict):
        return {key: with_values(value, function) for key, value in data.items()}
    if isinstance(data, list):
        return [with_values(value, function) for value in data]
    return function(data)


def number_of(value: Any) -> Any:
    """Return the number of a text such as ``-pi/2`` or, where it has units, ``20 ms``.

    Raises
    ------
    ValueError
        If it is none; the message has the expected values.
    """
    if isinstance(value, AsText):
        raise ValueError(f"expected one number for all runs, got '{value}', which each run draws")
    if not isinstance(value, str):
        return value
    units: tuple[str, ...] = getattr(value, "units", ())
    text, unit = split(value) or (value, "")
    expected = " or ".join(["a number", *dict.fromkeys(map(offered, units))])
    try:
        number = constant(text)
    except ExpressionError as error:
        if _WITH_A_UNIT.fullmatch(value.strip()):
            raise ValueError(f"expected {expected}, got '{value}'{_of_gauss(value)}") from error
        raise ValueError(f"expected a number, got '{value}': {error}") from error
    if not unit:
        return number
    if getattr(value, "mixed", False):
        listed = " and ".join(offered(choice).partition(" in ")[0] for choice in units)
        raise ValueError(
            f"expected a list with an entry for each coordinate, because they are of different "
            f"kinds ({listed}), got '{value}'"
        )
    for allowed in units:
        if (size := factor(unit, base_of(unit) if allowed == ANY else allowed)) is not None:
            return number * size
    plain = expected if units else NO_UNIT
    si = base_of(unit)
    converted = "" if si == unit else f", which is {number * (factor(unit, si) or 1):.6g} {si}"
    raise ValueError(f"expected {plain}, got '{value}'{converted}")


def _of_gauss(value: str) -> str:
    """Return both readings of G, with what to write for either; "" for other units."""
    if not (match := re.search(r"(?<![A-Za-z])([muµ]?)G(?![A-Za-z])", value)):
        return ""
    sizes = {"": "100 uT", "m": "0.1 uT"}
    return (
        f"; {match[0]} is gauss or g: write {sizes.get(match[1], '0.1 nT')} for each {match[0]} of "
        f"a field, {match[1]}g for an acceleration"
    )


NO_UNIT = "a number that has no unit"
"""What is expected where an option declares no unit."""

_WITH_A_UNIT = re.compile(
    r"(?!0[xXbBoO])(?:pi|[-+*/().0-9 ]|(?<=[0-9])[eE][-+]?(?=[0-9]))*?[0-9.)](?: +|(?![eE]))"
    r"(?!pi\b)(?:[A-Za-zµμ]+(?![A-Za-z(])|sqrt\(|[%°√]).*"
)
"""A number with a word that may be meant as a unit; not ``2pi``, ``2 sin(1)``, ``0x10``, ``1e``."""


def has_unit(value: Any) -> bool:
    """Whether a value is a text such as ``20 ms``."""
    return isinstance(value, str) and split(value) is not None


@dataclass(frozen=True)
class Unit(_InUnit):
    """The unit of an option: ``Annotated[Real, Unit("s")]`` may also be written as ``20 ms``.

    Attributes
    ----------
    unit
        A unit, or one of `POSE`, `VELOCITY`, … of coordinates, which the group decides.
    """

    unit: str


@dataclass(frozen=True)
class Scale(_InUnit):
    """Unit of an option, and its label on an axis: ``Annotated[Real, Scale("horizon", "s")]``.

    Attributes
    ----------
    label
        Words, or a symbol.
    unit
        As of `Unit`; empty for pure numbers.
    is_symbol
        Whether the label is a symbol.
    """

    label: str
    unit: str = ""
    is_symbol: bool = False


Real = Annotated[float, _FiniteReal()]
"""A finite number; in a configuration also a constant expression."""

Angle = Annotated[Real, Unit("rad")]
"""An angle in rad; in a configuration also one such as ``90 deg``."""

AnyReal = Annotated[Real, Unit(ANY)]
"""A finite number in any unit; for values of keys that are not known where they are read."""

Positive = Annotated[float, _FiniteReal(above=0.0)]
"""A finite number greater than 0; in a configuration also a constant expression."""


def one_of(kind: Callable[[Any], str | None], expected: str) -> Discriminator:
    """Return a discriminator of a union, with `expected` for values that match no member."""
    return Discriminator(kind, custom_error_type="none_of", custom_error_message=expected)


def rank(value: Any) -> str | None:
    """Return the kind of a number, a list or a list of rows; None for anything else."""
    if not isinstance(value, list):
        number = isinstance(value, int | float | str) and not isinstance(value, bool)
        return "scalar" if number else None
    return "matrix" if any(isinstance(row, list) for row in value) else "list"


Row = list[Real]
Constant = (
    Annotated[Real, Tag("scalar")]
    | Annotated[Row, Tag("list")]
    | Annotated[list[Row], Tag("matrix")]
)
Matrix = Annotated[Constant, one_of(rank, "a number, a list (the diagonal) or a list of rows")]
"""A number (times the identity), a list (a diagonal) or a list of rows."""

SHORTEST = 1e-12
"""Shortest horizon, s; an engine can still step to a billionth of it."""


def _is_long_enough(duration: float) -> float:
    if duration < SHORTEST:
        raise ValueError(f"expected at least {SHORTEST:g} s, got {duration:g}")
    return duration


Duration = Annotated[Positive, AfterValidator(_is_long_enough)]
"""The length of a horizon, s."""


def _is_no_device(name: str) -> str:
    if is_device(name):
        raise ValueError(
            f"expected a name that Windows does not reserve for a device, got '{name}'"
        )
    return name


Name = Annotated[
    str,
    Field(pattern=r"^[A-Za-z0-9]([A-Za-z0-9._-]*[A-Za-z0-9_-])?$"),
    AfterValidator(_is_no_device),
]
"""A name that a file or folder can have on every system."""

NEARLY = 1e-9
"""Relative distance from a whole number within which a result of a formula, as 0.07/0.01, is it."""


def _nearly_whole(value: Any) -> Any:
    """Return the whole number that a number misses by rounding; any other value as it is."""
    if not isinstance(value, float) or not math.isfinite(value) or value.is_integer():
        return value
    return round(value) if abs(value - round(value)) <= NEARLY * abs(value) else value


_Whole = BeforeValidator(_nearly_whole)

Count = Annotated[int, Field(strict=True, ge=1), _Whole]
"""A whole number of at least 1."""

MAX_RUNS = 10**8
"""Largest number of runs of a controller; a billion would take months and 100 GB."""

MAX_POINTS = 10**7
"""Largest number of points of a sweep, because all are checked before the first one is run."""

RunCount = Annotated[int, Field(strict=True, ge=1, le=MAX_RUNS), _Whole]
"""A number of runs."""

MAX_SAMPLES = 10**7
"""Largest number of samples of a run: a day at 100 Hz, and 80 MB for each quantity."""

Samples = Annotated[int, Field(strict=True, ge=2, le=MAX_SAMPLES), _Whole]
"""A number of sample times, both ends included."""

Points = Annotated[int, Field(strict=True, ge=1, le=MAX_POINTS), _Whole]
"""A number of points of a sweep, or of values along one of its axes."""

CountOrNone = Annotated[int, Field(strict=True, ge=0), _Whole]
"""A whole number of at least 0, where 0 stands for none."""


def seconds(text: str) -> float:
    """Return the time of a text such as ``20 ms``."""
    return float(number_of(Written(text, ["s"])))


def _time_as_written(value: Any, handler: Any) -> Any:
    """Return a time such as ``20 ms`` as it is, once it is read; any other value is a count."""
    value = _nearly_whole(value)
    if isinstance(value, float) and not value.is_integer():
        # A formula gives a count more than 1; a number below 1 was meant as a time.
        instead = "take a whole number, or a time such as '20 ms'"
        instead = f"for a time write '{value!r} s'" if value < 1 else instead
        raise ValueError(f"counts control periods, got {value!r}; {instead}")
    if not has_unit(value):
        return handler(value)
    if not 0 <= seconds(value) < math.inf:
        raise ValueError(f"expected a time of at least 0 s, got {value}")
    return str(value)


_TIME = {"type": "string", "description": "a time such as 20 ms"}
CountOrTime = Annotated[
    CountOrNone,
    WrapValidator(_time_as_written),
    WithJsonSchema({"anyOf": [{"type": "integer", "minimum": 0}, _TIME]}),
]
"""A whole number of control periods, or a time as text."""

Offset = Annotated[Real, Unit("s")]
"""The time of the first instant of a clock, s."""


T = TypeVar("T")

_WRONG = "component"
"""Pydantic's type of the errors of a component, which it carries."""

_UNKNOWN_KEY = "unknown key"
MISSING = "missing; this key is required"

_EXPECTED = {
    "float_type": "a number",
    "int_type": "a whole number",
    "int_from_float": "a whole number",
    "string_type": "text",
    "bool_type": "true or false",
    "list_type": "a list",
    "dict_type": "a mapping",
    "model_type": "a mapping",
    "dataclass_type": "a mapping",
    "sequence_str": "a list",
    "dataclass_exact_type": "one of the class {class_name}, which is no eqt_cli.extend.Keys",
    "finite_number": "a finite number",
    "greater_than": "a number greater than {gt:g}",
    "greater_than_equal": "a whole number of at least {ge}",
    "less_than": "a whole number less than {lt}",
    "less_than_equal": "a number of at most {le:,.15g}",
    "too_short": "at least {min_length} entry",
    "literal_error": "{expected}",
    "string_pattern_mismatch": (
        "letters, digits, '.', '_' and '-', with a letter or digit first and no '.' last"
    ),
}
"""Expectations in words, by pydantic's type of error."""


# Values -------------------------------------------------------------------------------------------


def validated(
    kind: Any,
    data: Any,
    problems: Problems,
    common: tuple[str, ...] = (),
    group: Any = None,
    measured: str = POSE,
) -> Any:
    """Return the data as the type `kind`, or None after noting all its errors.

    Parameters
    ----------
    common
        Keys that `data` may have in addition to those of its type.
    group
        The group, which decides the units of coordinates; None where it is not known.
    measured
        The unit that `MEASURED` stands for.
    """
    of = data.get("of") if isinstance(data, dict) else None
    place = UnitPlace(group, measured, of if isinstance(of, str) else "")
    try:
        # All of a strict call is strict, so that it takes no mapping for any of `Keys`.
        strict = None if owners(kind) else True
        return _adapter(kind).validate_python(data, strict=strict, context=place)
    except ValidationError as error:
        _note_errors(error, data, kind, problems, common)
    return None


def known_keys(kind: Any, path: KeyPath, common: tuple[str, ...] = ()) -> dict[str, str]:
    """Return the keys at a place in data of a type, with their meanings."""
    for step in path:
        hints = [get_type_hints(owner) for owner in owners(kind)]
        kind = next((hint[str(step)] for hint in hints if str(step) in hint), kind)
    keys = dict.fromkeys(() if path else common, "")
    for owner in owners(kind):
        keys |= _meanings(owner)
    return keys


@cache
def _meanings(owner: type) -> dict[str, str]:
    """Return the meanings of the keys of a model or component, from its docstring."""
    texts = {option_of_field(name): text for name, text in meanings(owner).items()}
    fields = owner.model_fields if issubclass(owner, BaseModel) else {}
    of_keys = {}
    for name in fields or option_names(owner):
        examples = (fields[name].examples or []) if fields else []
        for_example = "".join(f", for example {name}: {example}" for example in examples)
        of_keys[name] = texts.get(name, "").removesuffix(".") + for_example
    return of_keys


def owners(kind: Any) -> list[type]:
    """Return the models and dataclasses that a value of a type may be or contain."""
    if isinstance(kind, type) and (dataclasses.is_dataclass(kind) or issubclass(kind, BaseModel)):
        return [kind]
    return [inner for part in get_args(kind) for inner in owners(part)]


def _note_errors(
    error: ValidationError, data: Any, kind: Any, problems: Problems, common: tuple[str, ...]
) -> None:
    """Note pydantic's errors at the places in `data` that the user wrote."""
    unknown: list[KeyPath] = []
    messages: dict[KeyPath, str] = {}
    expected: dict[KeyPath, list[str]] = {}
    for detail in error.errors(include_url=False):
        code, context = detail["type"], detail.get("ctx", {})
        path = _written(detail["loc"], data, missing=code == "missing")
        if code == _WRONG:
            problems.at(*path).include(context["problems"])
        elif code in ("extra_forbidden", "unexpected_keyword_argument"):
            unknown.append(path)
        elif code == "missing":
            meaning = known_keys(kind, path[:-1], common).get(str(path[-1]), "")
            messages[path] = f"{MISSING}: {meaning}".removesuffix(": ")
        elif code == "value_error":
            messages[path] = str(context["error"])
            if NO_UNIT in messages[path] and any(is_foreign(of.__module__) for of in owners(kind)):
                messages[path] += '; a plugin declares units by Annotated[Numbers, Unit("rad")]'
        else:
            words = _expectation(code, context) if code in _EXPECTED else detail["msg"]
            expected.setdefault(path, []).append(words)
    noted = (*expected, *messages, *unknown)
    above = {path[:depth] for path in noted for depth in range(len(path))} | messages.keys()
    messages |= {
        path: _unexpected(alternatives, value := reduce(getitem, path, data), path)
        + _time_instead(path, value, kind, common)
        for path, alternatives in expected.items()
        if path not in above  # a member of a union may fail deeper in its value
    }
    meant = _meant(unknown[:MAX_PROBLEMS], kind, common)
    for path, message in messages.items():
        if not (path in meant and message.startswith(MISSING)):
            problems.at(*path).add(message)
    for path in unknown:
        problems.at(*path).add(_unknown_at(path, kind, common))


def _time_instead(path: KeyPath, value: Any, kind: Any, common: tuple[str, ...]) -> str:
    """Return the key of a time that a number at a key of another meaning was probably for."""
    key = SAME_MEANING.get(str(path[-1])) if path else None
    is_time = isinstance(value, int | float) and not isinstance(value, bool)
    keys = known_keys(kind, path[:-1], common) if key and is_time else {}
    return f"; did you mean '{key}'?" if key in keys else ""


def _meant(unknown: Iterable[KeyPath], kind: Any, common: tuple[str, ...]) -> set[KeyPath]:
    """Return the keys that unknown keys probably mean, which are not missing."""
    likely = (
        (path, closest(str(path[-1]), known_keys(kind, path[:-1], common))) for path in unknown
    )
    return {(*path[:-1], key) for path, key in likely if key}


def _unknown_at(path: KeyPath, kind: Any, common: tuple[str, ...]) -> str:
    """Return the message for an unknown key, which may belong deeper: gains.kp for kp."""
    key, keys = str(path[-1]), known_keys(kind, path[:-1], common)
    if len(path) == 1:
        for name, field in getattr(kind, "model_fields", {}).items():
            models = (field.annotation, *get_args(field.annotation))
            if any(key in getattr(model, "model_fields", {}) for model in models):
                return unknown_key(key, keys, f"{name}.{key}")
            kinds = [mark for model in models for mark in getattr(model, "__metadata__", ())]
            if any(key in getattr(entry, "of_every_entry", ()) for entry in kinds):
                return unknown_key(key, keys, f"{name}[0].{key}")
    return unknown_key(key, keys)


def _unexpected(alternatives: list[str], value: Any, path: KeyPath) -> str:
    """Return the message for a value that is none of some alternatives."""
    *earlier, last = dict.fromkeys(alternatives)  # each may itself be "a or b"
    expected = listed([*(text.replace(" or ", ", ") for text in earlier), last], "or")
    if expected == _EXPECTED["list_type"] and isinstance(value, str) and len(path) <= 2:
        expected += f", such as [{value}]"
    said = f"expected {expected}, got {shown(value)}"
    if "{uniform:" in expected and isinstance(value, list) and len(value) == 2:
        said += f"; write {{uniform: {shown(value)}}}"
    return said


def _expectation(code: str, context: Mapping[str, Any]) -> str:
    """Return the expected values in words; a bound that is no whole number is of any number."""
    words = _EXPECTED[code].format(**context)
    if any(isinstance(context.get(bound), float) for bound in ("ge", "lt")):
        return words.replace("a whole number", "a number").removesuffix(".0")
    return words


def unknown_key(key: str, keys: Iterable[str], deeper: str | None = None) -> str:
    """Return the message for an unknown key, which may belong at `deeper`."""
    if deeper:
        return f"{_UNKNOWN_KEY}; did you mean '{deeper}'?"
    others = [name for name in keys if name != key]  # a union's other members may know `key`
    return _UNKNOWN_KEY + (suggestion(key, others) or f"; expected one of {', '.join(others)}")


def shown(value: Any) -> str:
    """Return a value as on one line of YAML, shortened."""
    text = _flow(value)
    return text if len(text) <= 60 else text[:57] + "..."


def _flow(value: Any) -> str:
    if isinstance(value, str):
        return repr(value)
    if isinstance(value, float) and not math.isfinite(value):
        return ".nan" if math.isnan(value) else ".inf" if value > 0 else "-.inf"
    if isinstance(value, list):
        return f"[{', '.join(map(_flow, value))}]"
    if isinstance(value, dict):
        return "{" + ", ".join(f"{key}: {_flow(entry)}" for key, entry in value.items()) + "}"
    return json.dumps(value, default=str)


def _written(location: KeyPath, data: Any, *, missing: bool) -> KeyPath:
    """Return the steps of a pydantic location that are in the data, without union members."""
    path: list[str | int] = []
    for index, step in enumerate(location):
        inside = (isinstance(data, dict) and step in data) or (
            isinstance(data, list) and isinstance(step, int) and step < len(data)
        )
        if inside:
            path.append(step)
            data = data[step]
        elif missing and index == len(location) - 1:
            path.append(step)
    return tuple(path)


@lru_cache(maxsize=256)
def _adapter(kind: Any) -> TypeAdapter[Any]:
    """Return what validates a type.

    Raises
    ------
    InputError
        If a component has an option of a type that no configuration can hold.
    """
    try:
        if isinstance(kind, type) and issubclass(kind, BaseModel):
            kind.model_rebuild()  # else it is built again where a model is dumped
        adapter = TypeAdapter(kind)
        adapter.rebuild()  # raises what is not defined
    except (PydanticUserError, NameError, TypeError, ValueError) as error:
        first = str(error).partition("\n")[0]
        raise InputError(
            f"'{getattr(kind, 'name', kind)}' has an option whose type no configuration can hold: "
            f"{first.partition('. ')[0]}; use float, int, bool, str or lists of them, "
            "or Real, Positive, Numbers or Matrix of eqt_cli.extend"
        ) from error
    return adapter


# Components ---------------------------------------------------------------------------------------


KIND = "The component; the other keys are its options."


@dataclass(frozen=True)
class Kind:
    """Marks a component, ``Annotated[Force, Kind(forces)]``: it is written as a name or a mapping.

    A mapping has the key `kind` and the options of the component.

    Attributes
    ----------
    registry
        The components by name.
    measured
        The unit that `MEASURED` stands for in their options.
    """

    registry: Registry[Any]
    measured: str = POSE

    def read(
        self, value: Any, problems: Problems, group: Any = None, common: tuple[str, ...] = ()
    ) -> Any:
        """Return the component that a value describes, or None after noting its errors.

        A mapping may have the keys `common` in addition to `kind` and the options.
        """
        if not isinstance(value, str | Mapping):
            problems.add(f"expected text or a mapping, got {shown(value)}")
            return None
        options = {} if isinstance(value, str) else dict(value)
        kind = value if isinstance(value, str) else options.pop("kind", None)
        at_kind = problems if isinstance(value, str) else problems.at("kind")
        if not isinstance(kind, str):
            said = f"expected a {self.registry.kind}, one of {', '.join(self.registry.names())}"
            at_kind.add(f"missing; {said}" if kind is None else f"{said}, got {shown(kind)}")
            return None
        with at_kind.catching():
            of, common_keys = self.registry.get(self.registry.written(kind)), ("kind", *common)
            component = validated(of, options, problems, common_keys, group, measured=self.measured)
            if component and is_foreign(of.__module__):
                for name, value in as_section(component).items():
                    try:
                        json.dumps(value)
                    except (TypeError, ValueError):
                        problems.at(name).add(f"is {value!r}; no configuration can hold that")
            return component

    def checked(self, value: Any, problems: Problems, group: Any = None) -> Any:
        """Return the component as `read`, checked for a group."""
        component = self.read(value, problems, group)
        if component is not None and group is not None:
            component.check(group, problems)
        return component

    def __get_pydantic_core_schema__(self, source: Any, handler: Any) -> Any:
        def component(value: Any, info: Any) -> Any:
            problems, result = Problems(), None
            try:
                result = self.checked(value, problems, (info.context or UnitPlace()).group)
            except ConfigError:  # after too many errors, whose places the tree knows
                if not problems:
                    raise
            if problems:
                raise PydanticCustomError(_WRONG, "wrong", {"problems": problems})
            return result

        section = core_schema.plain_serializer_function_ser_schema(self.section)
        schema = core_schema.with_info_plain_validator_function(component, serialization=section)
        return core_schema.nullable_schema(schema) if type(None) in get_args(source) else schema

    def section(self, component: Any) -> Any:
        """Return the value that describes a component, with every option."""
        return as_section(component)

    def __get_pydantic_json_schema__(self, schema: Any, handler: Any) -> dict[str, Any]:
        names = {"enum": self.registry.names(), "type": "string"}
        return {"anyOf": [names, *(self.mapping(kind, handler) for kind in self.registry.all())]}

    def mapping(self, component: Any, handler: Any, **more: Any) -> dict[str, Any]:
        """Return the JSON schema of a component as a mapping, which may have more keys."""
        schema = handler.resolve_ref_schema(handler(_adapter(component).core_schema))
        options = {name: schema["properties"][name] for name in option_names(component)}
        kind = {"const": component.name, "description": KIND}
        return {
            "type": "object",
            "description": summary(component),
            "properties": {"kind": kind, **more, **options},
            "required": ["kind", *(name for name in schema.get("required", []) if name in options)],
            "additionalProperties": False,
        }


def has_options(component: type) -> bool:
    """Whether a component has options by name; some have one that is the whole section."""
    return dataclasses.is_dataclass(component) and not getattr(component, "whole_section", "")


def option_names(component: type) -> list[str]:
    """Return the options that a component has in a configuration."""
    return [option_of_field(field.name) for field in dataclasses.fields(component) if field.init]


def as_section(component: Any) -> dict[str, Any]:
    """Return a component as a mapping with `kind` and every option, including defaults."""
    section = {"kind": component.name}
    for field in dataclasses.fields(component):
        value = getattr(component, field.name)
        if field.init and value is not None:
            section[option_of_field(field.name)] = plain_data(value)
    return section


class AsText:
    """A value that has been made of a text, as which a configuration has it again."""

    @classmethod
    def __get_pydantic_core_schema__(cls, source: Any, handler: Any) -> Any:
        return core_schema.is_instance_schema(
            cls, serialization=core_schema.to_string_ser_schema(when_used="always")
        )

    @classmethod
    def __get_pydantic_json_schema__(cls, schema: Any, handler: Any) -> dict[str, Any]:
        return number_schema()


def plain_data(value: Any) -> Any:
    """Return dataclasses as mappings and arrays as lists, also inside others; paths as text."""
    if isinstance(value, list | tuple):
        return [plain_data(entry) for entry in value]
    if isinstance(value, Enum):
        return value.value
    if isinstance(value, PurePath | Decimal | date | Fraction | AsText):
        return str(value)
    if hasattr(value, "__dataclass_fields__"):
        value = {option_of_field(f.name): getattr(value, f.name) for f in dataclasses.fields(value)}
    if isinstance(value, dict):
        return {name: plain_data(entry) for name, entry in value.items()}
    return value.tolist() if hasattr(value, "tolist") else value
