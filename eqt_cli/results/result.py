"""Results as all readers see them: labels, runs, points, quantities and units."""

import copy
import math
import os
from collections.abc import Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, replace
from functools import cache, cached_property, partial
from pathlib import Path
from typing import Any, Self

import numpy as np

from eqt_cli.base.arrays import Array
from eqt_cli.base.errors import EqtError, printable, suggestion
from eqt_cli.base.reporting import significant
from eqt_cli.base.stored import (
    CASE,
    FORMULA,
    LAW,
    MIXED,
    POINT,
    Attribute,
    Status,
    Symbol,
    signal_of,
)
from eqt_cli.numbers.running import SampledRuns, changes_missed
from eqt_cli.results.metrics import INTEGRALS, METRICS, QUANTITIES, over, quantity_of
from eqt_cli.results.origin import KnownResult, law_title
from eqt_cli.results.quantity import (
    WHOLE,
    Measure,
    SweptKey,
    ValuePer,
    Window,
    constant_of,
    with_unit,
)

# The class `Result`: reads the runs of a result and their numbers with their meaning --------------


_OF_MOTIONS = {
    "pose_error": (
        Symbol(r"\|I - R_E\|_{\mathrm{F}}", "‖I − R_E‖"),
        Symbol(r"\|p_E\|", "‖p_E‖"),
        Symbol(r"\|%s_E\|", "‖%s_E‖"),
    ),
    "velocity_error": (
        Symbol(r"\|\omega - \omega_d\|", "‖ω − ω_d‖"),
        Symbol(r"\|v - v_d\|", "‖v − v_d‖"),
        Symbol(r"\|V - V_d\|_{%s}", "‖V − V_d‖_%s"),
    ),
    "torque_norm": (
        Symbol(r"\|\tau\|", "‖τ‖"),
        Symbol(r"\|f\|", "‖f‖"),
        Symbol(r"\|f_{%s}\|", "‖f_%s‖"),
    ),
}
"""Symbols of the norms in rigid motions: of the rotation, of the only translation, and of one of
several vectors, by its initial."""
FOR_SAMPLING = 20
"""Number of stored runs that show the error of an integral over samples."""


@dataclass(frozen=True)
class PerRun:
    """A quantity over a window, for every run of every law.

    Attributes
    ----------
    quantity, window, unit
        The quantity, its window, which ends with the runs at the latest, and its unit.
    values : (controllers, runs)
        NaN for runs that failed, have no such number, or have no stored trajectory; the horizon for
        censored runs.
    censored : (controllers, runs)
        Whether the number of a run lies beyond the horizon.
    runs
        Number of evaluated runs of each controller: those with a trajectory, or all.
    sampling
        Error from the distance of the samples, 0 where it is none and NaN where it is not known,
        and how many changes of a held value lie between two samples.
    """

    quantity: Measure
    window: Window
    unit: str
    values: Array
    censored: Array
    runs: int
    sampling: tuple[float, int] = (math.nan, 0)

    def sampling_note(self, least: float, unit: str) -> list[str]:
        """State the error by the distance of the samples, if it is larger than this."""
        error, missed = self.sampling
        if not error > least:
            return []
        text = f"{significant(error, 2)} {unit}".strip()
        by = f"; they miss {missed} of {missed + 1} held values, and alias a sensor's noise"
        name = self.quantity.described
        return [f"{name}: an error of up to {text} by the distance of samples{by * bool(missed)}."]

    @property
    def is_share(self) -> bool:
        """Whether it is a share of runs or of the time, so that differences are points of 100."""
        return self.quantity.counts or self.quantity.name.endswith("_share")

    @property
    def seen(self) -> Window:
        """The window, or its last part for a number of the last share of the time."""
        start, stop = self.window.start, self.window.stop
        share = float(self.quantity.notes.get("share_of_time", 1.0))
        return Window(stop - share * (stop - start), stop)

    def __repr__(self) -> str:
        """Return a description without the values."""
        return f"PerRun({self.quantity.name}, {self.window}, {self.runs} runs)"


ROUNDING = 1e-6
"""Relative difference of one and the same run, whose sums may be added in another order."""


