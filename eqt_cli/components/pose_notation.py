"""Converts poses, vectors and matrices of a configuration to arrays.

A pose is `identity`, a matrix, or a rotation and translations by name; for a product of groups
also a list with one pose per factor.
"""

import re
from collections.abc import Callable, Container, Iterator
from functools import partial
from itertools import pairwise
from typing import Annotated, Any

import numpy as np

from eqt_cli.base.arrays import Array
from eqt_cli.base.errors import InputError, KeyPath, Problems
from eqt_cli.base.option_types import Angle, Real, Unit, shown, validated
from eqt_cli.components.groups import MatrixLieGroup, ProductGroup
from eqt_cli.components.matrix_groups import EuclideanGroup, rotation_of_euler
from eqt_cli.numbers.rounded import rounded

GROUP_TOLERANCE = 1e-9
"""Largest ‖QᵀQ − I‖ of a pose written in decimal; below the integrators' tolerances."""

ANGLES = ("rotvec", "angles")
"""Keys of a pose that hold angles."""

HALF_TURN = 180 * (1 + 1e-9)
"""Angle, deg, beyond which a turn is more than half of one, but for decimals."""

QUATERNION_TOLERANCE = 1e-3
"""Largest difference of a quaternion's norm from 1, as left by rounding to three digits."""

GREATEST = 1e15
"""Largest number of a vector or a pose, in SI units; the squares of absurd ones overflow."""


def square(value: float | list[Any], n: int, group: MatrixLieGroup) -> Array:
    """Return the n×n matrix of `value`, or raise an `InputError` if its shape is wrong."""
    if not isinstance(value, list):
        return value * np.eye(n)
    if not any(isinstance(row, list) for row in value):
        if len(value) != n:
            raise InputError(f"expected {n} diagonal entries for {group.name}, got {len(value)}")
        return np.diag(np.array(value, dtype=float))
    if single := [row for row in value if not isinstance(row, list)]:
        raise InputError(f"expected rows, or numbers of the diagonal, got both: {single[0]:g}")
    widths = {len(row) for row in value}
    if len(widths) > 1:
        listed = ", ".join(str(len(row)) for row in value)
        raise InputError(f"expected rows of equal length, got rows of {listed} entries")
    shape = (len(value), widths.pop())
    if shape != (n, n):
        raise InputError(f"expected {n}×{n} for {group.name}, got {shape[0]}×{shape[1]}")
    return np.array(value, dtype=float)


def vector(value: float | list[float], n: int, group: MatrixLieGroup) -> Array:
    """Return the vector of `value`, or raise an `InputError` if it does not have n entries."""
    if isinstance(value, list) and len(value) != n:
        raise InputError(f"expected {n} entries for {group.name}, got {len(value)}")
    numbers = np.full(n, value, dtype=float)
    check_sizes(numbers)
    return numbers


def check_sizes(numbers: Any) -> None:
    """Raise an `InputError` if a number is so large that no motion has it."""
    if not (size := np.abs(numbers).max(initial=0.0)) <= GREATEST:
        raise InputError(f"expected numbers of at most {GREATEST:g}, got {size:g}")


def pose_from(value: Any, G: MatrixLieGroup, problems: Problems) -> Array | None:
    """Return the pose that `value` describes, or None after noting its errors."""
    if value == "identity":
        return G.identity
    if isinstance(G, ProductGroup) and isinstance(value, list) and len(value) != G.size:
        if len(value) != len(G.factors):
            problems.add(f"expected {_alternatives(G)}, got a list of {len(value)}")
            return None
        parts = [
            pose_from(entry, factor, problems.at(index))
            for index, (entry, factor) in enumerate(zip(value, G.factors, strict=True))
        ]
        poses = [pose for pose in parts if pose is not None]
        return G.assemble(poses) if len(poses) == len(parts) else None
    if isinstance(value, dict) and isinstance(G, EuclideanGroup):
        matrix = value["matrix"] if G.columns and value.keys() == {"matrix"} else None
        if not isinstance(matrix, list) or len(matrix) != G.size:
            return _from_parts(value, G, problems)
        problems = problems.at("matrix")
        value = matrix
    if not isinstance(value, list):
        problems.add(f"expected {_alternatives(G)}, got {shown(value)}")
        return None
    rows = validated(list[list[Real]], value, problems)
    if rows is None:
        return None
    with problems.catching():
        Q = square(rows, G.size, G)
        _require_near(G, Q, f"an element of {G.name}", f", or give {_alternatives(G)}")
        return Q
    return None


