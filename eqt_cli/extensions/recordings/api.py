"""Reads and checks recordings, replays and fits a plant, compares a recording with runs."""

import os
import re
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any, Literal, TypeAlias, get_args

import numpy as np

from eqt_cli.analysis.gate import rules_of
from eqt_cli.api.loading import Configuration, ResultPath, document_from, open_at, path_from
from eqt_cli.base import yaml_source
from eqt_cli.base.errors import EqtError, InputError, Problems
from eqt_cli.base.files import refusals, text_of
from eqt_cli.base.option_types import validated
from eqt_cli.base.reporting import step
from eqt_cli.base.units import factor
from eqt_cli.components import pose_tables
from eqt_cli.components.groups import MatrixLieGroup, group_named, known_group
from eqt_cli.components.pose_tables import LogMapping, MappingError, TrajectoryFormat
from eqt_cli.config.document import Document
from eqt_cli.config.experiment import Experiment
from eqt_cli.config.preflight import build
from eqt_cli.config.schema import without_search
from eqt_cli.extensions.recordings import flights, frames, logs, plant_fit, prediction
from eqt_cli.extensions.recordings.first_bytes import format_of
from eqt_cli.extensions.recordings.log_table import open_sheet
from eqt_cli.extensions.recordings.logs import Flight, LogCheck, Series, TrackingErrors, flight_of
from eqt_cli.extensions.recordings.measured import Explanation, explained, measured_runs
from eqt_cli.extensions.recordings.plant_fit import PlantFit, check_folder, write_fitted
from eqt_cli.extensions.recordings.prediction import Growth, Windows
from eqt_cli.extensions.recordings.recording import read_log, recorded_names
from eqt_cli.extensions.recordings.recording_check import Recording, recording_of
from eqt_cli.extensions.recordings.tables import text_of_recording, with_columns
from eqt_cli.loop.closed_loop import ClosedLoop
from eqt_cli.results.result import Result

_Mapping: TypeAlias = str | os.PathLike[str] | Mapping[str, Any] | None

# Reads and checks recordings ----------------------------------------------------------------------


def _literal(kind: Any, option: str, text: str) -> Any:
    """Return a text that is one of a `Literal`'s, or raise an `InputError`."""
    if text not in get_args(kind):
        raise InputError(f"{option}: expected one of {', '.join(get_args(kind))}, got {text!r}")
    return text


def check_log(
    path: str | os.PathLike[str],
    mapping: _Mapping = None,
    *,
    format: str = "csv",
    group: str | None = None,
) -> LogCheck:
    r"""Read a recording and report its columns, units, times and irregularities.

    Parameters
    ----------
    path
        The recording; a file name that ends in ``.ulg`` is a PX4 flight log.
    mapping
        Information that the file does not contain (columns, units, frames, times), as a YAML file
        or a mapping with the keys of ``reference.mapping``.
    format
        ``csv`` with a header that names the columns, ``tum`` or ``euroc``.
    group
        Group of the poses. Default: the group that fits the columns.

    Returns
    -------
    LogCheck
        The report. Its ``problems`` are empty if the recording can be used as waypoints.

    Raises
    ------
    EqtError
        If the file does not exist or holds no poses.
    ConfigError
        If the mapping is wrong or does not fit the file, with the place of each problem.

    Examples
    --------
    >>> from pathlib import Path
    >>> rows = "stamp,yaw (deg),pitch,roll\n0,0,0,0\n10,1,0,0\n20,2,0,0\n"
    >>> _ = Path("flight.csv").write_text(rows)
    >>> check = eqt_cli.check_log("flight.csv", {"columns": {"t": "stamp"}, "units": {"t": "ms"}})
    >>> check.group, check.rate, check.notes
    ('SO3', 100.0, [])
    """
    G, flight = None if group is None else group_named(group), _flight(path)
    with _read(path, mapping, format, flight) as log:
        check = logs.check_text(*log, G)
    more: Any = {"topics": [*logs.topics_of(flight)], "format": flight.format} if flight else {}
    return replace(check, **more)


