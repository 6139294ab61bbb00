"""Annotated types of numbers and names in a configuration.

Components use them for their options; pydantic calls the hooks below when it validates a
configuration. Every real number may be given as a constant expression such as ``-pi/2``.
"""

import math
import re
from dataclasses import dataclass
from functools import partial
from typing import Annotated, Any, ClassVar

from pydantic import AfterValidator, Field
from pydantic_core import core_schema

from eqt_cli.core.errors import ExpressionError
from eqt_cli.core.expressions import constant
from eqt_cli.core.file_names import is_device


def number_schema(above: float | None = None) -> dict[str, Any]:
    """Return the JSON schema of a number greater than `above`, or of a constant expression."""
    limit = {} if above is None else {"exclusiveMinimum": above}
    expression = {"type": "string", "description": "a constant expression such as -pi/2"}
    return {"anyOf": [{"type": "number", **limit}, expression]}


@dataclass(frozen=True)
class _FiniteReal:
    """Marks a float that may also be written as a constant expression."""

    above: float | None = None
    in_degrees: ClassVar[bool] = False

    def __get_pydantic_core_schema__(self, source: Any, handler: Any) -> Any:
        number = core_schema.float_schema(strict=True, allow_inf_nan=False, gt=self.above)
        evaluated = partial(_evaluated, in_degrees=self.in_degrees)
        return core_schema.no_info_before_validator_function(evaluated, number)

    def __get_pydantic_json_schema__(self, schema: Any, handler: Any) -> dict[str, Any]:
        return number_schema(self.above)


@dataclass(frozen=True)
class _Angle(_FiniteReal):
    """Marks an angle in radians that may also be written in degrees."""

    in_degrees: ClassVar[bool] = True

    def __get_pydantic_core_schema__(self, source: Any, handler: Any) -> Any:
        number = super().__get_pydantic_core_schema__(source, handler)
        return core_schema.no_info_before_validator_function(_in_radians, number)


def written_in_degrees(value: Any) -> str | None:
    """Return what stands before ``deg`` in a text such as ``90 deg``; None for other values."""
    found = re.fullmatch(r"(.*\S)\s*\bdeg", value.strip()) if isinstance(value, str) else None
    return found[1] if found else None


_UNITS_OF_TIME = {"s": 1.0, "ms": 1e-3, "us": 1e-6}


def written_as_time(value: Any) -> float | None:
    """Return the time of a text such as ``20 ms``, s; None for other values."""
    found = (
        re.fullmatch(r"(.*[\d.)])\s*(s|ms|us)", value.strip()) if isinstance(value, str) else None
    )
    return None if found is None else float(_evaluated(found[1])) * _UNITS_OF_TIME[found[2]]


def _in_radians(value: Any) -> Any:
    degrees = written_in_degrees(value)
    return value if degrees is None else math.radians(_evaluated(degrees))


def _evaluated(value: Any, *, in_degrees: bool = False) -> Any:
    if not isinstance(value, str):
        return value
    try:
        return constant(value)
    except ExpressionError as error:
        wrong = str(error)
        if unit := _WITH_UNIT.fullmatch(value.strip()):
            wrong = f"write {unit[1]} without a unit"
            if unit[2].startswith("deg"):
                radians = f"angles are in radians here: write {unit[1]}*pi/180"
                wrong = f"write '{unit[1]} deg'" if in_degrees else radians
        raise ValueError(f"expected a number, got '{value}': {wrong}") from error


_WITH_UNIT = re.compile(
    r"(?!0[xXbBoO])([-+]?[0-9.]+(?:[eE][-+]?[0-9]+)?)(?: +|(?![eE]))(?!pi\b)([A-Za-z%][\w/*^² ]*)"
)
"""A number with a unit, such as ``20 s``, at a key whose unit is fixed.

``2pi``, and texts that look like the numbers ``0x10`` and ``1e``, do not match.
"""

TORQUE, DAMPING, TORQUE_RATE = "torque", "torque s", "torque/s"
"""Units made of that of a torque on the group."""


@dataclass(frozen=True)
class Scale:
    """Label and unit of an option on an axis: ``Annotated[Real, Scale("horizon", "s")]``.

    Attributes
    ----------
    label
        Words, or a symbol.
    unit
        The unit as figures write it, or a unit of a torque.
    is_symbol
        Whether the label is a symbol.
    """

    label: str
    unit: str = ""
    is_symbol: bool = False


Real = Annotated[float, _FiniteReal()]
"""A finite number; in a configuration also a constant expression."""

Angle = Annotated[float, _Angle()]
"""An angle in rad; in a configuration also a constant expression, or one such as ``90 deg``."""

PositiveAngle = Annotated[float, _Angle(above=0.0)]
"""An angle greater than 0, as `Angle`."""

Positive = Annotated[float, _FiniteReal(above=0.0)]
"""A finite number greater than 0; in a configuration also a constant expression."""

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
        raise ValueError(f"expected no name that Windows keeps for a device, got '{name}'")
    return name


Name = Annotated[str, Field(pattern=r"^[A-Za-z0-9][A-Za-z0-9._-]*$"), AfterValidator(_is_no_device)]
"""A name that a file or folder can have on every system."""

Count = Annotated[int, Field(strict=True, ge=1)]
"""A whole number of at least 1."""

MAX_RUNS = 10**8
"""Largest number of runs of a controller; a billion would take months and 100 GB."""

MAX_POINTS = 10**7
"""Largest number of points of a sweep, because all are checked before the first one is run."""

RunCount = Annotated[int, Field(strict=True, ge=1, le=MAX_RUNS)]
"""A number of runs."""

MAX_SAMPLES = 10**7
"""Largest number of samples of a run: a day at 100 Hz, and 80 MB for each quantity."""

Samples = Annotated[int, Field(strict=True, ge=2, le=MAX_SAMPLES)]
"""A number of sample times, both ends included."""

Points = Annotated[int, Field(strict=True, ge=1, le=MAX_POINTS)]
"""A number of points of a sweep, or of values along one of its axes."""

CountOrNone = Annotated[int, Field(strict=True, ge=0)]
"""A whole number of at least 0, where 0 stands for none."""
