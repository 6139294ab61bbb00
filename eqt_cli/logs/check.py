"""Checks a recording: its columns, the units assumed, its errors and its oddities."""

from collections.abc import Collection, Iterator
from dataclasses import dataclass, field

import numpy as np

from eqt_cli.core.arrays import Array
from eqt_cli.core.errors import InputError
from eqt_cli.groups import MatrixLieGroup, groups
from eqt_cli.groups.euclidean import EuclideanGroup
from eqt_cli.logs.columns import (
    EULER,
    VELOCITY,
    pose_columns,
    quaternion_norms,
    used_columns,
)
from eqt_cli.logs.fit import misfits, other_order, reordered
from eqt_cli.logs.mapping import PARTNERS, LogMapping, MappingError, TrajectoryFormat
from eqt_cli.logs.reading import Log, read_log
from eqt_cli.logs.table import QUATERNION, open_sheet
from eqt_cli.logs.ulog import SUFFIX
from eqt_cli.logs.units import is_angular, units_of

SLOWEST, FASTEST = 5.0, 1e-5
"""Largest and smallest usual step between rows, s; others suggest another unit of time."""

USUAL = 1e-3, 1.0
"""Steps that confirm another unit of time, s."""

_FINER = {"ms": 1e-3, "us": 1e-6, "ns": 1e-9}

ROTATED, LEVEL = np.deg2rad(90.0), np.deg2rad(20.0)
"""Angles of the first pose: a mapping is doubted if it gives more than the first angle where
another one gives less than the second."""

MAX_NAMED = 10
"""Largest number of unused columns that a remark names."""


@dataclass(frozen=True)
class ColumnUse:
    """A column of a file and its use.

    Attributes
    ----------
    heading
        The heading in the file, without the unit.
    name
        eqt's name for the column; empty where it is not used.
    use
        ``time``, ``pose``, ``rates``, ``velocity``, ``torque``, ``force`` or ``not used``.
    unit
        The unit of its numbers; empty where they have none.
    assumed
        Whether neither the file nor a mapping gives this unit.
    """

    heading: str
    name: str
    use: str
    unit: str
    assumed: bool


@dataclass(frozen=True)
class LogCheck:
    """The contents of a recording, its errors and its oddities.

    Attributes
    ----------
    file, format, group
        The file, its format, and the group of its poses.
    columns
        Every column, in the order of the file.
    rows
        The number of rows.
    begin, end
        The first and the last time, s.
    rate
        Sampling rate by the median step, Hz.
    gaps
        The begin and the length of each gap, s.
    norms
        The smallest and the largest norm of its quaternions; None without any.
    problems
        Reasons why it cannot be used.
    notes
        Oddities, each with what to do.
    """

    file: str
    format: str
    group: str
    columns: list[ColumnUse]
    rows: int
    begin: float
    end: float
    rate: float
    gaps: list[tuple[float, float]]
    norms: tuple[float, float] | None
    problems: list[str] = field(default_factory=list)
    notes: list[str] = field(default_factory=list)


def check_text(
    text: str,
    name: str,
    form: TrajectoryFormat,
    mapping: LogMapping,
    G: MatrixLieGroup | None = None,
) -> LogCheck:
    """Check the text of a recording; without a group, the largest that fits the columns is taken.

    Raises
    ------
    InputError
        If there are no columns of a pose, or entries that are no finite numbers.
    """
    G = G or _largest_group(text, name, form, mapping)
    log = read_log(text, name, form, G, mapping)
    times, norms = log.times, quaternion_norms(log.table, log.columns)
    steps = np.diff(times)
    median = float(np.median(steps)) if len(steps) else np.nan
    problems = list(_problems(log))
    all_norms = np.concatenate(list(norms.values())) if norms else np.empty(0)
    return LogCheck(
        name,
        "ulog" if name.lower().endswith(SUFFIX) else form,
        G.name,
        list(_uses(log)),
        len(times),
        float(times[0]),
        float(times[-1]),
        1 / median if median > 0 else np.nan,
        gaps_of(times, log.gaps),
        (float(all_norms.min()), float(all_norms.max())) if len(all_norms) else None,
        problems,
        [] if problems else list(notes(log)),
    )


def _largest_group(
    text: str, name: str, form: TrajectoryFormat, mapping: LogMapping
) -> MatrixLieGroup:
    """Return the largest group whose poses the columns of a file can hold."""
    sheet = open_sheet(text, name, form, mapping)
    names = set(sheet.names)
    fitting = [
        group
        for group in _groups_of_poses()
        if (found := used_columns(names, group)) is not None and found.layout == "parts"
    ]
    if not fitting:
        if len(sheet.names) == 1 and (other := next((c for c in ";\t" if c in sheet.names[0]), "")):
            shown = {";": "semicolons", "\t": "tabs"}[other]
            raise InputError(
                f"{sheet.header_place}: the columns are separated by {shown}; expected commas, and "
                "decimals with a point"
            )
        if incomplete := next(_incomplete(names), None):
            raise InputError(f"{sheet.header_place}: {incomplete}")
        known = ", ".join(QUATERNION)
        raise InputError(
            f"{name}: no columns of a pose were found, such as {known} or yaw, pitch, roll for a "
            "rotation and x, y, z for a position; name them in a mapping, "
            "`columns: {qx: …}`, or give the group"
        )
    return max(fitting, key=lambda group: len(pose_columns(group)))


