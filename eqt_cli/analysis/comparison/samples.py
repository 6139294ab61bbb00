"""One number per run and controller out of an open result; it knows no statistics."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
import yaml

from eqt_cli.analysis.comparison.measures import MEASURES, Measure, stored_measure
from eqt_cli.analysis.comparison.windows import WHOLE, Window
from eqt_cli.core.arrays import Array
from eqt_cli.core.errors import EqtError, suggestion
from eqt_cli.results.metrics import unit_in
from eqt_cli.store.reader import Results

_NO_QUANTITY = ("status", "message")


@dataclass(frozen=True)
class Samples:
    """A measure over a window, for every run of every controller.

    Attributes
    ----------
    measure, window, unit
        What it is; the window ends with the runs at the latest.
    values : (controllers, runs)
        NaN for runs that failed, have no such number, or have no stored trajectory.
    censored : (controllers, runs)
        The runs whose number lies beyond the horizon; its value here is the horizon.
    runs
        How many runs of each controller were looked at: those with a trajectory, or all.
    """

    measure: Measure
    window: Window
    unit: str
    values: Array
    censored: Array
    runs: int


class Source:
    """What a result offers for comparison.

    Parameters
    ----------
    results
        Open, of a single experiment or of one point of a sweep.

    Raises
    ------
    EqtError
        If the result is a sweep.
    """

    def __init__(self, results: Results) -> None:
        self.results = results.single("controllers are compared within one experiment")
        self.labels = [str(label) for label in results.coordinate("controller")]
        self.times: Array = results.coordinate("time")
        self.runs = results.dimensions["run"]

    @cached_property
    def good(self) -> Array:
        """Which runs ended with status 0, ``(controllers, runs)``."""
        return np.stack([self._read("status", i) for i in range(len(self.labels))]) == 0

    @cached_property
    def kinds(self) -> dict[str, str]:
        """The controller's kind by label, as the stored configuration has it; else the label."""
        try:
            # Only its top is looked at, and aliases are not expanded.
            config = yaml.safe_load(str(self.results.attributes.get("config", "")))
            entries = config["controllers"]
            return {str(entry["label"]): str(entry["kind"]) for entry in entries}
        except (yaml.YAMLError, KeyError, TypeError, RecursionError, ValueError):
            return {label: label for label in self.labels}

    @cached_property
    def stored_runs(self) -> Array:
        """The runs whose trajectories are stored; none if the result holds no trajectories."""
        if not self._over_time("lyapunov"):
            return np.array([], dtype=int)
        (dimension,) = (dim for dim in self.results.dims("lyapunov") if dim.endswith("run"))
        stored: Array = self.results.coordinate(dimension)
        return stored

    @cached_property
    def measures(self) -> dict[str, Measure]:
        """Everything that this result can be compared by, by name."""
        found: dict[str, Measure] = {}
        for measure in MEASURES:
            if self._available(measure):
                found[measure.name] = measure
            for suffix in self._parts(measure):
                found[measure.name + suffix] = measure.part(suffix)
        for name in self.results.names:
            if name not in found and self._is_metric(name):
                found[name] = stored_measure(name, self.results.long_name(name))
        return found

    def defaults(self) -> list[tuple[Measure, Window]]:
        """What is compared unless a user chooses; parts instead of norms with mixed units."""
        return [
            (measure, window)
            for base in MEASURES
            for measure in self.split(base.name)
            for window in base.by_default
            if self.covers(measure, window)
        ]

    def split(self, name: str) -> list[Measure]:
        """A measure, or its parts where it has some; nothing if it cannot be computed here."""
        if name not in self.measures:
            return []
        suffixes = self._parts(self.measures[name])
        return [self.measures[name + suffix] for suffix in suffixes] or [self.measures[name]]

    def is_rotation(self, measure: Measure) -> bool:
        """Whether a measure of the pose error is about orientation alone."""
        if measure.signals and measure.signals[0].startswith("pose_error_rotation"):
            return True
        whole = self.results.units("mean_pose_error") if self.results.has("mean_pose_error") else ""
        return whole == "1" and not self._parts(measure)

    def covers(self, measure: Measure, window: Window) -> bool:
        """Whether the result holds what the measure needs over this window."""
        return self._stored_as(measure, window) is not None or self._has_signals(measure)

    def measure(self, name: str) -> Measure:
        """A measure by name.

        Raises
        ------
        EqtError
            If this result has none of that name.
        """
        if name not in self.measures:
            known = next((measure for measure in MEASURES if measure.name == name), None)
            if known is not None:
                raise self._not_stored(known)
            hint = suggestion(name, self.measures)
            raise EqtError(
                f"unknown metric '{name}'{hint}"
                f"{'' if hint else ';'} known here: {', '.join(self.measures)}"
            )
        return self.measures[name]

    def samples(self, measure: Measure, window: Window = WHOLE) -> Samples:
        """The measure over a window, of every run.

        Raises
        ------
        EqtError
            If the result does not hold what that takes.
        """
        window = window.within(self.times)
        stored = self._stored_as(measure, window)
        if stored is not None:
            name, runs = stored, np.arange(self.runs)
            columns = [self._read(name, index) for index in range(len(self.labels))]
            unit = self.results.units(name)
        elif measure.of is not None and self._has_signals(measure):
            runs = self.stored_runs
            columns = [self._computed(measure, window, index) for index in range(len(self.labels))]
            unit = self._unit(measure)
        else:
            raise self._not_stored(measure, window)
        values = np.full((len(self.labels), self.runs), np.nan)
        values[:, runs] = np.stack(columns)
        values[~self.good] = np.nan
        censored = np.zeros_like(self.good)
        if measure.censored_at_horizon:
            censored = self.good & np.isnan(values)
            values[censored] = window.stop
        return Samples(measure, window, unit, values, censored, len(runs))

    def _computed(self, measure: Measure, window: Window, controller: int) -> Array:
        assert measure.of is not None
        cut = [window.cut(self.times, self._read(name, controller)) for name in measure.signals]
        with np.errstate(all="ignore"):  # runs that failed hold NaN, and drop out
            found: Array = measure.of(cut[0][0], *(values for _, values in cut))
        return found

    def _read(self, name: str, controller: int) -> Array:
        return self.results.read(name, controller=controller)

    def _stored_as(self, measure: Measure, window: Window) -> str | None:
        """The metric of the file that is this measure on this window."""
        window = window.within(self.times)
        for name, stored_window in measure.stored:
            if self._is_metric(name) and stored_window.within(self.times) == window:
                return name
        return None

    def _has_signals(self, measure: Measure) -> bool:
        return bool(measure.signals) and all(map(self._over_time, measure.signals))

    def _available(self, measure: Measure) -> bool:
        if self._has_signals(measure):
            return True
        return any(self._is_metric(name) for name, _ in measure.stored)

    def _over_time(self, signal: str) -> bool:
        return self.results.has(signal) and "time" in self.results.dims(signal)

    def _is_metric(self, name: str) -> bool:
        if name in _NO_QUANTITY or not self.results.has(name):
            return False
        return self.results.dims(name) == ("controller", "run")

    def _parts(self, measure: Measure) -> Sequence[str]:
        if not measure.parted:
            return ()
        start = measure.signals[0] + "_"
        return [
            name.removeprefix(measure.signals[0])
            for name in self.results.names
            if name.startswith(start) and self._over_time(name)
        ]

    def _unit(self, measure: Measure) -> str:
        return unit_in(measure.units, self.results.units(measure.signals[0]))

    def _not_stored(self, measure: Measure, window: Window | None = None) -> EqtError:
        what = measure.name if window is None else f"{measure.name} over {window} s"
        if not measure.windowed:
            return self.error(
                f"holds no metric '{measure.name}' over a window; it is one of whole runs"
            )
        needed = " and ".join(f"'{name}'" for name in measure.signals)
        return self.error(
            f"cannot give {what}: it takes the trajectories of {needed}, which the result does not "
            "hold; set store.trajectories to all and run the experiment again"
        )

    def error(self, message: str) -> EqtError:
        """An error about this result."""
        return EqtError(f"{self.results.path}: {message}")
