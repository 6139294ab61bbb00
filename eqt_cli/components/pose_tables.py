"""Poses in files: what a file does not say of itself, and tables of poses.

Plain tables are read here; an extension reads all others, and says what is wrong with a file.
"""

from collections.abc import Callable, Collection, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, field
from hashlib import sha256
from typing import Annotated, Any, Literal, Self, TypeAlias

import numpy as np
from pydantic import Tag

from eqt_cli.base import purposes
from eqt_cli.base.arrays import Array, transpose
from eqt_cli.base.errors import InputError, KeyPath, Problems
from eqt_cli.base.extensions import function_for
from eqt_cli.base.option_types import Positive, Real, Unit, one_of
from eqt_cli.base.registry import Keys
from eqt_cli.components.groups import MatrixLieGroup, ProductGroup
from eqt_cli.components.matrix_groups import EuclideanGroup, rotation_of_euler
from eqt_cli.components.pose_notation import QUATERNION_TOLERANCE
from eqt_cli.numbers.leaves import STRUCTURE, with_fields

# The mapping of a file: columns, units, frames and times ------------------------------------------


TrajectoryFormat: TypeAlias = Literal["csv", "tum", "euroc"]


MAPPING = "mapping"
"""The key of a mapping in a configuration."""

_AXIS_CHANGES = {
    "world": np.array([[0.0, 1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, -1.0]]),
    "body": np.diag([1.0, -1.0, -1.0]),
}
"""Rotations from the axes of a file to those wanted, there and back: each is its own inverse."""


def _offset_kind(value: Any) -> str | None:
    if value == "first":
        return "first"
    return None if isinstance(value, str) and value.isidentifier() else "number"


Dropped = Literal["invalid", "repeated", "unordered"]


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
class TimeMapping(Keys):
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
    gap
        A longer time between two rows is a gap, s. Default: five times the median one.
    rate
        Rows to keep in a second, at most; the first in each interval. Wrenches and speeds of rotors
        hold until the next row, so that their means over the interval are kept.
    """

    scale: Positive = 1.0
    begin: Annotated[Real | None, Unit("s")] = None
    end: Annotated[Real | None, Unit("s")] = None
    offset: _Offset | None = None
    gap: Annotated[Positive | None, Unit("s")] = None
    rate: Annotated[Positive | None, Unit("Hz")] = None


@dataclass(frozen=True)
class LogMapping(Keys):
    """How a file of poses is read, where the file itself does not say it.

    Attributes
    ----------
    columns
        The heading of a column in the file by eqt's name for it, as in ``{t: stamp, qw: q_w}``.
    units
        The unit of a column by its name, where its heading has none, as in ``{t: ms, yaw: deg}``.
    scale
        A factor of a column by its name, as in ``{pitch: -1}`` for a pitch of the other sign.
    quaternion
        The order of columns ``q0 … q3``, ``q1 … q4``, ``q[0] … q[3]``, and of those of the formats
        tum and euroc where a file departs from its format; w is the scalar part.
    euler
        The order of ``yaw``, ``pitch`` and ``roll``: ZYX about rotated axes, zyx about fixed axes.
    attitude
        Whether the rotation maps body coordinates to world coordinates, or back.
    world, body
        Axes of the file, and the axes to convert them to.
    origin
        Pose of the file's frame in the world, as in `initial.pose`: every pose Q becomes origin Q.
    geodetic
        ``{lat: 48.1, lon: 11.5, alt: 500}``, deg and m: the point about which columns lat, lon and
        alt become x, y, z. Default: that of the first row; of two files, the first one's.
    sensor
        Pose in the body of what was recorded, a marker or a sensor: Q becomes Q sensor⁻¹, and
        velocities V, which are those of the sensor, become Ad_sensor V. Wrenches are the body's.
    rates, velocity, torque, force
        The frame of the recorded ``wx, wy, wz``, ``vx, vy, vz``, ``tx, ty, tz`` and
        ``fx, fy, fz``. The velocity is that of the body's origin; the torque is about it.
    time
        How the times are read.
    setpoint
        What was wanted, in the same table: the heading of a column, or a number, by eqt's name, as
        in ``{x: x_ref, y: y_ref, z: 1.5}``. Default: usual headings, such as ``x_ref``, ``sp_x``.
    command
        What was commanded, likewise, as in ``{thrust: T_sp, tx: u1, ty: u2, tz: 0}``.
    drop
        Rows to leave out: ``invalid`` have an empty cell, a number that is not finite, or a
        quaternion of another norm than 1, ``repeated`` the time of an earlier row, and
        ``unordered`` no time after the largest so far. Up to 5 % are left out without it.
    """

    columns: dict[str, str] = field(default_factory=dict)
    units: dict[str, str] = field(default_factory=dict)
    scale: dict[str, float] = field(default_factory=dict)
    quaternion: Literal["xyzw", "wxyz"] | None = None
    euler: str = "ZYX"
    attitude: Literal["body_to_world", "world_to_body"] = "body_to_world"
    world: Literal["NED to ENU", "ENU to NED"] | None = None
    body: Literal["FRD to FLU", "FLU to FRD"] | None = None
    origin: Any = None
    geodetic: dict[Literal["lat", "lon", "alt"], Real] | None = None
    sensor: Any = None
    rates: Literal["body", "spatial"] = "body"
    velocity: Literal["body", "spatial"] = "spatial"
    torque: Literal["body", "spatial"] = "body"
    force: Literal["body", "spatial"] = "body"
    time: TimeMapping = field(default_factory=TimeMapping)
    setpoint: dict[str, str | float] = field(default_factory=dict)
    command: dict[str, str | float] = field(default_factory=dict)
    # Not `list` itself, whose signature pydantic would read by Python's tokenizer, for 5 ms.
    drop: list[Dropped] = field(default_factory=lambda: [])  # noqa: PIE807

    def axes(self, which: str) -> Array:
        """Return the rotation from the file's axes to the wanted ones, ``(3, 3)``."""
        return np.eye(3) if getattr(self, which) is None else _AXIS_CHANGES[which]

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
        if missing := {"lat", "lon"} - {*(self.geodetic or ("lat", "lon"))}:
            problems.at("geodetic").add(f"lacks {', '.join(sorted(missing))}, in deg")
        headings = list(self.columns.values())
        for name, heading in self.columns.items():
            if headings.count(heading) > 1:
                problems.at("columns", name).add(f"'{heading}' is given for two columns")


