"""Compares flights, replays and fits a plant, and compares a recording with runs."""

import math
import os
import re
from collections.abc import Callable, Iterator, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any, Literal

import numpy as np

from eqt_cli.analysis.gate import rules_of
from eqt_cli.analysis.intervals import Interval
from eqt_cli.api.loading import Configuration, ResultPath, document_from, open_at, path_from
from eqt_cli.base import purposes
from eqt_cli.base.errors import EqtError
from eqt_cli.base.reporting import step
from eqt_cli.components.groups import known_group
from eqt_cli.config.document import Document
from eqt_cli.config.experiment import Experiment
from eqt_cli.config.preflight import build
from eqt_cli.config.schema import without_search
from eqt_cli.extensions.flights import flights, plant_fit, prediction, validation
from eqt_cli.extensions.flights.conditions import ConditionTable, condition_table
from eqt_cli.extensions.flights.joined import recordings_of_a_list
from eqt_cli.extensions.flights.judging import Design
from eqt_cli.extensions.flights.looks import kept_looks
from eqt_cli.extensions.flights.measured import Explanation, explained, measured_runs
from eqt_cli.extensions.flights.planning import FlightPlan, of_pilot, planned
from eqt_cli.extensions.flights.plant_fit import PlantFit, check_folder, write_fitted
from eqt_cli.extensions.flights.prediction import Growth, Windows
from eqt_cli.extensions.flights.predictions import predictions_of
from eqt_cli.extensions.flights.sides import Sides, sides_for
from eqt_cli.extensions.logs.api import MappingSource, driving, literal, log_errors, read_measured
from eqt_cli.extensions.logs.flight_list import ListedFlight, flights_in, is_list, read_list
from eqt_cli.extensions.logs.logs import QUANTITIES, TrackingErrors
from eqt_cli.extensions.logs.recording_check import Recording
from eqt_cli.loop.closed_loop import ClosedLoop
from eqt_cli.results.result import Result

# Compares flights ---------------------------------------------------------------------------------


