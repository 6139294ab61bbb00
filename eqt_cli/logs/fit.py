"""Whether velocities of a recording fit its poses, and with which mapping they would.

Poses alone do not tell the order of a quaternion, a frame or a unit; beside recorded velocities
they do.
"""

from collections.abc import Callable, Iterator
from dataclasses import replace
from itertools import permutations
from typing import NamedTuple

import numpy as np

from eqt_cli.core.arrays import Array, apply_matrix, norm, transpose
from eqt_cli.groups.euclidean import EuclideanGroup
from eqt_cli.logs.columns import EULER, VELOCITY, Beside
from eqt_cli.logs.reading import Log
from eqt_cli.logs.table import QUATERNION

WINDOWS = 1000
"""At so many places velocities are compared, at most."""

MOST_ROWS = 100_000
"""That are compared, spread over a longer recording."""

TURN, SHARE = 0.05, 0.05
"""rad, and of the range of the positions: what poses change by in a window, so that noise does not
count; a window is a row if they change by more."""

LARGEST_TURN = 0.5
"""rad in a window, beyond which a rate is no constant."""

FITS, DOUBT = 0.25, 0.5
"""Relative differences: below the one velocities fit, and beyond the other they do not."""

CLEAR = 0.05
"""Relative: what is left behind a factor that is no accident."""

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
"""Why velocities are larger than those of the poses by a factor, and the units to give then."""


class _Fit(NamedTuple):
    """How velocities compare with the poses: a relative difference, and a factor between them."""

    difference: float
    factor: float
    shape: float
    """The difference that is left behind the factor."""

    @property
    def is_doubtful(self) -> bool:
        """Whether they differ by much, or by a factor and little else."""
        return self.difference > DOUBT or (self.shape <= CLEAR and self.difference > 2 * CLEAR)