# Tables of poses ----------------------------------------------------------------------------------


@dataclass(frozen=True)
class Table:
    """Numbers in named columns.

    Attributes
    ----------
    name
        The file, for messages.
    columns
        The numbers of each column by its name, ``(rows,)``, in rad, m and s.
    lines
        The line of each row in the file.
    """

    name: str
    columns: dict[str, Array]
    lines: Sequence[int]

    def __len__(self) -> int:
        return len(self.lines)

    def error(self, row: int, message: str) -> InputError:
        """Return the error of a row."""
        return InputError(f"{self.name}:{self.lines[row]}: {message}")

    def get(self, names: Sequence[str]) -> Array:
        """Return the numbers of some columns, ``(rows, len(names))``."""
        return np.stack([self.columns[name] for name in names], axis=-1)


QUATERNION = ("qx", "qy", "qz", "qw")

ANGLE, EULER = ("angle",), ("yaw", "pitch", "roll")
"""Columns of an angle in the plane, and of Euler angles: about z, y and x."""

# Columns that a rotation may have by its number of coordinates, the usual ones first.
_FORMS: dict[int, Any] = {0: [()], 1: [ANGLE, QUATERNION, EULER], 3: [QUATERNION, EULER]}

# Largest angle between the z axes of a body in the plane and of the world, as noise leaves it, rad.
# The heading is uncertain by its square / 4, which is 0.005 deg.
TILT = np.deg2rad(1.0)


@dataclass(frozen=True)
class PoseColumns:
    """The columns of a table that hold poses.

    Attributes
    ----------
    names
        Names of the columns.
    layout
        ``parts`` (a rotation and translations), ``coordinates`` or ``entries`` of the matrix.
    """

    names: list[str]
    layout: str