class Result(KnownResult):
    """An open result of one experiment, of a point of a sweep, or of a whole sweep.

    It reads variables by name as `ResultFile` does, and provides the numbers of its runs. A run is
    good if its status is 0.
    """

    _wished: tuple[tuple[str, str], ...] = ()
    """Units of a user, each with the quantity that has it, or with "" for all."""

    out_of: int = 0
    """Number of points of the sweep of which this is one; 0 of no sweep."""

    of_all_points = (*KnownResult.of_all_points, "_wished", "out_of")

    @property
    def is_sweep(self) -> bool:
        """Whether the result has points, each of which is an experiment."""
        return POINT in self.dimensions

    @property
    def points(self) -> int:
        """Number of points; 1 for a single experiment."""
        return self.dimensions.get(POINT, 1)

    @property
    def runs(self) -> int:
        """Number of runs per law and point."""
        return self.dimensions["run"]

    @cached_property
    def times(self) -> Array:
        """Sample times of trajectories, s."""
        return _fixed(self.coordinate("time"))

    @cached_property
    def config(self) -> Mapping[str, Any]:
        """The configuration of the result; empty if it cannot be read."""
        from eqt_cli.base.yaml_source import load  # slow to import, and most readers need it not

        with suppress(EqtError):
            return load(str(self.attributes["config"]), "config").data
        return {}

    @property
    def horizon(self) -> float | None:
        """Duration of the runs, s; None if it differs between points."""
        return float(self.times[-1] - self.times[0]) if self.has("time") else None

    @cached_property
    def status(self) -> Array:
        """Status of every run, ``(controllers, runs)``; a sweep has a leading axis of points."""
        status = self["status"]
        if status.dtype.kind not in "iu" and not (status == np.round(status)).all():  # NaN is not
            raise self.refusal("its 'status' is not whole numbers")
        if status.size and status.min() < 0:
            raise self.refusal(f"its 'status' is {status.min():g} for a run")
        return _fixed(status)

    @property
    def good(self) -> Array:
        """Whether each run is good, in the shape of `status`."""
        return self.status == 0

    @property
    def failed(self) -> dict[str, int]:
        """Number of failed runs of each controller, by label."""
        counts = np.count_nonzero(self.status, axis=(0, 2) if self.is_sweep else 1)
        return dict(zip(self.labels, counts.tolist(), strict=True))

    @property
    def failures(self) -> Array:
        """Indices (point,) controller and run of the failed runs, one per row."""
        return np.argwhere(self.status)

    def messages(self, where: Array) -> list[str]:
        """Return the messages of failed runs, given rows of `failures`."""
        # Reading all messages of a million runs takes seconds, so only these rows are read.
        axes = [np.unique(where[:, axis], return_inverse=True) for axis in range(where.shape[1])]
        chosen = {dim: k for dim, (k, _) in zip(self.dims("status"), axes, strict=True)}
        messages = self.read("message", **chosen)[tuple(position for _, position in axes)]
        return [printable(str(message)) for message in messages]

    def place(self, where: Sequence[int]) -> str:
        """Describe a run given a row of `failures`: ``point 3 eqt run 17``."""
        *point, controller, run = where
        return f"{f'point {point[0]} ' if point else ''}{self.labels[controller]} run {run}"

    @cached_property
    def swept_keys(self) -> list[SweptKey]:
        """Swept keys of more than one value, without those that follow or change with another."""
        keys: list[SweptKey] = []
        for name in self.coordinates:
            follows = FORMULA in self.attributes_of(name)
            if name != POINT and self.dims(name) == (POINT,) and not follows:
                key = swept_key(self, name)
                if max(key.levels) > 0 and key.levels not in [other.levels for other in keys]:
                    keys.append(key)
        return keys

    def point(self, point: int, attributes: Mapping[str, Attribute] | None = None) -> Self:
        """Return a point of a sweep as the result of a single experiment with its name.

        Parameters
        ----------
        attributes
            Attributes of the point, where the file has only those of the sweep.

        Raises
        ------
        ResultError
            If there is no such point.
        """
        title = f"{self.at(point).attributes['title']}, {self.point_name(point)}"
        view = self.at(point, {"title": title, **(attributes or {})})
        view.out_of = self.points
        return view

    def point_name(self, point: int) -> str:
        """Describe a point of a sweep: ``kp 2, kd 0.5``; a case by its name only."""
        keys = [swept.key.rpartition(".")[2] for swept in self.swept_keys]
        if len(set(keys)) < len(keys):
            keys = [swept.key for swept in self.swept_keys]
        pairs = zip(keys, self.swept_keys, strict=True)
        return ", ".join(
            swept.at(point) if key == CASE else f"{key} {swept.at(point)}" for key, swept in pairs
        )

    @property
    def run_dimension(self) -> str:
        """Dimension of the runs with trajectories: ``run`` or ``stored_run``."""
        return next(dim for dim in self.dims("lyapunov") if dim.endswith("run"))

    @cached_property
    def stored_runs(self) -> Array:
        """Numbers of the runs with stored trajectories; empty if there are none."""
        if not self.is_over_time("lyapunov"):
            return np.array([], dtype=int)
        return _fixed(self.coordinate(self.run_dimension))

    def is_over_time(self, name: str) -> bool:
        """Whether the file holds this variable over time."""
        return self.has(name) and "time" in self.dims(name)

    def trajectories(self, signal: str, controller: int, most: int | None = None) -> Array:
        """Return a signal of the good runs of a controller, ``(runs, samples, …)``.

        Parameters
        ----------
        most
            Largest number of runs to read, from the first on; all if None.
        """
        good = self.good[controller][self.stored_runs]
        if most is None:
            values = self.read(signal, controller=controller)
            return values if good.all() else values[good]
        first = np.flatnonzero(good)[:most]
        return self.read(signal, controller=controller, **{self.run_dimension: first})

    def trajectory(self, signal: str, run: int) -> Array:
        """Return a signal of one run of every controller, ``(controllers, samples, …)``."""
        return self.read(signal, **{self.run_dimension: stored_place(self, run)})

    def parts(self, norm: str) -> list[str]:
        """Return the parts of a norm that are stored separately, such as ``rotation``."""
        return [
            name.removeprefix(f"{norm}_")
            for name in self.names
            if name.startswith(f"{norm}_") and self.is_over_time(name)
        ]

    def in_units(self, texts: Sequence[str]) -> "Result":
        """Return this result with its numbers and signals in other units.

        Variables that are read by name stay as they are stored.

        Parameters
        ----------
        texts
            ``QUANTITY=UNIT``, or ``UNIT`` for every quantity of its dimension, the last one first.

        Raises
        ------
        EqtError
            If a quantity or a unit is unknown, or nothing here has the dimension of the unit.
        """
        view = copy.copy(self)
        view._wished = tuple(
            (name.strip(), unit.strip()) for name, _, unit in (t.rpartition("=") for t in texts)
        )
        if not texts:
            return view
        from eqt_cli.base.units import in_wished, offered, size_of

        unit_of = {name: super(Result, self).units(name) for name in self.names}
        unit_of |= {name: self.unit_of(quantity) for name, quantity in self.comparable.items()}
        for name, wish in view._wished:
            if size_of(wish) is None:
                raise EqtError(f"unit '{wish}': unknown; write for example mN m, deg/s or arcsec")
            if name and name not in unit_of:
                raise EqtError(f"unit of '{name}': no such quantity{suggestion(name, unit_of)}")
            if name and in_wished(unit_of[name], wish) is None:
                raise EqtError(f"unit of '{name}': expected {offered(unit_of[name])}, got '{wish}'")
            if not any(in_wished(unit, wish) for unit in unit_of.values()):
                units = ", ".join(dict.fromkeys(u for u in unit_of.values() if u not in ("", "1")))
                raise EqtError(f"unit '{wish}': nothing here has its dimension; there are: {units}")
        return view

    def shown_in(self, name: str, unit: str) -> tuple[str, float]:
        """Return the unit in which a quantity is shown, and the factor to it."""
        if not self._wished:
            return unit, 1.0
        from eqt_cli.base.units import in_wished

        for of, wish in reversed(self._wished):
            if of in ("", name) and (shown := in_wished(unit, wish)) is not None:
                return shown
        return unit, 1.0

    def units(self, name: str) -> str:
        """Return the unit of a variable or of a computed number, or that in which it is shown."""
        if not self.has(name) and name in self.comparable:
            return self.shown_in(name, self.unit_of(self.comparable[name]))[0]
        unit = super().units(name)
        return unit if name in self.coordinates else self.shown_in(name, unit)[0]

    def factor(self, name: str) -> Any:
        """Return the factor from a variable in the file to the shown unit, one for each axis."""
        if not (self._wished and self.has(name)):
            return 1.0
        signal, units = signal_of(name.removeprefix("desired_")), [super().units(name)]
        if units == [MIXED] and signal and self.described.parts and self.dims(name)[-1] == "axis":
            units = [signal.unit_in(p) for p in self.described.parts for _ in range(p.dimension)]
        factors = [self.shown_in(name, unit)[1] for unit in units]
        return np.array(factors) if len(factors) > 1 else factors[0]

    def unit_of(self, quantity: Measure) -> str:
        """Return the unit in which a number per run is computed or stored."""
        for name in (quantity.name, *(like.name for like in _metrics_like(self, quantity))):
            if self.has(name):
                return super().units(name)
        signal = quantity.signals[0] if quantity.signals else ""
        return quantity.unit(super().units(signal) if self.has(signal) else "")

    @cached_property
    def metrics(self) -> list[str]:
        """Names of all numbers that are stored for every run, and of those implied by one."""
        per_run = (POINT, "controller", "run") if self.is_sweep else ("controller", "run")
        stored = [
            name
            for name in self.names
            if self.dims(name) == per_run and name not in ("status", "message")
        ]
        implied = [row.name for row in METRICS if row.implied_by in stored]
        return list(dict.fromkeys([*stored, *implied]))

    def metric(self, name: str, controller: int | None = None) -> Array:
        """Return a number of every run, ``(controllers, runs)``, or ``(runs,)`` for one controller.

        It is as stored, as it follows from another one, or computed from trajectories. NaN if a run
        failed or has no value. A sweep has a leading axis of points.

        Raises
        ------
        EqtError
            If there is no number of that name.
        """
        if name in self.metrics:
            values = np.where(self.good, _number(self, name), np.nan) * self.factor(name)
        elif self.is_sweep:
            values = np.stack([self.at(point).metric(name) for point in range(self.points)])
        else:
            quantity = self.comparable_named(name)
            numbers = self.per_run(quantity)
            values = np.where(numbers.censored, np.nan, numbers.values)
        return values if controller is None else values[..., controller, :]

    def censored(self, name: str, controller: int | None = None) -> Array:
        """Whether the number of each good run lies beyond the horizon, in the shape of `metric`."""
        late = self.good & np.isnan(self.metric(name)) & self.quantity(name).censored
        return late if controller is None else late[..., controller, :]

    def counted(self, name: str) -> Array:
        """Return a number of every run, as `metric`, with values for runs beyond the horizon.

        A number beyond the horizon counts as the horizon, as in comparisons. A mean with such runs
        is a lower bound of the true mean, while leaving them out would average only the settled
        runs. If the points of a sweep differ in the horizon, the value stays NaN.
        """
        end = np.nan if self.horizon is None else self.horizon * self.factor(name)
        return np.where(self.censored(name), end, self.metric(name))

    def means(self, name: str) -> Array:
        """Return the mean of a number over all runs, ``(controllers,)``; a sweep adds points.

        NaN if a run failed, because the remaining runs are a biased sample.
        """
        return np.mean(self.counted(name), axis=-1)

    def quantity(self, name: str) -> Measure:
        """Return the row of a variable in the table, with the attributes of the file."""
        attributes = (self.long_name(name), self.attributes_of(name)) if self.has(name) else ()
        return _of_part(self, over(quantity_of(name, *attributes), window_of(self)))

    @cached_property
    def comparable(self) -> dict[str, Measure]:
        """All numbers per run that the result holds or that can be computed from it, by name."""
        quantities: dict[str, Measure] = {}
        for quantity in (self.quantity(row.name) for row in METRICS):
            if _has_signals(self, quantity) or _metrics_like(self, quantity):
                quantities[quantity.name] = quantity
            for part in _parts_of(self, quantity):
                quantities[f"{quantity.name}_{part}"] = _of_part(self, quantity.part(part))
        for name in self.metrics:
            quantities.setdefault(name, self.quantity(name))
        return quantities

    def in_parts(self, name: str) -> list[str]:
        """Return the stored numbers of the parts if their units differ, else the number."""
        return [other for other in self.metrics if other.startswith(f"{name}_")] or [name]

    def per_run(self, quantity: Measure, window: Window | None = None) -> PerRun:
        """Return a number of every run over a window, as stored or computed from trajectories.

        Parameters
        ----------
        window
            Default: that of the quantity.

        Raises
        ------
        EqtError
            If the result lacks the data.
        """
        window = (quantity.window if window is None else window).within(self.times)
        unit = self.unit_of(quantity)
        stored, runs = _stored_as(self, quantity, window), np.arange(self.runs)
        if stored is not None:
            columns = _number(self, stored)
        elif _has_signals(self, quantity):
            runs, samples = self.stored_runs, SampledRuns(self.times, self.described.holds)
            columns = np.empty((len(self.labels), len(runs)))
            for c in range(len(self.labels)):
                signals = {signal: self.read(signal, controller=c) for signal in quantity.signals}
                with np.errstate(all="ignore"):  # failed runs hold NaN
                    columns[c] = quantity.measure(samples, signals, window)
        else:
            raise _not_stored(self, quantity, window)
        values = np.full((len(self.labels), self.runs), np.nan)
        values[:, runs] = columns
        values[~self.good] = np.nan
        if quantity.name == "decay_rate":  # for these, L is not a function that falls
            values[[label in self.without_function for label in self.labels]] = np.nan
        censored = self.good & np.isnan(values) & quantity.censored
        values[censored] = window.stop
        unit, factor = self.shown_in(quantity.name, unit)
        of_all = self.described.decimate if stored is not None else 1
        error, missed = _sampling(self, quantity, window, of_all)
        sampling = (error * factor, missed)
        quantity = over(quantity, WHOLE if window == WHOLE.within(self.times) else window)
        return PerRun(quantity, window, unit, values * factor, censored, len(runs), sampling)

    @cached_property
    def stored_metrics(self) -> list[Measure]:
        return [self.quantity(name) for name in self.metrics]

    def comparable_named(self, name: str) -> Measure:
        """Return a number per run by name.

        Raises
        ------
        EqtError
            If this result has no such number.
        """
        if name in self.comparable:
            return self.comparable[name]
        quantity = QUANTITIES.get(name)
        if quantity is not None and quantity.per is ValuePer.RUN and quantity.of is not None:
            raise _not_stored(self, quantity)
        hint = suggestion(name, self.comparable)
        raise EqtError(
            f"unknown metric '{name}'{hint}"
            f"{'' if hint else ';'} known here: {', '.join(self.comparable)}"
        )


