"""Which columns of a table hold the poses of a group, and these poses."""

from collections.abc import Collection, Iterator
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from eqt_cli.core.arrays import Array, transpose
from eqt_cli.core.errors import InputError
from eqt_cli.groups import MatrixLieGroup
from eqt_cli.groups.euclidean import EuclideanGroup
from eqt_cli.groups.product import ProductGroup
from eqt_cli.logs.mapping import LogMapping, MappingError
from eqt_cli.logs.table import LOOKS_LIKE, QUATERNION, Sheet, Table
from eqt_cli.notation.poses import QUATERNION_TOLERANCE

EULER = ("yaw", "pitch", "roll")
"""Angles about z, y and x."""


@dataclass(frozen=True)
class PoseColumns:
    """The columns of a table that hold poses.

    Attributes
    ----------
    names
        Of the columns.
    way
        ``parts`` (a rotation and translations), ``coordinates`` or ``entries`` of the matrix.
    turn
        The columns of a rotation in space: those of a quaternion, or of Euler's angles.
    """

    names: list[str]
    way: str
    turn: tuple[str, ...] = QUATERNION


VELOCITY = {"rates": "w", "velocity": "v"}
WRENCH = {"torque": "t", "force": "f"}
"""What is measured beside poses, and the letter of its columns; each is a key of a mapping, too."""


class Beside(NamedTuple):
    """Columns of what was measured beside the poses.

    Attributes
    ----------
    kind
        Of `VELOCITY` or `WRENCH`.
    names
        Of the columns.
    axes
        Which coordinates of the Lie algebra they are, or of its dual.
    group, block
        The factor of the group that they belong to, and its rows and columns in a pose.
    """

    kind: str
    names: tuple[str, ...]
    axes: slice
    group: EuclideanGroup
    block: slice


def columns_beside(G: MatrixLieGroup, suffix: str = "") -> Iterator[Beside]:
    """The columns that velocities and wrenches of a group may have; none where not known."""
    if isinstance(G, ProductGroup):
        for k, (factor, first, own) in enumerate(
            zip(G.factors, G.coordinates, G.blocks, strict=True), start=1
        ):
            for one in columns_beside(factor, str(k)):
                axes = slice(first.start + one.axes.start, first.start + one.axes.stop)
                yield one._replace(axes=axes, block=own)
    if not isinstance(G, EuclideanGroup) or G.space > 3:
        return
    moves = [part.axes for part in G.parts if part.velocity_unit == "m/s"]
    for kinds in (VELOCITY, WRENCH):
        turning, moving = kinds
        if G.rotations:
            about = "xyz" if G.rotations == 3 else "z"
            names = tuple(kinds[turning] + axis + suffix for axis in about)
            yield Beside(turning, names, slice(0, G.rotations), G, slice(0, G.size))
        for axes in moves:
            names = tuple(kinds[moving] + axis + suffix for axis in "xyz"[: G.space])
            yield Beside(moving, names, axes, G, slice(0, G.size))


def names_beside(G: MatrixLieGroup, kinds: Collection[str]) -> list[str]:
    """The names of all columns of some kinds."""
    return [name for each in columns_beside(G) if each.kind in kinds for name in each.names]


def coordinate_names(G: MatrixLieGroup) -> list[str]:
    """The coordinates of the algebra as they are typed: ``wz`` for ωz, ``v2`` for v₂."""
    digits = {ord("₀") + digit: str(digit) for digit in range(10)}
    return [axis.replace("ω", "w").translate(digits) for axis in G.axis_names]


def pose_columns(
    G: MatrixLieGroup, suffix: str = "", turn: tuple[str, ...] = QUATERNION
) -> list[str]:
    """The columns of a pose: the rotation, then translations; none where not known."""
    if isinstance(G, ProductGroup):
        parts = [pose_columns(factor, str(k), turn) for k, factor in enumerate(G.factors, start=1)]
        return [column for part in parts for column in part] if all(parts) else []
    if not isinstance(G, EuclideanGroup) or G.space > 3:
        return []
    letters = {"position": "", "velocity": "v"}
    moves = [
        letters.get(column, column) + axis for column in G.columns for axis in "xyz"[: G.space]
    ]
    return [column + suffix for column in (*_turn(G, turn), *moves)]


def _turn(G: EuclideanGroup, in_space: tuple[str, ...]) -> tuple[str, ...]:
    """The columns of a rotation."""
    return {0: (), 1: ("angle",)}.get(G.rotations, in_space)


def ways_of(G: MatrixLieGroup) -> list[PoseColumns]:
    """The columns that poses of a group may stand in, the usual first."""
    digits = range(1, G.size + 1)
    ways = (
        PoseColumns(pose_columns(G), "parts"),
        PoseColumns(pose_columns(G, turn=EULER), "parts", EULER),
        # Before the coordinates, which are the names of velocities, too.
        PoseColumns([f"Q{row}{column}" for row in digits for column in digits], "entries"),
        PoseColumns(coordinate_names(G), "coordinates"),
    )
    return [way for way in ways if way.names]


def used_columns(names: Collection[str], G: MatrixLieGroup) -> PoseColumns | None:
    """The columns that hold the poses of a table; None where some are missing.

    Beside a part of a rotation or a position, coordinates are a velocity and no pose.
    """
    found = next((way for way in ways_of(G) if set(way.names) <= set(names)), None)
    if found and found.way == "coordinates":
        parts = {*pose_columns(G), *pose_columns(G, turn=EULER)} - {*found.names}
        return None if parts & {*names} else found
    return found


