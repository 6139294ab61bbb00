"""The runs of a result that a figure shows; it must not know how they are drawn."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from eqt_cli.controllers import controllers
from eqt_cli.core.arrays import Array
from eqt_cli.core.errors import EqtError, suggestion
from eqt_cli.groups import groups
from eqt_cli.store.reader import Results

MIXED = "mixed"
"""The unit, in a result file, of a norm over parts that have units of their own."""

_PARTED = ("pose_error", "velocity_error", "torque_norm")


@dataclass(frozen=True)
class Ensemble:
    """The runs of one controller whose trajectories are stored.

    Attributes
    ----------
    index
        The controller's position in the result; its line style depends on nothing else.
    label, title
        Its name in the result and in figures.
    good : (stored runs,)
        Which of them ended with status 0.
    """

    index: int
    label: str
    title: str
    good: Array

    @property
    def failed(self) -> int:
        """How many runs are left out because they failed."""
        return int(self.good.size - np.count_nonzero(self.good))


class GoodRuns:
    """Trajectories of the runs of a result that did not fail.

    Parameters
    ----------
    results
        The open result.
    figure
        Name of the figure, for messages.
    chosen
        Labels of the controllers to show; all if empty.

    Raises
    ------
    EqtError
        If the result holds no trajectories, no such controller, or no run that is good.
    """

    def __init__(self, results: Results, figure: str, chosen: Sequence[str] = ()) -> None:
        self.results, self.figure = results, figure
        self._check_stored("lyapunov")
        self.times: Array = results.coordinate("time")
        if len(self.times) < 2:
            raise self.error(
                "needs trajectories of two samples or more, and the result holds one; "
                "decrease store.decimate and run the experiment again"
            )
        self.run_dimension = results.dims("lyapunov")[1]
        labels = [str(label) for label in results.coordinate("controller")]
        for label in chosen:
            if label not in labels:
                hint = suggestion(label, labels) or f"; the result holds: {', '.join(labels)}"
                raise self.error(f"finds no controller '{label}'{hint}")
        self.ensembles = [
            Ensemble(index, label, _title(label), self._good(index))
            for index, label in enumerate(labels)
            if not chosen or label in chosen
        ]
        if not any(ensemble.good.any() for ensemble in self.ensembles):
            raise self.error("has nothing to show, since every run failed; see `eqt show`")

    @property
    def shown(self) -> list[Ensemble]:
        """The controllers with at least one good run."""
        return [ensemble for ensemble in self.ensembles if ensemble.good.any()]

    def values(self, signal: str, ensemble: Ensemble) -> Array:
        """One signal of every good run of a controller, ``(runs, samples, …)``.

        Raises
        ------
        EqtError
            If the result does not hold the signal over time.
        """
        self._check_stored(signal)
        values: Array = self.results.read(signal, controller=ensemble.index)[ensemble.good]
        return values

    def unit(self, name: str) -> str:
        """The unit of a variable."""
        return self.results.units(name)

    @cached_property
    def parts(self) -> list[str]:
        """Suffixes of the norms with units of their own, ``_rotation``; else one empty suffix."""
        whole = _PARTED[0]
        suffixes = [
            name.removeprefix(whole) for name in self.results.names if name.startswith(whole + "_")
        ]
        has = self.results.has
        return [end for end in suffixes if all(has(norm + end) for norm in _PARTED)] or [""]

    @cached_property
    def axes(self) -> list[tuple[str, str]]:
        """Name and torque unit of every algebra coordinate."""
        names = [str(name) for name in self.results.coordinate("axis")]
        units = [self.unit("torque")] * len(names)
        group = str(self.results.attributes.get("group"))
        if MIXED in units and group in groups.names():  # a plugin's group need not be loaded here
            for part in groups.get(group)().parts:
                units[part.axes] = [part.force_unit] * len(names[part.axes])
        return list(zip(names, units, strict=True))

    @property
    def desired_torque(self) -> Array:
        """τ_d at the sample times, ``(samples, m)``."""
        self._check_stored("desired_torque")
        return self.results["desired_torque"]

    def notes(self) -> list[str]:
        """What a reader must know about the runs that are not shown."""
        return list(self._notes())

    def _notes(self) -> Iterator[str]:
        total = self.results.dimensions["run"]
        stored = self.results.dimensions[self.run_dimension]
        if stored < total:
            yield f"Trajectories of the first {stored} of {total} runs."
        for ensemble in self.ensembles:
            if ensemble.failed:
                yield f"{ensemble.title}: {ensemble.failed} of {stored} runs failed; left out."

    def _good(self, controller: int) -> Array:
        status = self.results.read("status", controller=controller)
        good: Array = status[self.results.coordinate(self.run_dimension)] == 0
        return good

    def _check_stored(self, signal: str) -> None:
        if not (self.results.has(signal) and "time" in self.results.dims(signal)):
            raise self.error(
                f"needs the trajectories of '{signal}', which the result does not hold; "
                "set store.trajectories to all and run the experiment again"
            )

    def error(self, message: str) -> EqtError:
        """An error of this figure about this result."""
        return EqtError(f"{self.results.path}: figure '{self.figure}' {message}")


def _title(label: str) -> str:
    """How a controller is written in figures: by its title if its label is a law's name."""
    if label not in controllers.names():
        return label
    return getattr(controllers.get(label), "title", label)
