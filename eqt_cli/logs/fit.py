"""Compares the velocities of a recording with its poses, and finds a mapping with which they fit.

Poses alone do not show a wrong quaternion order, frame or unit; together with recorded velocities
they do.
"""

from collections.abc import Callable, Iterator
from dataclasses import replace
from itertools import permutations
from typing import NamedTuple

import numpy as np

from eqt_cli.core.arrays import Array, apply_matrix, norm, transpose
from eqt_cli.groups.euclidean import EuclideanGroup
from eqt_cli.logs.columns import EULER, VELOCITY, RecordedColumns
from eqt_cli.logs.reading import Log
from eqt_cli.logs.table import QUATERNION

WINDOWS = 1000
"""Largest number of windows in which velocities are compared."""

MAX_ROWS = 100_000
"""Largest number of rows that are compared, spread over the recording."""

ROTATION, SHARE = 0.05, 0.05
"""Smallest median change of the poses in a window, rad and as a share of the range of positions.

Smaller changes could be noise. A window is as short as this allows, at least one step.
"""

MAX_ROTATION = 0.5
"""Median rotation in a window, rad, beyond which the rates are not compared."""

FITS, DOUBT = 0.25, 0.5
"""Relative differences: velocities fit up to the first, and do not fit beyond the second."""

CLEAR = 0.05
"""Largest relative difference that remains after a factor, for the factor to be the cause."""

_CAUSES: dict[str, tuple[tuple[float, str, str], ...]] = {
    "rates": ((180 / np.pi, "the rates are in deg/s", "{wx: deg/s, wy: deg/s, wz: deg/s}"),),
    "velocity": (
        (1e3, "the velocity is in mm/s", "{vx: mm/s, vy: mm/s, vz: mm/s}"),
        (1e2, "the velocity is in cm/s", "{vx: cm/s, vy: cm/s, vz: cm/s}"),
        (3.6, "the velocity is in km/h", "{vx: km/h, vy: km/h, vz: km/h}"),
        (1e-3, "the position is in mm", "{x: mm, y: mm, z: mm}"),
    ),
}
_CAUSES_OF_ALL = tuple(
    (factor, f"t is in {unit}", f"{{t: {unit}}}")
    for factor, unit in ((1e3, "ms"), (1e6, "us"), (1e9, "ns"))
)
"""Factors between recorded velocities and those of the poses, each with its cause and units."""


class _Fit(NamedTuple):
    """Relative difference between recorded velocities and those of the poses, and their factor."""

    difference: float
    factor: float
    shape: float
    """The relative difference that remains after the factor."""

    @property
    def is_doubtful(self) -> bool:
        """Whether they differ by much, or almost only by a factor."""
        return self.difference > DOUBT or (self.shape <= CLEAR and self.difference > 2 * CLEAR)


