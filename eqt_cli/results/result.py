"""A result with its meaning: laws, good runs, trajectories, metrics, points, experiment."""

from __future__ import annotations

import json
import os
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING, Any, Self

import numpy as np
import yaml

from eqt_cli.config.signal_path import loop_in_words
from eqt_cli.config.source import ConfigSource, source_of
from eqt_cli.config.yaml_source import dump
from eqt_cli.controllers import controllers
from eqt_cli.core.arrays import Array
from eqt_cli.core.errors import ComponentError, EqtError, suggestion
from eqt_cli.core.printable import printable
from eqt_cli.engines import Status
from eqt_cli.experiment.config_at_point import config_at
from eqt_cli.experiment.law_names import LAW
from eqt_cli.groups import MatrixLieGroup, group_named
from eqt_cli.results.contract import check_attributes, check_coordinates, check_status
from eqt_cli.results.metrics import METRICS
from eqt_cli.results.quantity import Per, Quantity
from eqt_cli.results.quantity_table import QUANTITIES, quantity_of
from eqt_cli.results.time_windows import WHOLE, Window
from eqt_cli.store.reader import ResultFile
from eqt_cli.store.reserved_names import POINT
from eqt_cli.store.table import Attribute

if TYPE_CHECKING:
    from eqt_cli.experiment.build import Experiment


def open_result(path: str | os.PathLike[str], point: int | None = None) -> Result:
    """Open a result, or one point of a sweep's as the result of a single experiment.

    Parameters
    ----------
    path
        The result folder, or the file in it.

    Returns
    -------
    Result
        To be used as a context manager, which closes the file.

    Raises
    ------
    ResultError
        If there is no such result or point, or its file is damaged or not safe.
    """
    result = Result(Path(path))
    try:
        return result if point is None else result.point(point)
    except BaseException:
        result.close()
        raise


HEADLINE: dict[str, Callable[[Array], Any]] = {
    "early_torque": np.mean,
    "mean_pose_error": np.mean,
    "final_pose_error": np.mean,
    "final_velocity_error": np.mean,
    "energy_residual": np.max,
}
"""The numbers that a summary shows, and how runs are summed up."""


@dataclass(frozen=True)
class PerRun:
    """A quantity over a window, for every run of every controller.

    Attributes
    ----------
    quantity, window, unit
        What it is; the window ends with the runs at the latest.
    values : (controllers, runs)
        NaN for runs that failed, have no such number, or have no stored trajectory. For those that
        are censored, the horizon.
    censored : (controllers, runs)
        The runs whose number lies beyond the horizon.
    runs
        How many runs of each controller were looked at: those with a trajectory, or all.
    """

    quantity: Quantity
    window: Window
    unit: str
    values: Array
    censored: Array
    runs: int


@dataclass(frozen=True)
class CrossCheck:
    """The outcome of a cross-check.

    Attributes
    ----------
    method
        What redid the runs.
    runs
        How many runs of each controller.
    difference
        Largest max(‖ΔQ‖_F, ‖ΔV‖) over samples and over the runs that did not fail; inf where one
        of these fails when it is redone, NaN where all failed.
    bound
        What it should not exceed.
    """

    method: str
    runs: int
    difference: float
    bound: float

    @property
    def holds(self) -> bool:
        """Whether the difference is within the bound."""
        return not self.difference > self.bound


