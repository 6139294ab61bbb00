"""The trajectories of results that a figure shows; it must not know how they are drawn."""

from __future__ import annotations

import dataclasses
from collections.abc import Iterator, Sequence
from contextlib import suppress
from functools import cached_property

import numpy as np

from eqt_cli.core.arrays import Array
from eqt_cli.core.errors import ComponentError, EqtError
from eqt_cli.groups import MatrixLieGroup, group_named
from eqt_cli.plots.drawing.ensembles import Ensemble, ensembles, error, names
from eqt_cli.store.reader import Results

MIXED = "mixed"
"""The unit, in a result file, of a norm over parts that have units of their own."""

_PARTED = ("pose_error", "velocity_error", "torque_norm")


class GoodRuns:
    """Trajectories of the runs, of one or several results on one group, that did not fail.

    Parameters
    ----------
    results
        Open.
    figure
        Name of the figure, for messages.
    chosen
        Labels of the controllers to show; all if empty.

    Attributes
    ----------
    ensembles : list of Ensemble
        The controllers; what is `good` is about the runs whose trajectories are stored.

    Raises
    ------
    EqtError
        If a result holds no trajectories, there is no such controller, or no run is good.
    """

    def __init__(self, results: Sequence[Results], figure: str, chosen: Sequence[str] = ()) -> None:
        self.results, self.figure = results, figure
        found = ensembles(results, figure, chosen)
        for one in results:
            self._check_stored(one, "lyapunov")
            if one.dimensions["time"] < 2:
                message = (
                    "needs trajectories of two samples or more, and the result holds one; "
                    "decrease store.decimate and run the experiment again"
                )
                raise error(one, figure, message)
        self.ensembles = [dataclasses.replace(e, good=_stored(e)) for e in found]
        if not self.shown:
            message = "has nothing to show: every run whose trajectory is stored failed"
            raise error(results[0], figure, message)

    @property
    def shown(self) -> list[Ensemble]:
        """The controllers with at least one good run."""
        return [ensemble for ensemble in self.ensembles if ensemble.good.any()]

    @property
    def span(self) -> tuple[float, float]:
        """The first and the last time of all results."""
        ends = [one.coordinate("time")[[0, -1]] for one in self.results]
        return float(np.min(ends)), float(np.max(ends))

    def times(self, ensemble: Ensemble) -> Array:
        """The sample times of a controller's runs."""
        times: Array = ensemble.results.coordinate("time")
        return times

    def values(self, signal: str, ensemble: Ensemble, most: int | None = None) -> Array:
        """One signal of the good runs of a controller, ``(runs, samples, …)``.

        Parameters
        ----------
        most
            How many runs to read, the first ones; all if None.

        Raises
        ------
        EqtError
            If the result does not hold the signal over time.
        """
        self._check_stored(ensemble.results, signal)
        results, at = ensemble.results, ensemble.controller
        if most is None:
            good: Array = results.read(signal, controller=at)[ensemble.good]
            return good
        first = np.flatnonzero(ensemble.good)[:most]
        return results.read(signal, controller=at, **{run_dimension(results): first})

    def numbers(self, ensemble: Ensemble, most: int | None = None) -> Array:
        """The numbers of the good runs of a controller, as `values` takes them."""
        stored = ensemble.results.coordinate(run_dimension(ensemble.results))
        numbers: Array = stored[ensemble.good][:most]
        return numbers

    def desired(self, signal: str, ensemble: Ensemble) -> Array:
        """A signal of the reference at the sample times, ``(samples, …)``: ``torque`` for τ_d."""
        self._check_stored(ensemble.results, f"desired_{signal}")
        return ensemble.results[f"desired_{signal}"]

    def unit(self, name: str) -> str:
        """The unit of a variable."""
        return self.results[0].units(name)

    @cached_property
    def parts(self) -> list[str]:
        """Suffixes of the norms with units of their own, ``_rotation``; else one empty suffix."""
        whole, first = _PARTED[0], self.results[0]
        suffixes = [
            name.removeprefix(whole) for name in first.names if name.startswith(whole + "_")
        ]
        return [end for end in suffixes if all(first.has(norm + end) for norm in _PARTED)] or [""]

    @cached_property
    def group(self) -> MatrixLieGroup | None:
        """The group of all results; None if it is of a plugin, which need not be loaded here."""
        with suppress(ComponentError):
            return group_named(str(self.results[0].attributes.get("group")))
        return None

    @cached_property
    def axes(self) -> list[tuple[str, str]]:
        """Name and torque unit of every algebra coordinate."""
        axes = [str(name) for name in self.results[0].coordinate("axis")]
        units = [self.unit("torque")] * len(axes)
        if MIXED in units and self.group is not None:
            for part in self.group.parts:
                units[part.axes] = [part.force_unit] * len(axes[part.axes])
        return list(zip(axes, units, strict=True))

    def notes(self) -> list[str]:
        """What a reader must know about the runs that are not shown."""
        return list(self._notes())

    def _notes(self) -> Iterator[str]:
        for one, name in zip(self.results, names(self.results), strict=True):
            total, stored = one.dimensions["run"], one.dimensions[run_dimension(one)]
            if stored < total:
                whose = f" of {name}" if len(self.results) > 1 else ""
                yield f"Trajectories of the first {stored} of {total} runs{whose}."
        for ensemble in self.ensembles:
            if ensemble.failed:
                runs = f"{ensemble.failed} of {ensemble.good.size} runs"
                yield f"{ensemble.title}: {runs} failed; left out."

    def error(self, message: str) -> EqtError:
        """An error of this figure about the results."""
        return error(self.results[0], self.figure, message)

    def _check_stored(self, results: Results, signal: str) -> None:
        if not (results.has(signal) and "time" in results.dims(signal)):
            message = (
                f"needs the trajectories of '{signal}', which the result does not hold; "
                "set store.trajectories to all and run the experiment again"
            )
            raise error(results, self.figure, message)


def run_dimension(results: Results) -> str:
    """The dimension along which a result's trajectories lie: ``run``, or ``stored_run``."""
    return results.dims("lyapunov")[1]


def _stored(ensemble: Ensemble) -> Array:
    """Which of the runs with trajectories are good."""
    good: Array = ensemble.good[ensemble.results.coordinate(run_dimension(ensemble.results))]
    return good