def require_pose(sheet: Sheet, G: MatrixLieGroup, time: bool = False) -> PoseColumns:
    """The columns that hold poses; raises an `InputError` if there are none, or no time."""
    if time and "t" not in sheet.names:
        alias = next((each for each in LOOKS_LIKE["t"] if each in sheet.names), None)
        hint = f"; add `columns: {{t: {alias}}}` if that is what {alias} holds" if alias else ""
        raise InputError(f"{sheet.header_place}: missing column t, the time in seconds{hint}")
    if found := used_columns(sheet.names, G):
        sheet.require_different()
        return found
    columns, coordinates = pose_columns(G), coordinate_names(G)
    wanted, euler = columns or coordinates, pose_columns(G, turn=EULER)
    # Of the columns that poses may have, those of which the file has most.
    ways = (columns, euler) if columns else (coordinates,)
    likely = max(ways, key=lambda names: len({*names} & {*sheet.names}))
    missing = ", ".join(name for name in likely if name not in sheet.names)
    others = [", ".join(euler)] if euler != columns else []
    others += [f"the coordinates {', '.join(coordinates)}"] if columns else []
    also = f" (or {', or '.join(others)})" if others else ""
    raise InputError(
        f"{sheet.header_place}: missing column {missing}; a pose of {G.name} has "
        f"{', '.join(wanted)}{also}"
    )


def table_poses(table: Table, columns: PoseColumns, G: MatrixLieGroup, said: LogMapping) -> Array:
    """A pose from each row, ``(rows, d, d)``, in the axes that are wanted."""
    if said.euler != LogMapping.euler and columns.turn != EULER:
        raise MappingError(
            ("euler",), f"the poses of {table.name} have no yaw, pitch and roll; remove this key"
        )
    if columns.way == "parts":
        return _assembled(table, G, "", columns.turn, said)
    if columns.way == "coordinates":
        poses = G.exp(table.get(columns.names))
    else:
        poses = table.get(columns.names).reshape(len(table), G.size, G.size)
    if isinstance(G, EuclideanGroup):
        return _in_axes(G, G.rotation(poses), G.translations(poses), said)
    _require_no_axes(said, G)
    return poses


@np.errstate(over="ignore")  # which is not 1, either
def quaternion_norms(table: Table, columns: PoseColumns) -> dict[str, Array]:
    """The norm of the quaternion in each row, by the suffix of its columns."""
    suffixes = [name.removeprefix("qw") for name in columns.names if name.startswith("qw")]
    return {
        suffix: np.linalg.norm(table.get([each + suffix for each in QUATERNION]), axis=-1)
        for suffix in suffixes
    }


def require_norms(table: Table, columns: PoseColumns) -> None:
    """Raise an `InputError` for the first quaternion that is none of a rotation."""
    for norms in quaternion_norms(table, columns).values():
        wrong = np.flatnonzero(abs(norms - 1) > QUATERNION_TOLERANCE)
        if len(wrong):
            row = int(wrong[0])
            raise table.error(row, f"expected a quaternion of norm 1, got norm {norms[row]:.6g}")


def _assembled(
    table: Table, G: MatrixLieGroup, suffix: str, way: tuple[str, ...], said: LogMapping
) -> Array:
    if isinstance(G, ProductGroup):
        return G.assemble(
            [
                _assembled(table, factor, str(k), way, said)
                for k, factor in enumerate(G.factors, start=1)
            ]
        )
    assert isinstance(G, EuclideanGroup)
    columns = pose_columns(G, suffix, way)
    turn = columns[: len(_turn(G, way))]
    rotations = np.broadcast_to(np.eye(G.space), (len(table), G.space, G.space))
    if len(turn) == 1:
        angle = table.get(turn)
        rotations = G.rotation(G.exp(np.pad(angle, ((0, 0), (0, G.dimension - 1)))))
    elif turn and way == EULER:
        rotations = _from_euler(said.euler, table, suffix)
    elif turn:
        rotations = G.rotation_towards(table.get(turn))
    moves = table.get(columns[len(turn) :]) if G.columns else np.zeros((len(table), 0))
    columns_of = moves.reshape(len(table), len(G.columns), G.space).swapaxes(-1, -2)
    return _in_axes(G, rotations, columns_of, said)


def _from_euler(sequence: str, table: Table, suffix: str) -> Array:
    from scipy.spatial.transform import Rotation  # slow to import; readers of results do without

    axis = dict(zip("zyx", EULER, strict=True))
    angles = table.get([axis[letter] + suffix for letter in sequence.lower()])
    return Rotation.from_euler(sequence, angles).as_matrix()


def _in_axes(G: EuclideanGroup, rotations: Array, moves: Array, said: LogMapping) -> Array:
    """Poses of body to world in the axes that are wanted: A_w R A_bᵀ and A_w x."""
    if said.attitude == "world_to_body":
        rotations = transpose(rotations)
    if G.space != 3:
        _require_no_axes(said, G)
        return G.assemble(rotations, moves)
    world, body = said.axes("world"), said.axes("body")
    turned = world @ rotations @ body.T if G.rotations else rotations
    return G.assemble(turned, world @ moves)


def _require_no_axes(said: LogMapping, G: MatrixLieGroup) -> None:
    for key in ("world", "body"):
        if value := getattr(said, key):
            raise MappingError((key,), f"{value} are axes of space, which {G.name} does not have")
