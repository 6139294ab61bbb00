"""Units in which numbers may be written: in configurations, in files, and in tables and figures.

One table serves them all. A library such as pint would take as long to import as all of `import
eqt_cli.api` (0.38 s), for a dozen units.
"""

import re
from functools import lru_cache
from math import prod
from typing import TypeAlias

from eqt_cli.base.reporting import listed

Dimension: TypeAlias = tuple[float, float, float, float, float]
"""Exponents of kg, m, s, rad and A; halves in densities of noise, ``deg/sqrt(h)``."""

_MASS, _LENGTH, _TIME, _ANGLE = (1, 0, 0, 0, 0), (0, 1, 0, 0, 0), (0, 0, 1, 0, 0), (0, 0, 0, 1, 0)
_FORCE, _TORQUE, _FIELD = (1, 1, -2, 0, 0), (1, 2, -2, 0, 0), (1, 0, -2, 0, -1)
_ACCELERATION = (0, 1, -2, 0, 0)
_PI = 3.141592653589793

Size: TypeAlias = tuple[float, Dimension]
"""Factor to kg, m, s, rad and A, and dimension."""

_SYMBOLS: dict[str, Size] = {
    "kg": (1.0, _MASS),
    "g": (1e-3, _MASS),
    "km": (1e3, _LENGTH),
    "m": (1.0, _LENGTH),
    "cm": (1e-2, _LENGTH),
    "mm": (1e-3, _LENGTH),
    "um": (1e-6, _LENGTH),
    "h": (3600.0, _TIME),
    "hr": (3600.0, _TIME),
    "min": (60.0, _TIME),
    "s": (1.0, _TIME),
    "sec": (1.0, _TIME),
    "ms": (1e-3, _TIME),
    "us": (1e-6, _TIME),
    "ns": (1e-9, _TIME),
    "rad": (1.0, _ANGLE),
    "mrad": (1e-3, _ANGLE),
    "deg": (_PI / 180, _ANGLE),
    "arcmin": (_PI / 10_800, _ANGLE),
    "arcsec": (_PI / 648_000, _ANGLE),
    **dict.fromkeys(("Hz", "hz"), (1.0, (0, 0, -1, 0, 0))),
    "rtHz": (1.0, (0, 0, -0.5, 0, 0)),
    "dps": (_PI / 180, (0, 0, -1, 1, 0)),
    "mdps": (_PI / 180_000, (0, 0, -1, 1, 0)),
    "rpm": (_PI / 30, (0, 0, -1, 1, 0)),
    "A": (1.0, (0, 0, 0, 0, 1)),
    # Of data sheets of accelerometers, by standard gravity; nothing here weighs a milligram.
    "ug": (9.80665e-6, _ACCELERATION),
    "mg": (9.80665e-3, _ACCELERATION),
    **{f"{prefix}T": (size, _FIELD) for prefix, size in (("", 1.0), ("u", 1e-6), ("n", 1e-9))},
    **{f"{prefix}J": (size, _TORQUE) for prefix, size in (("", 1.0), ("k", 1e3), ("m", 1e-3))},
    **{f"{prefix}N": (size, _FORCE) for prefix, size in (("", 1.0), ("k", 1e3), ("m", 1e-3))},
    "uN": (1e-6, _FORCE),
    **{f"{prefix}Nm": (size, _TORQUE) for prefix, size in (("", 1.0), ("k", 1e3), ("m", 1e-3))},
    "uNm": (1e-6, _TORQUE),
    **{f"{prefix}Nms": (size, (1, 2, -1, 0, 0)) for prefix, size in (("", 1.0), ("m", 1e-3))},
    "1": (1.0, (0, 0, 0, 0, 0)),
}

_OFFERED: dict[str, tuple[str, ...]] = {
    "a time": ("s", "ms", "us", "min", "h"),
    "an angle": ("rad", "mrad", "deg", "arcmin", "arcsec"),
    "a length": ("m", "cm", "mm", "km"),
    "an angular velocity": ("rad/s", "deg/s", "deg/h", "rpm"),
    "a velocity": ("m/s", "cm/s", "mm/s", "km/h"),
    "an acceleration": ("m/s^2", "ug", "mg"),
    "an angular acceleration": ("rad/s^2", "deg/s^2"),
    "a torque": ("N m", "mN m", "uN m"),
    "a force": ("N", "mN", "kN"),
    "a mass": ("kg", "g"),
    "a moment of inertia": ("kg m^2", "kg cm^2", "g cm^2"),
    "an angular momentum": ("N m s", "mN m s"),
    "a momentum": ("N s", "mN s"),
    "a stiffness": ("N/m",),
    "a torque per time": ("N m/s", "mN m/s"),
    "a force per time": ("N/s",),
    "a rate": ("1/s", "Hz"),
    "a magnetic field": ("T", "uT", "nT"),
    "an angle random walk": ("rad/sqrt(s)", "deg/sqrt(h)", "deg/h/sqrt(Hz)", "deg/s/sqrt(Hz)"),
    "a rate random walk": ("rad/s/sqrt(s)", "deg/h/sqrt(h)", "deg/h/sqrt(s)"),
    "a velocity random walk": ("m/s/sqrt(s)", "m/s/sqrt(h)", "ug/sqrt(Hz)"),
    "a position random walk": ("m/sqrt(s)", "mm/s/sqrt(Hz)"),
    "an acceleration random walk": ("m/s^2/sqrt(s)", "ug/sqrt(h)"),
    "a density of an angle": ("rad sqrt(s)", "arcsec/sqrt(Hz)"),
    "a density of a length": ("m sqrt(s)", "mm/sqrt(Hz)"),
    "a density of a magnetic field": ("T sqrt(s)", "nT/sqrt(Hz)"),
}
"""Units that messages offer, the first one that of eqt, by the name of their dimension."""