def by_parts(result: Result, name: str) -> list[Measure]:
    """Return a number per run, or those of its parts if it has some; empty if it is unknown."""
    quantities = result.comparable
    if name not in quantities:
        return [quantities[at] for at in quantities if at.startswith(f"{name}_")]
    parts = _parts_of(result, quantities[name])
    return [quantities[at] for part in parts if (at := f"{name}_{part}") in quantities] or [
        quantities[name]
    ]


def window_of(result: Result) -> Window:
    """Return the window of time over which metrics are taken, unless they have their own."""
    start, stop = result.described.window
    return Window(start, stop or math.inf)


def covers(result: Result, quantity: Measure, window: Window) -> bool:
    """Whether a number per run is known over this window."""
    return _stored_as(result, quantity, window) is not None or _has_signals(result, quantity)


def _parts_of(result: Result, quantity: Measure) -> list[str]:
    """Return the parts for which a number per run is stored or can be computed."""
    over_time = result.parts(quantity.signals[0]) if quantity.parted else []
    stored = [
        part.removeprefix(f"{like.name}_")
        for like in _metrics_like(result, quantity)
        for part in result.in_parts(like.name)
        if part != like.name
    ]
    return list(dict.fromkeys([*over_time, *stored]))


def _sampling(result: Result, quantity: Measure, window: Window, of_all: int) -> tuple[float, int]:
    """Return the error of an integral over samples, and how many changes they miss.

    The error is the change where every other sample is left out, in the mean over
    `FOR_SAMPLING` stored runs of the law for which it is largest; of smooth values a third of
    it (Richardson). 0 where a held value changes at samples only; NaN of what is no integral,
    or without trajectories. Of `of_all` samples of a run one is stored.
    """
    of, signals = getattr(quantity.of, "func", quantity.of), quantity.signals
    if of not in INTEGRALS or not all(map(result.is_over_time, signals)):
        return math.nan, 0
    hold, odd = quantity.hold(result.described.holds), (len(result.times) - 1) // 2 * 2 + 1
    if result.times[odd - 1] - result.times[0] <= window.start:  # too few to leave some out
        return math.nan, 0
    times = np.linspace(result.times[0], result.times[-1], (len(result.times) - 1) * of_all + 1)
    missed = int(changes_missed(times, hold).max()) if hold else 0
    if hold and not missed:
        return 0.0, 0
    some = {result.run_dimension: slice(min(FOR_SAMPLING, len(result.stored_runs)))}

    def values(step: int) -> Array:
        read = {name: np.concatenate(result.read(name, **some)) for name in quantity.signals}
        signals = {name: values[:, :odd:step] for name, values in read.items()}
        samples = SampledRuns(result.times[:odd:step], result.described.holds)
        with np.errstate(invalid="ignore"):  # NaN of too few samples, or of infinite ones
            return np.asarray(quantity.measure(samples, signals, window))

    changes = np.abs(values(1) - values(2)).reshape(len(result.labels), -1)
    error = mean_over_runs(changes) / (1 if hold else 3)
    finite = np.isfinite(error)
    return float(np.max(error, where=finite, initial=0.0)) if finite.any() else math.nan, missed