def coordinate_names(G: MatrixLieGroup) -> list[str]:
    """Return the coordinates of the algebra as they are typed: ``wz`` for ωz, ``v2`` for v₂."""
    digits = {ord("₀") + digit: str(digit) for digit in range(10)}
    return [axis.replace("ω", "w").translate(digits) for axis in G.axis_names]


def pose_columns(G: MatrixLieGroup, suffix: str = "", names: Collection[str] = ()) -> list[str]:
    """Return the columns of a pose, the rotation first; none if not known.

    Of the forms of a rotation, the first is taken whose columns are among some names.
    """
    if isinstance(G, ProductGroup):
        parts = [pose_columns(factor, str(k), names) for k, factor in enumerate(G.factors, start=1)]
        return [column for part in parts for column in part] if all(parts) else []
    if not isinstance(G, EuclideanGroup) or G.space > 3:
        return []
    letters, axes = {"position": "", "velocity": "v"}, "xyz"[: G.space]
    translations = [letters.get(column, column) + axis for column in G.columns for axis in axes]
    return [column + suffix for column in (*_rotation(G, suffix, names), *translations)]


def _rotation(G: EuclideanGroup, suffix: str, names: Collection[str]) -> tuple[str, ...]:
    """Return the columns of a rotation of the group, without suffix."""
    forms = _FORMS[G.rotations]
    return next(
        (form for form in forms if all(column + suffix in names for column in form)), forms[0]
    )


def forms_of_pose(G: MatrixLieGroup) -> list[list[str]]:
    """Return the columns of a pose in each of its forms; none if not known."""
    alike = [[column + k for column in form for k in ("", *"123456789")] for form in _FORMS[3]]
    forms = [pose_columns(G, names=names) for names in ((), *alike)]
    return [form for k, form in enumerate(forms) if form and form not in forms[:k]]


def used_columns(names: Collection[str], G: MatrixLieGroup) -> PoseColumns | None:
    """Return the columns that hold the poses of a table; None where some are missing.

    Where the table has a part of a pose in another form, coordinates are taken for a velocity.
    """
    digits = range(1, G.size + 1)
    entries = [f"Q{row}{column}" for row in digits for column in digits]
    coords = coordinate_names(G)
    # Entries come before coordinates, because velocities have the coordinates' names, too.
    layouts = {"parts": pose_columns(G, names=names), "entries": entries, "coordinates": coords}
    fitting = (
        PoseColumns(layout, k) for k, layout in layouts.items() if layout and {*layout} <= {*names}
    )
    used, others = next(fitting, None), {*entries}.union(*forms_of_pose(G)) - {*coords}
    return None if used and used.layout == "coordinates" and others & {*names} else used


def table_poses(
    table: Table, columns: PoseColumns, G: MatrixLieGroup, mapping: LogMapping
) -> Array:
    """Return the pose of each row, ``(rows, d, d)``, in the wanted axes."""
    if mapping.euler != LogMapping.euler and not any(name[:4] == "roll" for name in columns.names):
        raise MappingError(
            ("euler",), f"the poses of {table.name} have no yaw, pitch and roll; remove this key"
        )
    if columns.layout == "parts":
        return _assembled(table, G, "", columns.names, mapping)
    if columns.layout == "coordinates":
        poses = G.exp(table.get(columns.names))
    else:
        poses = table.get(columns.names).reshape(len(table), G.size, G.size)
    if isinstance(G, EuclideanGroup):
        return _in_axes(G, G.rotation(poses), G.translations(poses), mapping)
    _require_no_axes(mapping, G)
    return poses


@np.errstate(over="ignore")  # an infinite norm is reported as different from 1
def quaternion_norms(table: Table, names: Collection[str]) -> list[Array]:
    """Return the norm in each row, for each quaternion in columns of these names."""
    ends = [name[2:] for name in names if name.startswith("qw")]
    return [np.linalg.norm(table.get([part + end for part in QUATERNION]), axis=-1) for end in ends]


