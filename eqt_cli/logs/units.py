"""Units that columns of a file may be in, and their factors to s, rad, m and N."""

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

_OF_COLUMNS: tuple[tuple[str, Mapping[str, float]], ...] = (
    (r"t", _TIMES),
    (r"(angle|roll|pitch|yaw)\d?", _ANGLES),
    (r"[xyz]\d?", _LENGTHS),
    (r"w[xyz]?\d?", _RATES),
    (r"[va][xyz]?\d{0,2}", _SPEEDS),
    (r"t[xyz]\d?", _TORQUES),
    (r"f[xyz]\d?", _FORCES),
)
"""The units of a column by its name; those of others have none."""


def units_of(name: str) -> Mapping[str, float]:
    """The units that a column of this name may be in; the first is the one that eqt takes."""
    found = (units for pattern, units in _OF_COLUMNS if re.fullmatch(pattern, name))
    return next(found, {})


def is_turn(name: str) -> bool:
    """Whether a column of a pose holds angles by this name, or a part of a rotation vector."""
    return units_of(name) in (_ANGLES, _RATES)


def is_known(name: str, unit: str) -> bool:
    """Whether a column may be in this unit; none is that which eqt takes."""
    return not unit or unit in units_of(name)


def factor_of(name: str, unit: str, path: KeyPath = ()) -> float:
    """What numbers of a column are multiplied by.

    Raises
    ------
    InputError
        For a unit that it cannot be in; a `MappingError` where the `path` is given.
    """
    if not unit:
        return 1.0
    units = units_of(name)
    if unit in units:
        return units[unit]
    expected = ", ".join(dict.fromkeys(each for each in units if each.isascii()))
    wanted = f"a unit of {expected}" if units else "no unit"
    message = f"column {name}: expected {wanted}, got '{unit}'"
    raise MappingError(path, message) if path else InputError(message)