def compare_flights(
    paths: Sequence[str | os.PathLike[str]],
    against: Sequence[str | os.PathLike[str]] = (),
    *,
    law: str = "",
    pair: bool = False,
    duplicates: bool = False,
    within: str = "",
    period: float = 0.0,
    metrics: Sequence[str] = (),
    of: str = "rms",
    negligible: float = 0.05,
    all_parameters: bool = False,
    sequential: bool = False,
    normal: bool = False,
    model: str | os.PathLike[str] | None = None,
    fail_on: Sequence[str] = (),
    out: str | os.PathLike[str] | None = None,
    **how: Any,
) -> flights.FlightComparison:
    """Compare the tracking errors of flights with one setting against those with another.

    Parameters
    ----------
    paths, against
        Recordings of both settings, A and B, or folders of them; or a list of flights, and the law
        of B in it. Two folders without `against` are those before a change, B, and after it, A.
    law
        The law of A in a list; of two, the other one by default.
    pair
        Whether the first of `paths` belongs to the first of `against`, and so on. In a list, its
        column says so.
    duplicates
        Whether recordings of the same file or the same motion are included.
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
    sequential
        Whether the answer holds at every look, so that flights may be added until it is decided,
        by bets on signs (`every_look.wealth`). Flights are in the order flown.
    normal
        Whether it then rests on normal logarithms of errors (`every_look.safe_t`).
    model
        A table with columns ``file`` and ``predicted``: the error that a model predicts for each
        flight, by one law for all.
    fail_on
        Rules, such as ``position worse by 10 %``.
    out
        Output folder for the figure ``flights``, for the looks at these flights, and for what is
        measured of each flight, which a second look at it in the same way uses again. Default: no
        files.
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
    rules = rules_of(fail_on)
    chosen: Any = {"law": law, "pair": pair, "within": within, "sequential": sequential}
    sides = sides_for(paths, against, **chosen)
    _check(sides, within, period, normal=normal, sequential=sequential, with_model=bool(model))
    literal(Literal["rms", "median", "largest"], "of", of)
    wanted = {*metrics, *(rule.metric for rule in rules if rule.margin < np.inf)}
    if odd := wanted - {*QUANTITIES}:
        raise EqtError(f"expected {', '.join(QUANTITIES)}; got {min(odd)!r}")
    rows, paired = sides.flights, sides.paired or bool(within)
    named = [[(side, one) for one in some] for side, some in zip("AB", rows, strict=True)]
    in_pairs = sides.paired and {*sides.blocks} == {(1, 1)}
    ordered = [x for two in (zip(*named, strict=True) if in_pairs else named) for x in two]
    turns = within[: len(within) // 2 * 2]

    def tracked(one: ListedFlight) -> TrackingErrors:
        return log_errors(one.file, **how | one.how)

    folder = None if out is None else Path(out)
    settings: dict[str, Any] = {"of": of, "period": period, "within": turns} | how
    shifts = dict[Path, float]()
    with flights.kept_in(folder, settings) as measured, step("flights", len(ordered)):
        more: Any = measured, shifts, duplicates
        flown = [*flights.read_flights(ordered, tracked, of, period, turns, *more)]
    blocks = sides.blocks or ((1, 1),) * (len(turns) // 2)
    design = Design(paired, blocks if sequential else None, normal)
    if model is not None:
        design = replace(design, predictions=predictions_of(Path(model), rows, paired))
    comparison = flights.compared(
        flown, design, metrics, negligible, all_parameters, rules, sides.places
    )
    comparison.premises[:0] = [sides.note] if sides.note else []
    if how.get("second"):
        comparison.notes.extend(flights.remarks_on_shifts(shifts))
    if folder is not None:
        comparison.notes[:0] = kept_looks(folder, comparison, settings, design)
    if folder is not None:
        from eqt_cli.extensions.flights.figures import save_flights  # slow to import

        save_flights(comparison, folder)
    return comparison


def _check(
    sides: Sides, within: str, period: float, *, normal: bool, sequential: bool, with_model: bool
) -> None:
    """Refuse sides and options that do not fit each other."""
    a, b = sides.flights
    if within and not (period and len(a) == 1 and re.fullmatch("(AB|BA)+[AB]?", within)):
        turns = "laps in turns, as ABAB, because wind and battery change with time"
        raise EqtError(f"within: expected one file, a period, and {turns}; got {within!r}")
    if bool(b) == bool(within) or not a:
        raise EqtError("against: expected flights with the other setting, or within")
    if normal and not sequential:
        raise EqtError("normal: belongs to sequential; add it, or leave normal out")
    if with_model and (sequential or within):
        raise EqtError("model: is for whole flights, planned before; leave sequential, within out")


def compare_conditions(
    path: str | os.PathLike[str],
    against: str,
    *,
    by: str = "condition",
    metrics: Sequence[str] = (),
    of: str = "rms",
    period: float = 0.0,
    negligible: float = 0.05,
    duplicates: bool = False,
    out: str | os.PathLike[str] | None = None,
    **how: Any,
) -> ConditionTable:
    """Compare all laws of a list of flights with one of them, by the conditions in a column.

    Parameters
    ----------
    path, against
        A list of flights, and the law that the others are compared with.
    by
        The column of conditions, such as ``wind``; ``condition`` and ``pair`` are such, too.
    metrics, of, period, negligible, duplicates, how
        As for `compare_flights`.
    out
        Output folder for the figure ``forest``, and for what is measured of each flight.

    Returns
    -------
    ConditionTable
        The ratio of each law in each condition and over all, and where it differs.

    Raises
    ------
    EqtError
        If a column or a law is missing, or a law was not flown in a condition.

    Examples
    --------
    >>> import numpy as np
    >>> t, rows = np.linspace(0, 20, 201), [("file", "law", "wind")]
    >>> for k in range(20):
    ...     law, wind = "ab"[k % 2], "05"[k // 10]
    ...     size = (1 + k % 2) * (1 + 0.01 * k)
    ...     table = np.c_[t, np.sin(t), size + 0 * t, 0 * t, np.sin(t), 0 * t, 0 * t]
    ...     header = "t,x,y,z,x_ref,y_ref,z_ref"
    ...     np.savetxt(f"flight{k}.csv", table, delimiter=",", header=header, comments="")
    ...     rows.append((f"flight{k}.csv", law, wind))
    >>> np.savetxt("flights.csv", rows, "%s", ",")
    >>> table = eqt_cli.compare_conditions("flights.csv", "b", by="wind")
    >>> [(cell.condition, cell.word.value) for cell in table.cells]
    [('all', 'better'), ('0', 'better'), ('5', 'better')]
    """
    literal(Literal["rms", "median", "largest"], "of", of)
    if not is_list(path):
        writes = "`eqt log check FOLDER --out flights.csv` writes one"
        raise EqtError(f"path: expected a list of flights with column {by}, got {path}; {writes}")
    rows = read_list(path_from("path", path))
    laws = [*dict.fromkeys(x.law for x in rows)]
    if against not in laws:
        raise EqtError(f"against: expected a law of {path} ({', '.join(laws)}), got {against}")
    conditions = [
        (x.factors | {"condition": x.condition, "pair": x.pair}).get(by, "") for x in rows
    ]
    if empty := [x.place for x, name in zip(rows, conditions, strict=True) if not (name and x.law)]:
        has = ", ".join(["condition", "pair", *rows[0].factors])
        raise EqtError(f"{empty[0]}: expected a law, and a text in column {by}; columns: {has}")

    def tracked(one: ListedFlight) -> TrackingErrors:
        return log_errors(one.file, **how | one.how)

    folder = None if out is None else Path(out)
    settings: dict[str, Any] = {"of": of, "period": period, "within": ""} | how
    with flights.kept_in(folder, settings) as measured, step("flights", len(rows)):
        sides = [(x.law, x) for x in rows]
        more: Any = of, period, "", measured, {}, duplicates
        flown = [*flights.read_flights(sides, tracked, *more)]
    table = condition_table(flown, conditions, against, by, metrics, negligible)
    if folder is not None:
        from eqt_cli.extensions.flights.figures import save_forest  # slow to import

        save_forest(table, folder)
    return table


def plan_flights(
    effect: float,
    pilot: str | os.PathLike[str] | None = None,
    *,
    spread: float | None = None,
    metric: str = "position",
    of: str = "rms",
    period: float = 0.0,
    model: str | os.PathLike[str] | None = None,
    **how: Any,
) -> FlightPlan:
    """Compute how many flights show a difference, from pilot flights or a known spread.

    Parameters
    ----------
    effect
        The relative difference to be found, such as 0.1.
    pilot
        A list of flights, or a folder; rows in the order flown.
    spread
        Standard deviation of the logarithms of errors, in place of pilot flights.
    metric, of, period
        The quantity, the size of its error over a flight, and the length of a lap, s.
    model
        Predictions of the pilot flights, as for `compare_flights`.
    how
        Other arguments of `log_errors`.

    Returns
    -------
    FlightPlan
        The flights of each side, or pairs, by the design, and the spread with its interval.

    Raises
    ------
    EqtError
        If there are neither pilot flights nor a spread, or too few of them.

    Examples
    --------
    >>> eqt_cli.plan_flights(0.1, spread=0.1).rows[0].needed
    20
    """
    if (pilot is None) == (spread is None) or (spread is not None and not 0 < spread < np.inf):
        raise EqtError("pilot: expected a list of flights, or a spread above 0, as 0.2")
    if spread is not None:
        return planned(effect, Interval(spread, spread, spread), None, None)
    assert pilot is not None
    literal(Literal["rms", "median", "largest"], "of", of)
    literal(Literal["position", "velocity", "attitude", "rates"], "metric", metric)
    rows = flights_in(pilot)
    laws = [[x for x in rows if x.law == law] for law in dict.fromkeys(x.law for x in rows)]

    def tracked(one: ListedFlight) -> TrackingErrors:
        return log_errors(one.file, **how | one.how)

    with step("flights", len(rows)):
        flown = [*flights.read_flights([("A", x) for x in rows], tracked, of, period, "", {}, {})]
    if lacking := [x.file for x in flown if metric not in x.errors]:
        raise EqtError(f"{lacking[0]}: has no {metric} error; choose another metric")
    logs = {id(x): math.log(y.errors[metric]) for x, y in zip(rows, flown, strict=True)}
    errors = [np.array([logs[id(x)] for x in law]) for law in laws]
    predicted = predictions_of(Path(model), laws, False) if model is not None else None
    places = [[k for k, x in enumerate(rows) if x in law] for law in laws]
    pairs = None
    if len(laws) == 2 and all(x.pair for x in rows):
        of_pair = [{x.pair: logs[id(x)] for x in law} for law in laws]
        both = [pair for pair in of_pair[0] if pair in of_pair[1]]
        pairs = np.array([of_pair[0][pair] - of_pair[1][pair] for pair in both])
    measured, of_pairs, by_model, notes = of_pilot(errors, places, pairs, predicted)
    return planned(effect, measured, of_pairs, by_model, notes)


# Compares a model driven by a recorded wrench with the recording, and fits the model --------------


WINDOWS, OF_FIT = 10, 20
"""Length of a recording divided by the default length of a window, for `replay` and for `fit`."""

MOST_WINDOWS = 50
"""Default largest number of predicted windows."""


def replay(
    config: Configuration | Document,
    measured: str | os.PathLike[str],
    mapping: MappingSource = None,
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
        The recording, with poses (of a rotation, rates are enough) and wrenches; or a list of
        flights, which follow each other in time.
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
        from eqt_cli.extensions.flights.figures import save_growth  # slow to import

        save_growth(errors, Path(out))
    return errors


def fit(
    config: Configuration | Document,
    measured: str | os.PathLike[str],
    over: Sequence[str],
    mapping: MappingSource = None,
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
    validation.note_fitted_on(folder, path_from("measured", measured), mapping)
    return replace(fitted, config=written, notes=(*fitted.notes, *_notes(base, cut)))


def _opened(
    config: Configuration | Document,
    measured: str | os.PathLike[str],
    mapping: MappingSource,
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

    def read(one: ListedFlight) -> Recording:
        return driving(one.file, base.group, one.mapping or mapping, format)

    is_one = not is_list(measured)
    recording = (
        driving(measured, base.group, mapping, format)
        if is_one
        else recordings_of_a_list(path_from("measured", measured), read)
    )
    recording = prediction.by_rotors(base.vehicle, recording)
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
    held = literal(prediction.Hold, "hold", hold)
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
    mapping: MappingSource = None,
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


# As `eqt compare --measured` and `eqt plot --measured` call them.
purposes.compare_measured(compare_measured)
purposes.plot_measured(read_measured)
