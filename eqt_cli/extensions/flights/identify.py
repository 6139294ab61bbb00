"""Which law flew, from flights: the position loop and the attitude loop in their logs."""

import os
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import product
from typing import Any, NamedTuple

import numpy as np

from eqt_cli.base.arrays import Array, norm
from eqt_cli.base.errors import EqtError
from eqt_cli.base.reporting import Block, TextTable, listed, significant, step
from eqt_cli.extensions.flights.axis_laws import AxisLaw, Gain, Rows, delay_of, law_along
from eqt_cli.extensions.flights.axis_laws import unexplained as left_by
from eqt_cli.extensions.logs.api import MappingSource, command_series, log_errors, reading_once
from eqt_cli.extensions.logs.flight_list import ListedFlight, flights_in
from eqt_cli.extensions.logs.log_table import NORMALISED
from eqt_cli.extensions.logs.logs import Series, TrackingErrors
from eqt_cli.extensions.logs.many import placed
from eqt_cli.extensions.logs.recording import GAP

TERMS = ("stiffness", "damping", "integral", "feedforward", "gyroscopic")
OPTIONAL = ("integral", "feedforward", "gyroscopic")
"""Terms that a law may do without."""

GRAVITY = 9.80665
"""Standard gravity, m/s²."""

FEWEST = 100
"""Least number of rows of a command."""

AT_LIMIT, CLIPPED, ALL_ALONG = 3, 0.02, 0.5
"""Successive rows with the same largest or smallest command that are a limit; the shares of rows at
which it is told, and at which nothing is identified."""

AT_REST = 1e-3
"""Largest command relative to its mean of a flight at rest."""

ALIKE, APART = 1.1, 0.3
"""By how much more another form may leave of the command to fit as well, and by how much gains of
it must differ to be told."""

RESOLVED = 1e-6
"""Share of the square of a command below which forms leave nothing."""

POOR = 0.02
"""Share of the command that is unexplained from which a law is told to lack something."""

CHANGED = 0.1
"""Relative difference of the gains of two halves from which it is told."""


class Form(NamedTuple):
    """A form of the errors that a law feeds back.

    Attributes
    ----------
    stiffness, damping
        What the terms multiply, in words.
    """

    stiffness: str
    damping: str

    @property
    def words(self) -> str:
        """The form in words."""
        return f"{self.stiffness}, {self.damping}"


POSITION = [Form("p − p_d", damping) for damping in ("v − v_d", "v")]
ATTITUDE = [
    Form(*pair)
    for pair in product(
        ("½(E − Eᵀ)^∨", "2 sgn(q_w) q_v", "log E"), ("ω − Eᵀω_d", "ω", "(1 + q_vᵀq_v) ω")
    )
]
"""Forms of both loops; E = R_dᵀR, with the quaternion q."""

NEAREST = {"½(E − Eᵀ)^∨": "lee2010", "2 sgn(q_w) q_v": "quaternion", "log E": "logarithmic"}
"""The shipped law of each error of attitude."""


@dataclass(frozen=True)
class LoopLaw:
    """A law that flew.

    Attributes
    ----------
    loop, unit
        ``position`` or ``attitude``; the unit of the command.
    form, others
        The form that leaves least of the command, and others that fit as well, in words.
    delay, delays, period
        The delay, and those that the flights cannot exclude, s; the time between rows, s.
    axes
        The law along each axis.
    limits
        Share of rows at a limit, by the axis.
    changes
        Gains that differ between the first and the second half, in words.
    largest
        The largest error of attitude, rad, or of position, m.
    """

    loop: str
    unit: str
    form: Form
    others: list[str]
    delay: float
    delays: tuple[float, float]
    period: float
    axes: list[AxisLaw]
    limits: tuple[float, ...]
    changes: list[str]
    largest: float

    @property
    def gains(self) -> list[Gain]:
        """The gains of all axes."""
        return [gain for axis in self.axes for gain in axis.gains]

    def has(self, term: str) -> bool:
        """Whether a term is there along any axis."""
        return any(g.term == term and g.word in ("", "wrong sign") for g in self.gains)

    @property
    def is_identified(self) -> bool:
        """Whether stiffness and damping are, along all axes that move."""
        first = [g for g in self.gains if g.term in ("stiffness", "damping")]
        return bool(first) and all(g.word in ("", "none") for g in first)

    @property
    def nearest(self) -> str:
        """The nearest shipped law, and what it lacks, in words."""
        has = [term for term in OPTIONAL if self.has(term)]
        lacks = [term for term in OPTIONAL[1:] if not self.has(term)]
        if self.loop == "position":
            extra = "; it lacks the integral" if "integral" in has else ""
            without = "; the law that flew lacks its feedforward" if "feedforward" in lacks else ""
            return f"`cascade`, by its `position`{extra}{without}"
        name = NEAREST[self.form.stiffness]
        if len(lacks) == 2 and self.form.stiffness == "½(E − Eᵀ)^∨":
            name = "pd"
        elif "integral" in has:
            return f"`goodarzi2013`, a PID{_without(lacks)}"
        return f"`{name}`{'' if name in ('pd', 'quaternion') else _without(lacks)}"