def read_measured(
    path: str | os.PathLike[str], G: MatrixLieGroup, mapping: _Mapping = None, format: str = "csv"
) -> Recording:
    """Read a recording as a motion on a group; arguments and errors as for `check_log`."""
    with _read(path, mapping, format) as (text, name, kind, columns):
        return recording_of(read_log(text, name, kind, G, columns))


def _driving(
    path: str | os.PathLike[str], G: MatrixLieGroup, mapping: _Mapping, format: str
) -> Recording:
    """Read a recording of a wrench; rates are enough for a rotation, and its poses then NaN."""
    rates, names = recorded_names(G, ["rates"]), pose_tables.pose_columns(G)
    with _read(path, mapping, format) as (text, name, kind, columns):
        sheet = open_sheet(text, name, kind, columns)
        used, units = pose_tables.used_columns(sheet.names, G), sheet.units | columns.units
        is_pose = used and (used.layout != "coordinates" or factor(units.get(rates[0], ""), "rad"))
        if is_pose or len(rates) < G.dimension or not {*rates} <= {*sheet.names}:
            return recording_of(read_log(text, name, kind, G, columns))
        rest = [0.0] * (len(names) - 1) + [float(len(names) > 1)]
        text = with_columns(text, ",".join(names), np.tile(rest, (len(sheet.lines), 1)))
        recording = recording_of(read_log(text, name, kind, G, columns))
        return replace(recording, poses=np.full_like(recording.poses, np.nan))


def _flight(path: str | os.PathLike[str], mapping: _Mapping = None) -> Flight | None:
    """Return the topics of a file of another program; None for a table.

    Of a mapping, they obey `drop`, `time`, and `t` of `columns` if that is the recorder's time.
    """
    file = path_from("path", path)
    if not format_of(file):
        return None
    with refusals(file, "read"):
        return flight_of(file)._replace(mapping=_mapping_from(mapping)[0])


def _mapping_from(mapping: _Mapping) -> tuple[LogMapping, Problems]:
    """Return a mapping, and the problems that note their place in it."""
    if mapping is None:
        return LogMapping(), Problems()
    if isinstance(mapping, Mapping):
        source = yaml_source.load(yaml_source.flow(mapping), "mapping")
    else:
        place = path_from("mapping", mapping, "a path or a mapping")
        source = yaml_source.load(text_of(place, "check the path"), str(place))
    problems = Problems(source.key_place)
    columns = validated(LogMapping, source.data, problems) or LogMapping()
    columns.check(problems)
    problems.raise_if_any()
    return columns, problems


@contextmanager
def _read(
    path: str | os.PathLike[str], mapping: _Mapping, format: str, flight: Flight | None = None
) -> Iterator[tuple[str, str, TrajectoryFormat, LogMapping]]:
    """Yield text, name, format and mapping; note a problem of the mapping at its place."""
    kind, file = _literal(TrajectoryFormat, "format", format), path_from("path", path)
    columns, problems = _mapping_from(mapping)
    smaller = "cut it into parts, leave out columns, or keep every tenth row"
    text = flight and logs.table_of(flight)
    text = text or text_of_recording(file, "check the path", EqtError, logs.MAX_BYTES, smaller)
    kind = _kind_of(text) if kind == "csv" else kind
    try:
        yield text, str(file), kind, columns
    except MappingError as error:
        problems.at(*error.path).add(str(error))
        problems.raise_if_any()
        raise


def _kind_of(text: str) -> TrajectoryFormat:
    """Return the format of a table by its first row of numbers."""
    row = next((line for line in text[:10_000].splitlines() if line[:1] != "#"), "")
    if re.fullmatch(r"\s*([-+.\deE]+\s+){7}[-+.\deE]+\s*", row):
        return "tum"
    return "euroc" if re.match(r"\d{16,}(\.0*)?(,\s*[-+.\deE]+){7}", row) else "csv"