def _require_near(G: MatrixLieGroup, Q: Array, expected: str, advice: str = "") -> None:
    """Raise an `InputError` for a matrix that is no element of a group but for rounding."""
    check_sizes(Q)
    if not (violation := G.violation(Q)) <= GROUP_TOLERANCE:
        raise InputError(
            f"expected {expected}, got a matrix that is {violation:.2g} away from one "
            f"(rounding may leave {GROUP_TOLERANCE:g}); write all digits{advice}"
        )


def _alternatives(G: MatrixLieGroup) -> str:
    """Describe the ways to write a pose of this group."""
    matrix = f"a {G.size}×{G.size} matrix"
    if isinstance(G, ProductGroup):
        return f"identity, {matrix}, or a list of {len(G.factors)} poses for {G.name}"
    if isinstance(G, EuclideanGroup):
        parts = ", ".join(f"{key}: …" for key in _lengths(G))
        others = " (quaternion, euler or matrix may replace rotvec)" if G.rotations == 3 else ""
        return f"identity, {matrix} or {{{parts}}} for {G.name}{others}"
    return f"identity or {matrix} for {G.name}"


def _lengths(G: EuclideanGroup) -> dict[str, int]:
    """Return the parts of a pose that are vectors, with their lengths."""
    rotation = {"rotvec": G.rotations} if G.rotations else {}
    return rotation | dict.fromkeys(G.columns, G.space)


def _from_parts(value: dict[str, Any], G: EuclideanGroup, problems: Problems) -> Array | None:
    lengths, rotations = _lengths(G), _rotations(G)
    keys = [*rotations, *G.columns]
    parts = {name: np.zeros(length) for name, length in lengths.items()}
    rotation = np.eye(G.space)
    for key, entry in value.items():
        if key not in keys:
            problems.at(key).add(f"unknown key; a pose of {G.name} takes {', '.join(keys)}")
        elif key in G.columns:
            unit = dict(zip(G.columns, G.column_units, strict=True))[key]
            numbers = validated(Annotated[Real | list[Real], Unit(unit)], entry, problems.at(key))
            if numbers is not None:
                with problems.catching(key):
                    parts[key] = vector(numbers, lengths[key], G)
        elif first := next((form for form in rotations if form in value and form != key), None):
            problems.at(key).add(f"{first} already gives the rotation; give one of the two")
        else:
            with problems.catching(key):
                R = rotations[key](entry, G, problems.at(key))
                rotation = rotation if R is None else R
    if problems:
        return None
    columns = np.array([parts[name] for name in G.columns]).reshape(-1, G.space).T
    return G.assemble(rotation, columns)


# Rotations ----------------------------------------------------------------------------------------


def _rotations(G: EuclideanGroup) -> dict[str, Callable[[Any, EuclideanGroup, Problems], Any]]:
    """Return readers of the forms of a rotation; they raise errors, or note them at inner keys."""
    if not G.rotations:
        return {}
    in_space = {"quaternion": _quaternion, "euler": _euler} if G.space != 2 else {}
    return {"rotvec": _rotvec, **in_space, "matrix": _rotation_matrix}


def _rotvec(value: Any, G: EuclideanGroup, problems: Problems) -> Array | None:
    numbers = validated(Angle | list[Angle], value, problems)
    if numbers is None:
        return None
    V = np.zeros(G.dimension)
    V[: G.rotations] = vector(numbers, G.rotations, G)
    return G.rotation(rounded(G.exp, V))


def _rotation_matrix(value: Any, G: EuclideanGroup, problems: Problems) -> Array | None:
    rows = validated(list[list[Real]], value, problems)
    if rows is None:
        return None
    R = square(rows, G.space, G)
    _require_near(G, G.assemble(R, np.zeros((G.space, len(G.columns)))), "a rotation matrix")
    return R