def _without(lacks: Sequence[str]) -> str:
    return f"; the law that flew lacks its {listed(lacks)} term" if lacks else ""


@dataclass(frozen=True)
class IdentifiedLaws:
    """What flights say of the law that flew.

    Attributes
    ----------
    files
        The flights.
    loops
        The laws of the loops whose commands were logged.
    notes
        What was left out, and what is not sure.
    """

    files: list[str]
    loops: list[LoopLaw]
    notes: list[str]

    def headlines(self) -> list[str]:
        """Return the answer for each loop."""
        return [_headline(loop) for loop in self.loops]

    def tables(self) -> Iterator[TextTable]:
        """Yield a table of gains for each loop."""
        for loop in self.loops:
            rows = []
            for axis, law in zip("xyz", loop.axes, strict=True):
                for g in law.gains:
                    ends = f"[{significant(g.low, 3)}, {significant(g.high, 3)}]"
                    shown = g.word not in ("none", "not identifiable")
                    value = significant(g.value, 3) if shown else "-"
                    rows.append([axis, g.term, value, ends if np.isfinite(g.low) else "-", g.word])
            header = ["axis", "term", "gain", "95 % interval", ""]
            caption = f"{loop.loop} loop, command in {loop.unit}: {loop.form.words}"
            yield TextTable(loop.loop, caption, header, [Block("", rows)], [*_notes(loop)])

    @property
    def document(self) -> dict[str, Any]:
        """All numbers, for programs."""
        loops = []
        for loop in self.loops:
            facts: Any = dict(vars(loop)) | {"form": loop.form.words, "nearest": loop.nearest}
            facts["axes"] = [
                axis._asdict() | {"gains": [g._asdict() for g in axis.gains]} for axis in loop.axes
            ]
            loops.append(facts)
        return {"files": self.files, "loops": loops, "notes": self.notes}


def _headline(loop: LoopLaw) -> str:
    parts = []
    for term in TERMS:
        some = [g for g in loop.gains if g.term == term]
        values = [significant(g.value, 3) for g in some if g.word == ""]
        if len(values) == len(some) and values:
            parts.append(f"{term} {', '.join(values)}")
        elif any(g.word == "not identifiable" for g in some) and term in TERMS[:2]:
            axes = ", ".join(g.axis for g in some if g.word == "not identifiable")
            parts.append(f"{term} not identifiable along {axes}")
    late = f"{1e3 * loop.delay:.3g} ms late"
    said = "; ".join(parts) or "no term is sure"
    return f"{loop.loop} loop: {said}; {late}; nearest is {loop.nearest}"


def _notes(loop: LoopLaw) -> Iterator[str]:
    low, high = (1e3 * x for x in loop.delays)
    span = "" if low == high else f" ({low:.3g} to {high:.3g} ms are possible)"
    yield f"delay {1e3 * loop.delay:.3g} ms{span}, in steps of {1e3 * loop.period:.3g} ms"
    shares = [100 * axis.unexplained for axis in loop.axes]
    noise = [100 * axis.noise for axis in loop.axes]
    along = ", ".join(f"{x:.2g} %" for x in shares)
    whole = ", ".join(f"{x:.2g} %" for x in noise)
    yield f"unexplained along x, y, z: {along} of the command; with noise {whole}"
    for name, axis in zip("xyz", loop.axes, strict=True):
        if axis.unexplained > POOR:
            yield (
                f"along {name}, {100 * axis.unexplained:.2g} % of the command is not explained, "
                f"most about t = {axis.worst:.4g} s: another structure, or an equivalent law only"
            )
        if axis.alike:
            yield f"along {name}, this motion cannot tell apart {listed(axis.alike)}"
        wrong = [g.term for g in axis.gains if g.word == "wrong sign"]
        if wrong:
            yield f"along {name}, {listed(wrong)} has the wrong sign: another structure flew"
    if loop.others:
        yield f"fits as well: {'; '.join(loop.others)}"
    for name, share in zip("xyz", loop.limits, strict=True):
        if share > CLIPPED:
            at = f"is at a limit in {100 * share:.2g} % of the rows, which are left out"
            yield f"the command along {name} {at}"
    yield from loop.changes