def misfits(log: Log) -> Iterator[str]:
    """Describe each velocity that does not fit the poses: its difference, and what would fit."""
    G = log.group
    if not isinstance(G, EuclideanGroup) or G.space != 3 or len(log.table) < 3:
        return
    log = log.part(slice(None, None, -(-len(log.table) // MAX_ROWS)))
    for recorded in log.recorded:
        if recorded.kind not in VELOCITY:
            continue
        as_mapped = _fit(log, G, recorded)
        if as_mapped is None or as_mapped.difference <= 2 * CLEAR:
            continue
        others = (
            (_fit(variant, G, recorded), words) for words, variant in _variants(log, recorded.kind)
        )
        fitting = [(fit, words) for fit, words in others if fit is not None and fit.shape <= FITS]
        if not (as_mapped.is_doubtful or any(fit.difference <= CLEAR for fit, _ in fitting)):
            continue
        yield f"{', '.join(recorded.names)} {_advice(log, recorded, as_mapped, fitting)}"


def _advice(
    log: Log, recorded: RecordedColumns, as_mapped: _Fit, fitting: list[tuple[_Fit, str]]
) -> str:
    """Describe the difference, and the change of the mapping that makes velocities fit."""
    kind = recorded.kind
    if as_mapped.shape <= CLEAR or (as_mapped.shape <= FITS and as_mapped.difference > DOUBT):
        return f"are {_of_factor(kind, as_mapped.factor)}"
    differ = f"differ from the velocity of the poses by {100 * as_mapped.difference:.0f} %"
    if not fitting:
        attitude = "angles" if log.columns.rotation == EULER else "quaternion"
        return (
            f"{differ}, and no other frame or order of the {attitude} makes them fit; check "
            "the columns, the units and the times"
        )
    fit, words = min(fitting, key=lambda each: each[0].shape)
    if fit.difference <= FITS:
        return f"{differ}, and with {words} by {100 * fit.difference:.0f} %; correct the mapping"
    return f"{differ}; with {words} they are {_of_factor(kind, fit.factor)}"


def _of_factor(kind: str, factor: float) -> str:
    """Describe a factor between velocities, its possible causes, and what to do."""
    causes = [
        f"`units: {units}` if {cause}"
        for known, cause, units in (*_CAUSES[kind], *_CAUSES_OF_ALL)
        if abs(factor / known - 1) < FITS
    ]
    clock = f"check their units, and add `time: {{scale: {1 / factor:.3g}}}` if the clock is wrong"
    advice = f"add {', or '.join(causes)}" if causes else clock
    return f"{float(f'{factor:.2g}'):g} times the velocity of the poses; {advice}"


def _variants(log: Log, kind: str) -> Iterator[tuple[str, Log]]:
    """Yield the log as read by other common mappings, each with the key to change."""
    frame = "spatial" if getattr(log.mapping, kind) == "body" else "body"
    yield f"`{kind}: {frame}`", log.with_mapping(**{kind: frame})
    is_inverse = log.mapping.attitude == "world_to_body"
    attitude = "body_to_world" if is_inverse else "world_to_body"
    yield f"`attitude: {attitude}`", log.with_mapping(attitude=attitude)
    if set(QUATERNION) <= set(log.columns.names):
        yield other_order(log), reordered(log)
    if log.columns.rotation == EULER:
        for order in ("".join(axes) for axes in permutations("ZYX")):
            for sequence in {order, order.lower()} - {log.mapping.euler}:
                yield f"`euler: {sequence}`", log.with_mapping(euler=sequence)


def other_order(log: Log) -> str:
    """Say how to read the quaternions in the other order."""
    if not log.sheet.order:
        return "the columns of the quaternion in the order wxyz"
    return f"`quaternion: {'wxyz' if log.sheet.order == 'xyzw' else 'xyzw'}`"


def reordered(log: Log) -> Log:
    """Return the log with its quaternions in the other order."""
    # With w first in the file, the column of x holds w, that of y holds x, and so on.
    actual = np.roll(QUATERNION, 1 if log.sheet.order == "wxyz" else -1).tolist()
    columns = log.table.columns
    swapped = {name: columns[of] for name, of in zip(QUATERNION, actual, strict=True)}
    return replace(log, table=replace(log.table, columns=columns | swapped))


@np.errstate(all="ignore")  # absurd numbers overflow; they fit nothing
def _fit(log: Log, G: EuclideanGroup, recorded: RecordedColumns) -> _Fit | None:
    """Compare velocities with those of the poses in world axes; None where nothing moves."""
    poses = log.poses
    R = G.rotation(poses)
    velocity = apply_matrix(R, log.in_body(recorded))
    if recorded.kind == "rates":
        rows = _windows(lambda i, j: norm(_rotation_vectors(R[i], R[j])), len(R), ROTATION)
        derived = None if rows is None else _rotation_vectors(R[rows[0]], R[rows[1]])
    else:
        p = G.translations(poses)[..., G.columns.index("position")]
        range_of = float(norm(p.max(axis=0) - p.min(axis=0)))
        rows = _windows(lambda i, j: norm(p[j] - p[i]), len(p), SHARE * range_of)
        derived = None if rows is None else p[rows[1]] - p[rows[0]]
    if rows is None or derived is None:
        return None
    if recorded.kind == "rates" and np.median(norm(derived)) > MAX_ROTATION:
        return None
    first, last = rows
    missing = np.zeros(len(log.times), int)
    missing[log.gaps + 1] = 1
    before = np.cumsum(missing)
    complete = before[first] == before[last]
    first, last, derived = first[complete], last[complete], derived[complete]
    steps = np.diff(log.times)[:, None]
    areas = (velocity[1:] + velocity[:-1]) / 2 * steps
    integral = np.concatenate([np.zeros((1, 3)), np.cumsum(areas, 0)])
    measured = integral[last] - integral[first]
    size = float(np.sum(derived * derived))
    if size == 0.0 or not np.isfinite([size, np.sum(measured * measured)]).all():
        return None
    factor = float(np.sum(measured * derived)) / size
    difference = float(np.sqrt(np.sum((measured - derived) ** 2) / size))
    remaining = float(np.sqrt(np.sum((measured - factor * derived) ** 2) / size))
    return _Fit(difference, factor, remaining / factor if factor > 0 else np.inf)


def _rotation_vectors(first: Array, last: Array) -> Array:
    """Return the rotation vector from each first to each last attitude, in world axes."""
    from scipy.spatial.transform import Rotation  # slow to import, and rarely needed

    return Rotation.from_matrix(last @ transpose(first)).as_rotvec()


def _windows(
    size: Callable[[Array, Array], Array], rows: int, smallest: float
) -> tuple[Array, Array] | None:
    """Return first and last rows of windows in which poses change enough; None if they never do."""
    length = 1
    while length < rows:
        first = np.unique(np.linspace(0, rows - 1 - length, WINDOWS).astype(int))
        if smallest > 0.0 and np.median(size(first, first + length)) >= smallest:
            return first, first + length
        length *= 2
    return None
