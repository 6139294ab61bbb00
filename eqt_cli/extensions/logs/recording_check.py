"""Recordings as motions on a group, components that follow one, and checks for oddities."""

from collections.abc import Callable, Collection, Iterator, Sequence
from dataclasses import dataclass, field, replace
from functools import reduce
from itertools import combinations, permutations
from typing import ClassVar, NamedTuple, Self

import numpy as np

from eqt_cli.base import purposes
from eqt_cli.base.arrays import Array, apply_matrix, norm, transpose
from eqt_cli.base.errors import InputError, Problems
from eqt_cli.components import motions
from eqt_cli.components.groups import MatrixLieGroup
from eqt_cli.components.matrix_groups import EuclideanGroup
from eqt_cli.components.pose_tables import EULER, QUATERNION, InFile, LogMapping
from eqt_cli.components.references import PiecewiseReference
from eqt_cli.extensions.logs import recording as reading
from eqt_cli.extensions.logs.log_table import NORMALISED, PARTNERS, units_of
from eqt_cli.extensions.logs.recording import VELOCITY, WRENCH, Log, RecordedColumns
from eqt_cli.numbers.leaves import with_fields

# Checks a recording: columns, assumed units, errors, oddities, and the mapping that fits ----------


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

_CAUSES = (
    ("rates", 180 / np.pi, "the rates are in deg/s", "{wx: deg/s, wy: deg/s, wz: deg/s}"),
    ("velocity", 1e3, "the velocity is in mm/s", "{vx: mm/s, vy: mm/s, vz: mm/s}"),
    ("velocity", 1e2, "the velocity is in cm/s", "{vx: cm/s, vy: cm/s, vz: cm/s}"),
    ("velocity", 3.6, "the velocity is in km/h", "{vx: km/h, vy: km/h, vz: km/h}"),
    ("velocity", 1e-3, "the position is in mm", "{x: mm, y: mm, z: mm}"),
    ("rates, velocity", 1e3, "t is in ms", "{t: ms}"),
    ("rates, velocity", 1e6, "t is in us", "{t: us}"),
    ("rates, velocity", 1e9, "t is in ns", "{t: ns}"),
)
"""What was recorded, a factor between it and the poses' velocity, its cause, and the units."""


class _Fit(NamedTuple):
    """Relative difference between recorded velocities and those of the poses, and their factor."""

    difference: float
    factor: float
    shape: float
    """The relative difference that remains after the factor."""


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
        variants = _variants(log, recorded)
        others = ((_fit(variant, G, recorded), words) for words, variant in variants)
        fitting = [(fit, words) for fit, words in others if fit is not None and fit.shape <= FITS]
        # They differ by much, or almost only by a factor.
        is_doubtful = as_mapped.difference > DOUBT or as_mapped.shape <= CLEAR
        if not (is_doubtful or any(fit.difference <= CLEAR for fit, _ in fitting)):
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
        advice = "check the columns, the units and the times"
        return f"{differ}, and no other frame, sign or order makes them fit; {advice}"
    fit, words = min(
        fitting, key=lambda candidate: round(candidate[0].shape, 3)
    )  # of equals, the simplest
    if fit.difference <= FITS:
        return f"{differ}, and with {words} by {100 * fit.difference:.0f} %; correct the mapping"
    return f"{differ}; with {words} they are {_of_factor(kind, fit.factor)}"


def _of_factor(kind: str, factor: float) -> str:
    """Describe a factor between velocities, its possible causes, and what to do."""
    causes = [
        f"`units: {units}` if {cause}"
        for kinds, usual, cause, units in _CAUSES
        if kind in kinds and abs(factor / usual - 1) < FITS
    ]
    clock = f"check their units, and add `time: {{scale: {1 / factor:.3g}}}` if the clock is wrong"
    advice = f"add {', or '.join(causes)}" if causes else clock
    return f"{float(f'{factor:.2g}'):g} times the velocity of the poses; {advice}"


