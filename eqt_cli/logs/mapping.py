"""What somebody says of a file of poses: its columns, units, frames and times; it reads none."""

import re
from dataclasses import dataclass, field
from typing import Annotated, Any, ClassVar, Literal, TypeAlias, get_args

import numpy as np
from pydantic import Tag

from eqt_cli.core.arrays import Array
from eqt_cli.core.errors import InputError
from eqt_cli.core.option_types import Positive, Real
from eqt_cli.core.problems import KeyPath, Problems
from eqt_cli.core.validation import one_of

TrajectoryFormat: TypeAlias = Literal["csv", "tum", "euroc"]


def trajectory_format(text: str) -> TrajectoryFormat:
    """The format of this name; raises an `InputError` if there is none."""
    known: tuple[TrajectoryFormat, ...] = get_args(TrajectoryFormat)
    for name in known:
        if text == name:
            return name
    raise InputError(f"format: expected one of {', '.join(known)}, got {text!r}")


MAPPING = "mapping"
"""The key of a configuration that holds one."""

_CHANGES: dict[str, Array] = {
    "NED to ENU": np.array([[0.0, 1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, -1.0]]),
    "FRD to FLU": np.diag([1.0, -1.0, -1.0]),
}
_CHANGES |= {" to ".join(reversed(name.split(" to "))): A for name, A in _CHANGES.items()}
"""Axes of a file in those of eqt; each of them undoes itself."""

PARTNERS = {"NED to ENU": "FRD to FLU", "ENU to NED": "FLU to FRD"}
PARTNERS |= {body: world for world, body in PARTNERS.items()}
"""Changes of axes that usually go together."""


def _offset_kind(value: Any) -> str | None:
    if value == "first":
        return "first"
    return None if isinstance(value, str) and value.isidentifier() else "number"


_Offset = Annotated[
    Annotated[Literal["first"], Tag("first")] | Annotated[Real, Tag("number")],
    one_of(_offset_kind, "a number of seconds, or first"),
]


class MappingError(InputError):
    """A mapping that does not fit its file; `path` is the key of it that is wrong."""

    def __init__(self, path: KeyPath, message: str) -> None:
        super().__init__(message)
        self.path = path


@dataclass(frozen=True)
class TimeMapping:
    """What times of a file stand for.

    Attributes
    ----------
    scale
        A factor of the times in s, such as that of a clock that runs fast.
    begin, end
        The first and the last time that is kept, s, before the offset; in the formats tum and
        euroc after the first row.
    offset
        s that are added to the times that are kept; with ``first``, the first of them is at 0 s.
        Without it, a recording that is compared with a run is aligned with it.
    """

    __pydantic_config__: ClassVar[dict[str, Any]] = {"extra": "forbid", "strict": True}

    scale: Positive = 1.0
    begin: Real | None = None
    end: Real | None = None
    offset: _Offset | None = None


@dataclass(frozen=True)
class LogMapping:
    """What a file of poses does not say of itself.

    Attributes
    ----------
    columns
        The heading of a column in the file by eqt's name of it, as in ``{t: stamp, qw: q_w}``.
    units
        The unit of a column by its name, where its heading has none, as in ``{t: ms, yaw: deg}``.
    quaternion
        The order of columns ``q0 … q3``, ``q1 … q4``, ``q[0] … q[3]``, and of those of the formats
        tum and euroc where these have another than their own; w is the scalar part.
    euler
        The order of ``yaw``, ``pitch`` and ``roll``: ZYX about turned axes, zyx about fixed ones.
    attitude
        Whether the rotation takes coordinates of the body to those of the world, or back.
    world, body
        Axes of the file, and those to have them in.
    rates, velocity, torque, force
        Of which frame the coordinates of recorded ``wx, wy, wz``, ``vx, vy, vz``, ``tx, ty, tz``
        and ``fx, fy, fz`` are. The velocity is that of the body's origin; the torque is about it.
    time
        What its times stand for.
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
        """The rotation from the axes of the file to those that are wanted, ``(3, 3)``."""
        return _CHANGES.get(getattr(self, which), np.eye(3))

    def check(self, problems: Problems) -> None:
        """What is wrong with it, whatever the file is."""
        if sorted(self.euler.lower()) != list("xyz") or not re.fullmatch(
            "[xyz]{3}|[XYZ]{3}", self.euler
        ):
            problems.at("euler").add(
                "expected each of the three axes once, such as ZYX (yaw, pitch, roll about the "
                f"turned axes) or zyx (about the fixed ones), got '{self.euler}'"
            )
        begin, end = self.time.begin, self.time.end
        if begin is not None and end is not None and not begin < end:
            problems.at("time", "end").add(f"expected a time after {begin:g} s, got {end:g} s")
        headings = list(self.columns.values())
        for name, heading in self.columns.items():
            if headings.count(heading) > 1:
                problems.at("columns", name).add(f"'{heading}' is given for two columns")