# From a flight to rows ----------------------------------------------------------------------------


def _turns(numbers: Array) -> Any:
    from scipy.spatial.transform import Rotation  # slow to import

    whole: Any = np.isfinite(numbers).all(axis=1)
    return Rotation.from_quat(np.where(whole[:, None], numbers, [1.0, 0, 0, 0]), scalar_first=True)


class _At:
    """Numbers of series at the instants of a command."""

    def __init__(self, errors: TrackingErrors, times: Array) -> None:
        self.errors, self.times = errors, times
        self.shift = 1e-3 * float(np.median(np.diff(times)))

    def __call__(self, series: Series) -> Array:
        numbers = series.at(self.times + self.shift, "held")
        last = np.searchsorted(series.times, self.times + self.shift, side="right") - 1
        steps = np.diff(series.times)
        longest = GAP * float(np.median(steps)) if len(steps) else np.inf
        old = self.times - series.times[np.maximum(last, 0)] > longest
        return np.where(old[:, None], np.nan, numbers)

    def rate(self, numbers: Array) -> Array:
        """Return derivatives in time; held numbers are first interpolated."""
        t = self.times
        moved: Any = np.r_[True, (np.diff(numbers, axis=0) != 0).any(axis=1)]
        if moved.mean() < 0.5 and moved.sum() > 3:
            numbers = np.stack([np.interp(t, t[moved], x[moved]) for x in numbers.T], axis=-1)
        return np.gradient(numbers, t, axis=0)


def _integral(errors: Array, times: Array) -> Array:
    e = np.nan_to_num(errors)
    steps = np.diff(times, prepend=times[0])[:, None]
    return np.cumsum((e + np.vstack([e[:1], e[:-1]])) / 2 * steps, axis=0)


def _good(times: Array, command: Array, raw: Array, *more: Array) -> tuple[Array, Array]:
    """Return the rows that count, and the share of rows at a limit, by the column of `raw`."""
    good: Any = np.isfinite(np.hstack([command, *more])).all(axis=1)
    active = np.flatnonzero((raw != 0).any(axis=1))
    if len(active):  # a law that is off before and after
        rows = np.arange(len(times))
        good &= (rows >= active[0]) & (rows <= active[-1])
    shares = []
    for column in raw.T:
        at = np.zeros(len(column), bool)
        for end in (np.nanmin(column), np.nanmax(column)):
            same = column == end
            runs = np.convolve(same, np.ones(AT_LIMIT), "same") >= AT_LIMIT
            at |= same & np.convolve(runs, np.ones(AT_LIMIT), "same").astype(bool)
        if np.ptp(column) > 0:
            good &= ~at
            shares.append(float(at.mean()))
        else:
            shares.append(0.0)
    return good, np.array(shares)