def _quaternion(value: Any, G: EuclideanGroup, problems: Problems) -> Array | None:
    order = next(iter(value)) if isinstance(value, dict) and len(value) == 1 else None
    if order not in ("xyzw", "wxyz"):
        raise InputError(
            "expected {xyzw: […]} or {wxyz: […]}, where w is the scalar part, got "
            f"{shown(value)}"
        )
    numbers = validated(list[Real], value[order], problems.at(order))
    if numbers is None:
        return None
    with problems.catching(order):
        q = vector(numbers, 4, G)
        size = float(np.linalg.norm(q))
        if not abs(size - 1) <= QUATERNION_TOLERANCE:
            raise InputError(
                f"expected a quaternion of norm 1, got norm {size:.6g}; divide it by its norm"
            )
        return G.rotation_towards(q if order == "xyzw" else np.roll(q, -1))
    return None


def _euler(value: Any, G: EuclideanGroup, problems: Problems) -> Array | None:
    if not isinstance(value, dict) or value.keys() != {"sequence", "angles"}:
        raise InputError(f"expected {{sequence: ZYX, angles: […]}}, got {shown(value)}")
    sequence = value["sequence"]
    angles = validated(list[Angle], value["angles"], problems.at("angles"))
    with problems.catching("sequence"):
        if not isinstance(sequence, str) or not re.fullmatch(r"[xyz]{1,3}|[XYZ]{1,3}", sequence):
            raise InputError(
                "expected up to three axes such as ZYX (about the rotated axes) or xyz (about the "
                f"fixed ones), got {shown(sequence)}"
            )
        if any(axis == next_axis for axis, next_axis in pairwise(sequence)):
            raise InputError(f"expected no axis twice in a row, got {sequence}")
    if not problems and len(angles) != len(sequence):
        expected = f"expected {len(sequence)} angles for {sequence}"
        problems.at("angles").add(f"{expected}, got {len(angles)}")
    if problems:
        return None
    return rounded(partial(rotation_of_euler, sequence), np.array(angles))


# Turns that poses do not count ----------------------------------------------------------------


def check_turn(first: Any, second: Any, G: MatrixLieGroup, problems: Problems) -> None:
    """Note a motion between two poses whose angles say another way than the shorter one."""
    start, end = (_turn_as_written(value, G) for value in (first, second))
    if start is None or end is None:
        return
    largest = np.degrees(max(np.linalg.norm(start), np.linalg.norm(end)))
    turn = float(np.degrees(np.linalg.norm(end - start)))
    if min(largest, turn) > HALF_TURN:
        degrees = (
            f"; write '{np.radians(turn):.6g} deg' if degrees were meant" if turn > 360 else ""
        )
        problems.add(
            f"turns by {turn:.6g} deg as written, but poses do not count turns, so that the motion "
            f"would take the shorter way; go by waypoints at most 180 deg from each other{degrees}"
        )


def _turn_as_written(value: Any, G: MatrixLieGroup) -> Array | None:
    """Return the rotation vector by which a pose is written, or that of its rotation."""
    pose = pose_from(value, G, Problems())
    if pose is None or not isinstance(G, EuclideanGroup) or not G.rotations:
        return None
    written: Any = value if isinstance(value, dict) else {}
    if "rotvec" in written:
        angles = validated(Angle | list[Angle], written["rotvec"], Problems())
        return vector(angles, G.rotations, G)
    euler = written.get("euler", {"sequence": "x", "angles": []})
    angles = validated(list[Angle], euler["angles"], Problems())
    if np.count_nonzero(angles) != 1:
        return G.log(pose)[: G.rotations]
    return np.asarray(angles @ np.eye(3)[["xyz".index(axis) for axis in euler["sequence"].lower()]])


# Numbers that are meant as degrees ------------------------------------------------------------


def many_turns(
    value: Any, angles: Container[str | int], path: KeyPath = ()
) -> Iterator[tuple[KeyPath, str]]:
    """Yield numbers that are angles of more than a full turn, perhaps in degrees, with advice.

    Parameters
    ----------
    value
        A part of a configuration, as written.
    angles
        Keys of angles, or of lists of angles.
    """
    entries = dict(enumerate(value)) if isinstance(value, list) else value
    if isinstance(entries, dict):
        for key, entry in entries.items():
            here = (*path, key)
            if isinstance(entry, dict | list):
                inner = range(len(entry)) if key in angles and isinstance(entry, list) else ()
                yield from many_turns(entry, inner or angles, here)
            elif key in angles and isinstance(entry, int | float) and abs(entry) > 2 * np.pi:
                yield (
                    here,
                    f"rotation of {entry:g} rad is {abs(entry) / (2 * np.pi):.2g} turns; write "
                    f"'{entry:g} deg' if degrees were meant",
                )