def log_errors(
    path: str | os.PathLike[str],
    second: str | os.PathLike[str] | None = None,
    mapping: _Mapping = None,
    *,
    format: str = "csv",
    second_mapping: _Mapping = None,
    second_format: str | None = None,
    topic: str | None = None,
    setpoint: str | None = None,
    association: str = "linear",
    align: str | None = None,
    relative: int | str | None = None,
    begin: float | str = -np.inf,
    end: float | str = np.inf,
    disarmed: bool = False,
    out: str | os.PathLike[str] | None = None,
) -> TrackingErrors:
    """Measure how far a recorded vehicle was from its setpoints, or from a second recording.

    Of measurement and setpoint, the smoother one is interpolated to the instants of the other:
    positions, velocities and rates linearly, attitudes along the shortest rotation. Only
    instants while armed count, and nothing is interpolated over a gap, a change of the mode, or a
    reset of the estimator. The times of two files are those of one clock, of which none is moved.

    Parameters
    ----------
    path, mapping, format
        As for `check_log`; without others, also those of the second file.
    second_mapping, second_format
        Those of the second file.
    second
        The recording of what was wanted. Default: the setpoints in the file.
    topic, setpoint
        Topics of the measurement and of the setpoints. Default: the first that the file has.
        The setpoint ``desired`` are the desired values of ArduPilot in place of its targets.
    association
        ``linear``; ``nearest``: for each row of the shorter one, the other at the nearest time, at
        most 0.01 s away; ``held``: the last measurement.
    align
        Moves the measured positions to the wanted ones first: ``rigid`` or ``similarity`` (with a
        scale) by least squares (Umeyama), ``yaw`` likewise but about z only, as for estimates that
        know gravity, ``origin`` by the first pose.
    relative
        Compare the motions over so many instants in place of the poses or, as in ``5m``, over
        metres of the desired path.
    begin, end
        The first and the last time to compare, s, by the clock of the files; a text such as ``+5``
        counts from the first row of `path`.
    disarmed
        Whether times while disarmed count, too.
    out
        Output folder for the figure ``errors``, and a CSV of each quantity. Default: no files.

    Returns
    -------
    TrackingErrors
        Root mean square, median and largest error by quantity and axis, a significant delay with
        its standard error, and the errors over time.

    Raises
    ------
    EqtError
        If a file cannot be read, or has nothing to compare.

    Examples
    --------
    >>> import numpy as np
    >>> t = np.linspace(0, 6, 61)
    >>> wanted = np.c_[t, np.sin(t), np.cos(t), 0 * t]
    >>> late = np.c_[t + 0.1, wanted[:, 1:]]
    >>> for name, rows in (("wanted.csv", wanted), ("flown.csv", late)):
    ...     np.savetxt(name, rows, delimiter=",", header="t,x,y,z", comments="")
    >>> size = eqt_cli.log_errors("flown.csv", "wanted.csv").sizes[0]
    >>> round(size.rms, 3), round(size.delay, 3), round(size.remains, 3)
    (0.1, 0.1, 0.0)
    """
    _literal(Literal["linear", "nearest", "held"], "association", association)
    _literal(Literal["rigid", "similarity", "yaw", "origin"], "align", align or "rigid")
    over = re.fullmatch(r"(\d+|\d*\.?\d+ ?(m))", f"{relative or 1}")
    if not over or relative == 0 or not (size := float(over[1].rstrip("m "))) > 0:
        expected = "expected instants, as 50, or metres of the path, as 5m"
        raise EqtError(f"relative: {expected}, got {relative!r}")
    parts = None if relative is None else (size, over[2] or "")
    flight, spans, of = _flight(path, mapping), logs.NO_SPANS, " setpoint"
    if flight is None and second is None and format == "csv":
        with _read(path, mapping, format) as (text, name, *_):
            flight, mapping = logs.flight_of_table(text, name), None
    of_second = mapping if second_mapping is None else second_mapping
    other = None if second is None else _flight(second, of_second)
    if second is not None and second_mapping is None and (flight is None) != (other is None):
        # One mapping of a log and a table is that of the table, but for the rows to leave out
        drop = LogMapping(drop=_mapping_from(mapping)[0].drop)
        flight, other = (x and x._replace(mapping=drop) for x in (flight, other))
    for source in filter(None, (flight, other)):
        rest = replace(source.mapping, columns={}, drop=[], world=None, body=None)
        if replace(rest, time=replace(rest.time, begin=None, end=None)) != LogMapping():
            keys = "`drop`, `world`, `body`, begin and end of `time`, and the recorder's `columns`"
            raise EqtError(f"mapping: of a log, errors take only {keys}")
    measured = _series(path, flight, mapping, format, topic)
    if second is not None:
        about = None if flight else _point(path, mapping, format)
        goals = _series(second, other, of_second, second_format or format, setpoint, about=about)
    elif flight is None:
        raise EqtError(f"{path}: a table has no setpoints; give a second file with them")
    else:
        setpoint, of = (None, " desired") if setpoint == "desired" else (setpoint, of)
        goals = _series(path, flight, mapping, format, setpoint, of)
        spans = logs.spans_of(flight, disarmed)
    actual, wanted = _chosen(measured, goals, second is None and setpoint is None)
    begins = [t for series in actual.values() for t in series.times[:1]]
    span = [_instant(*bound, begins) for bound in (("begin", begin), ("end", end))]
    errors = logs.tracking_errors(f"{path}", actual, wanted, spans, association, align, parts, span)
    errors = errors._replace(flight=flight)
    if out is not None:
        from eqt_cli.extensions.recordings.figures import save_errors  # slow to import

        save_errors(errors, f"{path}", Path(out))
    return errors