def _assembled(
    table: Table, G: MatrixLieGroup, suffix: str, names: Collection[str], mapping: LogMapping
) -> Array:
    """Return poses from the columns of rotations and translations."""
    if isinstance(G, ProductGroup):
        factors = enumerate(G.factors, start=1)
        return G.assemble([_assembled(table, f, str(k), names, mapping) for k, f in factors])
    assert isinstance(G, EuclideanGroup)
    form, columns = _rotation(G, suffix, names), pose_columns(G, suffix, names)
    rotation = columns[: len(form)]
    rotations = np.broadcast_to(np.eye(G.space), (len(table), G.space, G.space))
    if len(form) == 1:
        rotations = G.rotation(G.exp(np.pad(table.get(rotation), ((0, 0), (0, G.dimension - 1)))))
    elif form == EULER:
        axis = dict(zip("zyx", EULER, strict=True))
        angles = table.get([axis[letter] + suffix for letter in mapping.euler.lower()])
        rotations = rotation_of_euler(mapping.euler, angles)
    elif form:
        rotations = G.rotation_towards(table.get(rotation))
    rotations = _in_plane(table, G, rotations) if G.space == 2 and form[1:] else rotations
    rows = table.get(columns[len(form) :]) if G.columns else np.zeros((len(table), 0))
    translations = rows.reshape(len(table), len(G.columns), G.space).swapaxes(-1, -2)
    return _in_axes(G, rotations, translations, mapping)


def _in_plane(table: Table, G: EuclideanGroup, R: Array) -> Array:
    """Return rotations of the plane from those of space about z, ``(n, 3, 3) -> (n, 2, 2)``."""
    tilts = np.arctan2(np.hypot(R[:, 0, 2], R[:, 1, 2]), R[:, 2, 2])
    if len(wrong := np.flatnonzero(tilts > TILT)):
        got = f"one that tilts it by {np.rad2deg(tilts[wrong[0]]):.3g} deg; give a column angle"
        raise table.error(wrong[0], f"expected a rotation about z for {G.name}, got {got}")
    return G.rotation_towards(np.stack([R[:, 1, 0] - R[:, 0, 1], R[:, 0, 0] + R[:, 1, 1]], axis=-1))


def _in_axes(G: EuclideanGroup, R: Array, x: Array, mapping: LogMapping) -> Array:
    """Return poses, body to world, in the wanted axes: A_w R A_bᵀ and A_w x."""
    if mapping.attitude == "world_to_body":
        R = transpose(R)
    if G.space != 3:
        _require_no_axes(mapping, G)
        return G.assemble(R, x)
    world, body = mapping.axes("world"), mapping.axes("body")
    R = world @ R @ body.T if G.rotations else R
    return G.assemble(R, world @ x)


def _require_no_axes(mapping: LogMapping, G: MatrixLieGroup) -> None:
    for key in ("world", "body"):
        if value := getattr(mapping, key):
            raise MappingError((key,), f"{value} are axes of space, which {G.name} does not have")


MAX_LINE = 100_000
"""Longest line, characters; a pose takes a few hundred."""


def velocity_columns(G: MatrixLieGroup) -> tuple[list[str], ...]:
    """Return the names that the columns of a start's velocity may have."""
    names = coordinate_names(G)
    return [f"V{k}" for k in range(1, G.dimension + 1)], [f"V_{name}" for name in names], names


def row_velocities(table: Table, names: list[str], G: MatrixLieGroup, mapping: LogMapping) -> Array:
    """Return the velocity of each row, ``(rows, m)``, in the wanted axes of the body."""
    velocities = table.get(names)
    for part in G.parts:
        if len(range(G.dimension)[part.axes]) == 3:  # in the plane, the axes stay
            velocities[:, part.axes] = velocities[:, part.axes] @ mapping.axes("body").T
    return velocities


