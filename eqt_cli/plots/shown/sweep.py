"""The points of a sweep, and the metrics at each."""

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
"""Configuration sections with design choices: gains, and options of laws."""
SEED = "ensemble.seed"


def are_choices(axes: Sequence[SweptKey]) -> bool:
    """Whether all swept keys are design choices; seeds only repeat a choice and do not count."""
    keys = [axis.key for axis in axes if axis.key != SEED]
    return all(re.split(r"\W", key)[0] in CHOICES for key in keys)


class ShownSweep:
    """A sweep's metrics over all runs of every point.

    Parameters
    ----------
    results
        The open result.
    figure, chosen
        See `ShownControllers`.

    Attributes
    ----------
    controllers : list of int
        Indices of the controllers in the result.
    looks : list of Look
        Looks, which determine their line styles.
    titles : list of str
        Their names in figures.
    remarks
        Notes that a figure adds while it is drawn.

    Raises
    ------
    EqtError
        If the result is not a sweep, or there is no such controller.
    """

    def __init__(self, results: Result, figure: str, chosen: Chosen = ALL) -> None:
        self.results, self.figure, self._shares = results, figure, False
        if not results.is_sweep:
            raise self.error(
                "shows sweeps, and this is a single experiment; see `eqt sweep --help`"
            )
        self.controllers = positions([results], figure, chosen.controllers)[0]
        self.looks = looks([results], [self.controllers], figure, chosen)
        self.titles = [results.titles[position] for position in self.controllers]
        self._shown: list[str] = []
        self.remarks: list[str] = []

    @property
    def axes(self) -> list[SweptKey]:
        """Swept keys that take more than one value; keys that change together count as one."""
        return self.results.swept_keys

    def one_or_two(self, instead: str = "") -> list[SweptKey]:
        """Return `axes`, for a figure that has room for at most two.

        Raises
        ------
        EqtError
            If there are more, or none; `instead` ends the message.
        """
        if not 1 <= len(self.axes) <= 2:
            here = f"{len(self.axes)} ({self.keys})"
            raise self.error(f"has room for one or two swept keys, and here are {here}{instead}")
        return self.axes

    @property
    def keys(self) -> str:
        """Names of `axes`, for messages."""
        return ", ".join(axis.key for axis in self.axes) or "none"

    def require_choices(self) -> None:
        """Refuse a trade-off over keys that are no design choices, such as a lag.

        Raises
        ------
        EqtError
            If any swept key is no design choice; the message names the keys.
        """
        if not are_choices(self.axes):
            raise self.error(
                "shows a trade-off between design choices, which are gains and options of laws; "
                f"here is swept: {self.keys}"
            )

    def of_one_unit(self, name: str) -> str:
        """Return the name of a metric; of its first part where the parts have different units."""
        mixed = self.results.has(name) and self.results.units(name) == MIXED
        return self.results.in_parts(name)[0] if mixed else name

    def metric(self, name: str) -> Array:
        """Return a metric of every run, ``(points, shown controllers, runs)``; NaN where it failed.

        Values beyond the horizon count as the horizon.
        """
        self.results.check_metrics([name], who=f"figure '{self.figure}'")
        self._shown.append(name)
        return self.results.counted(name)[:, self.controllers]

    def means(self, name: str) -> Array:
        """Return means over all runs, ``(points, shown controllers)``; NaN where a run failed.

        Raises
        ------
        EqtError
            If no point has a finite mean.
        """
        means: Array = np.mean(self.metric(name), axis=-1)
        if not np.isfinite(means).any():
            raise self.error(f"finds no point at which every run has a {name}")
        return means

    def laws(self, shown: int) -> dict[int, str]:
        """Return the titles of the registered laws that the n-th shown controller equals, by point.

        Empty unless the sweep is over the controllers' options.
        """
        return self.results.laws(self.controllers[shown])

    def point_name(self, point: int) -> str:
        """Return the swept values at a point: ``kp 2, kd 0.5``."""
        return self.results.point_name(point)

    def notes(self) -> list[str]:
        """Return the notes for the reader about runs without a number."""
        return [*self.remarks, *self._failed(), *self._censored()]

    @property
    def count(self) -> str:
        """Number of runs of each point: ``20 runs``."""
        return f"{self.results.runs} run{'s' * (self.results.runs != 1)}"

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
        """Return whether each run has settled by a time, or by its end if 0; failed runs have not.

        Raises
        ------
        EqtError
            If the runs are shorter, or the result holds no settling times.
        """
        horizon = self.results.horizon
        if horizon is not None and by > horizon:
            raise self.error(f"option 'by': the runs last {horizon:g} s, got {by:g}")
        self.results.check_metrics(["settling_time"], who=f"figure '{self.figure}'")
        self._shares = True
        times = self.results.metric("settling_time")[:, self.controllers]
        return times <= (by or np.inf)  # False for NaN: not settled

    def error(self, message: str) -> EqtError:
        """Return an error of this figure about this result."""
        return error_of(self.results, self.figure, message)
