"""A result with its meaning: all that its readers ask for, and the numbers of its runs."""

import os
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np

from eqt_cli.closed_loop.signals import signal_of
from eqt_cli.core.arrays import Array
from eqt_cli.core.errors import EqtError, suggestion
from eqt_cli.core.over_time import Samples
from eqt_cli.results.metrics import METRICS
from eqt_cli.results.quantity import Quantity, ValuePer
from eqt_cli.results.quantity_table import QUANTITIES, quantity_of
from eqt_cli.results.stored_runs import StoredRuns, lacks
from eqt_cli.results.time_windows import WHOLE, Window

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


class Result(StoredRuns):
    """An open result: of one experiment, of a point of a sweep, or of a sweep as a whole.

    All that `ResultFile` reads by name, and what readers want to know besides: here, the numbers of
    its runs.
    """

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
        found = np.where(self.good, self._number(name), np.nan)
        return found if controller is None else found[..., controller, :]

    def _number(self, name: str) -> Array:
        """A number of every run as it is stored, or as another one tells it."""
        if name in self.metrics:
            return self[name].astype(float)
        return np.isfinite(self[self.quantity(name).told_by]).astype(float)

    def _is_told(self, name: str) -> bool:
        """Whether a number per run that is not stored follows from one that is."""
        return name not in self.metrics and self.quantity(name).told_by in self.metrics

    def censored(self, name: str, controller: int | None = None) -> Array:
        """Which good runs have no such number because it lies beyond the horizon, as `metric`."""
        found = self.good & np.isnan(self.metric(name)) & self.quantity(name).censored
        return found if controller is None else found[..., controller, :]

    def counted(self, name: str) -> Array:
        """A stored number of every run, as `metric`, with every run that did not fail counted.

        One whose number lies beyond the horizon counts as the horizon, as it does in comparisons:
        a mean with such runs is less than the true one, and not the mean of those that arrived.
        Where the points of a sweep differ in the horizon, it stays NaN.
        """
        end = np.nan if self.horizon is None else self.horizon
        return np.where(self.censored(name), end, self.metric(name))

    @property
    def settles(self) -> Array | None:
        """Which good runs end within the settling threshold, ``(controllers, runs)``.

        The points of a sweep stand in front. None where nothing that is stored tells.
        """
        if not {"settled", self.quantity("settled").told_by} & set(self.metrics):
            return None
        found: Array = self.metric("settled") > 0  # NaN, of a run that failed, is not
        return found

    def means(self, name: str) -> Array:
        """The mean of a number over all runs, ``(controllers,)``, at the points of a sweep before.

        NaN where a run failed: those that are left say too little of the point.
        """
        return np.mean(self.counted(name), axis=-1)

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

    def part_units(self, name: str) -> list[str]:
        """The different units of the parts of a norm, as ``["N m", "N"]``.

        Empty where all parts have one unit, or the group is of a plugin.
        """
        found = self.quantity(name)
        signal = signal_of(found.signals[0] if found.signals else name)
        parts = () if self.group is None else self.group.parts
        if signal is None or len(parts) < 2:
            return []
        units = [signal.unit_in(part) for part in parts]
        # A signal says its own unit; a metric has it from that of its signal.
        of = [unit if self.is_over_time(name) else found.unit(unit) for unit in units]
        return list(dict.fromkeys(of)) if len(set(of)) > 1 else []

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
            for part in self._parts_of(quantity):
                found[f"{quantity.name}_{part}"] = quantity.part(part)
        for name in self.metrics:
            found.setdefault(name, self.quantity(name))
        return found

    def headline(self) -> list[dict[str, Any]]:
        """What a run ends with: for every controller, `HEADLINE` over its good runs.

        Returns
        -------
        list of dict
            ``controller``, ``runs``, ``failed`` and the numbers by name, or of their parts where
            these have units of their own; NaN where no run is good.
            How many runs have ``settled``, and their mean ``saturated_share``, as far as these are
            in the result.
        """
        good = self.good
        return [
            {
                "controller": label,
                "runs": good[..., c, :].size,
                "failed": self.failed[label],
                **{
                    each: self._over_good(each, c, of)
                    for name, of in HEADLINE.items()
                    for each in self.in_parts(name)
                },
                **self._settled(c),
                **self._saturated(c),
            }
            for c, label in enumerate(self.labels)
        ]

    def _settled(self, controller: int) -> dict[str, int]:
        if not self.has("settling_time"):
            return {}
        times = self.metric("settling_time", controller)[self.good[..., controller, :]]
        return {"settled": int(np.count_nonzero(np.isfinite(times)))}

    def _saturated(self, controller: int) -> dict[str, float]:
        name = "saturated_share"
        return {name: self._over_good(name, controller, np.mean)} if self.has(name) else {}

    def _over_good(self, name: str, controller: int, of: Callable[[Array], Any]) -> float:
        values = self.metric(name, controller)[self.good[..., controller, :]]
        return float(of(values)) if values.size else float("nan")

    def by_parts(self, name: str) -> list[Quantity]:
        """A number per run, or those of its parts where it has some; none if it is not here."""
        known = self.comparable
        if name not in known:
            return []
        parts = self._parts_of(known[name])
        return [known[at] for part in parts if (at := f"{name}_{part}") in known] or [known[name]]

    def _parts_of(self, quantity: Quantity) -> list[str]:
        """The parts for which a number per run is known: over time, or as it is stored."""
        over_time = self.parts(quantity.signals[0]) if quantity.parted else []
        stored = [
            part.removeprefix(f"{like.name}_")
            for like in self._metrics_like(quantity)
            for part in self.in_parts(like.name)
            if part != like.name
        ]
        return list(dict.fromkeys([*over_time, *stored]))

    def unit_in_words(self, name: str) -> str:
        """The unit of a number; "" of a pure one, ``N m and N`` of several parts together."""
        unit = self.units(name)
        if unit == "mixed" and (parts := self.part_units(name)):
            return " and ".join(parts)
        return "" if unit == "1" else unit

    def in_parts(self, name: str) -> list[str]:
        """The stored numbers of the parts where they have units of their own, else the number."""
        return [other for other in self.metrics if other.startswith(f"{name}_")] or [name]

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
            columns = self[stored]
        elif self._has_signals(quantity):
            runs, unit = self.stored_runs, quantity.unit(self.units(quantity.signals[0]))
            each = [self._computed(quantity, window, c) for c in range(len(self.labels))]
            columns = np.stack(each)
        elif self._is_told(quantity.name):
            runs, unit = np.arange(self.runs), quantity.units
            columns = self._number(quantity.name)
        else:
            raise self._not_stored(quantity, window)
        values = np.full((len(self.labels), self.runs), np.nan)
        values[:, runs] = columns
        values[~self.good] = np.nan
        if quantity.name == "decay_rate":  # nobody claims the decay of another function
            values[[label in self.unclaimed for label in self.labels]] = np.nan
        censored = self.good & np.isnan(values) & quantity.censored
        values[censored] = window.stop
        return PerRun(quantity, window, unit, values, censored, len(runs))

    def _computed(self, quantity: Quantity, window: Window, controller: int) -> Array:
        signals = {name: self.read(name, controller=controller) for name in quantity.signals}
        with np.errstate(all="ignore"):  # runs that failed hold NaN, and drop out
            return quantity.measure(Samples(self.times), signals, window)

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
        if known is not None and known.per is ValuePer.RUN and known.of is not None:
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
        return self.error(f"cannot give {what}: it takes {lacks(quantity.signals)}")


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


def mean_over_runs(values: Array) -> Array:
    """The mean over the last axis, without NaN; NaN where there is nothing else."""
    count = np.isfinite(values).sum(axis=-1)
    total = np.nansum(values, axis=-1)
    return np.where(count > 0, total / np.maximum(count, 1), np.nan)


def point_folder(*points: int) -> Path:
    """Where in a result folder goes what is made of points of a sweep."""
    return Path("figures") / "_".join(["point", *map(str, points)])
