"""Latitude, longitude and altitude in columns, as a local frame on the ellipsoid of WGS84."""

import re
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from eqt_cli.base.arrays import Array
from eqt_cli.base.errors import InputError
from eqt_cli.base.units import factor
from eqt_cli.components.pose_tables import LogMapping, MappingError

SEMI_AXIS, FLATTENING = 6378137.0, 1 / 298.257223563
"""Of the ellipsoid: semi-major axis, m, and flattening (WGS84, NGA.STND.0036)."""

NAMES = ("lat", "lon", "alt")
"""eqt's names of the columns, which become x, y and z."""

AXES = ("x", "y", "z")

_UNIT = r"(?:[ _]?(?:deg|degrees|e7|deg_?e7))?"
_PATTERNS = {
    "lat": rf"(?:.*[ _./])?lat(?:itude)?{_UNIT}",
    "lon": rf"(?:.*[ _./])?(?:lon|lng|long|longitude){_UNIT}",
    "alt": r"(?:.*[ _./])?(?:alt|altitude|height|hgt|elevation)(?:_(?:m|msl|amsl|ellipsoid))*",
}

FINE = ("1e-7 deg", "degE7", "deg e7", "1e-7deg")
"""Unit of whole numbers of 1e-7 deg, as PX4 and ArduPilot have them."""

MOST = {"lat": 90.0, "lon": 180.0}
"""Largest size of an angle, deg; larger numbers can only be 1e-7 deg."""


class Point(NamedTuple):
    """A point by latitude and longitude, deg, and the height above the ellipsoid, m."""

    lat: float
    lon: float
    alt: float

    @property
    def words(self) -> str:
        """The point with all digits that count: 1e-9 deg is 0.1 mm."""
        return f"{{lat: {self.lat:.12g}, lon: {self.lon:.12g}, alt: {self.alt:.9g}}}"


def named(heading: str) -> str:
    """Return which of the three a heading names; "" for none."""
    matches = (k for k, pattern in _PATTERNS.items() if re.fullmatch(pattern, heading.lower()))
    return next(matches, "")


def is_angle(heading: str) -> bool:
    """Whether a heading is that of a latitude or a longitude, and so never of a length."""
    return named(heading) in MOST


def ecef(lat: Array, lon: Array, alt: Array) -> Array:
    """Return Cartesian coordinates fixed to the Earth, m, ``(n, 3)``, of angles in rad."""
    e2 = FLATTENING * (2 - FLATTENING)
    N = SEMI_AXIS / np.sqrt(1 - e2 * np.sin(lat) ** 2)
    across = (N + alt) * np.cos(lat)
    polar = (N * (1 - e2) + alt) * np.sin(lat)
    return np.stack([across * np.cos(lon), across * np.sin(lon), polar], axis=-1)


def local(rows: Array, about: Point) -> Array:
    """Return east, north and up, m, about a point, of latitudes, longitudes (deg), heights (m)."""
    lat, lon = np.radians(about[:2])
    s, c, S, C = np.sin(lon), np.cos(lon), np.sin(lat), np.cos(lat)
    axes = np.array([[-s, c, 0.0], [-S * c, -S * s, C], [C * c, C * s, S]])
    lats, lons = np.radians(rows[:, :2]).T
    moved = ecef(lats, lons, rows[:, 2]) - ecef(lat, lon, np.array(about.alt))
    turned: Array = moved @ axes.T
    return turned


class Positions(NamedTuple):
    """Positions in a local frame.

    Attributes
    ----------
    rows : (n, 3)
        x, y, z, m.
    about
        The point at 0.
    words
        What they are, in words.
    units
        The units of latitude, longitude and altitude.
    """

    rows: Array
    about: Point
    words: str
    units: Mapping[str, str]