def _variants(log: Log, recorded: RecordedColumns) -> Iterator[tuple[str, Log]]:
    """Yield the log as read by other common mappings, each with the keys to change."""
    kind, columns = recorded.kind, log.table.columns
    frame = "spatial" if getattr(log.mapping, kind) == "body" else "body"
    attitude = "body_to_world" if log.mapping.attitude == "world_to_body" else "world_to_body"
    changes: list[tuple[str, Callable[[Log], Log]]] = [
        (f"`{kind}: {frame}`", lambda one: one.with_mapping(**{kind: frame})),
        (f"`attitude: {attitude}`", lambda one: one.with_mapping(attitude=attitude)),
    ]
    if {*QUATERNION} <= {*log.columns.names}:
        changes += [(other_order(log), reordered)]
    for some in (some for count in (1, 2, 3) for some in combinations(changes, count)):
        yield " and ".join(words for words, _ in some), reduce(lambda x, y: y[1](x), some, log)
    if {*EULER} <= {*log.columns.names}:
        for order in ("".join(axes) for axes in permutations("ZYX")):
            for sequence in {order, order.lower()} - {log.mapping.euler}:
                yield f"`euler: {sequence}`", log.with_mapping(euler=sequence)
    for name in (name for name in (*EULER, *recorded.names) if name in columns):
        table = replace(log.table, columns=columns | {name: -columns[name]})
        words = f"`scale: {{{name}: {-log.mapping.scale.get(name, 1):g}}}`"
        yield words, replace(log, table=table)


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
    R, turns = G.rotation(log.poses), recorded.kind == "rates"
    velocity, smallest = apply_matrix(R, log.in_body(recorded)), ROTATION
    if not turns:
        p = G.translations(log.poses)[..., G.columns.index("position")]
        smallest = SHARE * float(norm(p.max(axis=0) - p.min(axis=0)))

    def change(i: Array, j: Array) -> Array:
        return G.rotation_group.log(R[j] @ transpose(R[i])) if turns else p[j] - p[i]

    rows = _windows(change, len(R), smallest)
    if rows is None:
        return None
    first, last = rows
    derived = change(first, last)
    if turns and np.median(norm(derived)) > MAX_ROTATION:
        return None
    missing = np.zeros(len(log.times), int)
    missing[log.gaps + 1] = 1
    before = np.cumsum(missing)
    complete = before[first] == before[last]
    first, last, derived = first[complete], last[complete], derived[complete]
    areas = (velocity[1:] + velocity[:-1]) / 2 * np.diff(log.times)[:, None]
    integral = np.concatenate([np.zeros((1, 3)), np.cumsum(areas, 0)])
    measured = integral[last] - integral[first]
    size = float(np.sum(derived * derived))
    if size == 0.0 or not np.isfinite([size, np.sum(measured * measured)]).all():
        return None
    factor = float(np.sum(measured * derived)) / size
    difference = float(np.sqrt(np.sum((measured - derived) ** 2) / size))
    remaining = float(np.sqrt(np.sum((measured - factor * derived) ** 2) / size))
    return _Fit(difference, factor, remaining / factor if factor > 0 else np.inf)


def _windows(
    change: Callable[[Array, Array], Array], rows: int, smallest: float
) -> tuple[Array, Array] | None:
    """Return first and last rows of windows in which poses change enough; None if they never do."""
    length = 1
    while length < rows:
        first = np.unique(np.linspace(0, rows - 1 - length, WINDOWS).astype(int))
        if smallest > 0.0 and np.median(norm(change(first, first + length))) >= smallest:
            return first, first + length
        length *= 2
    return None


SLOWEST, FASTEST = 5.0, 1e-5
"""Largest and smallest usual step between rows, s; others suggest another unit of time."""

USUAL = 1e-3, 1.0
"""Steps that confirm another unit of time, s."""

_FINER = {"ms": 1e-3, "us": 1e-6, "ns": 1e-9}

ROTATED, LEVEL = np.deg2rad(90.0), np.deg2rad(20.0)
"""Angles of the first pose: a mapping is doubted if it gives more than the first angle where
another one gives less than the second."""


def incomplete_columns(names: Collection[str]) -> Iterator[str]:
    """Describe each rotation and position that has some of its columns, but not all."""
    for complete in (QUATERNION, EULER, ("x", "y", "z")):
        present = [column for column in complete if column in names]
        if present and (
            missing := ", ".join(column for column in complete if column not in present)
        ):
            yield f"column {missing} is missing, so {', '.join(present)} cannot be used"


def gaps_of(times: Array, gaps: Array) -> list[tuple[float, float]]:
    """Return the begin and the length of each gap, s."""
    begin = times[gaps]
    return list(zip(begin.tolist(), (times[gaps + 1] - begin).tolist(), strict=True))