def misfits(log: Log) -> Iterator[str]:
    """For each velocity that does not fit the poses, how far it is off and what would fit."""
    G = log.group
    if not isinstance(G, EuclideanGroup) or G.space != 3 or len(log.table) < 3:
        return
    log = log.part(slice(None, None, -(-len(log.table) // MOST_ROWS)))
    for beside in log.recorded:
        if beside.kind not in VELOCITY:
            continue
        as_said = _fit(log, G, beside)
        if as_said is None or as_said.difference <= 2 * CLEAR:
            continue
        others = (
            (_fit(variant, G, beside), words) for words, variant in _variants(log, beside.kind)
        )
        found = [(fit, words) for fit, words in others if fit is not None and fit.shape <= FITS]
        if not (as_said.is_doubtful or any(fit.difference <= CLEAR for fit, _ in found)):
            continue
        yield f"{', '.join(beside.names)} {_said_of(log, beside, as_said, found)}"


def _said_of(log: Log, beside: Beside, as_said: _Fit, found: list[tuple[_Fit, str]]) -> str:
    """How far they are off, and what of a mapping would make them fit."""
    part = beside.kind
    if as_said.shape <= CLEAR or (as_said.shape <= FITS and as_said.difference > DOUBT):
        return f"are {_of_factor(part, as_said.factor)}"
    seen = f"differ from the velocity of the poses by {100 * as_said.difference:.0f} %"
    if not found:
        turned = "angles" if log.columns.turn == EULER else "quaternion"
        return (
            f"{seen}, and no other frame or order of the {turned} makes them fit; check the "
            "columns, the units and the times"
        )
    fit, words = min(found, key=lambda each: each[0].shape)
    if fit.difference <= FITS:
        return f"{seen}, and with {words} by {100 * fit.difference:.0f} %; correct the mapping"
    return f"{seen}; with {words} they are {_of_factor(part, fit.factor)}"


def _of_factor(part: str, factor: float) -> str:
    """What a factor between velocities comes from."""
    found = [
        f"`units: {units}` if {cause}"
        for known, cause, units in (*_CAUSES[part], *_CAUSES_OF_ALL)
        if abs(factor / known - 1) < FITS
    ]
    clock = f"check their units, and add `time: {{scale: {1 / factor:.3g}}}` if the clock is wrong"
    advice = f"add {', or '.join(found)}" if found else clock
    return f"{float(f'{factor:.2g}'):g} times the velocity of the poses; {advice}"


def _variants(log: Log, part: str) -> Iterator[tuple[str, Log]]:
    """The recording by other mappings that people mean."""
    frame = "spatial" if getattr(log.said, part) == "body" else "body"
    yield f"`{part}: {frame}`", log.by(**{part: frame})
    known = log.said.attitude == "world_to_body"
    attitude = "body_to_world" if known else "world_to_body"
    yield f"`attitude: {attitude}`", log.by(attitude=attitude)
    if set(QUATERNION) <= set(log.columns.names):
        yield other_order(log), reordered(log)
    if log.columns.turn == EULER:
        for order in ("".join(axes) for axes in permutations("ZYX")):
            for sequence in {order, order.lower()} - {log.said.euler}:
                yield f"`euler: {sequence}`", log.by(euler=sequence)


def other_order(log: Log) -> str:
    """How to get its quaternions in the other of the two orders."""
    if not log.sheet.order:
        return "the columns of the quaternion in the order wxyz"
    return f"`quaternion: {'wxyz' if log.sheet.order == 'xyzw' else 'xyzw'}`"


def reordered(log: Log) -> Log:
    """The same with its quaternions in that order."""
    turned = np.roll(QUATERNION, 1 if log.sheet.order == "wxyz" else -1).tolist()
    # What stands in the column of w is x where w is first in the file, and so on.
    columns = log.table.columns
    swapped = {name: columns[of] for name, of in zip(QUATERNION, turned, strict=True)}
    return replace(log, table=replace(log.table, columns=columns | swapped))


@np.errstate(all="ignore")  # of numbers that are no velocity, and fit nothing
def _fit(log: Log, G: EuclideanGroup, beside: Beside) -> _Fit | None:
    """Velocities against those of the poses, in the axes of the world; None where nothing moves."""
    poses = log.poses
    R = G.rotation(poses)
    given = apply_matrix(R, log.in_body(beside))
    if beside.kind == "rates":
        rows = _windows(lambda i, j: norm(_turns(R[i], R[j])), len(R), TURN)
        derived = None if rows is None else _turns(R[rows[0]], R[rows[1]])
    else:
        p = G.translations(poses)[..., G.columns.index("position")]
        range_of = float(norm(p.max(axis=0) - p.min(axis=0)))
        rows = _windows(lambda i, j: norm(p[j] - p[i]), len(p), SHARE * range_of)
        derived = None if rows is None else p[rows[1]] - p[rows[0]]
    if rows is None or derived is None:
        return None
    if beside.kind == "rates" and np.median(norm(derived)) > LARGEST_TURN:
        return None
    first, last = rows
    missing = np.zeros(len(log.times), int)
    missing[log.gaps + 1] = 1
    before = np.cumsum(missing)
    whole = before[first] == before[last]
    first, last, derived = first[whole], last[whole], derived[whole]
    steps = np.diff(log.times)[:, None]
    moved = np.concatenate([np.zeros((1, 3)), np.cumsum((given[1:] + given[:-1]) / 2 * steps, 0)])
    measured = moved[last] - moved[first]
    size = float(np.sum(derived * derived))
    if size == 0.0 or not np.isfinite([size, np.sum(measured * measured)]).all():
        return None
    factor = float(np.sum(measured * derived)) / size
    difference = float(np.sqrt(np.sum((measured - derived) ** 2) / size))
    left = float(np.sqrt(np.sum((measured - factor * derived) ** 2) / size))
    return _Fit(difference, factor, left / factor if factor > 0 else np.inf)


def _turns(first: Array, last: Array) -> Array:
    """The rotation from each to each, as a rotation vector in the axes of the world."""
    from scipy.spatial.transform import Rotation  # slow to import; readers of results do without

    return Rotation.from_matrix(last @ transpose(first)).as_rotvec()


def _windows(
    size: Callable[[Array, Array], Array], rows: int, least: float
) -> tuple[Array, Array] | None:
    """The first and last rows of windows in which poses change enough; None if they never do."""
    length = 1
    while length < rows:
        first = np.unique(np.linspace(0, rows - 1 - length, WINDOWS).astype(int))
        if least > 0.0 and np.median(size(first, first + length)) >= least:
            return first, first + length
        length *= 2
    return None
