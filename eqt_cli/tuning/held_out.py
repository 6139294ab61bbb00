"""Combines the held-out runs of a tuning over cases into those of one experiment."""

from collections.abc import Mapping, Sequence
from dataclasses import replace
from functools import cached_property
from typing import Any

import numpy as np

from eqt_cli.core.arrays import Array
from eqt_cli.ensemble.designs.base import CASE
from eqt_cli.results.quantity import Quantity
from eqt_cli.results.result import PerRun, Result, mean_over_runs
from eqt_cli.results.time_windows import WHOLE, Window
from eqt_cli.tuning.folder import TUNE

Record = Mapping[str, Any]


def cases_of(result: Result, record: Record) -> dict[str, Result]:
    """Return the held-out runs in each case by name; without cases, the result itself."""
    return {name: result.point(k) for k, name in enumerate(record["cases"])} or {"": result}


def held_out(result: Result, record: Record) -> Result:
    """Return the held-out runs of a tuning as those of one experiment."""
    if not record["cases"]:
        return result
    return OverCases(cases_of(result, record), worst=record["over_cases"] == "worst")


class OverCases(Result):
    """A result whose run k combines run k of all cases, by the mean of its numbers.

    If the worst case counts, the numbers are those of the case with the worst mean over all runs,
    for each law and each number separately.
    """

    def __init__(self, cases: Mapping[str, Result], *, worst: bool) -> None:
        self._cases, self._worst = list(cases.values()), worst
        self.__dict__.update(vars(self._cases[0]))  # an open result with all other data

    @cached_property
    def status(self) -> Array:
        """Status as in `Result`; a run that fails in any case has failed."""
        return np.max([case.status for case in self._cases], axis=0)

    def metric(self, name: str, controller: int | None = None) -> Array:
        """Return the same as in `Result`, combined over the cases."""
        values = self._over(self.quantity(name), [case.metric(name) for case in self._cases])
        return values if controller is None else values[controller]

    def counted(self, name: str) -> Array:
        """Return the same as in `Result`, combined over the cases."""
        return self._over(self.quantity(name), [case.counted(name) for case in self._cases])

    def censored(self, name: str, controller: int | None = None) -> Array:
        """Return the same as in `Result`: censored in any case."""
        late: Array = np.any([case.censored(name) for case in self._cases], axis=0)
        return late if controller is None else late[controller]

    def per_run(self, quantity: Quantity, window: Window = WHOLE) -> PerRun:
        """Return the same as in `Result`, combined over the cases."""
        per_case = [case.per_run(quantity, window) for case in self._cases]
        values = self._over(quantity, [one.values for one in per_case])
        censored = np.any([one.censored for one in per_case], axis=0)
        return replace(per_case[0], values=values, censored=censored)

    def _over(self, quantity: Quantity, values: Sequence[Array]) -> Array:
        """Combine the numbers ``(controllers, runs)`` of all cases."""
        cases = np.stack(values)
        if not self._worst:
            return cases.mean(axis=0)
        costs = quantity.cost(mean_over_runs(cases))
        worst = np.where(np.isnan(costs), -np.inf, costs).argmax(axis=0)
        return cases[worst, np.arange(len(worst))]


def side_by_side(result: Result) -> list[str]:
    """Return the labels that a figure of cases compares: two laws or winners, or winner and start.

    Empty if the result has no cases, or no such pair.
    """
    if [one.key for one in result.swept_keys] != [CASE]:
        return []
    labels, record = result.labels, TUNE.beside(result)
    if record:
        one = len(record["objectives"]) == 1  # a front has many winners
        laws = [law for law in record["laws"] if law["winners"] and one]
        labels = [law["winners"][0]["label"] for law in laws]
        labels += [law["start"] for law in laws[:1]] if len(labels) == 1 else []
    return labels if len(labels) == 2 else []
