"""The mapping of a recording file: columns, units with their factors, frames and times."""

import re
from dataclasses import dataclass, field
from typing import Annotated, Any, ClassVar, Literal, TypeAlias, get_args

import numpy as np
from pydantic import Tag

from eqt_cli.core.arrays import Array
from eqt_cli.core.errors import InputError, KeyPath, Problems
from eqt_cli.core.option_types import Positive, Real, Unit, one_of
from eqt_cli.core.units import factor, offered

_UNITS_BY_NAME: tuple[tuple[str, tuple[str, ...]], ...] = (
    (r"t", ("s",)),
    (r"(angle|roll|pitch|yaw)\d?", ("rad",)),
    (r"[xyz]\d?", ("m",)),
    (r"w[xyz]?\d?", ("rad", "rad/s")),
    (r"[va][xyz]?\d{0,2}", ("m", "m/s", "m/s^2")),
    (r"t[xyz]\d?", ("N m",)),
    (r"f[xyz]\d?", ("N",)),
)
"""Units of eqt, one for each dimension, by a pattern of column names; other columns have none."""


def units_of(name: str) -> tuple[str, ...]:
    """Return the units of eqt that a column may be in; the first is the default."""
    matching = (units for pattern, units in _UNITS_BY_NAME if re.fullmatch(pattern, name))
    return next(matching, ())


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
    ratio = next(filter(None, (factor(unit, own) for own in units)), None)
    if ratio is not None:
        return ratio
    expected = " or ".join(map(offered, units)) if units else "no unit"
    message = f"column {name}: expected {expected}, got '{unit}'"
    raise MappingError(path, message) if path else InputError(message)


TrajectoryFormat: TypeAlias = Literal["csv", "tum", "euroc"]


def literal(kind: Any, option: str, text: str) -> Any:
    """Return a text that is one of a `Literal`'s, or raise an `InputError`."""
    if text not in get_args(kind):
        raise InputError(f"{option}: expected one of {', '.join(get_args(kind))}, got {text!r}")
    return text


MAPPING = "mapping"
"""The key of a mapping in a configuration."""

_AXIS_CHANGES: dict[str, Array] = {
    "NED to ENU": np.array([[0.0, 1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, -1.0]]),
    "FRD to FLU": np.diag([1.0, -1.0, -1.0]),
}
_AXIS_CHANGES |= {" to ".join(reversed(name.split(" to "))): A for name, A in _AXIS_CHANGES.items()}
"""Rotations from the axes of a file to those wanted; each is its own inverse."""

PARTNERS = {"NED to ENU": "FRD to FLU", "ENU to NED": "FLU to FRD"}
PARTNERS |= {body: world for world, body in PARTNERS.items()}
"""The change of the body's axes that usually goes with one of the world's, and back."""


def _offset_kind(value: Any) -> str | None:
    if value == "first":
        return "first"
    return None if isinstance(value, str) and value.isidentifier() else "number"


_Offset = Annotated[
    Annotated[Literal["first"], Tag("first")] | Annotated[Real, Tag("number")],
    one_of(_offset_kind, "a number of seconds, or first"),
]


class MappingError(InputError):
    """Raised where a mapping does not fit its file; `path` is the wrong key of the mapping."""

    def __init__(self, path: KeyPath, message: str) -> None:
        super().__init__(message)
        self.path = path


@dataclass(frozen=True)
class TimeMapping:
    """How the times of a file are read.

    Attributes
    ----------
    scale
        Factor of the times in s, for example to correct a clock that runs fast.
    begin, end
        The first and the last time to keep, s, before the offset is added; in the formats tum and
        euroc counted from the first row.
    offset
        Time to add to the times that are kept, s; ``first`` puts the first of them at 0 s.
        Without it, a recording that is compared with a run is aligned with the run.
    """

    __pydantic_config__: ClassVar[dict[str, Any]] = {"extra": "forbid", "strict": True}

    scale: Positive = 1.0
    begin: Annotated[Real | None, Unit("s")] = None
    end: Annotated[Real | None, Unit("s")] = None
    offset: _Offset | None = None


@dataclass(frozen=True)
class LogMapping:
    """How a file of poses is read, where the file itself does not say it.

    Attributes
    ----------
    columns
        The heading of a column in the file by eqt's name for it, as in ``{t: stamp, qw: q_w}``.
    units
        The unit of a column by its name, where its heading has none, as in ``{t: ms, yaw: deg}``.
    quaternion
        The order of columns ``q0 … q3``, ``q1 … q4``, ``q[0] … q[3]``, and of those of the formats
        tum and euroc where a file departs from its format; w is the scalar part.
    euler
        The order of ``yaw``, ``pitch`` and ``roll``: ZYX about rotated axes, zyx about fixed axes.
    attitude
        Whether the rotation maps body coordinates to world coordinates, or back.
    world, body
        Axes of the file, and the axes to convert them to.
    rates, velocity, torque, force
        The frame of the recorded ``wx, wy, wz``, ``vx, vy, vz``, ``tx, ty, tz`` and
        ``fx, fy, fz``. The velocity is that of the body's origin; the torque is about it.
    time
        How the times are read.
    """

    __pydantic_config__: ClassVar[dict[str, Any]] = {"extra": "forbid", "strict": True}

    columns: dict[str, str] = field(default_factory=dict)
    units: dict[str, str] = field(default_factory=dict)
    quaternion: Literal["xyzw", "wxyz"] | None = None
    euler: str = "ZYX"
    attitude: Literal["body_to_world", "world_to_body"] = "body_to_world"
    world: Literal["NED to ENU", "ENU to NED"] | None = None
    body: Literal["FRD to FLU", "FLU to FRD"] | None = None
    rates: Literal["body", "spatial"] = "body"
    velocity: Literal["body", "spatial"] = "spatial"
    torque: Literal["body", "spatial"] = "body"
    force: Literal["body", "spatial"] = "body"
    time: TimeMapping = field(default_factory=TimeMapping)

    def axes(self, which: str) -> Array:
        """Return the rotation from the file's axes to the wanted ones, ``(3, 3)``."""
        return _AXIS_CHANGES.get(getattr(self, which), np.eye(3))

    def check(self, problems: Problems) -> None:
        """Note errors that do not depend on the file."""
        if sorted(self.euler) not in (list("xyz"), list("XYZ")):
            problems.at("euler").add(
                "expected each of the three axes once, such as ZYX (yaw, pitch, roll about the "
                f"rotated axes) or zyx (about the fixed ones), got '{self.euler}'"
            )
        begin, end = self.time.begin, self.time.end
        if begin is not None and end is not None and not begin < end:
            problems.at("time", "end").add(f"expected a time after {begin:g} s, got {end:g} s")
        headings = list(self.columns.values())
        for name, heading in self.columns.items():
            if headings.count(heading) > 1:
                problems.at("columns", name).add(f"'{heading}' is given for two columns")