def position_rows(
    name: str, errors: TrackingErrors, commands: Mapping[str, Series], mass: float = 0.0
) -> tuple[str, dict[str, Rows]] | None:
    """Return the unit and the rows of a position loop, by the damping; None without one."""
    actual, goals = errors.actual, errors.goals
    if not {"position"} <= {*actual} & {*goals}:
        return None
    thrust = commands.get("thrust", commands.get("force"))
    attitude = commands.get("attitude", goals.get("attitude"))
    lead = commands.get("acceleration", None if attitude is None else thrust)
    if lead is None or len(lead.times) < FEWEST:
        return None
    at = _At(errors, lead.times)
    raw = at(lead)
    if attitude is not None and lead is thrust:
        unit, pushed = lead.unit, raw[:, -1:]
        if len(raw[0]) == 3 and np.nanmax(abs(raw[:, :2])) > AT_REST * np.nanmax(abs(pushed)):
            return None  # a force that is not along z
        both = at(attitude)
        whole: Any = np.isfinite(both).all(axis=1)
        u = pushed * _turns(both).as_matrix()[:, :, 2]
        u = np.where(whole[:, None], u, np.nan)
        raw = pushed
        if "hover" in commands:
            u, unit = u * GRAVITY / at(commands["hover"]), "m/s^2"
        elif unit == "N" and mass:
            u, unit = u / mass, "m/s^2"
        elif unit == NORMALISED:
            u, unit = u * GRAVITY / np.nanmean(u[:, 2]), "m/s^2, if the mean thrust is the weight"
    else:
        u, unit = raw, lead.unit
    p, goal = at(actual["position"]), at(goals["position"])
    skip = 1 if "velocity" in actual else 2
    v = at(actual["velocity"]) if "velocity" in actual else np.gradient(p, lead.times, axis=0)
    wanted = at(goals["velocity"]) if "velocity" in goals else at.rate(goal)
    terms = {
        "stiffness": goal - p,
        "integral": _integral(goal - p, lead.times),
        "feedforward": at.rate(wanted),
    }
    good, shares = _good(lead.times, u, raw, p, goal, v, wanted)
    limits: Any = tuple(np.broadcast_to(shares, 3).tolist())
    rows = Rows(name, lead.times, u, terms, good, limits, skip)
    by_form = {POSITION[0]: wanted - v, POSITION[1]: -v}
    return unit, {
        form.words: replace(rows, terms=terms | {"damping": x}, cache={})
        for form, x in by_form.items()
    }


def attitude_rows(
    name: str, errors: TrackingErrors, commands: Mapping[str, Series]
) -> tuple[str, dict[str, Rows]] | None:
    """Return the unit and the rows of an attitude loop, by the form; None without one."""
    actual, goals = errors.actual, errors.goals
    if "torque" not in commands or "attitude" not in {*actual} & {*goals}:
        return None
    lead = commands["torque"]
    if len(lead.times) < FEWEST:
        return None
    at = _At(errors, lead.times)
    u, q, wanted = at(lead), at(actual["attitude"]), at(goals["attitude"])
    R, Rd = _turns(q), _turns(wanted)
    E = Rd.inv() * R
    t = lead.times

    def rate_of(turn: Any) -> Array:
        rates = np.full((len(t), 3), np.nan)
        rates[1:-1] = (turn[:-2].inv() * turn[2:]).as_rotvec() / (t[2:] - t[:-2])[:, None]
        return rates

    skip = 1 if "rates" in actual else 2
    w = at(actual["rates"]) if "rates" in actual else rate_of(R)
    moves = norm((Rd[0].inv() * Rd).as_rotvec()).max() > 1e-9
    wd = at(goals["rates"]) if "rates" in goals else rate_of(Rd) if moves else 0 * w
    seen = E.inv().apply(np.nan_to_num(wd))
    quaternion: Array = E.as_quat(canonical=True, scalar_first=True)
    vector = quaternion[:, 1:]
    stiffness = {
        "½(E − Eᵀ)^∨": 2 * quaternion[:, :1] * vector,
        "2 sgn(q_w) q_v": 2 * vector,
        "log E": E.as_rotvec(),
    }
    damping = {
        "ω − Eᵀω_d": w - seen,
        "ω": w,
        "(1 + q_vᵀq_v) ω": (1 + (vector**2).sum(axis=1))[:, None] * w,
    }
    products = np.stack([w[:, 1] * w[:, 2], w[:, 2] * w[:, 0], w[:, 0] * w[:, 1]], axis=-1)
    terms = {"gyroscopic": products}
    if moves:  # the change of Eᵀω_d
        change = E.inv().apply(np.nan_to_num(at.rate(np.nan_to_num(wd))))
        terms["feedforward"] = change - np.cross(np.nan_to_num(w), seen)
    good, shares = _good(t, u, u, q, wanted, w, wd)
    limits: Any = tuple(shares.tolist())
    by_form = {}
    for form in ATTITUDE:
        if not moves and form.damping == "ω − Eᵀω_d":
            continue
        error = stiffness[form.stiffness]
        more = {
            "stiffness": -error,
            "damping": -damping[form.damping],
            "integral": -_integral(error, t),
        }
        by_form[form.words] = Rows(name, t, u, terms | more, good, limits, skip)
    return lead.unit or "N m", by_form


# From rows to laws --------------------------------------------------------------------------------