def _metrics_like(result: Result, quantity: Measure) -> list[Measure]:
    """Return the stored metrics that are this number over any window."""
    return [
        metric
        for metric in result.stored_metrics
        if metric.name == quantity.name
        or (metric.of and (metric.of, metric.signals) == (quantity.of, quantity.signals))
    ]


def _stored_as(result: Result, quantity: Measure, window: Window) -> str | None:
    """Return the stored metric that is this number over this window."""
    window = window.within(result.times)
    same = (q for q in _metrics_like(result, quantity) if q.window.within(result.times) == window)
    return next((other.name for other in same), None)


def _has_signals(result: Result, quantity: Measure) -> bool:
    """Whether a quantity can be computed from stored signals."""
    stored = quantity.windowed and all(map(result.is_over_time, quantity.signals))
    return stored and len(result.times) > 1


def _not_stored(result: Result, quantity: Measure, window: Window | None = None) -> EqtError:
    name = quantity.name
    if not quantity.windowed:
        return result.error(f"holds no metric '{name}' over a window; it is one of whole runs")
    what = name if window is None else f"{name} over {window} s"
    return result.error(f"cannot compute {what}: it needs {lacks(quantity.signals)}")


def _of_part(result: Result, quantity: Measure) -> Measure:
    """Return a quantity with the symbol of its part, on a group of a rotation and vectors."""
    of = quantity.signals[0] if quantity.signals else ""
    norm = next((quantity for quantity in _OF_MOTIONS if of.startswith(f"{quantity}_")), "")
    parts = result.described.parts if norm else []
    part = next((pose_part for pose_part in parts if of == f"{norm}_{pose_part.name}"), None)
    vectors = [pose_part for pose_part in parts if not pose_part.turns]
    initials = {pose_part.name[0] for pose_part in vectors}
    if part is None or len(parts) != 1 + len(vectors) or len(initials) < len(vectors):
        return quantity
    if not vectors or (len(vectors) == 1 and vectors[0].pose_unit != "m"):
        return quantity
    turning, only, one_of_several = _OF_MOTIONS[norm]
    vector = only
    if len(vectors) > 1:
        vector = Symbol(*(text.replace("%s", part.name[0]) for text in one_of_several))
    label = quantity.label.replace(f"{{}} {part.name.replace('_', ' ')}", "{}")
    return replace(quantity, symbol=turning if part.turns else vector, label=label)