def _instant(name: str, value: float | str, begins: Sequence[float]) -> float:
    """Return a time, s; a text with a sign counts from the first of some times."""
    try:
        return float(value) + f"{value}".startswith("+") * min(begins, default=0.0)
    except ValueError:
        expected = "expected seconds, as 12.5 by the clock of the file or +5 from its first row"
        raise EqtError(f"{name}: {expected}, got {value!r}") from None


def _point(path: Any, mapping: Any, format: str) -> Any:
    """Return the point about which latitudes of a table are positions; None without any."""
    with _read(path, mapping, format) as (text, name, kind, columns):
        positions = open_sheet(text, name, kind, columns).geodetic
        return positions and positions.about._asdict()


def _series(
    path: Any,
    flight: Flight | None,
    mapping: Any,
    format: str,
    topic: str | None,
    of: str = "",
    about: Any = None,
) -> dict[str, list[Series]]:
    """Return the series of each quantity, the first of the table first; of a topic, if named.

    Latitudes are about a point, if the mapping states none.
    """
    if flight is None:
        with _read(path, mapping, format) as (text, name, kind, columns):
            columns = replace(columns, geodetic=columns.geodetic or about)
            G = logs.largest_group(text, name, kind, columns)
            motions = logs.motions_of(read_log(text, name, kind, G, columns))
            return {quantity: [series] for quantity, series in motions.items()}
    kinds, topics = [of], flight.topics
    if topic is not None:
        kinds, topics = (
            [of, "", " setpoint"],
            [candidate for candidate in topics if candidate.name == topic],
        )
        topics = topics or list(filter(None, [frames.composed(flight.topics, topic)]))
        if not topics:
            raise EqtError(f"{path}: has no topic '{topic}'; eqt log check lists them")
    flight = flight._replace(topics=topics)
    every = {q: [s for k in kinds for s in flight.series(q + k, not of)] for q in logs.QUANTITIES}
    turned = {q: [frames.in_axes(q, s, flight.mapping) for s in some] for q, some in every.items()}
    return {quantity: some for quantity, some in turned.items() if some}


