"""The class `Result`: reads the numbers of the runs of a result with their meaning."""

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
"""Metrics of a summary, and how each is combined over runs."""


@dataclass(frozen=True)
class PerRun:
    """A quantity over a window, for every run of every controller.

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
    """

    quantity: Quantity
    window: Window
    unit: str
    values: Array
    censored: Array
    runs: int

    def __repr__(self) -> str:
        """Return a description without the values."""
        return f"PerRun({self.quantity.name}, {self.window}, {self.runs} runs)"


class Result(StoredRuns):
    """An open result of one experiment, of a point of a sweep, or of a whole sweep.

    It reads variables by name as `ResultFile` does, and provides the numbers of its runs.
    """

    @cached_property
    def metrics(self) -> list[str]:
        """Names of all numbers that are stored for every run."""
        per_run = ("point", "controller", "run") if self.is_sweep else ("controller", "run")
        return [
            name
            for name in self.names
            if self.dims(name) == per_run and name not in ("status", "message")
        ]

    def metric(self, name: str, controller: int | None = None) -> Array:
        """Return a number of every run, ``(controllers, runs)``, or ``(runs,)`` for one controller.

        NaN if a run failed or has no value. A sweep has a leading axis of points.

        Raises
        ------
        EqtError
            If there is no number of that name.
        """
        self.check_metrics([name])
        found = np.where(self.good, self._number(name), np.nan)
        return found if controller is None else found[..., controller, :]

    def _number(self, name: str) -> Array:
        """Return a number of every run as stored, or as it follows from another one."""
        if name in self.metrics:
            return self[name].astype(float)
        return np.isfinite(self[self.quantity(name).told_by]).astype(float)

    def _follows(self, name: str) -> bool:
        """Whether a number per run is not stored, but follows from a stored one."""
        return name not in self.metrics and self.quantity(name).told_by in self.metrics

    def censored(self, name: str, controller: int | None = None) -> Array:
        """Whether the number of each good run lies beyond the horizon, in the shape of `metric`."""
        found = self.good & np.isnan(self.metric(name)) & self.quantity(name).censored
        return found if controller is None else found[..., controller, :]

    def counted(self, name: str) -> Array:
        """Return a number of every run, as `metric`, with values for runs beyond the horizon.

        A number beyond the horizon counts as the horizon, as in comparisons. A mean with such runs
        is a lower bound of the true mean, while leaving them out would average only the settled
        runs. If the points of a sweep differ in the horizon, the value stays NaN.
        """
        end = np.nan if self.horizon is None else self.horizon
        return np.where(self.censored(name), end, self.metric(name))

    @property
    def settles(self) -> Array | None:
        """Whether each good run ends within the settling threshold, ``(controllers, runs)``.

        A sweep has a leading axis of points. None if the result does not store this.
        """
        if not {"settled", self.quantity("settled").told_by} & set(self.metrics):
            return None
        found: Array = self.metric("settled") > 0  # NaN (a failed run) is not settled
        return found

    def means(self, name: str) -> Array:
        """Return the mean of a number over all runs, ``(controllers,)``; a sweep adds points.

        NaN if a run failed, because the remaining runs are a biased sample.
        """
        return np.mean(self.counted(name), axis=-1)

    def check_metrics(self, names: Sequence[str], who: str = "") -> None:
        """Check that numbers per run of these names exist.

        Parameters
        ----------
        who
            Name of the caller for the message: ``figure 'pareto'``.

        Raises
        ------
        EqtError
            With the existing names.
        """
        for name in names:
            if name not in self.metrics and not self._follows(name):
                hint = suggestion(name, self.metrics) or f"; there are: {', '.join(self.metrics)}"
                raise self.error(f"{f'{who} ' if who else ''}finds no metric '{name}'{hint}")

    def quantity(self, name: str) -> Quantity:
        """Return the row of a variable in the table, with the attributes of the file."""
        if not self.has(name):
            return quantity_of(name)
        return quantity_of(name, self.long_name(name)).with_choices(self.attributes_of(name))

    def knows(self, name: str) -> bool:
        """As of what a result is of; and what can be computed from it."""
        return super().knows(name) or name in self.comparable

    def part_units(self, name: str) -> list[str]:
        """Return the different units of the parts of a norm, as ``["N m", "N"]``.

        Empty if all parts have the same unit, or the group comes from a plugin.
        """
        found = self.quantity(name)
        signal = signal_of(found.signals[0] if found.signals else name)
        parts = () if self.group is None else self.group.parts
        if signal is None or len(parts) < 2:
            return []
        units = [signal.unit_in(part) for part in parts]
        # A metric derives its unit from that of its signal.
        of = [unit if self.is_over_time(name) else found.unit(unit) for unit in units]
        return list(dict.fromkeys(of)) if len(set(of)) > 1 else []

    @cached_property
    def comparable(self) -> dict[str, Quantity]:
        """All numbers per run that the result holds or that can be computed from it, by name."""
        found: dict[str, Quantity] = {}
        for quantity in (self.quantity(row.name) for row in METRICS):
            if quantity.of_turns:
                for part in (name.removeprefix("pose_error") for name in self.attitude_errors):
                    found[quantity.name + part] = quantity.part(part[1:]) if part else quantity
                continue
            follows = self._follows(quantity.name)
            if follows or self._has_signals(quantity) or self._metrics_like(quantity):
                found[quantity.name] = quantity
            for part in self._parts_of(quantity):
                found[f"{quantity.name}_{part}"] = quantity.part(part)
        for name in self.metrics:
            found.setdefault(name, self.quantity(name))
        return found

    def headline(self) -> list[dict[str, Any]]:
        """Return the summary of every controller: `HEADLINE` over its good runs.

        Returns
        -------
        list of dict
            ``controller``, ``runs``, ``failed``, and the numbers by name, or those of their parts
            if the units differ; NaN if no run is good. Also the number of ``settled`` runs and the
            mean ``saturated_share``, if the result has them.
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
        """Return a number per run, or those of its parts if it has some; empty if it is unknown."""
        known = self.comparable
        if name not in known:
            return []
        parts = self._parts_of(known[name])
        return [known[at] for part in parts if (at := f"{name}_{part}") in known] or [known[name]]

    def _parts_of(self, quantity: Quantity) -> list[str]:
        """Return the parts for which a number per run is stored or can be computed."""
        over_time = self.parts(quantity.signals[0]) if quantity.parted else []
        stored = [
            part.removeprefix(f"{like.name}_")
            for like in self._metrics_like(quantity)
            for part in self.in_parts(like.name)
            if part != like.name
        ]
        return list(dict.fromkeys([*over_time, *stored]))

    def unit_in_words(self, name: str) -> str:
        """Return the unit of a number; "" for a pure one, ``N m and N`` for several parts."""
        unit = self.units(name)
        if unit == "mixed" and (parts := self.part_units(name)):
            return " and ".join(parts)
        return "" if unit == "1" else unit

    def in_parts(self, name: str) -> list[str]:
        """Return the stored numbers of the parts if their units differ, else the number."""
        return [other for other in self.metrics if other.startswith(f"{name}_")] or [name]

    def covers(self, quantity: Quantity, window: Window) -> bool:
        """Whether a number per run is known over this window."""
        stored = self._stored_as(quantity, window) is not None
        return stored or self._has_signals(quantity) or self._follows(quantity.name)

    def per_run(self, quantity: Quantity, window: Window = WHOLE) -> PerRun:
        """Return a number of every run over a window, as stored or computed from trajectories.

        Raises
        ------
        EqtError
            If the result lacks the data.
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
        elif self._follows(quantity.name):
            runs, unit = np.arange(self.runs), quantity.units
            columns = self._number(quantity.name)
        else:
            raise self._not_stored(quantity, window)
        values = np.full((len(self.labels), self.runs), np.nan)
        values[:, runs] = columns
        values[~self.good] = np.nan
        if quantity.name == "decay_rate":  # the decay of L is not claimed for these
            values[[label in self.unclaimed for label in self.labels]] = np.nan
        censored = self.good & np.isnan(values) & quantity.censored
        values[censored] = window.stop
        return PerRun(quantity, window, unit, values, censored, len(runs))

    def _computed(self, quantity: Quantity, window: Window, controller: int) -> Array:
        signals = {name: self.read(name, controller=controller) for name in quantity.signals}
        with np.errstate(all="ignore"):  # failed runs hold NaN
            return quantity.measure(Samples(self.times), signals, window)

    def _metrics_like(self, quantity: Quantity) -> list[Quantity]:
        """Return the stored metrics that are this number over any window."""
        found = [self.quantity(name) for name in self.metrics]
        return [other for other in found if other.is_same_as(quantity)]

    def _stored_as(self, quantity: Quantity, window: Window) -> str | None:
        """Return the stored metric that is this number over this window."""
        window = window.within(self.times)
        same = (q for q in self._metrics_like(quantity) if q.window.within(self.times) == window)
        return next((other.name for other in same), None)

    def _has_signals(self, quantity: Quantity) -> bool:
        """Whether a quantity can be computed from stored signals."""
        return quantity.windowed and all(map(self.is_over_time, quantity.signals))

    def comparable_named(self, name: str) -> Quantity:
        """Return a number per run by name.

        Raises
        ------
        EqtError
            If this result has no such number.
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
        return self.error(f"cannot compute {what}: it needs {lacks(quantity.signals)}")


def open_result(path: str | os.PathLike[str], point: int | None = None) -> Result:
    """Open a result, or one point of a sweep as the result of a single experiment.

    Parameters
    ----------
    path
        The result folder, or the result file in it.
    point
        Number of a point of a sweep.

    Returns
    -------
    Result
        A context manager that closes the file.

    Raises
    ------
    ResultError
        If there is no such result or point, or its file is damaged or unsafe.
    """
    result = Result(Path(path))
    try:
        return result if point is None else result.point(point)
    except BaseException:
        result.close()
        raise


def mean_over_runs(values: Array) -> Array:
    """Return the mean over the last axis without NaN; NaN if all values are NaN."""
    count = np.isfinite(values).sum(axis=-1)
    total = np.nansum(values, axis=-1)
    return np.where(count > 0, total / np.maximum(count, 1), np.nan)


def point_folder(*points: int) -> Path:
    """Return the folder within a result folder for files made from points of a sweep."""
    return Path("figures") / "_".join(["point", *map(str, points)])