def law_of(loop: str, unit: str, flights: Sequence[Mapping[str, Rows]], period: float) -> LoopLaw:
    """Return the law of a loop; raises an `EqtError` where nothing can be said."""
    forms = [x for x in (POSITION if loop == "position" else ATTITUDE) if x.words in flights[0]]
    by_form = {form: [flight[form.words] for flight in flights] for form in forms}
    first = by_form[forms[0]]
    for rows in first:
        share = max(rows.limits)
        if share > ALL_ALONG:
            what = f"the command is at a limit in {100 * share:.2g} % of its rows"
            raise EqtError(f"{rows.name}: {what}; identify a part without it, by --begin and --end")
        u = rows.command[rows.good]
        if len(u) < 2 or norm(u - u.mean(axis=0)).max() <= AT_REST * norm(u).max():
            why = "its command hardly changes" if len(u) else "it has no rows with all it needs"
            raise EqtError(f"{rows.name}: {why}, so that no law can be told from it")
    names = [term for term in TERMS if term in first[0].terms]
    delay, span = delay_of(first, names, period)
    step_of = max(rows.step for rows in first)
    for _ in range(2):  # the delay of the first form may be that of another one
        left = {form: left_by(rows, names, delay, period) for form, rows in by_form.items()}
        least = max(min(one.total for one in left.values()), RESOLVED)
        fitting = [x for x in forms if left[x].total <= ALIKE**2 * least]
        form = min(fitting or forms, key=lambda x: left[x].whole)
        before, (delay, span) = delay, delay_of(by_form[form], names, period)
        if delay == before:
            break
    flights_of = by_form[form]
    optional = [name for name in names if name in OPTIONAL]

    def axes_of(some: Sequence[Rows]) -> list[AxisLaw]:
        return [law_along(some, axis, names, optional, delay, period) for axis in range(3)]

    axes = axes_of(flights_of)
    most = ALIKE**2 * left[form].whole
    others = [x.words for x in fitting if x != form and left[x].whole <= most]
    limits = np.mean([rows.limits for rows in flights_of], axis=0).tolist()
    largest = max(float(norm(rows.terms["stiffness"][rows.good]).max()) for rows in flights_of)
    changes = [*_changes(flights_of, axes_of)] if len(flights_of) == 1 else []
    return LoopLaw(
        loop,
        unit,
        form,
        others,
        delay * step_of,
        (span[0] * step_of, span[1] * step_of),
        step_of,
        axes,
        tuple(limits),
        changes,
        largest,
    )


def _changes(flights: Sequence[Rows], axes_of: Any) -> Iterator[str]:
    """Say which gains differ between the halves of a flight."""
    (rows,) = flights
    middle = rows.times[rows.good].mean() if rows.good.any() else 0.0
    halves = [
        axes_of([replace(rows, good=rows.good & ((rows.times < middle) == first))])
        for first in (True, False)
    ]
    for one, other in zip(*halves, strict=True):
        for a, b in zip(one.gains, other.gains, strict=True):
            if a.word or b.word or a.term not in TERMS[:2]:
                continue
            apart = abs(a.value - b.value)
            widths = (a.high - a.low) / 2 + (b.high - b.low) / 2
            if apart > 1.5 * widths and apart > CHANGED * max(abs(a.value), abs(b.value)):
                before, behind = significant(a.value, 3), significant(b.value, 3)
                values = f"{before} before {middle:.4g} s, {behind} behind"
                yield f"along {a.axis}, {a.term} is {values}: did the gains change in flight?"