def _chosen(
    measured: dict[str, list[Series]], goals: dict[str, list[Series]], differ: bool
) -> tuple[dict[str, Series], dict[str, Series]]:
    """Return the first pair of each quantity: usable, of the same axes, and of different fields."""
    actual = {q: some[0] for q, some in measured.items()}
    wanted: dict[str, Any] = {q: some[0] for q, some in goals.items()}
    for q in [q for q in actual if q in goals]:  # the position first, whose topic leads
        lead = actual.get("position", actual[q]).topic
        pairs: list[Any] = [(k, w) for w in goals[q] for k in measured[q]]
        pairs = [(k, w) for k, w in pairs if not differ or k.fields != w.fields]
        odd = [(k.is_odd or w.is_odd, k.axes != w.axes, k.topic != lead) for k, w in pairs]
        best = odd.index(min(odd)) if odd else 0
        actual[q], wanted[q] = (pairs or [(actual[q], None)])[best]
    return actual, {q: series for q, series in wanted.items() if series is not None}


# Compares flights ---------------------------------------------------------------------------------


def compare_flights(
    paths: Sequence[str | os.PathLike[str]],
    against: Sequence[str | os.PathLike[str]] = (),
    *,
    pair: bool = False,
    within: str = "",
    period: float = 0.0,
    metrics: Sequence[str] = (),
    of: str = "rms",
    negligible: float = 0.05,
    all_parameters: bool = False,
    fail_on: Sequence[str] = (),
    out: str | os.PathLike[str] | None = None,
    **how: Any,
) -> flights.FlightComparison:
    """Compare the tracking errors of flights with one setting against those with another.

    Parameters
    ----------
    paths, against
        Recordings of both settings, A and B, or folders of them.
    pair
        Whether the first of `paths` belongs to the first of `against`, and so on.
    within
        The order of laps of both settings in a single recording, such as ``ABABAB``; each two
        neighbours are a pair.
    period
        Length of a lap, s. The error of a flight is then the geometric mean over its laps.
    metrics
        Quantities to compare, such as ``position``. Default: all that all flights have.
    of
        The size of an error over a flight: ``rms``, ``median`` or ``largest``.
    negligible
        Relative difference that counts as none.
    all_parameters
        Whether parameters count that autopilots write themselves.
    fail_on
        Rules, such as ``position worse by 10 %``.
    out
        Output folder for the figure ``flights``. Default: no figure.
    how
        Other arguments of `log_errors`, such as ``second``, ``mapping`` and ``begin``.

    Returns
    -------
    FlightComparison
        The ratio of the errors of A to those of B, by the quantity, and what else differs.

    Raises
    ------
    EqtError
        If a file cannot be read, stands twice, is too short, or was changed in flight.

    Examples
    --------
    >>> import numpy as np
    >>> t, files = np.linspace(0, 20, 201), ([], [])
    >>> for k in range(10):
    ...     size = (0.8 if k < 5 else 1.0) * (1 + 0.01 * k**2)
    ...     files[k // 5].append(f"flight{k}.csv")
    ...     rows = np.c_[t, np.sin(t), size + 0 * t, 0 * t]
    ...     np.savetxt(f"flight{k}.csv", rows, delimiter=",", header="t,x,y,z", comments="")
    >>> wanted = np.c_[t, np.sin(t), 0 * t, 0 * t]
    >>> np.savetxt("wanted.csv", wanted, delimiter=",", header="t,x,y,z", comments="")
    >>> eqt_cli.compare_flights(*files, second="wanted.csv").pairs[0].word
    <Word.BETTER: 'better'>
    """
    rules, paired = rules_of(fail_on), pair or bool(within)
    files = [[x for path in some for x in flights.files_in(path)] for some in (paths, against)]
    _literal(Literal["rms", "median", "largest"], "of", of)
    wanted = {*metrics, *(rule.metric for rule in rules if rule.margin < np.inf)}
    if odd := wanted - {*logs.QUANTITIES}:
        raise EqtError(f"expected {', '.join(logs.QUANTITIES)}; got {min(odd)!r}")
    if within and not (period and len(files[0]) == 1 and re.fullmatch("(AB|BA)+[AB]?", within)):
        turns = "laps in turns, as ABAB, because wind and battery change with time"
        raise EqtError(f"within: expected one file, a period, and {turns}; got {within!r}")
    if bool(against) == bool(within) or not paths:
        raise EqtError("against: expected flights with the other setting, or within")
    a, b = ([file.name for file in side] for side in files)
    if pair and (len(a) != len(b) or ({*a} & {*b} and a != b)):
        got = f"{', '.join(a)} and {', '.join(b)}"
        raise EqtError(f"pair: expected as many files of both sides, in one order; got {got}")
    rows = [[(side, file) for file in some] for side, some in zip("AB", files, strict=True)]
    ordered = [x for two in (zip(*rows, strict=True) if pair else rows) for x in two]
    tracked, turns = partial(log_errors, **how), within[: len(within) // 2 * 2]
    with step("flights", len(ordered)):
        flown = [*flights.read_flights(ordered, tracked, of, period, turns)]
    comparison = flights.compared(flown, paired, metrics, negligible, all_parameters, rules)
    if out is not None:
        from eqt_cli.extensions.recordings.figures import save_flights  # slow to import

        save_flights(comparison, Path(out))
    return comparison


# Compares a model driven by a recorded wrench with the recording, and fits the model --------------


WINDOWS, OF_FIT = 10, 20
"""Length of a recording divided by the default length of a window, for `replay` and for `fit`."""

MOST_WINDOWS = 50
"""Default largest number of predicted windows."""


def replay(
    config: Configuration | Document,
    measured: str | os.PathLike[str],
    mapping: _Mapping = None,
    *,
    format: str = "csv",
    hold: str = "zero",
    delay: float = 0.0,
    horizon: float | None = None,
    windows: int = MOST_WINDOWS,
    out: str | os.PathLike[str] | None = None,
    trust_plugins: bool = False,
) -> Growth:
    """Predict a recording from many of its rows, and measure the growth of the error.

    The plant of a configuration starts in the recorded states, and the recorded wrench drives it.
    Control laws, control clock and sensors of the configuration are not used.

    Parameters
    ----------
    config
        A configuration as for `load_experiment`. Its group, inertia, plant, actuators and solver
        are used.
    measured
        The recording, with poses (of a rotation, rates are enough) and wrenches.
    mapping, format
        As for `check_log`.
    hold
        Wrench between two rows: ``zero`` holds the first one, ``linear`` interpolates.
    delay
        The time by which the wrench was recorded late, s: at t acts the recorded wrench of
        t + delay. The plant is moved in time for it, with whatever else depends on time.
    horizon
        Longest prediction, s. Default: a tenth of the recording.
    windows
        Largest number of start rows, which are spread over the recording.
    out
        Output folder for the figure ``replay`` as PDF, SVG and PNG. Default: no figure.
    trust_plugins
        Whether to execute plugin sources that are stored in a result.

    Returns
    -------
    Growth
        The error of each part at up to ten horizons: median, quantiles, and the error due to noise.

    Raises
    ------
    ConfigError
        With all problems of the configuration or of the mapping.
    EqtError
        If the recording has no wrench or no section of this length without a gap, or if a part of
        the plant has a state that recordings do not contain.

    Examples
    --------
    The recording of a wheel of 2 kg m² under 1 N m. The model has 0.4 kg m²:

    >>> import numpy as np
    >>> t = np.linspace(0, 4, 41)
    >>> rows = np.stack([t, t**2 / 4, t / 2, 0 * t + 1], axis=1)
    >>> np.savetxt("wheel.csv", rows, delimiter=",", header="t,angle,wz,tz", comments="")
    >>> errors = eqt_cli.replay("configs/so2.yaml", "wheel.csv", horizon=1.0)
    >>> float(errors.median[0, -1].round(6))  # ½ (1/0.4 − 1/2) rad/s² · (1 s)²
    1.0
    """
    base, cut, plant = _opened(
        config, measured, mapping, format, hold, horizon, WINDOWS, delay, trust_plugins
    )
    if windows < 1:
        raise EqtError(f"windows: expected 1 or more, got {windows}")
    errors = prediction.growth(plant(base), base.engine, cut, windows, delay)
    errors = replace(errors, notes=(*errors.notes, *_notes(base, cut)))
    if out is not None:
        from eqt_cli.extensions.recordings.figures import save_growth  # slow to import

        save_growth(errors, Path(out))
    return errors


def fit(
    config: Configuration | Document,
    measured: str | os.PathLike[str],
    over: Sequence[str],
    mapping: _Mapping = None,
    *,
    format: str = "csv",
    hold: str = "zero",
    delay: float = 0.0,
    horizon: float | None = None,
    out: str | os.PathLike[str] | None = None,
    trust_plugins: bool = False,
) -> PlantFit:
    """Fit numbers of a plant so that it predicts a recording best.

    The fit minimises the sum of the squared errors of replayed windows, each divided by the noise
    of the recording. The fitted configuration is written as ``fitted.yaml``.

    Parameters
    ----------
    config, measured, mapping, format, hold, delay, trust_plugins
        As for `replay`. The search starts at the numbers of the configuration.
    over
        Keys of numbers in `inertia`, `plant` and `actuators`; ``linear[0:3]`` is one number for
        three entries. ``delay`` finds the delay of the wrench, from the one that is given.
    horizon
        Length of a window, s. Default: a twentieth of the recording.
    out
        Output folder. Default: ``results/<name>-fitted``.

    Returns
    -------
    PlantFit
        The numbers with their intervals, and the errors before and after the fit.

    Raises
    ------
    ConfigError, EqtError
        As for `replay`. Also if a key is not a number of the plant, or the recording does not
        determine it.

    Examples
    --------
    The recording of a wheel of 2 kg m² under 1 N m. The search starts at 0.4 kg m²:

    >>> import numpy as np
    >>> t = np.linspace(0, 4, 41)
    >>> rows = np.stack([t, t**2 / 4, t / 2, 0 * t + 1], axis=1)
    >>> np.savetxt("wheel.csv", rows, delimiter=",", header="t,angle,wz,tz", comments="")
    >>> fit = eqt_cli.fit("configs/so2.yaml", "wheel.csv", ["inertia"], horizon=0.5)
    >>> round(fit.numbers[0].value, 4)
    2.0
    """
    base, cut, plant = _opened(
        config, measured, mapping, format, hold, horizon, OF_FIT, delay, trust_plugins
    )
    folder = Path("results") / f"{base.name}-fitted" if out is None else Path(out)
    check_folder(folder)
    fitted = plant_fit.fit(base, over, cut, plant, delay)
    written = write_fitted(fitted, folder)
    return replace(fitted, config=written, notes=(*fitted.notes, *_notes(base, cut)))


def _opened(
    config: Configuration | Document,
    measured: str | os.PathLike[str],
    mapping: _Mapping,
    format: str,
    hold: str,
    horizon: float | None,
    parts: int,
    delay: float,
    trust_plugins: bool,
) -> tuple[Experiment, Windows, Callable[[Experiment], ClosedLoop]]:
    """Return the experiment, the windows of the recording, and a function that drives its plant."""
    if isinstance(config, Document):
        document = config
    else:
        document = document_from(config, {}, trust_plugins=trust_plugins)
    base = build(replace(document, data=without_search(document.data)))
    recording = prediction.by_rotors(base.vehicle, _driving(measured, base.group, mapping, format))
    recording.require_wrenches()
    length = float(recording.times[-1] - recording.times[0])
    if not abs(delay) < length:
        raise EqtError(
            f"delay: expected less than the {length:.4g} s of {recording.name}, got {delay:g} s"
        )
    if horizon is None:
        horizon = length / parts
    if not horizon > 0:
        raise EqtError(f"horizon: expected a time greater than 0 s, got {horizon:g}")
    held = _literal(prediction.Hold, "hold", hold)
    law = prediction.Replay(file=recording.name, hold=held).with_recording(recording)
    return base, Windows(recording, horizon), lambda one: prediction.driven(one, law)


def _notes(base: Experiment, windows: Windows) -> Iterator[str]:
    yield from (f"{windows.recording.name}: {note}." for note in windows.recording.notes)
    if left := [name for name in ("control", "sensors") if name in base.resolved]:
        yield (
            f"{' and '.join(left)} of the configuration are left out: the recorded wrench acts "
            "when it was recorded."
        )


# A recording beside the runs of a result ----------------------------------------------------------


def compare_measured(
    result: ResultPath,
    measured: str | os.PathLike[str],
    mapping: _Mapping = None,
    *,
    format: str = "csv",
    run: int = 0,
    controllers: Sequence[str] = (),
    point: int | None = None,
    units: Sequence[str] = (),
) -> list[Explanation]:
    """Compute how much of a measured tracking error the runs of a result explain.

    Parameters
    ----------
    result
        The result folder, or the file in it.
    measured, mapping, format
        A recording, as for `check_log`. Without ``time.offset`` in the mapping, its clock is
        aligned with that of the runs. Without a wrench, its rotor speeds give one.
    run
        Number of the run, counted from 0.
    controllers
        Labels of the controllers to compare with; all if empty.
    point
        Point of a sweep, counted from 0.
    units
        Units of quantities, as for `compare`.

    Returns
    -------
    list of Explanation
        The explained shares of the error, for each controller.

    Raises
    ------
    EqtError
        If the run or a controller does not exist, or the recording does not fit the run.

    Examples
    --------
    >>> import numpy as np
    >>> with eqt_cli.open_result("results/paper") as result:
    ...     poses = result.read("pose", controller="eqt", run=0).reshape(-1, 9)
    ...     rows = np.c_[result.times + 0.25, poses]
    >>> header = "t,Q11,Q12,Q13,Q21,Q22,Q23,Q31,Q32,Q33"
    >>> np.savetxt("flight.csv", rows, delimiter=",", header=header, comments="")
    >>> late = {"time": {"offset": -0.25}}
    >>> laws = eqt_cli.compare_measured("results/paper", "flight.csv", late)
    >>> laws[0].rows == len(rows), round(laws[0].shares[0].explained, 6)
    (True, 1.0)
    """
    with open_at(path_from("result", result), point) as opened:
        group = known_group(opened.group_name)
        if group is None:
            raise opened.error(f"is on group '{opened.group_name}' of a plugin, which is not known")
        recording = _with_wrench(opened, read_measured(measured, group, mapping, format))
        chosen = [opened.position_of(name) for name in controllers]
        shown_in = opened.in_units(units).shown_in
        return [explained(one, shown_in) for one in measured_runs(opened, recording, chosen, run)]


def _with_wrench(result: Result, recording: Recording) -> Recording:
    """Return the recording with the wrench of its rotors, where it has speeds and no wrench."""
    if not recording.speeds.size or np.isfinite(recording.wrenches).any():
        return recording
    try:
        vehicle = next(iter(result.loops.values())).vehicle
        recording = prediction.by_rotors(vehicle, recording)
        note = "the rotor speeds give the wrench, by the thrusters of the configuration"
    except EqtError as error:
        note = f"the rotor speeds are not used: {error}"
    return replace(recording, notes=(*recording.notes, note))
