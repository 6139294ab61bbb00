"""The metrics of a sweep as figures need them; it must not know how they are drawn."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from eqt_cli.core.arrays import Array
from eqt_cli.core.errors import EqtError, suggestion
from eqt_cli.plots.drawing.ensembles import error, law_title, positions, title_of
from eqt_cli.store.reader import Results

LAW = "law"
"""The variable that names the laws of a sweep over the controllers' options."""


@dataclass(frozen=True)
class Axis:
    """A key that takes several values in a sweep.

    Attributes
    ----------
    name, key
        The coordinate, and the key of the configuration.
    values : (points,)
        Numbers; text and matrices are numbered.
    ticks
        Position and text of those that are no numbers.
    """

    name: str
    key: str
    values: Array
    ticks: dict[float, str]

    @property
    def logarithmic(self) -> bool:
        """Whether the values are spread evenly on a logarithmic scale rather than a linear one."""
        levels = np.unique(self.values)
        if self.ticks or len(levels) < 3 or levels[0] <= 0:
            return False
        return bool(np.ptp(np.diff(np.log(levels))) / np.log(levels[-1] / levels[0]) < 1e-6)

    def at(self, point: int) -> str:
        """The value at a point, as text."""
        value = float(self.values[point])
        return self.ticks.get(value) or f"{value:.4g}".replace("-", "−")


class Swept:
    """A sweep's metrics over the good runs of every point.

    Parameters
    ----------
    results
        The open result.
    figure
        Name of the figure, for messages.
    chosen
        Labels of the controllers to show; all if empty.

    Attributes
    ----------
    controllers : list of int
        The positions of the controllers, on which their line styles depend.

    Raises
    ------
    EqtError
        If the result is not one of a sweep, or there is no such controller.
    """

    def __init__(self, results: Results, figure: str, chosen: Sequence[str] = ()) -> None:
        self.results, self.figure = results, figure
        if "point" not in results.dimensions:
            raise self.error(
                "shows sweeps, and this is a single experiment; see `eqt sweep --help`"
            )
        self.controllers = positions([results], figure, chosen)[0]
        labels = results.coordinate("controller")
        self.titles = [title_of(results, str(labels[position])) for position in self.controllers]

    @cached_property
    def axes(self) -> list[Axis]:
        """The swept keys that take more than one value; one for keys that change together."""
        found: list[Axis] = []
        names = [name for name in self.results.coordinates if name != "point"]
        for name in names:
            if self.results.dims(name) != ("point",) or name.endswith(".label"):
                continue
            axis = self._axis(name)
            levels = _levels(axis.values)
            if max(levels) > 0 and levels not in [_levels(other.values) for other in found]:
                found.append(axis)
        return found

    def _axis(self, name: str) -> Axis:
        values = self.results.coordinate(name)
        key = self.results.long_name(name).removesuffix(", swept")
        if values.dtype == object:
            texts, values = np.unique(values.astype(str), return_inverse=True)
            return Axis(name, key, values, {float(k): str(text) for k, text in enumerate(texts)})
        if self.results.has(f"{name}.label"):
            labels = self.results.coordinate(f"{name}.label")
            ticks = {float(k): str(text) for k, text in zip(values, labels, strict=True)}
            return Axis(name, key, values, ticks)
        return Axis(name, key, values.astype(float), {})

    def metric(self, name: str) -> Array:
        """A metric of every run, ``(points, shown controllers, runs)``; NaN where one failed."""
        metrics = [
            other
            for other in self.results.names
            if self.results.dims(other) == ("point", "controller", "run") and other != "message"
        ]
        if name not in metrics:
            hint = suggestion(name, metrics) or f"; there are: {', '.join(metrics)}"
            raise self.error(f"finds no metric '{name}'{hint}")
        status, values = self.results["status"], self.results[name].astype(float)
        return np.where(status == 0, values, np.nan)[:, self.controllers]

    def laws(self, shown: int) -> dict[int, str]:
        """The points where a controller, the n-th of those shown, is a law with a name of its own.

        Empty where the sweep is not over the controllers' options.
        """
        if not self.results.has(LAW):
            return {}
        names = self.results.read(LAW, controller=self.controllers[shown])
        return {int(point): law_title(str(names[point])) for point in np.flatnonzero(names != "")}

    def point_name(self, point: int) -> str:
        """What is swept at a point: ``kp 2, kd 0.5``."""
        keys = [axis.key.rpartition(".")[2] for axis in self.axes]
        named = keys if len(set(keys)) == len(keys) else [axis.key for axis in self.axes]
        return ", ".join(
            f"{key} {axis.at(point)}" for key, axis in zip(named, self.axes, strict=True)
        )

    def notes(self) -> list[str]:
        """What a reader must know about the runs that are not shown."""
        failed = int(np.count_nonzero(self.results["status"][:, self.controllers]))
        return [f"{failed} runs failed; left out."] if failed else []

    def error(self, message: str) -> EqtError:
        """An error of this figure about this result."""
        return error(self.results, self.figure, message)


def _levels(values: Array) -> list[int]:
    """The values numbered in the order in which they first occur."""
    numbers: dict[float, int] = {}
    return [numbers.setdefault(value, len(numbers)) for value in values.tolist()]


def mean_over_runs(values: Array) -> Array:
    """The mean over the last axis, without NaN; NaN where there is nothing else."""
    count = np.isfinite(values).sum(axis=-1)
    total = np.nansum(values, axis=-1)
    return np.where(count > 0, total / np.maximum(count, 1), np.nan)