def identify_law(
    paths: Sequence[str | os.PathLike[str]],
    mapping: MappingSource = None,
    *,
    format: str = "csv",
    law: str = "",
    period: float = 0.0,
    mass: float = 0.0,
    begin: float | str = -np.inf,
    end: float | str = np.inf,
    **how: Any,
) -> IdentifiedLaws:
    """Identify the law that flew, from state, setpoints and commands.

    A command is a sum of gains times errors, of a time before. Instrumental variables find the
    gains, because the log's state has noise that the law did not see.

    Parameters
    ----------
    paths
        Recordings, folders or lists of flights, all of one law.
    mapping, format, begin, end
        As for `log_errors`.
    law
        The law in a list of flights of several ones.
    period
        Length of a lap, s, if flights repeat one: other laps are then the instruments, which also
        removes noise that is correlated from row to row.
    mass
        The mass that the law assumes, kg, by which a thrust in N is divided.
    how
        Other arguments of `log_errors`.

    Returns
    -------
    IdentifiedLaws
        The gains of each term along each axis, with their 95 % intervals, the delay, and what is
        left unexplained.

    Raises
    ------
    EqtError
        If a flight cannot be read, or has neither setpoints nor commands of a loop.

    Examples
    --------
    >>> import numpy as np
    >>> t = np.arange(0, 20, 0.02)
    >>> wanted = np.c_[np.sin(t), np.cos(2 * t), 0.3 * np.sin(3 * t)]
    >>> speed = np.c_[np.cos(t), -2 * np.sin(2 * t), 0.9 * np.cos(3 * t)]
    >>> error = np.outer(0.1 * np.sin(1.7 * t) + 0.2 * np.sin(0.6 * t), [1, 1, 1])
    >>> rate = np.outer(0.17 * np.cos(1.7 * t) + 0.12 * np.cos(0.6 * t), [1, 1, 1])
    >>> rows = np.c_[t, wanted + error, speed + rate, wanted, speed, -4 * error - 3 * rate]
    >>> names = "t,x,y,z,vx,vy,vz,x_ref,y_ref,z_ref,vx_ref,vy_ref,vz_ref,ux,uy,uz"
    >>> np.savetxt("flown.csv", rows, delimiter=",", header=names, comments="")
    >>> commands = {"command": {"ax": "ux", "ay": "uy", "az": "uz"}}
    >>> law = eqt_cli.identify_law(["flown.csv"], commands).loops[0]
    >>> [(g.term, round(g.value, 2)) for g in law.axes[0].gains if not g.word]
    [('stiffness', 4.0), ('damping', 3.0)]
    """
    flights = [flight for path in paths for flight in flights_in(path)]
    laws = [*dict.fromkeys(x.law for x in flights if x.law)]
    if len(laws) > 1 or law:
        if law not in laws:
            if not laws:
                raise EqtError("law: no list of flights names a law in its column law; remove it")
            what = f"expected one of {', '.join(laws)}, because flights of two laws have no common"
            raise EqtError(f"law: {what} gains; got {law or 'none'}")
        flights = [x for x in flights if x.law == law]
    notes, loops = dict[str, None](), dict[str, list[tuple[str, dict[str, Rows]]]]()
    if not 0 <= period < np.inf or not 0 <= mass < np.inf:
        raise EqtError(f"expected a period and a mass of at least 0, got {period:g} and {mass:g}")
    with step("flights", len(flights)) as progress:
        for flight in flights:
            with placed(flight), reading_once():
                _read(
                    flight, mapping, format, {"begin": begin, "end": end} | how, loops, notes, mass
                )
            progress.advance(1)
    identified = []
    for loop, some in loops.items():
        if len(some) < len(flights):
            notes[f"{loop} loop: {len(some)} of {len(flights)} flights have its command"] = None
        identified.append(law_of(loop, some[0][0], [rows for _, rows in some], period))
    return IdentifiedLaws([f"{x.file}" for x in flights], identified, [*notes])


def _read(
    flight: ListedFlight,
    mapping: MappingSource,
    format: str,
    how: dict[str, Any],
    loops: dict[str, list[tuple[str, dict[str, Rows]]]],
    notes: dict[str, None],
    mass: float,
) -> None:
    """Add the rows of a flight to those of its loops."""
    name = f"{flight.file}"
    errors = log_errors(flight.file, **{"mapping": mapping, "format": format} | how | flight.how)
    commands = command_series(flight.file, flight.mapping or mapping, format)
    span = [series.times for series in errors.actual.values()]
    low, high = max(t[0] for t in span), min(t[-1] for t in span)
    for quantity, one in commands.items():
        rows = (one.times >= low - 1e-6) & (one.times <= high + 1e-6)
        commands[quantity] = one._replace(times=one.times[rows], numbers=one.numbers[rows])
    notes |= {f"{flight.file.name}: {remark}": None for remark in errors.remarks}
    is_any = False
    for loop, rows in (
        ("position", position_rows(name, errors, commands, mass)),
        ("attitude", attitude_rows(name, errors, commands)),
    ):
        if rows is not None:
            loops.setdefault(loop, []).append(rows)
            is_any = True
    if not is_any:
        has, wanted = (listed([*x]) if x else "none" for x in (commands, errors.goals))
        raise EqtError(
            f"{name}: has no command of a loop (commands: {has}; setpoints: {wanted}); "
            "a position loop commands an acceleration, or a thrust "
            "with an attitude setpoint; an attitude loop a torque with an attitude setpoint; name "
            "them in a mapping, `command: {thrust: …}` or `{tx: …, ty: …, tz: …}`"
        )