def notes(log: Log) -> Iterator[str]:
    """Yield the oddities of a log that can be used."""
    if log.sheet.damaged:
        yield "parts of the file are damaged and were skipped"
    yield from incomplete_columns({*log.sheet.names} - {*log.columns.names})
    for name in log.columns.names:
        if "rad" in units_of(name) and not log.sheet.units.get(name):
            largest = float(np.abs(log.table.columns[name]).max())
            if largest > 2 * np.pi:
                yield (
                    f"column {name}: {largest:.4g} is more than a full turn and has no unit, so it "
                    f"is taken as rad; add `units: {{{name}: deg}}` to the mapping, or rad if it "
                    "is meant"
                )
    yield from _times(log)
    normalised = [name for name, unit in log.sheet.units.items() if unit == NORMALISED]
    if named := ", ".join(column for column in normalised if column in log.table.columns):
        yield f"{named}: normalised; the actuator `scale` gives their unit, or fit finds it"
    yield from misfits(log)
    yield from _start(log)
    yield from log.sheet.notes(log.table)


def _times(log: Log) -> Iterator[str]:
    median = float(np.median(np.diff(log.times)))
    if not FASTEST <= median <= SLOWEST and not log.sheet.units.get("t"):
        unit = next((u for u, f in _FINER.items() if USUAL[0] <= median * f <= USUAL[1]), "…")
        meant = "if t is not in s" if unit == "…" else f"if t is in {unit}"
        yield (
            f"rows are {median:.4g} s apart, which is unusual; add `units: {{t: {unit}}}` to the "
            f"mapping {meant}"
        )
    if gaps := gaps_of(log.times, log.gaps):
        begin, length = max(gaps, key=lambda gap: gap[1])
        count = "1 gap" if len(gaps) == 1 else f"{len(gaps)} gaps, the longest"
        there = f"{length:.4g} s after t = {begin:.13g} s"
        yield f"{count} of {there}, where rows are {median:.4g} s apart"


def _start(log: Log) -> Iterator[str]:
    """Report a first pose that is level only with another quaternion order, or other axes."""
    if not isinstance(log.group, EuclideanGroup) or log.group.rotations != 3:
        return
    first = log.part(slice(1))
    if set(QUATERNION) <= set(log.columns.names):
        cosines = [(np.trace(_rotation(read)) - 1) / 2 for read in (first, reordered(first))]
        angles = np.arccos(np.clip(cosines, -1.0, 1.0)).tolist()
        yield from _if_level("rotated", other_order(log), *angles)
    for which, other in (("body", "world"), ("world", "body")):
        if getattr(log.mapping, which) is None and getattr(log.mapping, other) is not None:
            change = PARTNERS[getattr(log.mapping, other)]
            both = (first, first.with_mapping(**{which: change}))
            tilts = [float(np.arccos(_rotation(read)[2, 2])) for read in both]
            yield from _if_level("tilted", f"`{which}: {change}`", *tilts)


def _if_level(how: str, words: str, here: float, there: float) -> Iterator[str]:
    if here > ROTATED and there < LEVEL:
        yield (
            f"the first pose is {how} by {np.rad2deg(here):.0f} deg, and with {words} by "
            f"{np.rad2deg(there):.0f} deg; correct the mapping if the body was level then"
        )


def _rotation(log: Log) -> Array:
    assert isinstance(log.group, EuclideanGroup)
    return np.clip(log.group.rotation(log.poses)[0], -1.0, 1.0)  # for arccos, in spite of rounding


# A recording as a motion on a group ---------------------------------------------------------------


@dataclass(frozen=True)
class Recording:
    """A measured motion on a group.

    Attributes
    ----------
    name, place
        The file and the line of its header, for messages.
    group
        G.
    times : (n,)
        Rising times, s.
    poses : (n, d, d)
        Q.
    velocities : (n, m)
        V in the Lie algebra, body frame; NaN in the coordinates that were not measured.
    wrenches : (n, m)
        The wrench in the dual, body frame; NaN in the coordinates that were not measured.
    gaps : (k,)
        The rows after which rows are missing.
    timed
        Whether the mapping gives the offset of the clock.
    notes
        Remarks on oddities in the file.
    speeds : (n, r)
        Speeds of rotors, rad/s, if they were recorded.
    rotors
        The columns that they are from: n1, n2, …
    unclear
        Which columns may be commands, and what a mapping must state.
    """

    name: str
    place: str
    group: MatrixLieGroup
    times: Array
    poses: Array
    velocities: Array
    wrenches: Array
    gaps: Array
    timed: bool = False
    notes: tuple[str, ...] = ()
    speeds: Array = field(default_factory=lambda: np.empty((0, 0)))
    rotors: Sequence[str] = ()
    unclear: str = ""

    def require_wrenches(self) -> Array:
        """Return the wrenches, or raise an `InputError` if one was not measured."""
        G = self.group
        if not np.isnan(self.wrenches).any():
            return self.wrenches
        names = reading.recorded_names(G, WRENCH)
        if len(names) < G.dimension:
            raise InputError(f"{self.place}: no columns of a wrench on {G.name} are known")
        missing = [
            name
            for columns in reading.recorded_columns(G)
            if columns.kind in WRENCH and np.isnan(self.wrenches[:, columns.axes]).any()
            for name in columns.names
        ]
        raise InputError(
            f"{self.place}: missing column {', '.join(missing)}; a wrench on {G.name} has "
            f"{', '.join(names)}{'; ' if self.unclear else ''}{self.unclear}"
        )