class Result(ResultFile):
    """An open result: of one experiment, of a point of a sweep, or of a sweep as a whole.

    All that `ResultFile` reads by name, and what readers want to know besides. Good is a run that
    ended with status 0. Labels, titles, messages and swept texts are as they can be shown.
    """

    def __init__(self, path: str | Path) -> None:
        super().__init__(path)
        try:
            check_attributes(self)
            check_coordinates(self)
        except BaseException:
            self.close()
            raise

    def at(self, point: int, attributes: Mapping[str, Attribute] | None = None) -> Self:
        """As `ResultFile.at`."""
        view = super().at(point, attributes)
        if self.has_groups:  # each says all of this anew
            check_attributes(view)
            check_coordinates(view)
        for name, value in vars(Result).items():  # what was found out about the whole
            if isinstance(value, cached_property):
                view.__dict__.pop(name, None)
        return view

    def point(self, point: int) -> Self:
        """One point of a sweep as the result of a single experiment, with its configuration.

        Raises
        ------
        ResultError
            If there is no such point.
        """
        view = self.at(point)
        attributes = {"title": f"{view.attributes['title']}, point {point}"}
        if not self.has_groups:  # which have a configuration each
            attributes["config"] = dump(config_at(source_of(self), point).data)
        return self.at(point, attributes)

    def error(self, message: str) -> EqtError:
        """An error about this result."""
        return EqtError(f"{self.path}: {message}")

    # What was run.

    @property
    def title(self) -> str:
        """Of the experiment; the folder's name if the file says none."""
        return printable(str(self.attributes.get("title", self.path.parent.name)))

    @property
    def group_name(self) -> str:
        """The group; several of a sweep over groups; nothing if the file says none."""
        return printable(str(self.attributes.get("group", "")))

    @cached_property
    def group(self) -> MatrixLieGroup | None:
        """The group; None if it is of a plugin, which need not be loaded here."""
        with suppress(ComponentError):
            return group_named(self.group_name)
        return None

    @cached_property
    def labels(self) -> list[str]:
        """The labels of the controllers."""
        return [printable(str(label)) for label in self.coordinate("controller")]

    @cached_property
    def titles(self) -> list[str]:
        """How the controllers are written: by their laws' titles, or by the labels they have."""
        if titles := self._told("titles"):
            return [printable(titles.get(label, label)) for label in self.labels]
        return [law_title(label) for label in self.labels]

    @cached_property
    def lyapunov_functions(self) -> dict[str, str]:
        """Which function L is, by label; empty where it is the same one for all."""
        found = self._told("lyapunov_functions").get("functions", {})
        return found if len(set(found.values())) > 1 else {}

    @cached_property
    def unclaimed(self) -> list[str]:
        """The labels of the laws that do not claim that their L falls."""
        return list(self._told("lyapunov_functions").get("unclaimed", []))

    @cached_property
    def without_function(self) -> list[str]:
        """The labels of laws that claim no decrease, beside laws that do so of their own L."""
        all_are = len(self.unclaimed) == len(self.labels)
        return self.unclaimed if self.lyapunov_functions and not all_are else []

    @cached_property
    def not_matched(self) -> list[str]:
        """The labels of laws whose stiffness and damping are not those of the gains."""
        return list(self._told("matching").get("not_matched", []))

    def _told(self, name: str) -> dict[str, Any]:
        """What an attribute holds as JSON; nothing in a file from before there was such a one."""
        found: dict[str, Any] = json.loads(str(self.attributes.get(name, "{}")))
        return found

    @cached_property
    def kinds(self) -> dict[str, str]:
        """The controller's kind by label, as the stored configuration has it; else the label."""
        try:
            # Only its top is looked at, and aliases are not expanded.
            config = yaml.safe_load(str(self.attributes.get("config", "")))
            entries = config["controllers"]
            return {str(entry["label"]): str(entry["kind"]) for entry in entries}
        except (yaml.YAMLError, KeyError, TypeError, RecursionError, ValueError):
            return {label: label for label in self.labels}

    @cached_property
    def loop_in_words(self) -> str:
        """What the loop has that the paper's has not, in a sentence; nothing for the paper's."""
        try:
            return loop_in_words(yaml.safe_load(str(self.attributes.get("config", ""))) or {})
        except (yaml.YAMLError, KeyError, TypeError, AttributeError, RecursionError, ValueError):
            return ""

    @property
    def source(self) -> ConfigSource:
        """The stored configuration, with the plugins that it was run with."""
        return source_of(self)

    def experiment(self, *, trust_plugins: bool = False) -> Experiment:
        """The experiment that the result says it is of.

        Parameters
        ----------
        trust_plugins
            Execute the plugin sources that the file holds.

        Raises
        ------
        EqtError
            If it cannot be built, as without its plugins.
        """
        from eqt_cli.experiment.build import build  # loads SciPy; readers do without

        return build(self.source, trust_plugins=trust_plugins)

    @property
    def provenance(self) -> dict[str, Any]:
        """Versions, machine and times, as the file has them; nothing where it has none."""
        return self._told("provenance")

    @property
    def cross_check(self) -> CrossCheck | None:
        """What came of the cross-check; None where there was none."""
        start = "cross_check_"
        if f"{start}difference" not in self.attributes:
            return None
        return CrossCheck(
            str(self.attributes[f"{start}method"]),
            int(self.attributes[f"{start}runs"]),
            float(self.attributes[f"{start}difference"]),
            float(self.attributes[f"{start}bound"]),
        )

    # Runs.

    @property
    def is_sweep(self) -> bool:
        """Whether it has several points, each an experiment."""
        return POINT in self.dimensions

    @property
    def points(self) -> int:
        """How many points a sweep has; 1 for a single experiment."""
        return self.dimensions.get(POINT, 1)

    @property
    def runs(self) -> int:
        """Runs per controller, and point."""
        return self.dimensions["run"]

    @cached_property
    def times(self) -> Array:
        """The sample times of trajectories, s."""
        return _fixed(self.coordinate("time"))

    @property
    def horizon(self) -> float | None:
        """How long the runs last, s; None where the points of a sweep differ in it."""
        if not self.has("time"):
            return None
        times = self.times
        return float(times[-1] - times[0])

    @cached_property
    def status(self) -> Array:
        """How every run ended, ``(controllers, runs)``, with the points of a sweep in front."""
        found = self["status"]
        check_status(self, found)
        return _fixed(found)

    @property
    def good(self) -> Array:
        """Which runs ended well, as `status`."""
        return self.status == 0

    @property
    def failed(self) -> dict[str, int]:
        """How many runs of each controller did not, by label."""
        counts = np.count_nonzero(self.status, axis=-1)
        totals = counts.sum(axis=0) if self.is_sweep else counts
        return {label: int(total) for label, total in zip(self.labels, totals, strict=True)}

    @property
    def failures(self) -> Array:
        """Where the failed runs are: positions along (point,) controller and run, one a row."""
        return np.argwhere(self.status)

    @property
    def endings(self) -> dict[str, int]:
        """How many runs failed in which way, the most frequent first."""
        codes, counts = np.unique(self.status[self.status != 0], return_counts=True)
        order = np.argsort(-counts, kind="stable")
        return {meaning_of(int(codes[i])): int(counts[i]) for i in order}

    def messages(self, where: Array) -> list[str]:
        """Why runs failed, of rows of `failures`."""
        # All messages of a million runs would take seconds: only the rows and columns of these.
        axes = [np.unique(where[:, axis], return_inverse=True) for axis in range(where.shape[1])]
        chosen = {dim: k for dim, (k, _) in zip(self.dims("status"), axes, strict=True)}
        found = self.read("message", **chosen)[tuple(position for _, position in axes)]
        return [printable(str(message)) for message in found]

    def place(self, where: Sequence[int]) -> str:
        """A run by its position as in `failures`: ``point 3 eqt run 17``."""
        *point, controller, run = where
        return f"{f'point {point[0]} ' if point else ''}{self.labels[controller]} run {run}"

    # Sweeps.

    @cached_property
    def swept_keys(self) -> list[SweptKey]:
        """The swept keys that take more than one value; one for keys that change together."""
        found: list[SweptKey] = []
        for name in self.coordinates:
            if name != POINT and self.dims(name) == (POINT,) and not name.endswith(".label"):
                key = self._swept_key(name)
                if max(key.levels) > 0 and key.levels not in [other.levels for other in found]:
                    found.append(key)
        return found

    def _swept_key(self, name: str) -> SweptKey:
        values = self.coordinate(name)
        key = self.long_name(name).removesuffix(", swept")
        if values.dtype == object:
            texts, values = np.unique(values.astype(str), return_inverse=True)
            return SweptKey(
                key, values, {float(k): printable(str(text)) for k, text in enumerate(texts)}
            )
        if self.has(f"{name}.label"):
            labels = self.coordinate(f"{name}.label")
            return SweptKey(
                key,
                values,
                {float(k): printable(str(v)) for k, v in zip(values, labels, strict=True)},
            )
        return SweptKey(key, values.astype(float), {}, key in self._on_log_scales)

    @cached_property
    def _on_log_scales(self) -> set[str]:
        """The keys for which a range of the sweep asks for a logarithmic scale."""
        try:
            config = yaml.safe_load(str(self.attributes.get("config", "")))
            return set(_log_keys(config["sweep"]))
        except (yaml.YAMLError, KeyError, TypeError, RecursionError):
            return set()

    def point_name(self, point: int) -> str:
        """What is swept at a point: ``kp 2, kd 0.5``."""
        keys = [swept.key.rpartition(".")[2] for swept in self.swept_keys]
        if len(set(keys)) < len(keys):
            keys = [swept.key for swept in self.swept_keys]
        pairs = zip(keys, self.swept_keys, strict=True)
        return ", ".join(f"{key} {swept.at(point)}" for key, swept in pairs)

    def laws(self, controller: int) -> dict[int, str]:
        """The points where a controller is a law with a name of its own, and its title.

        Empty where the sweep is not over the controllers' options.
        """
        if not self.has(LAW):
            return {}
        names = self.read(LAW, controller=controller)
        return {int(point): law_title(str(names[point])) for point in np.flatnonzero(names != "")}

    # Trajectories.

    @property
    def run_dimension(self) -> str:
        """The dimension along which trajectories lie: ``run``, or ``stored_run``."""
        return next(dim for dim in self.dims("lyapunov") if dim.endswith("run"))

    @cached_property
    def stored_runs(self) -> Array:
        """The numbers of the runs whose trajectories are stored; none without trajectories."""
        if not self.is_over_time("lyapunov"):
            return np.array([], dtype=int)
        return _fixed(self.coordinate(self.run_dimension))

    def is_over_time(self, name: str) -> bool:
        """Whether the file holds this over time."""
        return self.has(name) and "time" in self.dims(name)

    def check_stored(self, *signals: str, who: str) -> None:
        """Refuse to go on without signals over time.

        Parameters
        ----------
        who
            Who needs them, with the verb: ``figure 'paper' needs``.

        Raises
        ------
        EqtError
            If the file lacks one; the message says how to get it.
        """
        for name in signals:
            if not self.is_over_time(name):
                raise self.error(f"{who} {_trajectories([name])}")

    def good_stored(self, controller: int) -> Array:
        """Which of the runs with trajectories are good, ``(stored runs,)``."""
        return self.good[controller][self.stored_runs]

    def trajectories(self, signal: str, controller: int, most: int | None = None) -> Array:
        """A signal of the good runs of a controller, ``(runs, samples, …)``.

        Parameters
        ----------
        most
            How many runs to read, the first ones; all if None.
        """
        good = self.good_stored(controller)
        if most is None:
            return self.read(signal, controller=controller)[good]
        first = np.flatnonzero(good)[:most]
        return self.read(signal, controller=controller, **{self.run_dimension: first})

    def trajectory(self, signal: str, run: int) -> Array:
        """A signal of one run of every controller, good or not, ``(controllers, samples, …)``.

        Raises
        ------
        EqtError
            If the trajectory of that run is not stored.
        """
        stored = self.stored_runs.tolist()
        if run not in stored:
            has = f"; stored are runs {stored[0]} to {stored[-1]}" if stored else ""
            raise self.error(f"the trajectory of run {run} is not stored{has}")
        return self.read(signal, **{self.run_dimension: stored.index(run)})

    def parts(self, norm: str) -> list[str]:
        """The parts of a norm that are stored by themselves, as ``rotation``; often none."""
        return [
            name.removeprefix(f"{norm}_")
            for name in self.names
            if name.startswith(f"{norm}_") and self.is_over_time(name)
        ]

    @cached_property
    def attitude_errors(self) -> list[str]:
        """The norms over time that are distances ‖I − R‖_F of rotations, which angles follow from.

        None on a group of a plugin, which need not be loaded here.
        """
        parts = () if self.group is None else self.group.parts
        turns = [f"_{part.name}" if len(parts) > 1 else "" for part in parts if part.turns]
        return [name for end in turns if self.is_over_time(name := f"pose_error{end}")]

    def split(self, norm: str) -> list[str]:
        """The names of a norm's parts where it has some, else its own."""
        return [f"{norm}_{part}" for part in self.parts(norm)] or [norm]

    # Numbers per run.

    @cached_property
    def metrics(self) -> list[str]:
        """The names of all numbers that are stored for every run."""
        per_run = ("point", "controller", "run") if self.is_sweep else ("controller", "run")
        return [
            name
            for name in self.names
            if self.dims(name) == per_run and name not in ("status", "message")
        ]

    def metric(self, name: str, controller: int | None = None) -> Array:
        """A stored number of every run, ``(controllers, runs)`` or of one ``(runs,)``.

        NaN where a run failed or has none. The points of a sweep stand in front.

        Raises
        ------
        EqtError
            If there is none of that name.
        """
        self.check_metrics([name])
        good = self.good if controller is None else self.good[..., controller, :]
        return np.where(good, self._number(name, controller), np.nan)

    def _number(self, name: str, controller: int | None = None) -> Array:
        """A number of every run as it is stored, or as another one tells it."""
        chosen: dict[str, int] = {} if controller is None else {"controller": controller}
        if name in self.metrics:
            found: Array = self.read(name, **chosen).astype(float)
            return found
        return np.isfinite(self.read(self.quantity(name).told_by, **chosen)).astype(float)

    def _is_told(self, name: str) -> bool:
        """Whether a number per run that is not stored follows from one that is."""
        return name not in self.metrics and self.quantity(name).told_by in self.metrics

    def censored(self, name: str, controller: int | None = None) -> Array:
        """Which good runs have no such number because it lies beyond the horizon, as `metric`."""
        values = self.metric(name, controller)
        good = self.good if controller is None else self.good[..., controller, :]
        return good & np.isnan(values) & self.quantity(name).censored

    def counted(self, name: str) -> Array:
        """A stored number of every run, as `metric`, with every run that did not fail counted.

        One whose number lies beyond the horizon counts as the horizon, as it does in comparisons:
        a mean with such runs is less than the true one, and not the mean of those that arrived.
        Where the points of a sweep differ in the horizon, it stays NaN.
        """
        end = np.nan if self.horizon is None else self.horizon
        return np.where(self.censored(name), end, self.metric(name))

    def means(self, name: str) -> Array:
        """The mean of a number over all runs, ``(controllers,)``, at the points of a sweep before.

        NaN where a run failed: those that are left say too little of the point.
        """
        found: Array = np.mean(self.counted(name), axis=-1)
        return found

    def check_metrics(self, names: Sequence[str], who: str = "") -> None:
        """Refuse names that are of no stored number per run.

        Parameters
        ----------
        who
            Who asks, for the message: ``figure 'pareto'``.

        Raises
        ------
        EqtError
            That says which there are.
        """
        for name in names:
            if name not in self.metrics and not self._is_told(name):
                hint = suggestion(name, self.metrics) or f"; there are: {', '.join(self.metrics)}"
                raise self.error(f"{f'{who} ' if who else ''}finds no metric '{name}'{hint}")

    def quantity(self, name: str) -> Quantity:
        """What a variable is: its row of the table, and of what is not there, all the file says."""
        if not self.has(name):
            return quantity_of(name)
        return quantity_of(name, self.long_name(name)).with_choices(self.attributes_of(name))

    @cached_property
    def comparable(self) -> dict[str, Quantity]:
        """All numbers per run that this result has or that can be computed from it, by name."""
        found: dict[str, Quantity] = {}
        for quantity in (self.quantity(row.name) for row in METRICS):
            if quantity.of_turns:
                for part in (name.removeprefix("pose_error") for name in self.attitude_errors):
                    found[quantity.name + part] = quantity.part(part[1:]) if part else quantity
                continue
            told = self._is_told(quantity.name)
            if told or self._has_signals(quantity) or self._metrics_like(quantity):
                found[quantity.name] = quantity
            for part in self.parts(quantity.signals[0]) if quantity.parted else ():
                found[f"{quantity.name}_{part}"] = quantity.part(part)
        for name in self.metrics:
            found.setdefault(name, self.quantity(name))
        return found

    def headline(self) -> list[dict[str, Any]]:
        """What a run ends with: for every controller, `HEADLINE` over its good runs.

        Returns
        -------
        list of dict
            ``controller``, ``runs``, ``failed`` and the numbers by name; NaN where no run is good.
        """
        good = self.good
        return [
            {
                "controller": label,
                "runs": good[..., c, :].size,
                "failed": self.failed[label],
                **{name: self._over_good(name, c, of) for name, of in HEADLINE.items()},
            }
            for c, label in enumerate(self.labels)
        ]

    def _over_good(self, name: str, controller: int, of: Callable[[Array], Any]) -> float:
        values = self.metric(name, controller)[self.good[..., controller, :]]
        return float(of(values)) if values.size else float("nan")

    def by_parts(self, name: str) -> list[Quantity]:
        """A number per run, or those of its parts where it has some; none if it is not here."""
        known = self.comparable
        if name not in known:
            return []
        parts = self.parts(known[name].signals[0]) if known[name].parted else []
        return [known[at] for part in parts if (at := f"{name}_{part}") in known] or [known[name]]

    def covers(self, quantity: Quantity, window: Window) -> bool:
        """Whether the result holds what a number per run takes over this window."""
        return self._stored_as(quantity, window) is not None or self._has_signals(quantity)

    def per_run(self, quantity: Quantity, window: Window = WHOLE) -> PerRun:
        """A number over a window, of every run: as it is stored, or computed from trajectories.

        Raises
        ------
        EqtError
            If the result does not hold what that takes.
        """
        window = window.within(self.times)
        stored = self._stored_as(quantity, window)
        if stored is not None:
            runs, unit = np.arange(self.runs), self.units(stored)
            columns = [self.read(stored, controller=c) for c in range(len(self.labels))]
        elif self._has_signals(quantity):
            runs, unit = self.stored_runs, quantity.unit(self.units(quantity.signals[0]))
            columns = [self._computed(quantity, window, c) for c in range(len(self.labels))]
        elif self._is_told(quantity.name):
            runs, unit = np.arange(self.runs), quantity.units
            columns = [self._number(quantity.name, c) for c in range(len(self.labels))]
        else:
            raise self._not_stored(quantity, window)
        values = np.full((len(self.labels), self.runs), np.nan)
        values[:, runs] = np.stack(columns)
        values[~self.good] = np.nan
        if quantity.name == "decay_rate":  # nobody claims the decay of another function
            values[[label in self.unclaimed for label in self.labels]] = np.nan
        censored = self.good & np.isnan(values) & quantity.censored
        values[censored] = window.stop
        return PerRun(quantity, window, unit, values, censored, len(runs))

    def _computed(self, quantity: Quantity, window: Window, controller: int) -> Array:
        signals = {name: self.read(name, controller=controller) for name in quantity.signals}
        with np.errstate(all="ignore"):  # runs that failed hold NaN, and drop out
            return quantity.measure(self.times, signals, window)

    def _metrics_like(self, quantity: Quantity) -> list[Quantity]:
        """The stored metrics that are this number over some window."""
        found = [self.quantity(name) for name in self.metrics]
        return [other for other in found if other.is_same_as(quantity)]

    def _stored_as(self, quantity: Quantity, window: Window) -> str | None:
        """The stored metric that is this number over this window."""
        window = window.within(self.times)
        same = (q for q in self._metrics_like(quantity) if q.window.within(self.times) == window)
        return next((other.name for other in same), None)

    def _has_signals(self, quantity: Quantity) -> bool:
        """Whether it can be computed from what is stored over time."""
        return quantity.windowed and all(map(self.is_over_time, quantity.signals))

    def comparable_named(self, name: str) -> Quantity:
        """A number per run by name.

        Raises
        ------
        EqtError
            If this result has none of that name.
        """
        if name in self.comparable:
            return self.comparable[name]
        known = QUANTITIES.get(name)
        if known is not None and known.per is Per.RUN and known.of is not None:
            raise self._not_stored(known)
        hint = suggestion(name, self.comparable)
        raise EqtError(
            f"unknown metric '{name}'{hint}"
            f"{'' if hint else ';'} known here: {', '.join(self.comparable)}"
        )

    def _not_stored(self, quantity: Quantity, window: Window | None = None) -> EqtError:
        what = quantity.name if window is None else f"{quantity.name} over {window} s"
        if not quantity.windowed:
            return self.error(
                f"holds no metric '{quantity.name}' over a window; it is one of whole runs"
            )
        return self.error(f"cannot give {what}: it takes {_trajectories(quantity.signals)}")


