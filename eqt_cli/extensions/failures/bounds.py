"""Bounds of errors at which runs end as failed: the section `failed_when`."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import reduce
from typing import Any

import numpy as np

from eqt_cli.base.arrays import Array, absolute, distinct, less, maximum
from eqt_cli.base.errors import Problems, suggestion
from eqt_cli.base.option_types import Written, number_of, shown
from eqt_cli.base.stored import Status
from eqt_cli.base.units import base_of, factor, offered
from eqt_cli.engines.engine import Engine, Problem, Solution, evaluate
from eqt_cli.loop.closed_loop import ClosedLoop
from eqt_cli.loop.signals import existing, values_at
from eqt_cli.numbers.running import SampledRuns
from eqt_cli.results.quantity import Measure
from eqt_cli.runs.batches import Batch

SHORT = {
    "position": "position_error",
    "attitude": "attitude_angle",
    "pointing": "pointing_error",
    "heading": "heading_error",
    "velocity": "velocity_error_translation",
    "rate": "velocity_error_rotation",
}
"""Errors by the words of a user, and the signals that they are."""

POINTS, ROUNDS = 65, 2
"""Times at which a run is looked at between two samples, and how often: the last ones are 1/4096 of
two samples apart. Between them the error is a straight line, which of an error e(t) moves the time
by less than ë/ė times 8e-9 of the square of the time between samples."""

AT_ONCE = 32
"""Runs that are looked at together: their times are those of all of them."""


@dataclass(frozen=True)
class Signals:
    """Signals of the loop by name at a sample, for floats or symbols."""

    names: tuple[str, ...]

    def __call__(self, loop: ClosedLoop, t: Any, states: Array) -> dict[str, Array]:
        """Return them."""
        return values_at(loop, loop.tracking(t, states), states, self.names)


@dataclass(frozen=True)
class Bounds:
    """The largest sizes of signals, at which a run ends as failed.

    Attributes
    ----------
    most, units
        By the names of signals: their bounds, in their units.
    """

    most: Mapping[str, float]
    units: Mapping[str, str]

    @property
    def largest(self) -> Measure:
        """The largest share of its bound that an error has at a sample of a run."""
        words = f"failed when {dict(self.most)}"
        return Measure(words, words, signals=tuple(self.most), of=self._largest)

    def crossed(self, value_of: Callable[[str], Any]) -> Any:
        """Return whether an error is beyond its bound, by the values of signals at an instant."""
        return less(1.0, reduce(maximum, self._shares([value_of(name) for name in self.most])))

    def _largest(self, over: SampledRuns, *values: Any) -> Any:
        return over.largest(reduce(maximum, self._shares(values)))

    def _shares(self, values: Sequence[Any]) -> list[Any]:
        """Return the sizes of the signals, each divided by its bound."""
        return [absolute(x) / most for x, most in zip(values, self.most.values(), strict=True)]

    def shares(self, engine: Engine, problem: Problem) -> Array:
        """Solve, and return the shares of bounds at the samples, ``(bounds, runs, samples)``."""
        states = engine.solve(problem).states
        values = evaluate(engine, Signals(tuple(self.most)), problem, states)
        shape = states.shape[:2]
        return np.array(self._shares([np.broadcast_to(values[k], shape) for k in self.most]))

    def end_runs(self, batch: Batch, solution: Solution) -> None:
        """End the runs of a solution that cross a bound, at the moment at which they do.

        A run that has failed later for another reason has crossed it first.
        """
        status, share = solution.status, solution.numbers[self.largest.name]
        stays = np.isin(status, (Status.STOPPED, Status.BY_ROUNDING)) | (share <= 1.0)
        suspects = np.flatnonzero(~stays)
        for first in range(0, len(suspects), AT_ONCE):
            some = suspects[first : first + AT_ONCE]
            for place, (t, name) in self.crossings(
                batch.engine, batch.problem.select(some)
            ).items():
                self._end(solution, int(some[place]), batch.problem.times, t, name)

    def crossings(self, engine: Engine, problem: Problem) -> dict[int, tuple[float, str]]:
        """Return when runs cross a bound, and which, by their index; of those that do."""
        shares, times = self.shares(engine, problem), problem.times
        beyond = shares.max(axis=0) > 1.0
        runs = np.flatnonzero(beyond.any(axis=1))
        after = beyond[runs].argmax(axis=1)
        problem, low, high = problem.select(runs), times[np.maximum(after - 1, 0)], times[after]
        for _ in range(ROUNDS if len(runs) else 0):
            grid = np.linspace(low, high, POINTS, axis=1)
            looked_at = distinct([*grid.ravel(), *times[:2]])
            shares = self.shares(engine, replace(problem, times=looked_at))
            here = np.searchsorted(looked_at, grid)
            inside = np.take_along_axis(shares, here[None], axis=2)
            beyond = inside.max(axis=0) > 1.0
            beyond[:, 0], beyond[:, -1] = False, True  # as before, but for rounding
            at, rows = beyond.argmax(axis=1), np.arange(len(runs))
            low, high = grid[rows, at - 1], grid[rows, at]
            before, behind = inside[:, rows, at - 1], inside[:, rows, at]
        crossings = {}
        for k, run in enumerate(runs):
            which = int(behind[:, k].argmax())
            rise = behind[which, k] - before[which, k]
            way = (1.0 - before[which, k]) / rise if rise > 0.0 else 1.0
            t = low[k] + min(max(way, 0.0), 1.0) * (high[k] - low[k])
            crossings[int(run)] = float(t), list(self.most)[which]
        return crossings

    def _end(self, solution: Solution, run: int, times: Array, t: float, name: str) -> None:
        """Note that a run has ended; what follows is NaN, and so are its numbers."""
        most = f"{self.most[name]:.6g} {self.units[name]}".removesuffix(" 1")
        solution.status[run] = Status.BOUND_CROSSED
        solution.messages[run] = f"t = {t:.9g} s: {name} exceeds {most} (failed_when)"
        for name, values in solution.numbers.items():
            solution.numbers[name] = values = np.array(values, dtype=float)
            values[run] = np.nan
        for name, values in solution.arrays.items():
            solution.arrays[name] = values = np.array(values)
            values[run, times > t] = np.nan


def read(
    written: Mapping[str, Any], loops: Mapping[str, ClosedLoop], problems: Problems
) -> dict[str, float]:
    """Return bounds in m, rad, s, N, …, by the names of signals, from those of a user."""
    by_law = {label: signals_of(loop) for label, loop in loops.items()}
    units, (part, *others) = next(iter(by_law.values())), next(iter(loops.values())).group.parts
    of_it = "" if others else f"_{part.name}"  # of the only part there is no signal of its own
    words = {word: name.removesuffix(of_it) for word, name in SHORT.items()}
    words = {word: name for word, name in words.items() if name in units}
    usual, most = [*words, *units], dict[str, float]()
    if not written:
        problems.add(f"expected at least one bound of {', '.join(usual)}")
    for word, value in written.items():
        here, name = problems.at(word), words.get(word, word)
        lacking = [label for label, of_law in by_law.items() if name not in of_law]
        if len(lacking) == len(loops):
            hint = suggestion(word, usual) or f"; expected some of {', '.join(usual)}"
            here.add(f"no error that all laws have{hint}")
        elif lacking:
            here.add(f"{', '.join(lacking)} has no {name}, and a bound is for every law")
        elif name in most:
            here.add(f"is {name}, which has a bound already; remove one")
        else:
            most[name] = _positive(value, units[name], here)
    return most


def bounds_of(most: Mapping[str, float], loop: ClosedLoop) -> Bounds:
    """Return bounds as `read` gives them, for a loop."""
    units = signals_of(loop)
    in_units = {k: x * (factor(base_of(units[k]), units[k]) or 1.0) for k, x in most.items()}
    return Bounds(in_units, {name: units[name] for name in most})


def signals_of(loop: ClosedLoop) -> dict[str, str]:
    """Return the units of the signals of one number that a loop has, by name."""
    return {
        name: signal.unit_in(part) if part else signal.units(loop.group)
        for name, (signal, part) in existing(loop).items()
        if not signal.dims and signal.exists_for(loop) and not signal.only_there
    }


def _positive(value: Any, unit: str, problems: Problems) -> float:
    """Return a number in the unit in which eqt keeps it; note what is none above 0."""
    base = base_of(unit)
    try:
        number = number_of(Written(value, [base]) if isinstance(value, str) else value)
    except ValueError as error:
        problems.add(str(error))
        return 1.0
    if not isinstance(number, int | float) or isinstance(number, bool) or not 0 < number < np.inf:
        problems.add(f"expected {offered(base)}, greater than 0, got {shown(value)}")
        return 1.0
    if unit == "deg" and number >= np.pi:
        problems.add(
            f"no angle is above 180 deg, and {shown(value)} is {np.degrees(number):.6g} deg; a "
            f"number without a unit is in rad: write '{shown(value)} deg'"
            if not isinstance(value, str)
            else f"expected an angle below 180 deg, got {value}"
        )
    return float(number)