def recording_of(log: Log) -> Recording:
    """Return the motion in a log.

    Raises
    ------
    InputError
        If its times, its poses or their axes make it no motion.
    """
    log.require_usable()
    G = log.group
    velocities, wrenches = np.full((2, len(log.times), G.dimension), np.nan)
    for columns in log.recorded:
        measured = velocities if columns.kind in VELOCITY else wrenches
        measured[:, columns.axes] = log.in_body(columns)
    if log.mapping.sensor is not None:  # V = Ad_sensor V_sensor; unknown where a part of it is
        Ad = G.Ad_matrix(log.placed("sensor"))
        unknown = np.isnan(velocities) @ (Ad != 0).T
        velocities = np.where(unknown, np.nan, np.nan_to_num(velocities) @ Ad.T)
    motion = log.times, log.moved_poses, velocities, wrenches, log.gaps
    is_timed = log.mapping.time.offset is not None
    place = log.table.name, log.sheet.header_place
    recording = Recording(*place, G, *motion, is_timed, tuple(notes(log)))
    recording = replace(recording, unclear=log.sheet.unclear)
    if not log.speeds:
        return recording
    return replace(recording, speeds=log.table.get(log.speeds), rotors=log.speeds)


# Components that name the file of a recording -----------------------------------------------------


@purposes.log_in_a_file
def log_of(component: InFile, G: MatrixLieGroup) -> Log:
    """Return the log in the file of a component, or raise an `InputError` if it is no motion."""
    if (G.name, "log") not in component.cache:
        assert component.text is not None and component.file is not None
        mapping = component.mapping or LogMapping()
        log = reading.read_log(component.text, component.file, component.format, G, mapping)
        log.require_usable()
        component.cache[G.name, "log"] = log
    return component.cache[G.name, "log"]


@dataclass(frozen=True, kw_only=True)
class RecordingInFile(InFile):
    """A component that follows the recording in its file from the first row to the last."""

    file: str = field()  # required, unlike in the base class

    def recording(self, G: MatrixLieGroup) -> Recording:
        """Return the motion in the file, body frame."""
        if (G.name, "recording") not in self.cache:
            self.cache[G.name, "recording"] = recording_of(log_of(self, G))
        return self.cache[G.name, "recording"]

    def with_recording(self, recording: Recording) -> Self:
        """Return the component with a recording that was read before."""
        return with_fields(self, cache={(recording.group.name, "recording"): recording})

    def ends(self, G: MatrixLieGroup) -> tuple[float, float]:
        """Return the times of the first and the last row."""
        times = self.recording(G).times
        return float(times[0]), float(times[-1])

    def gaps(self, G: MatrixLieGroup) -> list[tuple[float, float]]:
        """Return the begin and the length of each gap, s."""
        recording = self.recording(G)
        return gaps_of(recording.times, recording.gaps)


@dataclass(frozen=True)
class LogReference(RecordingInFile, PiecewiseReference):
    """A recorded motion: at every row the recorded pose and velocity, with their noise.

    Between two rows, a cubic curve joins these poses and velocities. Without recorded velocities,
    the motion is the spline of `waypoints`. It does not include the recorded wrench, which the law
    `replay` applies. To track a recording, use `waypoints` with `smoothing`.
    """

    name: ClassVar[str] = "log"
    by_processor: ClassVar[bool] = True  # recordings are long

    def pieces(self, G: MatrixLieGroup) -> motions.Pieces:
        """Return a piece from each row to the next."""
        log = self.recording(G)
        if np.isnan(log.velocities).any():
            return motions.spline(G, log.times, log.poses)
        return motions.through(G, log.times, log.poses, log.velocities)

    def knot_times(self, G: MatrixLieGroup) -> Array:
        """Return the times of the rows."""
        return self.recording(G).times

    def remarks(self, G: MatrixLieGroup) -> Iterator[str]:
        """Yield the oddities of the file."""
        yield from (f"{self.file}: {note}" for note in self.recording(G).notes)

    def check(self, G: MatrixLieGroup, problems: Problems) -> None:
        """Note an invalid file or mapping."""
        self.check_file(problems, lambda: self.prepared(G, self.pieces))