def plain_poses(
    text: str, name: str, G: MatrixLieGroup, mapping: LogMapping, others: Collection[list[str]]
) -> tuple[Table, Array, list[str]] | None:
    """Return the table, its poses and its other columns, in a file that leaves nothing open.

    The header of such a file names the columns of a pose and one of the lists `others`, without
    units. All numbers are finite, and quaternions have norm 1.
    """
    lines = text.splitlines()
    if len(lines) < 2 or max(map(len, lines)) > MAX_LINE or not all(map(str.strip, lines)):
        return None
    names = [entry.strip() for entry in lines[0].split(",")]
    columns = used_columns(names, G)
    if columns is None or columns.layout == "coordinates" or mapping != LogMapping():
        return None
    beside = [entry for entry in names if entry not in columns.names]
    if beside not in others or len({*names}) < len(names):
        return None
    with suppress(ValueError):  # of an entry that is no number
        numbers = np.loadtxt(lines[1:], delimiter=",", comments=None, ndmin=2)
        table = Table(name, dict(zip(names, numbers.T, strict=True)), range(2, len(lines) + 1))
        off = [abs(norms - 1).max() for norms in quaternion_norms(table, columns.names)]
        if np.isfinite(numbers).all() and max(off, default=0.0) <= QUATERNION_TOLERANCE:
            return table, table_poses(table, columns, G, mapping), beside
    return None


def read_starts(
    text: str, name: str, G: MatrixLieGroup, mapping: LogMapping
) -> tuple[Array, Array | None, tuple[str, ...]]:
    """Read initial poses ``(n, d, d)`` and velocities ``(n, m)``, if any, one row per run.

    The third value are remarks on the file.

    Raises
    ------
    InputError
        With the line and the error; a `MappingError` where the mapping does not fit the file.
    """
    plain = plain_poses(text, name, G, mapping, ([], *velocity_columns(G)))
    if plain is None:
        return function_for(purposes.initial_file)(text, name, G, mapping)
    table, poses, velocity = plain
    return poses, row_velocities(table, velocity, G, mapping) if velocity else None, ()


# Components with poses in a file ------------------------------------------------------------------


@dataclass(frozen=True, kw_only=True)
class InFile:
    """A component whose poses may stand in a file.

    Attributes
    ----------
    file
        The recording, relative to the configuration.
    format
        Its format: ``csv`` with a header that names the columns, ``tum`` or ``euroc``.
    mapping
        Columns, units, order of quaternions, frames and times, where the file does not give them.
    """

    file: str | None = None
    format: TrajectoryFormat = "csv"
    mapping: LogMapping | None = None
    text: str | None = field(default=None, init=False, repr=False)
    digest: str = field(default="", init=False)
    # What was read of the text for each group; copies of the component share it.
    cache: Any = field(
        default_factory=dict, init=False, repr=False, compare=False, metadata=STRUCTURE
    )

    @property
    def files(self) -> dict[str, str]:
        """The file, if there is one, by the option that names it."""
        return {} if self.file is None else {"file": self.file}

    def with_files(self, texts: Mapping[str, str]) -> Self:
        """Return the component with the content of its file."""
        if self.file is None or self.file not in texts:
            return self
        text = texts[self.file]
        return with_fields(self, text=text, digest=sha256(text.encode()).hexdigest(), cache={})

    def rows(self, G: MatrixLieGroup) -> tuple[Array, Array]:
        """Return the times and the poses in the file.

        Raises
        ------
        InputError
            If they are no motion.
        """
        assert self.text is not None and self.file is not None
        mapping, is_table = self.mapping or LogMapping(), self.format == "csv"
        plain = plain_poses(self.text, self.file, G, mapping, [["t"]]) if is_table else None
        if plain and len(plain[0]) > 1 and np.all(np.diff(plain[0].columns["t"]) > 0):
            identity = np.eye(G.size)  # as the default `origin` and `sensor`, to the bit
            return plain[0].columns["t"], identity @ plain[1] @ G.inverse(identity)
        log = function_for(purposes.log_in_a_file)(self, G)
        return log.times, log.moved_poses

    def check_file(self, problems: Problems, use: Callable[[], Any]) -> None:
        """Note errors of the mapping, and of the file where `use` raises them."""
        if self.mapping is not None:
            self.mapping.check(problems.at(MAPPING))
        if self.text is None or problems:
            return  # a file that could not be read was noted before
        with problems.catching("file"):
            try:
                use()
            except MappingError as error:
                problems.at(MAPPING, *error.path).add(str(error))