_ALIKE = str.maketrans({"µ": "u", "μ": "u", "°": "deg", "²": "^2", "³": "^3", "·": " ", "*": " "})
_SYMBOL = "|".join(sorted(map(re.escape, _SYMBOLS), key=len, reverse=True))
_TERM = rf"(?:sqrt\((?:{_SYMBOL})\)|(?:{_SYMBOL})(?![A-Za-z])(?:\^-?[0-9])?)"
_PRODUCT = rf"{_TERM}(?:(?: */ *| +){_TERM})*"
_UNIT = rf"(?:\({_PRODUCT}\)(?:\^-?[0-9])?(?:(?: */ *| +){_TERM})*|{_PRODUCT})"
_FACTOR = rf"(/?) *(sqrt\()?({_SYMBOL})(?![A-Za-z])\)?(?:\^(-?\d))?"
_NUMBER_AND_UNIT = re.compile(rf"(.*?(?:[\d.)]|\bpi|\bt(?= )))(?: +(?=1)| *(?!1))({_UNIT})\s*")


def _spelled(text: str) -> str:
    """Return a text with ``^`` for powers and ``sqrt(h)`` for ``√h``."""
    return re.sub(r"√ *(?:\( *(\w+) *\)|(\w+))", r"sqrt(\1\2)", text.replace("**", "^"))


@lru_cache(maxsize=256)
def size_of(unit: str, g: Size = _SYMBOLS["g"]) -> Size | None:
    """Return the factor of a unit to kg, m, s, rad and A, and its dimension; None if unknown."""
    text = " ".join(_spelled(unit).translate(_ALIKE).split())
    if not re.fullmatch(_UNIT, text):
        return None
    factors: list[tuple[float, Dimension, float]] = []
    if bracket := re.match(r"\((.*)\)(?:\^(-?\d))?", text):
        inner = size_of(bracket[1], g)
        assert inner is not None  # it is a product of known symbols
        factors.append((*inner, int(bracket[2] or 1)))
        text = text[bracket.end() :]
    for slash, root, symbol, exponent in re.findall(_FACTOR, text):
        power = 0.5 if root else int(exponent or 1)
        factors.append((*(g if symbol == "g" else _SYMBOLS[symbol]), -power if slash else power))
    a, b, c, d, e = (sum(power * base[k] for _, base, power in factors) for k in range(5))
    return prod(size**power for size, _, power in factors), (a, b, c, d, e)


def split(text: str) -> tuple[str, str] | None:
    """Return the number and the unit of ``20 ms`` or ``pi/2 rad``; None for a text without unit."""
    match = _NUMBER_AND_UNIT.fullmatch(_spelled(text.strip()).translate(_UNIT_SIGNS))
    return (match[1].replace("^", "**"), match[2]) if match else None


_UNIT_SIGNS = {sign: other for sign, other in _ALIKE.items() if sign != ord("*")}
"""The product sign stays: it is of the number."""


def factor(unit: str, to: str) -> float | None:
    """Return the factor from a unit to another one of its dimension; None for any other."""
    one, other = size_of(unit), size_of(to)
    if one and other and one[1] != other[1] and other[1][:2] == _ACCELERATION[:2]:
        one = size_of(unit, (9.80665, _ACCELERATION))
    return one[0] / other[0] if one and other and _same(one[1], other[1]) else None


def _same(one: Dimension, other: Dimension) -> bool:
    """Whether dimensions are equal; a torque per angle is a torque."""
    return one == other or (one[0] != 0 and one[:3] + one[4:] == other[:3] + other[4:])


def offered(unit: str) -> str:
    """Return the dimension of a unit, and what it may be written in: ``a time in s, ms or h``."""
    for name, units in _OFFERED.items():
        if factor(unit, units[0]) is not None:
            return f"{name} in {listed(units, 'or')}"
    return f"a number in {unit}"


def in_wished(unit: str, wish: str) -> tuple[str, float] | None:
    """Return a wished unit and the factor to it; ``(mN m)^2 s`` for ``(N m)^2 s`` and ``mN m``.

    None if it has another dimension; an energy in J is no torque.
    """
    square = re.fullmatch(r"(?:\((.+)\)|([A-Za-z]+))\^2 s", unit)
    inner = (square[1] or square[2]) if square else unit
    ratio = factor(inner, wish) if ("J" in inner) == ("J" in wish) else None
    if ratio is None:
        return None
    if square:
        return f"{wish if wish.isalpha() else f'({wish})'}^2 s", ratio**2
    return wish, ratio


def base_of(unit: str) -> str:
    """Return the unit in which eqt keeps numbers that are written in a unit."""
    names = (units[0] for units in _OFFERED.values())
    return next((name for name in names if factor(unit, name) is not None), unit)
