"""Units of the columns of a file, with their factors to s, rad, m and N."""

import math
import re
from collections.abc import Mapping

from eqt_cli.core.errors import InputError
from eqt_cli.core.problems import KeyPath
from eqt_cli.logs.mapping import MappingError

_TIMES = {"s": 1.0, "sec": 1.0, "ms": 1e-3, "us": 1e-6, "µs": 1e-6, "μs": 1e-6, "ns": 1e-9}
_ANGLES = {"rad": 1.0, "deg": math.pi / 180, "°": math.pi / 180}
_LENGTHS = {"m": 1.0, "cm": 1e-2, "mm": 1e-3, "km": 1e3}
_RATES = _ANGLES | {f"{unit}/s": factor for unit, factor in _ANGLES.items()}
_SPEEDS = _LENGTHS | {f"{unit}/s": factor for unit, factor in _LENGTHS.items()} | {"km/h": 1 / 3.6}
_FORCES = {"N": 1.0, "mN": 1e-3, "kN": 1e3}
_TORQUES = {f"{unit}{m}": factor for unit, factor in _FORCES.items() for m in (" m", "m", "·m")}

_UNITS_BY_NAME: tuple[tuple[str, Mapping[str, float]], ...] = (
    (r"t", _TIMES),
    (r"(angle|roll|pitch|yaw)\d?", _ANGLES),
    (r"[xyz]\d?", _LENGTHS),
    (r"w[xyz]?\d?", _RATES),
    (r"[va][xyz]?\d{0,2}", _SPEEDS),
    (r"t[xyz]\d?", _TORQUES),
    (r"f[xyz]\d?", _FORCES),
)
"""Units by a pattern of column names; other columns have none."""


def units_of(name: str) -> Mapping[str, float]:
    """Return the units that a column may have; the first is the default."""
    matching = (units for pattern, units in _UNITS_BY_NAME if re.fullmatch(pattern, name))
    return next(matching, {})


def is_angular(name: str) -> bool:
    """Whether a pose column of this name holds an angle or a rotation vector's component."""
    return units_of(name) in (_ANGLES, _RATES)


def is_known(name: str, unit: str) -> bool:
    """Whether a column may have this unit; an empty unit stands for the default."""
    return not unit or unit in units_of(name)


def factor_of(name: str, unit: str, path: KeyPath = ()) -> float:
    """Return the factor that converts a column to eqt's units.

    Raises
    ------
    InputError
        If the column cannot have this unit; a `MappingError` where `path` is given.
    """
    if not unit:
        return 1.0
    units = units_of(name)
    if unit in units:
        return units[unit]
    known = ", ".join(unit for unit in units if unit.isascii())
    expected = f"a unit of {known}" if units else "no unit"
    message = f"column {name}: expected {expected}, got '{unit}'"
    raise MappingError(path, message) if path else InputError(message)