def _incomplete(names: Collection[str]) -> Iterator[str]:
    """Describe each rotation and position that has some of its columns, but not all."""
    for complete in (QUATERNION, EULER, ("x", "y", "z")):
        found = [each for each in complete if each in names]
        if found and (missing := ", ".join(each for each in complete if each not in found)):
            yield f"column {missing} is missing, so {', '.join(found)} cannot be used"


def _groups_of_poses() -> Iterator[EuclideanGroup]:
    """Yield the groups whose elements are rotations and positions, without velocities."""
    examples = (kind.named(each) for kind in groups.all() for each in kind.examples())
    for group in examples:
        if isinstance(group, EuclideanGroup) and set(group.column_units) <= {"m"}:
            yield group


def _uses(log: Log) -> Iterator[ColumnUse]:
    for name, heading in zip(log.sheet.names, log.sheet.headings, strict=True):
        if name not in log.table.columns:
            yield ColumnUse(heading, "", "not used", log.sheet.units.get(name, ""), False)
            continue
        kinds = [recorded.kind for recorded in log.recorded if name in recorded.names]
        use = "time" if name == "t" else kinds[0] if kinds else "pose"
        given = log.sheet.units.get(name, "")
        default = next(iter(units_of(name)), "")
        if use in VELOCITY and "/" not in default:
            default += "/s"
        yield ColumnUse(heading, name, use, given or default, bool(default) and not given)


def gaps_of(times: Array, gaps: Array) -> list[tuple[float, float]]:
    """Return the begin and the length of each gap, s."""
    begin = times[gaps]
    return list(zip(begin.tolist(), (times[gaps + 1] - begin).tolist(), strict=True))


def _problems(log: Log) -> Iterator[str]:
    """Say why the log cannot be used, and how often its time goes back."""
    back = np.flatnonzero(np.diff(log.times) <= 0)
    try:
        log.require_usable()
    except MappingError:
        raise
    except InputError as error:
        more = f" ({len(back)} times in all)" if len(back) > 1 else ""
        yield f"{error}{more if 'a time after' in str(error) else ''}"


def notes(log: Log) -> Iterator[str]:
    """Yield the oddities of a log that can be used."""
    if log.sheet.damaged:
        yield "parts of the file are damaged and were skipped"
    yield from _incomplete({*log.sheet.names} - {*log.columns.names})
    yield from _angles_without_unit(log)
    yield from _times(log)
    yield from misfits(log)
    yield from _start(log)
    if unused := log.unused:
        named = ", ".join(unused[:MAX_NAMED])
        more = f" and {len(unused) - MAX_NAMED} more" if len(unused) > MAX_NAMED else ""
        verb = "is" if len(unused) == 1 else "are"
        yield f"column{'s' * (len(unused) > 1)} {named}{more} {verb} not used"


def _angles_without_unit(log: Log) -> Iterator[str]:
    for name in log.columns.names:
        if is_angular(name) and not log.sheet.units.get(name):
            largest = float(np.abs(log.table.columns[name]).max())
            if largest > 2 * np.pi:
                yield (
                    f"column {name}: {largest:.4g} is more than a full turn and has no unit, so it "
                    f"is taken as rad; add `units: {{{name}: deg}}` to the mapping, or rad if it "
                    "is meant"
                )


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
        there = f"{length:.4g} s after t = {begin:.6g} s"
        yield f"{count} of {there}, where rows are {median:.4g} s apart"


def _start(log: Log) -> Iterator[str]:
    """Report a first pose that is level only with another quaternion order, or other axes."""
    if not isinstance(log.group, EuclideanGroup) or log.group.rotations != 3:
        return
    one = log.part(slice(1))
    if set(QUATERNION) <= set(log.columns.names):
        angles = [_angle(_rotation(each)) for each in (one, reordered(one))]
        yield from _if_level("rotated", other_order(log), *angles)
    for which, other in (("body", "world"), ("world", "body")):
        if getattr(log.mapping, which) is None and getattr(log.mapping, other) is not None:
            change = PARTNERS[getattr(log.mapping, other)]
            both = (one, one.with_mapping(**{which: change}))
            tilts = [float(np.arccos(_rotation(each)[2, 2])) for each in both]
            yield from _if_level("tilted", f"`{which}: {change}`", *tilts)


def _if_level(how: str, words: str, here: float, there: float) -> Iterator[str]:
    if here > ROTATED and there < LEVEL:
        yield (
            f"the first pose is {how} by {np.rad2deg(here):.0f} deg, and with {words} by "
            f"{np.rad2deg(there):.0f} deg; correct the mapping if the body was level then"
        )


def _rotation(one: Log) -> Array:
    assert isinstance(one.group, EuclideanGroup)
    return np.clip(one.group.rotation(one.poses)[0], -1.0, 1.0)  # for arccos, in spite of rounding


def _angle(R: Array) -> float:
    return float(np.arccos(np.clip((np.trace(R) - 1) / 2, -1.0, 1.0)))