@dataclass(frozen=True)
class Geodetic:
    """Columns of a latitude, a longitude and perhaps an altitude.

    Attributes
    ----------
    places
        The column of each, by eqt's name.
    units
        Their units: deg, 1e-7 deg or rad; of the altitude, a length.
    """

    places: Mapping[str, int]
    units: Mapping[str, str]

    def positions(self, columns: Array, mapping: LogMapping) -> Positions:
        """Return x, y, z of each row, m, ``(n, 3)``; without an altitude, z is 0.

        They are east, north and up; north, east and down where `world` of the mapping says that the
        file is NED. The point is that of the mapping, or else of the first row without a gap.
        """
        rows = np.zeros((len(columns), 3))
        rows[:, : columns.shape[1]] = columns
        whole = np.flatnonzero(np.isfinite(rows).all(axis=1))
        if not len(whole):
            raise InputError("holds no row with a latitude and a longitude")
        units = self._known_units(rows[whole])
        rows = rows * [*map(factor_of_angle, (units["lat"], units["lon"])), _height(units)]
        about = point_of(mapping) or Point(*rows[whole[0]].tolist())
        is_ned = mapping.world == "NED to ENU"
        enu = local(rows, about)
        placed = np.stack([enu[:, 1], enu[:, 0], -enu[:, 2]], axis=-1) if is_ned else enu
        words = ("north", "east", "down") if is_ned else ("east", "north", "up")
        names = ", ".join(f"{a} {word}" for a, word in zip(AXES, words, strict=True))
        what = f"{names}, m, about {about.words} (WGS84)"
        if "alt" not in self.places:
            placed[:, 2], what = 0.0, f"{what}, with z = 0, as there is no altitude"
        return Positions(placed, about, what, units)

    def _known_units(self, rows: Array) -> dict[str, str]:
        """Return the units, of angles without one by what their numbers can be."""
        sizes, units = np.abs(rows[:, :2]).max(axis=0), {"lat": "deg", "lon": "deg", "alt": "m"}
        if not {"lat", "lon"} & self.units.keys() and (sizes > [*MOST.values()]).any():
            units |= dict.fromkeys(MOST, FINE[0])
            if "alt" in self.places and "alt" not in self.units:
                raise MappingError(
                    ("units", "alt"),
                    "latitudes are in 1e-7 deg, where altitudes may be in mm or m; add "
                    "`units: {alt: mm}` to the mapping, or m",
                )
        units |= self.units
        for name, size in zip(MOST, sizes.tolist(), strict=True):
            if size * factor_of_angle(units[name]) > MOST[name] * (1 + 1e-12):
                raise MappingError(
                    ("units", name),
                    f"column {name} has numbers up to {size:.6g}, which are no angles up to "
                    f"{MOST[name]:g} deg; add `units: {{{name}: 1e-7 deg}}`, or correct the column",
                )
        return units


def _height(units: Mapping[str, str]) -> float:
    return factor(units["alt"], "m") or 1.0


def factor_of_angle(unit: str) -> float:
    """Return the factor that gives deg."""
    return 1e-7 if unit in FINE else factor(unit or "deg", "deg") or 1.0


def point_of(mapping: LogMapping) -> Point | None:
    """Return the point that a mapping states, or None."""
    if mapping.geodetic is None:
        return None
    return Point(mapping.geodetic["lat"], mapping.geodetic["lon"], mapping.geodetic.get("alt", 0.0))


def geodetic_of(
    names: Sequence[str], headings: Sequence[str], units: Mapping[str, str], mapping: LogMapping
) -> Geodetic | None:
    """Return the columns of a latitude and a longitude; None where positions are there already.

    Raises
    ------
    MappingError
        Where two columns have such a name, or a unit is none.
    """
    if {"x", "y"} & {*names}:
        return None
    places = dict[str, int]()
    for key in NAMES:
        alike = [k for k, name in enumerate(names) if name == key]
        alike = alike or [k for k, heading in enumerate(headings) if named(heading) == key]
        if len(alike) > 1:
            two = ", ".join(headings[k] for k in alike)
            message = f"{two} may each be {key}; name the one that is meant"
            raise MappingError(("columns", key), message)
        places |= {key: alike[0]} if alike else {}
    if not {"lat", "lon"} <= places.keys():
        return None
    in_header = {key: units.get(names[k], "") for key, k in places.items()}
    both = {key: mapping.units.get(key) or unit for key, unit in in_header.items()}
    for key, unit in both.items():
        base = "m" if key == "alt" else "deg"
        if unit and not (factor(unit, base) or (base == "deg" and unit in FINE)):
            expected = "m or mm" if key == "alt" else "deg, rad or 1e-7 deg"
            raise MappingError(("units", key), f"column {key}: expected {expected}, got '{unit}'")
    return Geodetic(places, {key: unit for key, unit in both.items() if unit})


def refuse_lengths(mapping: LogMapping, units_of: Callable[[str], tuple[str, ...]]) -> None:
    """Raise a `MappingError` where a mapping takes a latitude or a longitude for a length."""
    for name, heading in mapping.columns.items():
        if is_angle(heading) and units_of(name)[:1] == ("m",):
            raise MappingError(
                ("columns", name),
                f"{heading} is an angle, not a length: leave x, y, z out, and eqt makes them of "
                "lat, lon and alt (WGS84); name other columns as `{lat: …, lon: …, alt: …}`",
            )
