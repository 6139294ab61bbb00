"""What a recording holds, what was assumed of it, and what is odd in it."""

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
from eqt_cli.logs.units import is_turn, units_of

SLOWEST, FASTEST = 5.0, 1e-5
"""s between rows: what is beyond is unusual, and perhaps in another unit."""

USUAL = 1e-3, 1.0
"""s between rows."""

_FINER = {"ms": 1e-3, "us": 1e-6, "ns": 1e-9}

TURNED, LEVEL = np.deg2rad(90.0), np.deg2rad(20.0)
"""A first pose that is turned by more than the one, and in another order by less than the other."""

MOST_NAMED = 10
"""Columns that are not used, in a remark; and gaps in a report."""


@dataclass(frozen=True)
class ColumnUse:
    """A column of a file, and what it is taken for.

    Attributes
    ----------
    heading
        As it is in the file, without its unit.
    name
        eqt's name of it; empty where it is not used.
    use
        ``time``, ``pose``, ``rates``, ``velocity``, ``torque``, ``force`` or ``not used``.
    unit
        That of its numbers; empty where they have none.
    assumed
        Whether neither the file nor a mapping says this unit.
    """

    heading: str
    name: str
    use: str
    unit: str
    assumed: bool


@dataclass(frozen=True)
class LogCheck:
    """What a recording holds.

    Attributes
    ----------
    file, format, group
        What was read, and the group of its poses.
    columns
        Every column, in the order of the file.
    rows
        How many there are.
    begin, end
        The first and the last time, s.
    rate
        Hz, of the median step.
    gaps
        When a gap begins, and how long it is, s.
    norms
        The smallest and the largest norm of its quaternions; None without any.
    problems
        For what it cannot be used.
    notes
        What is odd in it, each with what to do.
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
    kind: TrajectoryFormat,
    said: LogMapping,
    G: MatrixLieGroup | None = None,
) -> LogCheck:
    """What the text of a recording holds; poses are of the group, or of one that fits its columns.

    Raises
    ------
    InputError
        Where it holds none, or numbers that are none.
    """
    G = G or _fitting(text, name, kind, said)
    log = read_log(text, name, kind, G, said)
    times, norms = log.times, quaternion_norms(log.table, log.columns)
    steps = np.diff(times)
    median = float(np.median(steps)) if len(steps) else np.nan
    problems = list(_problems(log))
    all_norms = np.concatenate(list(norms.values())) if norms else np.empty(0)
    return LogCheck(
        name,
        "ulog" if name.lower().endswith(SUFFIX) else kind,
        G.name,
        list(_uses(log)),
        len(times),
        float(times[0]),
        float(times[-1]),
        1 / median if median > 0 else np.nan,
        gaps_of(log),
        (float(all_norms.min()), float(all_norms.max())) if len(all_norms) else None,
        problems,
        [] if problems else list(notes(log)),
    )


def _fitting(text: str, name: str, kind: TrajectoryFormat, said: LogMapping) -> MatrixLieGroup:
    """The largest group that the columns of a file can be poses of."""
    sheet = open_sheet(text, name, kind, said)
    names = set(sheet.names)
    fitting = [
        group
        for group in _of_bodies()
        if (found := used_columns(names, group)) is not None and found.way == "parts"
    ]
    if not fitting:
        if len(sheet.names) == 1 and (other := next((c for c in ";\t" if c in sheet.names[0]), "")):
            shown = {";": "semicolons", "\t": "tabs"}[other]
            raise InputError(
                f"{sheet.header_place}: the columns are parted by {shown}; expected commas, and "
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
    """What is missing of a rotation or a position, of which there are some columns."""
    for whole in (QUATERNION, EULER, ("x", "y", "z")):
        if (found := [each for each in whole if each in names]) and len(found) < len(whole):
            missing = ", ".join(each for each in whole if each not in found)
            verb = "is" if len(found) == 1 else "are"
            yield f"column {missing} is missing, without which {', '.join(found)} {verb} of no use"


def _of_bodies() -> Iterator[EuclideanGroup]:
    """Groups whose poses are rotations and places; velocities are no part of these."""
    examples = (kind.named(each) for kind in groups.all() for each in kind.examples())
    for group in examples:
        if isinstance(group, EuclideanGroup) and set(group.column_units) <= {"m"}:
            yield group


def _uses(log: Log) -> Iterator[ColumnUse]:
    for name, heading in zip(log.sheet.names, log.sheet.headings, strict=True):
        if name not in log.table.columns:
            yield ColumnUse(heading, "", "not used", log.sheet.units.get(name, ""), False)
            continue
        kinds = [beside.kind for beside in log.recorded if name in beside.names]
        use = "time" if name == "t" else kinds[0] if kinds else "pose"
        given = log.sheet.units.get(name, "")
        taken = next((unit for unit in units_of(name)), "")
        if use in VELOCITY and "/" not in taken:
            taken += "/s"
        yield ColumnUse(heading, name, use, given or taken, bool(taken) and not given)


def gaps_of(log: Log) -> list[tuple[float, float]]:
    """When a gap begins, and how long it is, s."""
    begin = log.times[log.gaps]
    return list(zip(begin.tolist(), (log.times[log.gaps + 1] - begin).tolist(), strict=True))


def _problems(log: Log) -> Iterator[str]:
    """What makes it no motion: each kind once, with how often it occurs."""
    back = np.flatnonzero(np.diff(log.times) <= 0)
    try:
        log.require_usable()
    except MappingError:
        raise
    except InputError as error:
        more = f" ({len(back)} times in all)" if len(back) > 1 else ""
        yield f"{error}{more if 'a time after' in str(error) else ''}"


def notes(log: Log) -> Iterator[str]:
    """What is odd in a recording that can be used."""
    if log.sheet.damaged:
        yield "parts of the file are damaged and were skipped"
    yield from _incomplete({*log.sheet.names} - {*log.columns.names})
    yield from _turns_without_unit(log)
    yield from _times(log)
    yield from misfits(log)
    yield from _start(log)
    if unused := log.unused:
        named = ", ".join(unused[:MOST_NAMED])
        more = f" and {len(unused) - MOST_NAMED} more" if len(unused) > MOST_NAMED else ""
        verb = "is" if len(unused) == 1 else "are"
        yield f"column{'s' * (len(unused) > 1)} {named}{more} {verb} not used"


def _turns_without_unit(log: Log) -> Iterator[str]:
    for name in log.columns.names:
        if is_turn(name) and not log.sheet.units.get(name):
            largest = float(np.abs(log.table.columns[name]).max())
            if largest > 2 * np.pi:
                yield (
                    f"column {name}: {largest:.4g} is more than a turn and has no unit, so it is "
                    f"taken as rad; add `units: {{{name}: deg}}` to the mapping, or rad if it is "
                    "meant"
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
    if gaps := gaps_of(log):
        begin, length = max(gaps, key=lambda gap: gap[1])
        count = "1 gap" if len(gaps) == 1 else f"{len(gaps)} gaps, the longest"
        there = f"{length:.4g} s after t = {begin:.6g} s"
        yield f"{count} of {there}, where rows are {median:.4g} s apart"


def _start(log: Log) -> Iterator[str]:
    """A first pose that is level only with the other order of the quaternion, or other axes."""
    if not isinstance(log.group, EuclideanGroup) or log.group.rotations != 3:
        return
    one = log.part(slice(1))
    if set(QUATERNION) <= set(log.columns.names):
        angles = [_angle(_rotation(each)) for each in (one, reordered(one))]
        yield from _if_level("turned", other_order(log), *angles)
    for which, other in (("body", "world"), ("world", "body")):
        if getattr(log.said, which) is None and getattr(log.said, other) is not None:
            change = PARTNERS[getattr(log.said, other)]
            both = (one, one.by(**{which: change}))
            tilts = [float(np.arccos(_rotation(each)[2, 2])) for each in both]
            yield from _if_level("tilted", f"`{which}: {change}`", *tilts)


def _if_level(how: str, words: str, here: float, there: float) -> Iterator[str]:
    if here > TURNED and there < LEVEL:
        yield (
            f"the first pose is {how} by {np.rad2deg(here):.0f} deg, and with {words} by "
            f"{np.rad2deg(there):.0f} deg; correct the mapping if the body was level then"
        )


def _rotation(one: Log) -> Array:
    assert isinstance(one.group, EuclideanGroup)
    return np.clip(one.group.rotation(one.poses)[0], -1.0, 1.0)  # rounding may leave more


def _angle(R: Array) -> float:
    return float(np.arccos(np.clip((np.trace(R) - 1) / 2, -1.0, 1.0)))
