"""The points of a sweep, and what was measured at each."""

import re
from collections.abc import Iterator, Sequence

import numpy as np

from eqt_cli.closed_loop.signals import MIXED
from eqt_cli.core.arrays import Array
from eqt_cli.core.errors import EqtError
from eqt_cli.plots.shown.controllers import ALL, Chosen, error_of, looks, positions
from eqt_cli.results.result import Result
from eqt_cli.results.swept_key import SweptKey

CHOICES = ("gains", "controllers")
"""Sections of a configuration whose keys a designer chooses: gains, and options of laws."""
SEED = "ensemble.seed"


def are_choices(axes: Sequence[SweptKey]) -> bool:
    """Whether all swept keys are choices of a designer; seeds only repeat what was chosen."""
    keys = [axis.key for axis in axes if axis.key != SEED]
    return all(re.split(r"\W", key)[0] in CHOICES for key in keys)


class ShownSweep:
    """A sweep's metrics over all runs of every point.

    Parameters
    ----------
    results
        The open result.
    figure, chosen
        As for `ShownControllers`.

    Attributes
    ----------
    controllers : list of int
        The positions of the controllers.
    looks : list of Look
        On what their line styles depend.
    titles : list of str
        Their names in figures.
    remarks
        What a figure adds to the notes while it is drawn.

    Raises
    ------
    EqtError
        If the result is not one of a sweep, or there is no such controller.
    """

    def __init__(self, results: Result, figure: str, chosen: Chosen = ALL) -> None:
        self.results, self.figure, self._shares = results, figure, False
        if not results.is_sweep:
            raise self.error(
                "shows sweeps, and this is a single experiment; see `eqt sweep --help`"
            )
        self.controllers = positions([results], figure, chosen.controllers)[0]
        self.looks = looks([results], [self.controllers], figure, chosen.focus)
        self.titles = [results.titles[position] for position in self.controllers]
        self._shown: list[str] = []
        self.remarks: list[str] = []

    @property
    def axes(self) -> list[SweptKey]:
        """The swept keys that take more than one value; one for keys that change together."""
        return self.results.swept_keys

    def one_or_two(self, instead: str = "") -> list[SweptKey]:
        """`axes`, for a figure that has room for no more of them.

        Raises
        ------
        EqtError
            If there are more, or none; it ends with what to do instead.
        """
        if not 1 <= len(self.axes) <= 2:
            here = f"{len(self.axes)} ({self.keys})"
            raise self.error(f"has room for one or two swept keys, and here are {here}{instead}")
        return self.axes

    @property
    def keys(self) -> str:
        """The names of `axes`, for messages."""
        return ", ".join(axis.key for axis in self.axes) or "none"

    def require_choices(self) -> None:
        """Refuse a trade-off between what nobody chooses, such as a lag or an initial angle.

        Raises
        ------
        EqtError
            That says what is swept.
        """
        if not are_choices(self.axes):
            raise self.error(
                "shows a trade-off between design choices, which are gains and options of laws; "
                f"here is swept: {self.keys}"
            )

    def of_one_unit(self, name: str) -> str:
        """A metric; that of the first part where the parts have units of their own."""
        mixed = self.results.has(name) and self.results.units(name) == MIXED
        return self.results.in_parts(name)[0] if mixed else name

    def metric(self, name: str) -> Array:
        """A metric of every run, ``(points, shown controllers, runs)``; NaN where one failed.

        The horizon stands for what lies beyond it.
        """
        self.results.check_metrics([name], who=f"figure '{self.figure}'")
        self._shown.append(name)
        return self.results.counted(name)[:, self.controllers]

    def means(self, name: str) -> Array:
        """The means over all runs, ``(points, shown controllers)``; NaN where one failed.

        Raises
        ------
        EqtError
            If none of the points has one.
        """
        found: Array = np.mean(self.metric(name), axis=-1)
        if not np.isfinite(found).any():
            raise self.error(f"finds no point at which every run has a {name}")
        return found

    @property
    def failed_runs(self) -> Array:
        """How many runs failed, ``(points, shown controllers)``."""
        found: Array = np.count_nonzero(self.results.status, axis=-1)[:, self.controllers]
        return found

    def beyond(self, name: str) -> Array:
        """Of how many runs a metric lies beyond the horizon, ``(points, shown controllers)``."""
        found: Array = self.results.censored(name).sum(axis=-1)[:, self.controllers]
        return found

    def laws(self, shown: int) -> dict[int, str]:
        """The points where a controller, the n-th of those shown, is a law with a name of its own.

        Empty where the sweep is not over the controllers' options.
        """
        return self.results.laws(self.controllers[shown])

    def point_name(self, point: int) -> str:
        """What is swept at a point: ``kp 2, kd 0.5``."""
        return self.results.point_name(point)

    def notes(self) -> list[str]:
        """What a reader must know about the runs that have no number."""
        return [*self.remarks, *self._failed(), *self._censored()]

    @property
    def count(self) -> str:
        """How many runs each point has: ``n = 20``."""
        return f"n = {self.results.runs}"

    def _failed(self) -> Iterator[str]:
        failed = self.results.status[:, self.controllers] != 0
        without = failed.any(axis=-1)
        if without.any():
            left_out = f"{np.count_nonzero(without)} of {without.size} means left out"
            number = int(np.count_nonzero(failed))
            count = f"{number} run{'s' * (number != 1)} failed"
            yield f"{count}; {'counted as not settled' if self._shares else left_out}."

    def _censored(self) -> Iterator[str]:
        horizon = self.results.horizon
        for name in dict.fromkeys(self._shown):
            late = int(np.count_nonzero(self.results.censored(name)[:, self.controllers]))
            if late and horizon is None:
                yield f"{name}: {late} runs unsettled at their end; their means left out."
            elif late:
                end = f"{horizon:g} s"
                counted = f"{late} runs unsettled at {end} count as {end}"
                yield f"{name}: {counted}; means are lower bounds."

    def settled(self, by: float) -> Array:
        """Which runs have settled by a time, or by their end if it is 0; no failed run has.

        Raises
        ------
        EqtError
            If runs do not last that long, or the result does not tell.
        """
        horizon = self.results.horizon
        if horizon is not None and by > horizon:
            raise self.error(f"option 'by': the runs last {horizon:g} s, got {by:g}")
        self.results.check_metrics(["settling_time"], who=f"figure '{self.figure}'")
        self._shares = True
        times = self.results.metric("settling_time")[:, self.controllers]
        found: Array = times <= (by or np.inf)  # NaN, of a run that has not settled, is not
        return found

    def error(self, message: str) -> EqtError:
        """An error of this figure about this result."""
        return error_of(self.results, self.figure, message)