@dataclass(frozen=True)
class SweptKey:
    """A key that takes several values in a sweep.

    Attributes
    ----------
    key
        Of the configuration.
    values : (points,)
        Numbers; text and matrices are numbered.
    texts
        What the numbers stand for, where the values are no numbers.
    asks_log
        Whether the range that they are from asks for a logarithmic scale.
    """

    key: str
    values: Array
    texts: dict[float, str]
    asks_log: bool = False

    @property
    def levels(self) -> list[int]:
        """The values numbered in the order in which they first occur."""
        numbers: dict[float, int] = {}
        return [numbers.setdefault(value, len(numbers)) for value in self.values.tolist()]

    @property
    def logarithmic(self) -> bool:
        """Whether the values are spread on a logarithmic scale rather than a linear one."""
        levels = np.unique(self.values)
        if self.asks_log:
            return True
        if self.texts or len(levels) < 3 or levels[0] <= 0:
            return False
        return bool(np.ptp(np.diff(np.log(levels))) / np.log(levels[-1] / levels[0]) < 1e-6)

    def value(self, point: int) -> float | str:
        """At a point, as it was given."""
        found = float(self.values[point])
        return self.texts.get(found, found)

    def at(self, point: int) -> str:
        """The value at a point, as text."""
        value = self.value(point)
        return value if isinstance(value, str) else f"{value:.4g}".replace("-", "−")