def check_stored(result: Result, *signals: str, who: str) -> None:
    """Check that signals are stored over time.

    Parameters
    ----------
    who
        Name of the caller with the verb: ``figure 'paper' needs``.

    Raises
    ------
    EqtError
        If the file lacks a signal; the message says how to store it.
    """
    for name in signals:
        if not result.is_over_time(name):
            raise result.error(f"{who} {lacks([name])}")


def stored_place(result: Result, run: int) -> int:
    """Return the index of a run among those with trajectories.

    Raises
    ------
    EqtError
        If the trajectory of that run is not stored.
    """
    stored = result.stored_runs.tolist()
    if run not in stored:
        has = f"; stored are runs {stored[0]} to {stored[-1]}" if stored else ""
        raise result.error(f"the trajectory of run {run} is not stored{has}")
    return int(stored.index(run))


def swept_key(result: Result, name: str) -> SweptKey:
    """Return a swept key by the name of its coordinate."""
    about, values = result.attributes_of(name), result.coordinate(name)
    label, unit = (printable(str(about.get(text, ""))) for text in ("label", "unit_of_key"))
    key = partial(
        SweptKey, result.long_name(name).removesuffix(", swept"), label=label, unit_of_key=unit
    )
    if values.dtype != object:
        return key(values.astype(float), {}, about.get("scale") == "log")
    written = [printable(str(value)) for value in values]
    numbers = [number for text in written if (number := with_unit(text)) is not None]
    units = {unit for _, unit in numbers}
    if len(numbers) == len(written) and len(units) == 1:
        return key(np.array([value for value, _ in numbers]), {}, unit=units.pop())
    constants = [value for text in written if (value := constant_of(text)) is not None]
    if len(constants) == len(written):
        return key(np.array([value for value, _ in constants]), dict(constants))
    order: dict[str, float] = {}  # in the order of the points
    places = [order.setdefault(text, float(len(order))) for text in written]
    texts = {place: text for text, place in order.items()}
    return key(np.array(places), texts, is_number=False)


def _number(result: Result, name: str) -> Array:
    """Return one of `metrics` of every run."""
    if result.has(name):
        return result[name].astype(float)
    return np.isfinite(result[result.quantity(name).implied_by]).astype(float)


def laws_at(result: Result, controller: int) -> dict[int, str]:
    """Return the titles of the registered laws that a controller equals, by point.

    Empty if the sweep does not vary the controllers' options.
    """
    if not result.has(LAW):
        return {}
    names = result.read(LAW, controller=controller)
    return {int(point): law_title(str(names[point])) for point in np.flatnonzero(names != "")}


def rename(result: Result, names: Mapping[str, str]) -> list[str]:
    """Call laws and quantities otherwise, in figures and tables; return those that are not here.

    Parameters
    ----------
    names
        By a law's label or title, or by the name of a quantity.
    """
    titles = {result.label_of(name): printable(title) for name, title in names.items()}
    result.custom_names = titles
    vars(result).pop("title_of", None)
    return [
        name
        for name, called in zip(names, titles, strict=True)
        if not (called in result.labels or result.has(called) or called in result.comparable)
    ]


def open_result(path: str | os.PathLike[str]) -> Result:
    """Open a result.

    Parameters
    ----------
    path
        The result folder, or the result file in it.

    Returns
    -------
    Result
        A context manager that closes the file.

    Raises
    ------
    ResultError
        If there is no such result, or its file is damaged or unsafe.
    """
    return Result(Path(path))


def mean_over_runs(values: Array) -> Array:
    """Return the mean over the last axis without NaN; NaN if all values are NaN."""
    count = np.isfinite(values).sum(axis=-1)
    return np.where(count > 0, np.nansum(values, axis=-1) / np.maximum(count, 1), np.nan)


def point_folder(*points: int) -> Path:
    """Return the folder within a result folder for files made from points of a sweep."""
    return Path("figures") / "_".join(["point", *map(str, points)])


@cache
def meaning_of(status: int) -> str:
    """Describe a status in words."""
    names = {status.value: status.name.lower().replace("_", " ") for status in Status}
    return names.get(status, f"status {status}")


def _fixed(values: Array) -> Array:
    """Make an array read-only, because it is cached."""
    values.setflags(write=False)
    return values


def lacks(signals: Sequence[str]) -> str:
    """Return the words about missing signals over time, for messages."""
    needed = " and ".join(f"'{name}'" for name in signals)
    return (
        f"the trajectories of {needed}, which the result does not hold; set store.trajectories to "
        "all and run the experiment again"
    )