def _log_keys(section: Any) -> Iterator[str]:
    """The keys of ranges with ``scale: log``, anywhere in the section of a sweep."""
    if isinstance(section, list):
        for entry in section:
            yield from _log_keys(entry)
    elif isinstance(section, dict):
        for key, entry in section.items():
            if isinstance(entry, dict) and entry.get("scale") == "log":
                yield str(key)
            yield from _log_keys(entry)


def mean_over_runs(values: Array) -> Array:
    """The mean over the last axis, without NaN; NaN where there is nothing else."""
    count = np.isfinite(values).sum(axis=-1)
    total = np.nansum(values, axis=-1)
    return np.where(count > 0, total / np.maximum(count, 1), np.nan)


def law_title(name: str) -> str:
    """How a law is written; its name where it is not registered here."""
    law = controllers.get(name) if name in controllers.names() else None
    return str(getattr(law, "title", name))


def meaning_of(status: int) -> str:
    """A status in words."""
    try:
        return Status(status).name.lower().replace("_", " ")
    except ValueError:
        return f"status {status}"


def point_folder(*points: int) -> Path:
    """Where in a result folder goes what is made of points of a sweep."""
    return Path("figures") / "_".join(["point", *map(str, points)])


def _fixed(values: Array) -> Array:
    """What is kept for later, and therefore never to be written to."""
    values.setflags(write=False)
    return values


def _trajectories(signals: Sequence[str]) -> str:
    needed = " and ".join(f"'{name}'" for name in signals)
    return (
        f"the trajectories of {needed}, which the result does not hold; set store.trajectories to "
        "all and run the experiment again"
    )
